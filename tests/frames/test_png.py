"""PNG frames that are not whole: what a decoder fills up is no frame."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from photosite.errors import FileError
from photosite.files.png import PngHeader
from photosite.frames.io.read import read_raw
from photosite.frames.raw_frame import RawFrame

ADAM7 = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(rows, cols, data, bits=8, interlaced=0):
    head = struct.pack(">IIBBBBB", cols, rows, bits, 0, 0, 0, interlaced)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize("rows", [7, 9, 8_000_000])
def test_rows_that_are_not_there_are_not_made_up(tmp_path, rows):
    """Six rows of data and a header that says more: Pillow reads the rest as zeros."""
    file = tmp_path / "a.png"
    file.write_bytes(png(rows, 4, zlib.compress(bytes(5 * 6))))
    with pytest.raises(FileError, match="is damaged"):
        read_raw(file)
    file.write_bytes(png(6, 4, zlib.compress(bytes(5 * 6))))
    assert read_raw(file).shape == (6, 4)


def test_data_in_many_chunks(tmp_path):
    dn = np.random.default_rng(0).integers(0, 4096, (900, 700)).astype(np.uint16)
    RawFrame(dn, bits=12).save(tmp_path / "a.png")
    assert np.array_equal(read_raw(tmp_path / "a.png").dn, dn)


def test_interlaced_sizes_beside_counting_pixels():
    """Every pixel belongs to one pass; a filter byte for each row of each pass."""
    for rows, cols in ((1, 1), (5, 3), (8, 8), (9, 17)):
        seen = np.zeros((rows, cols), int)
        filters = 0
        head = PngHeader(rows, cols, 16, color_type=0, interlaced=True)
        for one in head.passes:
            part = seen[one.row :: one.down, one.col :: one.right]
            part += 1
            assert part.shape == (one.rows, one.cols)
            filters += one.rows
        assert (seen == 1).all()
        assert head.stored_bytes == 2 * rows * cols + filters


def test_an_interlaced_picture_is_read(tmp_path):
    """Passes by hand, without filters."""
    dn = np.random.default_rng(1).integers(0, 256, (9, 11)).astype(np.uint8)
    passes = [dn[r::down, c::right] for r, c, down, right in ADAM7]
    data = b"".join(b"\0" + row.tobytes() for part in passes if part.size for row in part)
    (tmp_path / "a.png").write_bytes(png(9, 11, zlib.compress(data), interlaced=1))
    assert np.array_equal(read_raw(tmp_path / "a.png").dn, dn)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), dn)
