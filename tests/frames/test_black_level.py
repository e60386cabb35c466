"""Masked borders: excluded from the frame, their level compared with the stated black level."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from dng_builder import LONG, SHORT, hand_made_dng
from raising import raises

from photosite.errors import FileError, PhotositeWarning
from photosite.frames.io.camera_raw import _border
from photosite.frames.io.formats import read_headers, read_raw
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import masked_border_level

MASKED_AREAS, BLACK_LEVEL, REPEAT = 50830, 50714, 50713


def masked_dng(path, *, black, border=70, masked=(0, 0, 60, 6, 0, 6, 4, 70)):
    dn = np.random.default_rng(4).integers(60, 4000, (60, 70)).astype(np.uint16)
    dn[:, :6] = border
    dn[:4, 6:] = border
    raw = {REPEAT: None, BLACK_LEVEL: None if black is None else (SHORT, [black]), MASKED_AREAS: (LONG, list(masked))}
    path.write_bytes(hand_made_dng(dn, area=[4, 6, 60, 70], raw=raw))
    return dn[4:, 6:]


def test_the_border_is_excluded_and_its_level_kept(tmp_path):
    dn = masked_dng(tmp_path / "dark.dng", black=70)
    frame = read_raw(tmp_path / "dark.dng")
    assert np.array_equal(frame.dn, dn)
    assert frame.metadata["masked_border_dn"] == 70.0


def test_the_border_is_the_black_level_where_none_is_stated(tmp_path):
    """DNG 1.4: MaskedAreas serve to measure the black encoding level."""
    masked_dng(tmp_path / "dark.dng", black=None, border=73)
    assert read_headers(tmp_path / "dark.dng")[0].black_level_dn is None
    assert read_raw(tmp_path / "dark.dng").black_level_dn == 73.0
    assert open_frames(tmp_path).black_level_dn == 73.0


def test_a_border_that_contradicts_the_black_level_gives_a_warning(tmp_path):
    masked_dng(tmp_path / "dark.dng", black=64, border=75)
    line = "the masked border has a mean of 75.00 DN, but the stated black level is 64 DN"
    with pytest.warns(PhotositeWarning, match=line):
        assert read_raw(tmp_path / "dark.dng").black_level_dn == 64.0
    with pytest.warns(PhotositeWarning, match=line):
        frames = open_frames(tmp_path)
    assert line in frames.warnings[0]
    assert frames.black_level_dn == 64.0


@pytest.mark.parametrize("masked", [(0, 0, 60), (0, 0, 61, 6), (4, 6, 4, 8)])
def test_invalid_masked_areas(tmp_path, masked):
    masked_dng(tmp_path / "dark.dng", black=70, masked=masked)
    with raises(FileError, "the file is damaged: masked areas"):
        read_raw(tmp_path / "dark.dng")


def drifting(path, drift, signal, border=None, saturated=False):
    """Write a frame of 60 x 70 pixels, 6 of its columns masked, a black level of 100 + drift, and its own noise."""
    dn = 100 + drift + np.random.default_rng(zlib.crc32(path.name.encode())).integers(-2, 3, (60, 70))
    dn[:, 6:] += signal
    dn[:, :6] += border or 0
    if saturated:
        dn[7, 9] = 4095
    raw = {REPEAT: None, BLACK_LEVEL: (SHORT, [100]), MASKED_AREAS: (LONG, [0, 0, 60, 6])}
    path.write_bytes(hand_made_dng(dn.astype(np.uint16), area=[0, 6, 60, 70], raw=raw, exif=False))


def levels(frames):
    return {(group.kind, group.exposure_s): [round(float(np.median(dn))) for dn in group] for group in frames.groups}


@pytest.mark.filterwarnings("ignore:.*black levels differ between channels")
@pytest.mark.parametrize("suffix", ["dng", "nef"])
def test_frames_follow_their_masked_border(tmp_path, suffix):
    """Frames of 0.02 s have their own reference: the dark current of the masked pixels must not be subtracted."""
    for name, drift, signal, saturated in (
        ("dark_0.01s_1", 0, 0, False),
        ("dark_0.01s_2", 7, 0, False),
        ("light_0.01s_1", -4, 1000, True),
        ("dark_0.02s_1", 20, 0, False),
        ("dark_0.02s_2", 23, 0, False),
        ("light_0.04s_1", 1, 2000, False),
        ("light_0.04s_2", -3, 2000, False),
    ):
        drifting(tmp_path / f"{name}.dng", drift, signal, saturated=saturated)
    for path in sorted(tmp_path.iterdir()):
        path.rename(path.with_suffix(f".{suffix}"))
    frames = open_frames(tmp_path)
    assert levels(frames) == {
        ("dark", 0.01): [100, 100],
        ("dark", 0.02): [120, 120],
        ("light", 0.01): [1100],
        ("light", 0.04): [2101, 2101],
    }
    light = next(group for group in frames.groups if group.kind == "light")
    assert max(int(dn.max()) for dn in light) == 4095  # a saturated pixel stays one
    assert [entry.id for entry in frames.diagnostics if entry.severity == "note"] == ["masked-border-levels"]


@pytest.mark.filterwarnings("ignore:.*black level")
def test_padding_of_camera_raw_that_receives_light_is_not_followed(tmp_path):
    for name, drift, signal, border in (
        ("dark_0.01s_1", 0, 0, 0),
        ("dark_0.01s_2", 7, 0, 0),
        ("light_0.01s", 0, 2000, 50),
    ):
        drifting(tmp_path / f"{name}.dng", drift, signal, border)
    for path in sorted(tmp_path.iterdir()):
        path.rename(path.with_suffix(".nef"))
    frames = open_frames(tmp_path)
    assert levels(frames) == {("dark", 0.01): [100, 107], ("light", 0.01): [2100]}
    assert not [entry for entry in frames.diagnostics if entry.id == "masked-border-levels"]


class Decoder:
    """The part of LibRaw's interface that the border needs: 3 lines above and 4 columns left of 10 x 12 pixels."""

    raw_image = np.pad(np.full((10, 12), 900, np.uint16), ((3, 2), (4, 1)), constant_values=66)

    class sizes:  # noqa: N801
        top_margin, left_margin, height, width = 3, 4, 10, 12


def test_the_border_of_camera_raw_is_beside_the_visible_area():
    strips = _border(Decoder)
    assert [strip.shape for strip in strips] == [(3, 12), (4, 10)]
    assert masked_border_level(strips) == 66.0
    assert masked_border_level([]) is None
