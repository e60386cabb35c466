"""Masked borders: excluded from the frame, their level compared with the stated black level."""

from __future__ import annotations

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
