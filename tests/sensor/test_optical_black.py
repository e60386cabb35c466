"""Covered rows and columns: without light in frames, masked areas in DNG, which are read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rawpy
from tests.helpers.raising import raises

import photosite as ps
from photosite.errors import InputError, PhotositeWarning
from photosite.frames.io.dng import read_dng_header

SENSOR = ps.load_sensor("nikon-d200").with_(
    rows=60, cols=80, black_level_dn=64, optical_black={"top": 4, "bottom": 2, "left": 8, "right": 1}
)
CAMERA = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), SENSOR)
LIGHT = np.full((60, 80), 5000, np.float32)


def test_covered_pixels_have_no_light():
    dn = CAMERA.expose(LIGHT, 0.01).dn.astype(float)
    lit = np.zeros((60, 80), bool)
    lit[4:58, 8:79] = True
    assert dn[~lit].max() < 100
    assert dn[lit].min() > 300
    plain = ps.Camera(CAMERA.optics, SENSOR.with_(optical_black=None)).expose(LIGHT, 0.01).dn
    assert (plain[lit] == dn[lit]).mean() > 0.999
    part = CAMERA.expose(LIGHT, 0.01, region=(2, 20, 5, 80))
    assert (part.dn == dn[2:20, 5:80]).all()
    assert "optical_black" not in part.metadata


def test_dng_has_masked_areas(tmp_path: Path):
    raw = CAMERA.expose(LIGHT, 0.01)
    assert raw.metadata["optical_black"] == "4,2,8,1"
    raw.save(tmp_path / "a.dng")
    header = read_dng_header(tmp_path / "a.dng")
    assert (header.rows, header.cols, header.masked_border) == (54, 71, True)
    again = ps.read_raw(tmp_path / "a.dng")
    assert (again.dn == raw.dn[4:58, 8:79]).all()
    covered = raw.dn.astype(float)
    covered[4:58, 8:79] = np.nan
    assert again.metadata["masked_border_dn"] == pytest.approx(np.nanmean(covered))
    assert "optical_black" not in again.metadata
    with rawpy.imread(str(tmp_path / "a.dng")) as decoded:
        assert (decoded.raw_image_visible == raw.dn[4:58, 8:79]).all()


def test_a_wrong_black_level_is_seen(tmp_path: Path):
    """The masked border of the dark frames is 20 DN above the black level that the file states."""
    raw = CAMERA.expose(np.zeros_like(LIGHT), 0.01)
    shifted = ps.RawFrame(raw.dn + np.uint16(20), 12, raw.cfa, black_level_dn=64.0, metadata=dict(raw.metadata))
    shifted.save(tmp_path / "dark.dng")
    with pytest.warns(PhotositeWarning, match="masked border"):
        ps.read_raw(tmp_path / "dark.dng")


@pytest.mark.parametrize(
    ("black", "what"),
    [({"top": 3}, "top"), ({"left": 1}, "left"), ({"top": 30, "bottom": 30}, "top"), ({"right": -1}, "right")],
)
def test_invalid_lines(black: dict[str, Any], what: str):
    with raises(InputError, what, where="effects.optical_black"):
        SENSOR.with_(optical_black=black)


def test_overscan_has_no_pixels():
    """Read noise and black level alone, on the side opposite to the output."""
    lines = {"left": 4, "overscan_rows": 6, "overscan_cols": 10}
    warm = SENSOR.with_(optical_black=lines, dark_current_e_per_s=2000, read_noise_e=3, dsnu_e=60)
    dn = ps.Camera(CAMERA.optics, warm).expose(np.zeros_like(LIGHT), 1.0).dn.astype(float)
    assert dn[:54, :4].mean() > 64 + 100
    assert abs(dn[54:].mean() - 64) < 0.1
    assert dn[:, 70:].std() < 1.0
    turned = warm.with_(charge_transfer={"output": "bottom_right"})
    assert turned.effects.border == (6, 0, 14, 0)
    dn = ps.Camera(CAMERA.optics, turned).expose(np.zeros_like(LIGHT), 1.0).dn.astype(float)
    assert abs(dn[:6].mean() - 64) < 0.1
    assert dn[6:, 14:].mean() > 64 + 100


@pytest.mark.parametrize("suffix", ["tif", "h5", "dng", "fits"])
def test_sets_have_the_active_area(tmp_path: Path, suffix: str):
    raw = CAMERA.expose(LIGHT, 0.01)
    path = tmp_path / f"flat_10ms_1.{suffix}"
    if suffix == "fits":
        fits = pytest.importorskip("astropy.io.fits")
        unit = fits.PrimaryHDU(raw.dn)
        unit.header["DATASEC"] = "[9:79,5:58]"
        unit.writeto(path)
    else:
        raw.save(path)
    cfa = "rggb" if suffix == "fits" else None
    frames = ps.open_frames(tmp_path, light="*", cfa=cfa)
    source = frames.groups[0].frames[0]
    assert (frames.rows, frames.cols, frames.border) == (54, 71, (4, 2, 8, 1))
    assert source.whole is not None
    np.testing.assert_array_equal(source.read(), raw.dn[4:58, 8:79])
    np.testing.assert_array_equal(source.whole(), raw.dn)
