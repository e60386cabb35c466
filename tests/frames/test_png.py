"""PNG frames that are incomplete, interlaced, or of the wrong kind."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from photosite.errors import FileError
from photosite.frames.io.formats import read_headers, read_raw
from photosite.frames.raw_frame import RawFrame

ADAM7 = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(rows, cols, data, bits=8, interlaced=0):
    head = struct.pack(">IIBBBBB", cols, rows, bits, 0, 0, 0, interlaced)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize("rows", [7, 9, 8_000_000])
def test_missing_rows_are_an_error(tmp_path, rows):
    """Six rows of data under a header that states more: Pillow alone pads them with zeros."""
    file = tmp_path / "a.png"
    file.write_bytes(png(rows, 4, zlib.compress(bytes(5 * 6))))
    with pytest.raises(FileError) as caught:
        read_raw(file)
    assert "is damaged" in caught.value.what
    file.write_bytes(png(6, 4, zlib.compress(bytes(5 * 6))))
    assert read_raw(file).shape == (6, 4)


@pytest.mark.parametrize("keep", [8, 20, 60, -300, -12, -1])
def test_truncated_frames_are_an_error_of_the_listing(tmp_path, keep):
    RawFrame(np.arange(4000, dtype=np.uint16).reshape(50, 80), bits=12).save(tmp_path / "a.png")
    (tmp_path / "a.png").write_bytes((tmp_path / "a.png").read_bytes()[:keep])
    with pytest.raises(FileError) as caught:
        read_headers(tmp_path / "a.png")
    assert "is damaged" in caught.value.what or "is truncated" in caught.value.what


@pytest.mark.parametrize(
    ("mode", "value"), [("RGB", "RGB"), ("P", "a palette"), ("LA", "gray with alpha"), ("1", "1 bits")]
)
def test_pictures_that_are_not_raw_frames(tmp_path, mode, value):
    Image.new(mode, (6, 4)).save(tmp_path / "a.png")
    with pytest.raises(FileError) as caught:
        read_raw(tmp_path / "a.png")
    assert (caught.value.what, caught.value.value) == ("pixels", value)


@pytest.mark.parametrize("bits", [2, 4])
def test_packed_gray_is_not_a_raw_frame(tmp_path, bits):
    (tmp_path / "a.png").write_bytes(png(2, 8, zlib.compress(bytes(2 * (1 + bits))), bits=bits))
    with pytest.raises(FileError) as caught:
        read_raw(tmp_path / "a.png")
    assert (caught.value.what, caught.value.value) == ("pixels", f"{bits} bits")


def test_data_in_many_chunks(tmp_path):
    dn = np.random.default_rng(0).integers(0, 4096, (900, 700)).astype(np.uint16)
    RawFrame(dn, bits=12).save(tmp_path / "a.png")
    assert np.array_equal(read_raw(tmp_path / "a.png").dn, dn)


def test_an_interlaced_picture_is_read(tmp_path, capfd):
    """Passes written by hand, without filters."""
    dn = np.random.default_rng(1).integers(0, 256, (9, 11)).astype(np.uint8)
    passes = [dn[r::down, c::right] for r, c, down, right in ADAM7]
    data = b"".join(b"\0" + row.tobytes() for part in passes if part.size for row in part)
    (tmp_path / "a.png").write_bytes(png(9, 11, zlib.compress(data), interlaced=1))
    assert np.array_equal(read_raw(tmp_path / "a.png").dn, dn)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), dn)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("bits", "dtype"), [(8, np.uint8), (16, np.dtype(">u2"))])
def test_rows_without_filter_are_read_without_libpng(tmp_path, monkeypatch, bits, dtype):
    dn = np.random.default_rng(2).integers(0, 1 << bits, (9, 11)).astype(dtype)
    data = zlib.compress(b"".join(b"\0" + row.tobytes() for row in dn))
    (tmp_path / "a.png").write_bytes(png(9, 11, data, bits=bits))
    with monkeypatch.context() as without:
        without.setattr("imagecodecs.png_decode", None)
        assert np.array_equal(read_raw(tmp_path / "a.png").dn, dn)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), dn)


@pytest.mark.parametrize("place", [0, -5, -1])
def test_damaged_rows_without_filter_are_an_error(tmp_path, place):
    """A changed byte of the filters, of the pixels or of their checksum."""
    rows = bytearray(b"\0" + bytes(range(40))) * 30
    data = bytearray(zlib.compress(bytes(rows), 0))
    data[7 if place == 0 else place] ^= 2
    (tmp_path / "a.png").write_bytes(png(30, 40, bytes(data)))
    with pytest.raises(FileError) as caught:
        read_raw(tmp_path / "a.png")
    assert "is damaged" in caught.value.what
