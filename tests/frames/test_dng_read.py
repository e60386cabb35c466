"""DNG and camera raw of other programs, built byte by byte and compared with LibRaw."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import rawpy
from dng_builder import ASCII, BYTE, DOUBLE, LONG, MATRIX_D65, RATIONAL, SHORT, SRATIONAL, hand_made_dng, ratios
from raising import raises

from photosite.errors import FileError, PhotositeWarning
from photosite.frames.io.camera_raw import read_frame
from photosite.frames.io.formats import read_headers, read_raw
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import cfa_from


@pytest.fixture
def dn() -> np.ndarray:
    return np.random.default_rng(11).integers(0, 4001, (60, 70)).astype(np.uint16)


def read(path: Path):
    with pytest.warns(PhotositeWarning, match="black levels differ.*64 to 68 DN"):
        return read_raw(path)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("area", [[4, 6, 58, 68], [0, 0, 60, 70]])
def test_a_dng_of_another_program(tmp_path, dn, order, area):
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
    """LibRaw moves such an area by a pixel, so the colors are compared by their place on the whole chip."""
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
    ("raw", "what"),
    [
        ({262: (SHORT, [34892]), 277: (SHORT, [3])}, "the DNG is developed, with 3 samples"),
        ({262: (SHORT, [2])}, "the DNG has no raw image"),
        ({33422: None}, "the file is damaged: a mosaic without"),
        ({33422: (BYTE, [2, 1])}, "the file is damaged: a mosaic without"),
        ({50711: (SHORT, [2])}, "CFALayout"),
        ({50829: (LONG, [0, 0, 61, 70])}, "the file is damaged: active area"),
        ({50829: (LONG, [0, 0, 61])}, "the file is damaged: active area"),
        ({50829: (DOUBLE, [0.0, 0.0, 1e-4, 1e-4])}, "the file is damaged: active area"),
        ({50830: (DOUBLE, [0.0, 0.0, np.nan, 1.0])}, "the file is damaged: masked areas"),
        ({51041: (DOUBLE, [1e-4] * 5)}, "the file is damaged: its tags contradict"),
        ({50717: (LONG, [70000])}, "bits"),
    ],
)
def test_invalid_dngs(tmp_path, dn, raw, what):
    path = tmp_path / "a.dng"
    path.write_bytes(hand_made_dng(dn, raw=raw))
    with raises(FileError, what):
        read_raw(path)


def test_truncated(tmp_path, dn):
    """Directories come last here, so truncation removes them first."""
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
    with pytest.warns(PhotositeWarning, match="differ between channels, 64 to 68 DN"):
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
    """The frame must not refer to LibRaw's memory, which is freed."""
    path = tmp_path / "a.nef"
    path.write_bytes(hand_made_dng(dn, raw={50713: None, 50714: (SHORT, [64])}))
    frames = [read_frame(path, bits=12)[0] for _ in range(3)]
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
    """Bits and mosaic come from the first file; the others are opened, not decoded."""
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
def test_a_set_warns_once_about_black_levels(tmp_path, dn, ending):
    for number in range(3):
        (tmp_path / f"dark_{number}.{ending}").write_bytes(hand_made_dng(np.roll(dn, number)))
    with pytest.warns(PhotositeWarning, match="black levels differ.*and 2 more frames") as caught:
        frames = open_frames(tmp_path)
    assert len(caught) == 1
    assert frames.black_level_dn == 65.75
    assert sum(1 for _ in frames.groups[0]) == 3  # reading them gives no warning


def test_a_bad_tag_of_a_camera_raw_file_is_skipped(tmp_path, dn):
    """Camera makers' files have offsets beyond their end; in a DNG that means truncation."""
    whole = hand_made_dng(dn, raw={50713: None, 50714: (SHORT, [64])})
    entry = struct.pack("<HHI", 50708, ASCII, len("Maker Model 1") + 1)
    at = whole.index(entry) + len(entry)
    bad = whole[:at] + struct.pack("<I", len(whole)) + whole[at + 4 :]
    for ending in ("nef", "dng"):
        (tmp_path / f"a.{ending}").write_bytes(bad)
    assert read_raw(tmp_path / "a.nef").exposure_s == 1 / 60
    assert read_headers(tmp_path / "a.nef")[0].metadata["iso"] == 800
    with raises(FileError, "is truncated: tag 50708"):
        read_raw(tmp_path / "a.dng")
