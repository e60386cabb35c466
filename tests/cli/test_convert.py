"""`photosite convert`."""

from __future__ import annotations

import errno
import json
import os
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tifffile
from PIL import Image

import photosite as ps
from photosite.errors import FileError

GRID = [400.0, 500.0, 600.0]


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A stack without metadata; one value is missing, another negative."""
    values = np.random.default_rng(1).uniform(0.1, 1, (3, 20, 30)).astype(np.float32)
    values[1, 4, 5], values[2, 6, 7] = np.nan, -0.01
    tifffile.imwrite(tmp_path / "bare.tif", values, photometric="minisblack", metadata=None)
    return tmp_path / "bare.tif"


@pytest.mark.smoke("convert")
def test_components_and_error_are_reported(photosite: Any, tmp_path: Path) -> None:
    ps.charts.macbeth("A", 40).save(tmp_path / "chart.hdr")
    done = photosite("convert", tmp_path / "chart.hdr", "-o", tmp_path / "chart.h5", "--tolerance", "0.01")
    assert done.status == 0
    scene = ps.read_scene(tmp_path / "chart.h5")
    assert f"41 bands as {len(scene.basis)} spectra" in done.out
    assert f"RMS error {scene.relative_error:.2e}" in done.out
    assert "tolerance 0.01" in done.out
    facts = photosite("convert", tmp_path / "chart.hdr", "-o", tmp_path / "b.h5", "--tolerance", "0.01", "--json").json
    assert (facts["components"], facts["bands"], facts["rows"], facts["cols"]) == (len(scene.basis), 41, 132, 196)
    assert facts["relative_error"] == scene.relative_error
    assert facts["mean_luminance_cd_m2"] == pytest.approx(scene.mean_luminance_cd_m2())
    again = photosite("convert", tmp_path / "chart.h5", "--force", "-o", tmp_path / "b.h5")
    assert f"spectra; not reduced (RMS error {scene.relative_error:.2e}" in again.out
    assert "tolerance" not in again.out
    again = photosite("convert", tmp_path / "chart.h5", "--force", "-o", tmp_path / "b.h5", "--json")
    assert again.json["tolerance"] is None
    for name, value in (("--variable", "cube"), ("--interleave", "bsq")):
        refused = photosite("convert", tmp_path / "chart.h5", "--force", "-o", tmp_path / "b.h5", name, value)
        assert refused.status == 2
        assert f"holds a scene, to which an option does not apply. Omit {name} {value}" in refused.err


def test_each_missing_option_is_asked_for(photosite: Any, bare: Path) -> None:
    options_given: list[str] = []
    steps = [
        ("does not state the units", ["--units", "reflectance"]),
        ("has no wavelengths of its bands", ["--wavelengths", "400:600:100"]),
        ("holds reflectances. Pass --illuminant D65 and --luminance 100", ["--illuminant", "D65"]),
        ("holds reflectances. Pass --luminance 100", ["--luminance", "100"]),
        ("has no data at row 4, column 5, band 2 (500 nm)", ["--no-data", "zero"]),
        ("the first at row 6, column 7, band 3 (600 nm)", ["--negative", "zero"]),
    ]
    target = bare.with_name("out.h5")
    for line, option in steps:
        done = photosite("convert", bare, "-o", target, *options_given)
        assert done.status == 2
        assert line in done.err
        assert not target.exists()
        options_given += option
    done = photosite("convert", bare, "-o", target, *options_given, "--distance", "2", "--width", "1", "--json")
    assert done.status == 0, done.err
    facts = done.json
    assert (facts["no_data_values"], facts["negative_values"]) == (1, 1)
    assert (facts["distance_m"], facts["width_m"]) == (2, 1)
    scene = ps.read_scene(target)
    assert scene.wavelength_nm.tolist() == GRID
    assert scene.mean_luminance_cd_m2() == pytest.approx(100)


def test_bands_on_the_first_axis(photosite: Any, tmp_path: Path) -> None:
    values = np.random.default_rng(2).uniform(1, 2, (3, 20, 30))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["cube"] = values
        file["cube"].attrs.update({"wavelength_nm": GRID, "units": "W/sr/m2/nm"})
    call = ("convert", tmp_path / "a.h5", "--force", "-o", tmp_path / "b.h5", "--json")
    error = photosite(*call).err
    assert "a cube of (3, 20, 30), and 3 wavelengths fit its first axis. Pass --interleave" in error
    done = photosite(*call, "--interleave", "bsq").json
    assert (done["rows"], done["cols"], done["bands"]) == (20, 30, 3)


def test_bands_are_sorted_on_request(photosite: Any, bare: Path) -> None:
    options_given = ["--units", "W/sr/m2/nm", "--no-data", "zero", "--negative", "zero", "--wavelengths", "600,400,500"]
    done = photosite("convert", bare, "-o", bare.with_name("out.h5"), *options_given)
    assert done.status == 2
    assert "not sorted: band 2 has 400 nm after 600 nm" in done.err
    assert photosite("convert", bare, "-o", bare.with_name("out.h5"), *options_given, "--sort-bands").status == 0
    assert ps.read_scene(bare.with_name("out.h5")).wavelength_nm.tolist() == GRID


@pytest.mark.parametrize("text", ["400:600", "600:400:10", "400:605:10", "400,red", "400:500:0", ""])
def test_invalid_wavelengths(photosite: Any, bare: Path, text: str) -> None:
    done = photosite("convert", bare, "-o", bare.with_name("out.h5"), "--wavelengths", text)
    assert done.status == 2
    assert "must be 400,410,420 or first:last:step" in done.err


def test_the_method_for_pictures(photosite: Any, tmp_path: Path) -> None:
    codes = np.random.default_rng(6).integers(30, 220, (5, 7, 3)).astype(np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", codes, photometric="rgb")
    options = ("--luminance", "40", "--json")
    plain = photosite("convert", tmp_path / "a.tif", "-o", tmp_path / "a.h5", *options).json
    smooth = photosite(
        "convert", tmp_path / "a.tif", "--force", "-o", tmp_path / "a.h5", *options, "--method", "jakob-hanika"
    ).json
    assert plain["components"] == 3 < smooth["components"]
    option = ("--scene-option", "method=jakob-hanika", *options)
    assert photosite("scenes", "show", tmp_path / "a.tif", *option).json["spectra"] == smooth["components"]
    cube = photosite("convert", tmp_path / "a.h5", "--force", "-o", tmp_path / "b.h5", "--method", "jakob-hanika")
    assert cube.status == 2
    assert "Omit --method jakob-hanika" in cube.err


def test_some_bands_of_a_file(photosite: Any, tmp_path: Path) -> None:
    grid = [400.0, 500, 600, 700, 900, 1000]
    values = np.random.default_rng(3).uniform(0.1, 0.9, (6, 8, 9)).astype(np.float32)
    metadata = {"wavelength_nm": grid, "units": "reflectance"}
    tifffile.imwrite(
        tmp_path / "a.tif", values, photometric="minisblack", metadata=None, description=json.dumps(metadata)
    )
    call = (
        "convert",
        tmp_path / "a.tif",
        "--force",
        "-o",
        tmp_path / "a.h5",
        "--illuminant",
        "D65",
        "--luminance",
        "100",
    )
    refused = photosite(*call)
    assert refused.status == 2
    assert "illuminant D65" in refused.err
    assert "--bands 300:830" in refused.err
    assert photosite(*call, "--bands", "400:830", "--json").json["bands"] == 4
    for wrong in ("830:400", "400", "400:830:10", "a:b", "0:5"):
        assert f"must be FIRST:LAST in nm, such as 400:780, got '{wrong}'" in photosite(*call, "--bands", wrong).err
    assert photosite(*call, "--bands", "400-830").status == 2
    show = ("scenes", "show", tmp_path / "a.tif", "--illuminant", "D65", "--luminance", "100")
    assert "--scene-option 'band_range_nm=[300,830]'" in photosite(*show).err
    assert photosite(*show, "--scene-option", "band_range_nm=[300,830]", "--json").json["last_nm"] == 700
    camera = "photosite_camera: 1\nsensor: nikon-d200\n"
    (tmp_path / "b.yaml").write_text(f"{camera}scene: {{source: a.tif, illuminant: D65, luminance_cd_m2: 100}}\n")
    options = "options: {band_range_nm: [300, 830]}"
    (tmp_path / "c.yaml").write_text(
        f"{camera}scene: {{source: a.tif, illuminant: D65, luminance_cd_m2: 100, {options}}}\n"
    )
    with pytest.raises(FileError) as caught:
        ps.load_camera(tmp_path / "b.yaml").scene.scene()
    assert options in str(caught.value.hint)
    assert ps.load_camera(tmp_path / "c.yaml").scene.scene().wavelength_nm[-1] == 700


def test_spectra_of_pictures_are_reduced_to_a_tolerance(photosite: Any, tmp_path: Path) -> None:
    Image.fromarray(np.random.default_rng(5).integers(0, 256, (3, 3, 3), np.uint8)).save(tmp_path / "a.png")
    call = ("convert", tmp_path / "a.png", "--force", "-o", tmp_path / "a.h5", "--luminance", "40")
    done = photosite(*call, "--method", "jakob-hanika", "--tolerance", "0.05")
    assert "(tolerance 0.05)" in done.out
    assert "not reduced" not in done.out
    assert "not reduced" in photosite(*call).out


def test_patches_across_a_chart(photosite: Any, tmp_path: Path) -> None:
    lines = [f"P{k},{k / 50 + 0.1:g},0.5" for k in range(24)]
    (tmp_path / "a.csv").write_text("\n".join(["patch,500,600", *lines]))
    call = ("convert", tmp_path / "a.csv", "--force", "-o", tmp_path / "a.h5", "--illuminant", "A", "--luminance", "40")
    done = photosite(*call)
    assert done.status == 0
    assert "photosite: warning: " in done.err
    assert "--patch-cols 6" in done.err
    assert photosite(*call, "--patch-cols", "4").status == 0
    assert len({part.c0 for part in ps.read_scene(tmp_path / "a.h5").regions}) == 4


@pytest.mark.skipif(sys.platform == "win32", reason="limits of file sizes")
def test_an_exr_file_that_cannot_be_written_names_itself(photosite: Any, tmp_path: Path) -> None:
    pytest.importorskip("OpenEXR")
    import resource

    scene, written = tmp_path / "scene.h5", tmp_path / "scene.exr"
    ps.charts.macbeth(illuminant="A", mean_luminance_cd_m2=40).save(scene)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, before[1]))
    try:
        done = photosite("convert", scene, "--distance", 2, "-o", written)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert done.status == 2
    assert done.err.endswith(f"photosite: {written}: cannot be written: {os.strerror(errno.EFBIG)}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["scene.h5"]
