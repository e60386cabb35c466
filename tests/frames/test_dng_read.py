"""DNG and camera raw of other origin: made by hand here, byte by byte, and held against LibRaw."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import rawpy

from photosite.errors import FileError, PhotositeWarning
from photosite.frames.io.camera_raw import read_camera_raw
from photosite.frames.io.read import read_headers, read_raw
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import cfa_from

BYTE, ASCII, SHORT, LONG, RATIONAL, SRATIONAL, DOUBLE = 1, 2, 3, 4, 5, 10, 12
CODES = {BYTE: "B", SHORT: "H", LONG: "I", RATIONAL: "I", SRATIONAL: "i", DOUBLE: "d"}

MATRIX_D65 = [0.84, -0.22, -0.08, -0.41, 1.25, 0.17, -0.06, 0.18, 0.66]
MATRIX_A = [0.9, -0.3, -0.1, -0.5, 1.3, 0.2, -0.1, 0.2, 0.5]


class Tiff:
    """A TIFF file put together block by block, the directories after the data they point to."""

    def __init__(self, order: str) -> None:
        self.order = order
        self.data = bytearray((b"II*\0" if order == "<" else b"MM\0*") + bytes(4))

    def put(self, block: bytes) -> int:
        self.data += bytes(len(self.data) % 2)
        self.data += block
        return len(self.data) - len(block)

    def directory(self, tags: dict[int, tuple[int, object]]) -> int:
        entries = []
        for tag, (kind, values) in sorted(tags.items()):
            if kind == ASCII:
                block, count = values.encode() + b"\0", len(values) + 1
            else:
                block = struct.pack(f"{self.order}{len(values)}{CODES[kind]}", *values)
                count = len(values) // (2 if kind in (RATIONAL, SRATIONAL) else 1)
            field = block.ljust(4, b"\0") if len(block) <= 4 else struct.pack(f"{self.order}I", self.put(block))
            entries.append(struct.pack(f"{self.order}HHI", tag, kind, count) + field)
        return self.put(struct.pack(f"{self.order}H", len(entries)) + b"".join(entries) + bytes(4))

    def finish(self, first: int) -> bytes:
        self.data[4:8] = struct.pack(f"{self.order}I", first)
        return bytes(self.data)


def packed_12_bit(dn: np.ndarray) -> bytes:
    first, second = dn[:, ::2].astype(np.uint16), dn[:, 1::2].astype(np.uint16)
    return np.stack([first >> 4, (first & 15) << 4 | second >> 8, second & 255], axis=-1).astype(np.uint8).tobytes()


def ratios(values) -> list[int]:
    return [part for value in values for part in (round(value * 10000), 10000)]


def hand_made_dng(dn: np.ndarray, *, order="<", area=None, top=(), raw=(), exif=True) -> bytes:
    """A preview in the first directory, the 12-bit packed mosaic in a SubIFD, exposure in Exif."""
    file = Tiff(order)
    rows, cols = dn.shape
    pixels = packed_12_bit(dn)
    raw_tags = {
        254: (LONG, [0]),
        256: (LONG, [cols]),
        257: (LONG, [rows]),
        258: (SHORT, [12]),
        259: (SHORT, [1]),
        262: (SHORT, [32803]),
        273: (LONG, [file.put(pixels)]),
        277: (SHORT, [1]),
        278: (LONG, [rows]),
        279: (LONG, [len(pixels)]),
        33421: (SHORT, [2, 2]),
        33422: (BYTE, [2, 1, 1, 0]),
        50713: (SHORT, [2, 2]),
        50714: (RATIONAL, [128, 2, 65, 1, 66, 1, 68, 1]),
        50717: (LONG, [4000]),
        50829: (LONG, area or [0, 0, rows, cols]),
        51041: (DOUBLE, [1e-4, 1e-7, 2e-4, 2e-7, 3e-4, 3e-7]),
    } | dict(raw)
    top_tags = {
        254: (LONG, [1]),
        256: (LONG, [8]),
        257: (LONG, [8]),
        258: (SHORT, [8, 8, 8]),
        259: (SHORT, [1]),
        262: (SHORT, [2]),
        271: (ASCII, "Maker"),
        272: (ASCII, "Model 1"),
        273: (LONG, [file.put(bytes(192))]),
        277: (SHORT, [3]),
        278: (LONG, [8]),
        279: (LONG, [192]),
        330: (LONG, [file.directory({tag: entry for tag, entry in raw_tags.items() if entry})]),
        50706: (BYTE, [1, 4, 0, 0]),
        50708: (ASCII, "Maker Model 1"),
        50721: (SRATIONAL, ratios(MATRIX_A)),
        50722: (SRATIONAL, ratios(MATRIX_D65)),
        50778: (SHORT, [17]),
        50779: (SHORT, [21]),
    } | dict(top)
    if exif:
        top_tags[34665] = (LONG, [file.directory({33434: (RATIONAL, [1, 60]), 34855: (SHORT, [800])})])
    return file.finish(file.directory({tag: entry for tag, entry in top_tags.items() if entry}))


@pytest.fixture
def dn() -> np.ndarray:
    return np.random.default_rng(11).integers(0, 4001, (60, 70)).astype(np.uint16)


def read(path: Path):
    with pytest.warns(PhotositeWarning, match="black levels differ.*64 to 68 DN"):
        return read_raw(path)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("area", [[4, 6, 58, 68], [0, 0, 60, 70]])
def test_a_dng_of_other_origin(tmp_path, dn, order, area):
    path = tmp_path / "a.dng"
    path.write_bytes(hand_made_dng(dn, order=order, area=area))
    frame = read(path)
    top, left, bottom, right = area
    assert np.array_equal(frame.dn, dn[top:bottom, left:right])
    assert (frame.bits, frame.white_level_dn, frame.black_level_dn) == (12, 4000.0, 65.75)
    assert frame.cfa == (("B", "G"), ("G", "R"))
    assert frame.exposure_s == 1 / 60
    assert dict(frame.metadata) == {"camera": "Maker Model 1", "make": "Maker", "model": "Model 1", "iso": 800}
    # Channels in reading order are B, G, R; the file's planes are R, G, B.
    np.testing.assert_allclose(frame.color_matrix, np.reshape(MATRIX_D65, (3, 3))[::-1], rtol=1e-12)
    assert frame.noise_profile.tolist() == [[3e-4, 3e-7], [2e-4, 2e-7], [1e-4, 1e-7]]
    with rawpy.imread(str(path)) as seen:
        assert np.array_equal(seen.raw_image_visible, frame.dn)
        assert "".join(chr(seen.color_desc[n]) for n in seen.raw_pattern.ravel()) == "BGGR"
        assert seen.white_level == 4000
        assert sorted(seen.black_level_per_channel) == [64, 65, 66, 68]


def test_an_active_area_that_starts_at_an_odd_place(tmp_path, dn):
    """LibRaw moves such an area by a pixel; its colours by place on the whole chip are the judge."""
    path = tmp_path / "a.dng"
    path.write_bytes(hand_made_dng(dn, area=[3, 5, 58, 68]))
    frame = read(path)
    assert np.array_equal(frame.dn, dn[3:58, 5:68])
    with rawpy.imread(str(path)) as seen:
        assert np.array_equal(seen.raw_image, dn)
        for r in range(4):
            for c in range(4):
                assert chr(seen.color_desc[seen.raw_color(3 + r, 5 + c)]) == frame.cfa[r % 2][c % 2]


def test_calibration_and_balance_are_part_of_the_matrix(tmp_path, dn):
    path = tmp_path / "a.dng"
    calibration = [1.1, 0, 0, 0, 1, 0.1, 0, 0, 0.9]
    path.write_bytes(
        hand_made_dng(dn, top={50724: (SRATIONAL, ratios(calibration)), 50727: (RATIONAL, [2, 1, 1, 1, 1, 2])})
    )
    expected = np.diag([2, 1, 0.5]) @ np.reshape(calibration, (3, 3)) @ np.reshape(MATRIX_D65, (3, 3))
    np.testing.assert_allclose(read(path).color_matrix, expected[::-1], rtol=1e-12)


def test_a_matrix_for_another_light_is_no_matrix_for_d65(tmp_path, dn):
    path = tmp_path / "a.dng"
    path.write_bytes(hand_made_dng(dn, top={50722: None, 50779: None}))
    assert read(path).color_matrix is None


def test_one_black_level_gives_no_warning(tmp_path, dn):
    path = tmp_path / "a.dng"
    path.write_bytes(hand_made_dng(dn, raw={50713: None, 50714: (RATIONAL, [643, 10])}, exif=False))
    frame = read_raw(path)
    assert (frame.black_level_dn, frame.exposure_s) == (64.3, None)


def test_a_monochrome_dng(tmp_path, dn):
    path = tmp_path / "a.dng"
    flat = {262: (SHORT, [34892]), 33421: None, 33422: None, 50713: None, 50714: (SHORT, [64])}
    path.write_bytes(hand_made_dng(dn, raw=flat | {51041: (DOUBLE, [1e-4, 1e-7])}))
    frame = read_raw(path)
    assert np.array_equal(frame.dn, dn)
    assert frame.cfa == (("M",),)
    assert frame.noise_profile.tolist() == [[1e-4, 1e-7]]


@pytest.mark.parametrize(
    ("raw", "why"),
    [
        ({262: (SHORT, [34892]), 277: (SHORT, [3])}, "a developed DNG of 3 samples"),
        ({262: (SHORT, [2])}, "without a raw image"),
        ({33422: None}, "without its colour filter array"),
        ({33422: (BYTE, [2, 1])}, "without its colour filter array"),
        ({50711: (SHORT, [2])}, "CFALayout 2"),
        ({50829: (LONG, [0, 0, 61, 70])}, r"active area \(0, 0, 61, 70\) in 60 x 70"),
        ({50829: (LONG, [0, 0, 61])}, "active area"),
        ({51041: (DOUBLE, [1e-4] * 5)}, "contradict each other"),
        ({50717: (LONG, [70000])}, "1 to 16 bits, not 17"),
    ],
)
def test_dngs_that_are_no_raw_frame(tmp_path, dn, raw, why):
    path = tmp_path / "a.dng"
    path.write_bytes(hand_made_dng(dn, raw=raw))
    with pytest.raises(FileError, match=why):
        read_raw(path)


def test_truncated(tmp_path, dn):
    """Directories come last here: what is cut off first is what says where the pixels are."""
    whole = hand_made_dng(dn)
    for length in [*range(64), *range(64, len(whole), 41), *range(len(whole) - 40, len(whole))]:
        (tmp_path / "a.dng").write_bytes(whole[:length])
        with pytest.raises(FileError):
            read_raw(tmp_path / "a.dng")


# Camera raw. LibRaw reads the files of some thousand cameras through one interface; here it is given a DNG under the
# name of a Nikon raw file, which asks for LibRaw's view of it.


def test_camera_raw_is_libraws_view(tmp_path, dn):
    path = tmp_path / "a.nef"
    path.write_bytes(hand_made_dng(dn, area=[4, 6, 58, 68]))
    with pytest.warns(PhotositeWarning, match="differ between the channels, 64 to 68 DN"):
        frame = read_raw(path)
    assert np.array_equal(frame.dn, dn[4:58, 6:68])
    assert (frame.bits, frame.white_level_dn, frame.black_level_dn) == (12, 4000.0, 65.75)
    assert frame.cfa == (("B", "G"), ("G", "R"))
    assert frame.exposure_s == 1 / 60
    assert (frame.metadata["model"], frame.metadata["iso"]) == ("Model 1", 800)
    assert frame.color_matrix is None  # LibRaw has no table for this camera


def test_camera_raw_takes_the_matrix_from_libraws_table(tmp_path, dn):
    """Adobe's published matrix of the Nikon D200, rows in the order of the tile's channels."""
    path = tmp_path / "a.nef"
    plain = {50713: None, 50714: (SHORT, [0])}
    nikon = {271: (ASCII, "NIKON CORPORATION"), 272: (ASCII, "NIKON D200")}
    no_matrix = dict.fromkeys((50721, 50722, 50778, 50779))
    path.write_bytes(hand_made_dng(dn, top=nikon | no_matrix, raw=plain))
    frame = read_raw(path)
    published = np.array([[8367, -2248, -763], [-8758, 16447, 2422], [-1527, 1550, 8053]]) / 10000
    np.testing.assert_allclose(frame.color_matrix, published[::-1], rtol=1e-6)
    assert frame.channels == ("B", "G", "R")


def test_camera_raw_owns_its_pixels(tmp_path, dn):
    """LibRaw's memory is gone after reading; the frame's is not."""
    path = tmp_path / "a.nef"
    path.write_bytes(hand_made_dng(dn, raw={50713: None, 50714: (SHORT, [64])}))
    frames = [read_camera_raw(path, bits=12)[0] for _ in range(3)]
    assert all(frame.dn.flags.owndata and np.array_equal(frame.dn, dn) for frame in frames)


def test_camera_raw_of_one_colour(tmp_path, dn):
    path = tmp_path / "a.nef"
    flat = {262: (SHORT, [34892]), 33421: None, 33422: None, 50713: None, 50714: (SHORT, [64]), 51041: None}
    path.write_bytes(hand_made_dng(dn, raw=flat))
    frame = read_raw(path)
    assert np.array_equal(frame.dn, dn)
    assert (frame.cfa, frame.black_level_dn) == ((("M",),), 64.0)


def test_truncated_camera_raw(tmp_path, dn):
    """Cut inside the pixels, with the directories before them."""
    file = tmp_path / "whole.dng"
    RawFrame(dn, bits=12, cfa=cfa_from("rggb")).save(file)
    whole = file.read_bytes()
    for length in (100, 500, len(whole) - dn.nbytes, len(whole) - dn.nbytes // 2, len(whole) - 1):
        (tmp_path / "a.nef").write_bytes(whole[:length])
        with pytest.raises(FileError) as caught:
            read_raw(tmp_path / "a.nef")
        assert "\n" not in str(caught.value)


def test_a_folder_of_camera_raw(tmp_path, dn):
    """Bits and mosaic are known from the first file; the others are opened, not decoded."""
    for number in (1, 2):
        plain = {50713: None, 50714: (SHORT, [64])}
        (tmp_path / f"dark_{number}.nef").write_bytes(hand_made_dng(np.roll(dn, number), raw=plain))
    (header,) = read_headers(tmp_path / "dark_1.nef")
    assert (header.rows, header.cols, header.bits, header.exposure_s) == (60, 70, None, 1 / 60)
    frames = open_frames(tmp_path)
    assert (frames.rows, frames.cols, frames.bits, frames.black_level_dn) == (60, 70, 12, 64.0)
    assert frames.cfa == (("B", "G"), ("G", "R"))
    assert [np.array_equal(got, np.roll(dn, n)) for n, got in enumerate(frames.groups[0], start=1)] == [True, True]


@pytest.mark.parametrize("ending", ["nef", "dng"])
def test_a_set_warns_once_of_its_black_levels(tmp_path, dn, ending):
    for number in range(3):
        (tmp_path / f"dark_{number}.{ending}").write_bytes(hand_made_dng(np.roll(dn, number)))
    with pytest.warns(PhotositeWarning, match="black levels differ.*and 2 frames more") as caught:
        frames = open_frames(tmp_path)
    assert len(caught) == 1
    assert frames.black_level_dn == 65.75
    assert sum(1 for _ in frames.groups[0]) == 3  # and reading them is silent


def test_one_bad_tag_of_a_camera_does_not_cost_the_exposure(tmp_path, dn):
    """Camera makers' files point outside themselves here and there; a DNG that does is refused as truncated."""
    whole = hand_made_dng(dn, raw={50713: None, 50714: (SHORT, [64])})
    entry = struct.pack("<HHI", 50708, ASCII, len("Maker Model 1") + 1)
    at = whole.index(entry) + len(entry)
    bad = whole[:at] + struct.pack("<I", len(whole)) + whole[at + 4 :]
    for ending in ("nef", "dng"):
        (tmp_path / f"a.{ending}").write_bytes(bad)
    assert read_raw(tmp_path / "a.nef").exposure_s == 1 / 60
    assert read_headers(tmp_path / "a.nef")[0].metadata["iso"] == 800
    with pytest.raises(FileError, match="truncated: tag 50708"):
        read_raw(tmp_path / "a.dng")
