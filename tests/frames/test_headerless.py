"""Headerless raw files, raw data behind a JPEG of a Raspberry Pi, and truncated camera files."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from dng_builder import LONG, SHORT, hand_made_dng
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.frames.io.camera_raw import check_filled, check_size
from photosite.frames.io.formats import read_headers
from photosite.frames.io.headerless import EXAMPLE, guessed_layouts
from photosite.frames.io.protocol import read_protocol, write_protocol
from photosite.frames.layout import parse_layout
from photosite.values.cfa import cfa_from

COLS, ROWS = 20, 6


def numbers(bits, seed=1):
    return np.random.default_rng(seed).integers(0, 1 << bits, (ROWS, COLS)).astype(np.uint16)


def stored(dn, packing):
    """Return the rows as bytes, bit by bit: independent of the reader."""
    rows = []
    for row in dn.tolist():
        out = []
        if packing == "mipi10":
            for k in range(0, len(row), 4):
                group = row[k : k + 4]
                out += [value >> 2 for value in group]
                out.append(sum((value & 3) << 2 * n for n, value in enumerate(group)))
        elif packing == "mipi12":
            for a, b in zip(row[::2], row[1::2], strict=True):
                out += [a >> 4, b >> 4, (b & 15) << 4 | a & 15]
        elif packing == "d100":
            for k in range(0, len(row), 10):
                text = "".join(f"{value:012b}" for value in row[k : k + 10]).ljust(120 if k + 10 < COLS else 0, "0")
                out += [int(text[j : j + 8].ljust(8, "0"), 2) for j in range(0, len(text), 8)]
                out += [0] if len(row[k : k + 10]) == 10 else []
        elif packing == "nikon12":
            text = "".join(f"{value:012b}" for value in row)
            out += [int(text[k : k + 8], 2) for k in range(0, len(text), 8)]
        else:
            out += list(struct.pack(packing.format(len(row)), *row))
        rows.append(bytes(out))
    return rows


CASES = [
    ("20x6,uint16", "<{}H", 16, None),
    ("20x6", "<{}H", 16, None),
    ("20x6,uint16,big", ">{}H", 16, None),
    ("20 x 6, uint8", "{}B", 8, None),
    ("20x6,packed=mipi10", "mipi10", 10, 10),
    ("20x6,packed=mipi12", "mipi12", 12, 12),
    ("20x6,packed=nikon12", "nikon12", 12, 12),
    ("20x6,packed=d100", "d100", 12, 12),
]


@pytest.mark.parametrize(("layout", "packing", "deep", "bits"), CASES)
@pytest.mark.parametrize(("offset", "padding"), [(0, 0), (128, 12)])
def test_layouts(tmp_path, layout, packing, deep, bits, offset, padding):
    dn = numbers(deep)
    rows = stored(dn, packing)
    if padding:
        layout = f"{layout},offset={offset},stride={len(rows[0]) + padding}"
    (tmp_path / "a.raw").write_bytes(bytes(offset) + b"".join(row + b"\xaa" * padding for row in rows))
    frame = ps.read_raw(tmp_path / "a.raw", layout=layout)
    np.testing.assert_array_equal(frame.dn, dn)
    assert frame.bits == (bits or deep)


def test_frames_one_after_the_other_and_the_last_row_without_padding(tmp_path):
    first, second = numbers(12), numbers(12, 2)
    rows = [row + bytes(8) for dn in (first, second) for row in stored(dn, "<{}H")]
    (tmp_path / "dark_1s.bin").write_bytes(b"".join(rows)[:-8])
    frames = ps.open_frames(tmp_path / "dark_1s.bin", layout="20x6,stride=48", bits=12)
    np.testing.assert_array_equal([*frames.groups[0]], [first, second])
    with raises(FileError, "the file holds 2 frames"):
        ps.read_raw(tmp_path / "dark_1s.bin", layout="20x6,stride=48")
    part = ps.read_raw(f"{tmp_path}/dark_1s.bin[1]", layout="20x6,stride=48", region="1:5,2:18")
    np.testing.assert_array_equal(part.dn, second[1:5, 2:18])


def test_a_folder_of_headerless_files(tmp_path):
    for number in range(2):
        (tmp_path / f"dark_10ms_{number}.raw").write_bytes(b"".join(stored(numbers(10, number), "mipi10")))
    (tmp_path / "notes.txt").write_text("x")
    frames = ps.open_frames(tmp_path, layout="20x6,packed=mipi10", cfa="rggb")
    assert (frames.bits, frames.cfa, frames.groups[0].exposure_s) == (10, cfa_from("rggb"), 0.01)
    assert frames.groups[0].frames[0].open_rows() is None
    np.testing.assert_array_equal([*frames.groups[0]], [numbers(10, 0), numbers(10, 1)])


def test_rows_of_a_d100_that_end_within_a_group(tmp_path):
    dn = numbers(12)[:, :13]
    (tmp_path / "a.raw").write_bytes(b"".join(stored(dn, "d100")))
    assert parse_layout("13x6,packed=d100").row_bytes == 16 + 5
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "a.raw", layout="13x6,packed=d100").dn, dn)


def test_a_protocol_states_the_layout(tmp_path):
    for number in range(2):
        (tmp_path / f"{number}.raw").write_bytes(b"".join(stored(numbers(10, number), "mipi10")))
    entry = "frames: [{kind: dark, exposure: 0.01, files: '*.raw'}]\n"
    listing = tmp_path / "protocol.yaml"
    listing.write_text(f"photosite_protocol: 1\nlayout: 20x6,packed=mipi10\n{entry}")
    np.testing.assert_array_equal([*ps.open_frames(tmp_path).groups[0]], [numbers(10, 0), numbers(10, 1)])
    write_protocol(read_protocol(listing), tmp_path / "again.yaml")
    assert read_protocol(tmp_path / "again.yaml").layout == parse_layout("20x6,packed=mipi10")
    with raises(FileError, "layout", value="20x6,packed=mipi12", expected="20x6,packed=mipi10, as the protocol states"):
        ps.open_frames(tmp_path, layout="20x6,packed=mipi12")
    listing.write_text(f"photosite_protocol: 1\nlayout: 20x\n{entry}")
    with raises(FileError, "layout", line=2, value="20x"):
        ps.open_frames(tmp_path)


@pytest.mark.parametrize(
    "layout",
    ["", "20", "20x6,int12", "20x6,uint8,uint16", "20x6,packed=zip", "0x6", "20x6,stride=10", "20x6,offset=-1", "x6"],
)
def test_invalid_layouts(tmp_path, layout):
    (tmp_path / "a.raw").write_bytes(bytes(240))
    with raises(InputError, "layout", value=layout):
        ps.read_raw(tmp_path / "a.raw", layout=layout)


def test_a_size_that_does_not_fit_and_the_guess(tmp_path):
    (tmp_path / "dark_1s.raw").write_bytes(bytes(640 * 480 * 2))
    with raises(
        FileError, "has 614400 bytes", hint="The size is that of 640x480,uint16 or 800x600,packed=mipi10,stride=1024"
    ):
        ps.read_raw(tmp_path / "dark_1s.raw", layout="640x481,uint16")
    with raises(FileError, "the file is not a frame, or a headerless one", arguments={"layout": "640x480,uint16"}):
        ps.read_raw(tmp_path / "dark_1s.raw")
    with raises(FileError, "the folder has no frames", arguments={"layout": "640x480,uint16"}):
        ps.open_frames(tmp_path)
    (tmp_path / "dark_1s.raw").write_bytes(bytes(641 * 479 * 2))  # a size of no usual camera
    with raises(FileError, "the file is not a frame, or a headerless one", arguments={"layout": EXAMPLE}):
        ps.read_raw(tmp_path / "dark_1s.raw")
    with raises(FileError, "the folder has no frames", arguments={"layout": EXAMPLE}):
        ps.open_frames(tmp_path)


@pytest.mark.parametrize(
    ("size", "layout"),
    [
        (4128 * 2464, "3280x2464,packed=mipi10,stride=4128"),
        (6112 * 3040, "4056x3040,packed=mipi12,stride=6112"),
        (4056 * 3040 * 2, "4056x3040,uint16"),
    ],
)
def test_guesses_for_streams_of_a_raspberry_pi(size, layout):
    assert str(guessed_layouts(size)[0]) == layout
    assert parse_layout(layout).frames(size) == 1
    assert guessed_layouts(size + 7) == []


def jpeg_with_raw(path, dn, order, kind, block=6404096):
    """A picture, and raw data of this many bytes whose header states the mode."""
    rows = stored(dn, {3: "mipi10", 4: "mipi12"}[kind])
    stride = -(-len(rows[0]) // 32) * 32
    header = bytearray(32768)
    header[:4] = b"BRCM"
    struct.pack_into("<32s4H24x2H2B", header, 176, b"mode", COLS, ROWS, 0, 0, 0, 0, order, kind)
    raw = bytes(header) + b"".join(row.ljust(stride, b"\0") for row in rows)
    path.write_bytes(b"\xff\xd8\xff\xe0picture\xff\xd9" + raw.ljust(block, b"\0"))


@pytest.mark.parametrize(("order", "cfa"), [(0, "rggb"), (1, "gbrg"), (2, "bggr"), (3, "grbg")])
@pytest.mark.parametrize(("kind", "bits"), [(3, 10), (4, 12)])
def test_raw_data_behind_a_jpeg(tmp_path, order, cfa, kind, bits):
    dn = numbers(bits)
    jpeg_with_raw(tmp_path / "dark_1s.jpg", dn, order, kind)
    frame = ps.read_raw(tmp_path / "dark_1s.jpg")
    np.testing.assert_array_equal(frame.dn, dn)
    assert (frame.bits, frame.cfa, frame.metadata["read_mode"]) == (bits, cfa_from(cfa), "mode")
    (tmp_path / "picture.jpg").write_bytes(b"\xff\xd8\xff\xe0picture\xff\xd9")
    frames = ps.open_frames(tmp_path)
    assert frames.frame_count == 1
    np.testing.assert_array_equal(next(iter(frames.groups[0])), dn)


def test_a_jpeg_without_raw_data(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff\xe0picture\xff\xd9")
    with raises(FileError, "the file is a JPEG, a developed picture"):
        ps.read_raw(tmp_path / "a.jpg")
    jpeg_with_raw(tmp_path / "b.jpg", numbers(10), 0, 3)
    content = bytearray((tmp_path / "b.jpg").read_bytes())
    content[len(content) - 6404096 + 176 + 69] = 7
    (tmp_path / "b.jpg").write_bytes(content)
    with raises(FileError, "the header of the raw data states 20 x 6 pixels of format 7"):
        ps.read_raw(tmp_path / "b.jpg")


@pytest.mark.filterwarnings("ignore:.*black levels differ")
@pytest.mark.parametrize("suffix", ["nef", "arw"])
@pytest.mark.parametrize("kept", [0.0, 0.5, 0.999])
def test_truncated_camera_files_are_refused(tmp_path, suffix, kept):
    """The pixels are the last bytes of the file, and some are missing."""
    dn = np.random.default_rng(3).integers(100, 4000, (400, 300)).astype(np.uint16)
    path = tmp_path / f"dark_1s.{suffix}"
    path.write_bytes(hand_made_dng(dn))
    np.testing.assert_array_equal(ps.read_raw(path).dn, dn)
    size = dn.size * 3 // 2
    length = len(hand_made_dng(dn))
    content = hand_made_dng(dn, raw={273: (LONG, [length]), 279: (LONG, [size])})
    path.write_bytes(content + content[8 : 8 + int(size * kept)])
    what = f"is truncated: its image data end at byte {length + size}, the file at {length + int(size * kept)}"
    for read in (ps.read_raw, read_headers):
        with raises(FileError, what):
            read(path)


@pytest.mark.filterwarnings("ignore:.*black levels differ")
def test_cut_lossless_jpeg_of_a_dng_is_refused(tmp_path):
    """The strip is as short as its tag says: 22 bytes, of which LibRaw makes a frame of zeros."""
    dn = np.random.default_rng(3).integers(100, 4000, (400, 300)).astype(np.uint16)
    packed = pytest.importorskip("imagecodecs").ljpeg_encode(dn, bitspersample=12)
    path = tmp_path / "dark_1s.dng"

    path.write_bytes(hand_made_dng(dn, raw={259: (SHORT, [7])}, pixels=packed))
    np.testing.assert_array_equal(ps.read_raw(path).dn, dn)
    path.write_bytes(hand_made_dng(dn, raw={259: (SHORT, [7])}, pixels=packed[:22]))
    with raises(FileError, f"is truncated: {path.stat().st_size} bytes cannot hold 400 x 300 pixels"):
        ps.read_raw(path)


class Sizes:
    """The part of LibRaw's interface that states the size: 10 megapixels."""

    raw_height, raw_width = 2600, 3900


def test_files_without_directories_that_libraw_fills_with_zeros(tmp_path):
    path = tmp_path / "a.raf"
    path.write_bytes(bytes(12_000))
    with raises(FileError, "is truncated: 12000 bytes cannot hold 2600 x 3900 pixels"):
        check_size(path, Sizes)
    path.write_bytes(bytes(700_000))
    check_size(path, Sizes)
    raw = np.full((40, 6), 3, np.uint16)
    raw[33:] = 0
    check_filled(path, raw)  # seven dark rows
    check_filled(path, np.zeros((40, 6), np.uint16))  # a dark frame without a black level
    raw[31:] = 0
    with raises(FileError, "is truncated: the last 9 of 40 rows have no data and are zeros"):
        check_filled(path, raw)
