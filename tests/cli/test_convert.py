"""`photosite convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tifffile

import photosite as ps

GRID = [400.0, 500.0, 600.0]


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A stack that says nothing of itself; one value is missing, another negative."""
    values = np.random.default_rng(1).uniform(0.1, 1, (3, 20, 30)).astype(np.float32)
    values[1, 4, 5], values[2, 6, 7] = np.nan, -0.01
    tifffile.imwrite(tmp_path / "bare.tif", values, photometric="minisblack", metadata=None)
    return tmp_path / "bare.tif"


def test_the_components_and_the_error_are_said(photosite: Any, tmp_path: Path) -> None:
    ps.charts.macbeth("A", 40).save(tmp_path / "chart.hdr")
    done = photosite("convert", tmp_path / "chart.hdr", "-o", tmp_path / "chart.h5", "--tolerance", "0.01")
    assert done.status == 0
    scene = ps.read_scene(tmp_path / "chart.h5")
    assert f"41 bands as {len(scene.basis)} spectra" in done.out
    assert f"RMS error {scene.relative_error:.2e}" in done.out
    assert "tolerance 0.01" in done.out
    told = photosite("convert", tmp_path / "chart.hdr", "-o", tmp_path / "b.h5", "--tolerance", "0.01", "--json").json
    assert (told["components"], told["bands"], told["rows"], told["cols"]) == (len(scene.basis), 41, 132, 196)
    assert told["relative_error"] == scene.relative_error
    assert told["mean_luminance_cd_m2"] == pytest.approx(scene.mean_luminance_cd_m2())
    again = photosite("convert", tmp_path / "chart.h5", "-o", tmp_path / "b.h5")
    assert f"spectra; as it was (RMS error {scene.relative_error:.2e}" in again.out
    assert "tolerance" not in again.out
    assert photosite("convert", tmp_path / "chart.h5", "-o", tmp_path / "b.h5", "--json").json["tolerance"] is None


def test_each_missing_word_is_asked_for_until_all_are_said(photosite: Any, bare: Path) -> None:
    said: list[str] = []
    steps = [
        ("does not say the units", ["--units", "reflectance"]),
        ("does not say the wavelengths", ["--wavelengths", "400:600:100"]),
        ("say the light on them", ["--illuminant", "D65"]),
        ("say how bright they are lit", ["--luminance", "100"]),
        ("has no data at row 4, column 5, band 2 (500 nm)", ["--no-data", "zero"]),
        ("the first at row 6, column 7, band 3 (600 nm)", ["--negative", "zero"]),
    ]
    target = bare.with_name("out.h5")
    for line, option in steps:
        done = photosite("convert", bare, "-o", target, *said)
        assert done.status == 2
        assert line in done.err
        assert not target.exists()
        said += option
    done = photosite("convert", bare, "-o", target, *said, "--distance", "2", "--width", "1", "--json")
    assert done.status == 0, done.err
    told = done.json
    assert (told["no_data_values"], told["negative_values"]) == (1, 1)
    assert (told["distance_m"], told["width_m"]) == (2, 1)
    scene = ps.read_scene(target)
    assert scene.wavelength_nm.tolist() == GRID
    assert scene.mean_luminance_cd_m2() == pytest.approx(100)


def test_bands_that_come_first_are_said(photosite: Any, tmp_path: Path) -> None:
    values = np.random.default_rng(2).uniform(1, 2, (3, 20, 30))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["cube"] = values
        file["cube"].attrs.update({"wavelength_nm": GRID, "units": "W/sr/m2/nm"})
    told = ("convert", tmp_path / "a.h5", "-o", tmp_path / "b.h5", "--json")
    asked = photosite(*told).err
    assert "(3, 20, 30), of which the first axis fits its 3 wavelengths; say where the bands are: --interleave" in asked
    done = photosite(*told, "--interleave", "bsq").json
    assert (done["rows"], done["cols"], done["bands"]) == (20, 30, 3)


def test_bands_are_sorted_where_that_is_said(photosite: Any, bare: Path) -> None:
    said = ["--units", "W/sr/m2/nm", "--no-data", "zero", "--negative", "zero", "--wavelengths", "600,400,500"]
    done = photosite("convert", bare, "-o", bare.with_name("out.h5"), *said)
    assert done.status == 2
    assert "not sorted: band 2 has 400 nm after 600 nm" in done.err
    assert photosite("convert", bare, "-o", bare.with_name("out.h5"), *said, "--sort-bands").status == 0
    assert ps.read_scene(bare.with_name("out.h5")).wavelength_nm.tolist() == GRID


@pytest.mark.parametrize("text", ["400:600", "600:400:10", "400:605:10", "400,red", "400:500:0", ""])
def test_wavelengths_that_are_none(photosite: Any, bare: Path, text: str) -> None:
    done = photosite("convert", bare, "-o", bare.with_name("out.h5"), "--wavelengths", text)
    assert done.status == 2
    assert "expected 400,410,420 or first:last:step" in done.err


def test_a_picture_is_raised_by_the_method_that_is_said(photosite: Any, tmp_path: Path) -> None:
    codes = np.random.default_rng(6).integers(30, 220, (5, 7, 3)).astype(np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", codes, photometric="rgb")
    told = ("--luminance", "40", "--json")
    plain = photosite("convert", tmp_path / "a.tif", "-o", tmp_path / "a.h5", *told).json
    smooth = photosite("convert", tmp_path / "a.tif", "-o", tmp_path / "a.h5", *told, "--method", "jakob-hanika").json
    assert plain["components"] == 3 < smooth["components"]
    option = ("--scene-option", "method=jakob-hanika", *told)
    assert photosite("scenes", "show", tmp_path / "a.tif", *option).json["spectra"] == smooth["components"]
    cube = photosite("convert", tmp_path / "a.h5", "-o", tmp_path / "b.h5", "--method", "jakob-hanika")
    assert cube.status == 2
    assert "method says how the colours of a display picture" in cube.err
    assert sum("method" in line for line in cube.err.splitlines()) == 1
