"""`photosite compare` from the command line: what agrees, what does not, and calls that cannot be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from scipy.io import savemat

import photosite as ps
from photosite.validation.set_up import SetUp

SENSOR = ps.load_sensor("nikon-d200")
CAMERA = ps.Camera(ps.DiffractionLimited(8, 50), SENSOR)
SET_UP = SetUp.from_chart(CAMERA, ps.charts.macbeth("A", 40), 1 / 3)
SHAPE = (264, 392)


def write_csv(path: Path, set_up: SetUp) -> Path:
    values = set_up.patch_values("e")
    lines = [f"{name},{','.join(map(repr, row))}" for name, row in zip(values.names, values.mean.tolist(), strict=True)]
    path.write_text("patch,R_e,G_e,B_e\n" + "\n".join(lines) + "\n")
    return path


@pytest.fixture
def patches(tmp_path: Path) -> Path:
    return write_csv(tmp_path / "patches.csv", SET_UP)


@pytest.mark.smoke("compare")
def test_isetcams_electrons(photosite: Any, isetcam_results: Path) -> None:
    file = isetcam_results
    done = photosite("compare", file, "--case", "d200", "--integration", "rectangle", "--tolerance", 0.001)
    assert done.status == 0
    assert done.out.splitlines()[0].endswith(
        "isetcam_macbeth_tungsten.json and photosite agree, at a tolerance of 0.001 %"
    )
    assert len([line for line in done.out.splitlines() if line.startswith("neutral 5 ")]) == 1
    other_rule = photosite("compare", file, "--json").json
    assert not other_rule["agrees"]
    assert other_rule["beyond"] == 72


def test_the_case_and_the_rule_that_agrees_come_first(photosite: Any, isetcam_results: Path) -> None:
    file = isetcam_results
    first = photosite("compare", file).out.splitlines()[:3]
    assert first[1:] == ["  case: d200", "  they agree with the rectangle rule: --integration rectangle"]
    other = photosite("compare", file, "--integration", "rectangle", "--json").json
    assert (other["case"], other["hint"]) == ("d200", None)


def test_patches_as_csv(photosite: Any, patches: Path) -> None:
    assert photosite("compare", patches, "--json").json["agrees"]
    for wrong in (
        ("--illuminant", "D65"),
        ("--exposure", "1/4"),
        ("--luminance", 40.1),
        ("--sensor", "vendor-2.2um"),
        ("--f-number", 7.9),
    ):
        done = photosite("compare", patches, *wrong, "--json")
        assert not done.json["agrees"], wrong
    quarter = photosite("compare", patches, "--exposure", "1/4", "--json").json
    slope = quarter["regression"]["slope"]
    assert slope["value"] == pytest.approx(4 / 3, rel=1e-5)
    assert slope["lower_95"] <= slope["value"] <= slope["upper_95"]


def test_a_mosaic_of_mean_electrons(photosite: Any, tmp_path: Path) -> None:
    """Blurred patches of a chart against even fields of their light; what diffraction spreads is in proportion to N."""
    found = {}
    for f_number in (1, 8):
        camera = replace(CAMERA, optics=ps.DiffractionLimited(f_number, 50))
        set_up = SetUp.from_chart(camera, ps.charts.macbeth("A", 40), 1 / 3 * (f_number / 8) ** 2)
        csv = write_csv(tmp_path / "patches.csv", set_up)
        savemat(tmp_path / "mosaic.mat", {"electrons": set_up.mean_electrons(SHAPE)})
        done = photosite("compare", tmp_path / "mosaic.mat", csv, "--unit", "e", "--tolerance", 0.3, "--json").json
        found[f_number] = np.abs(done["relative_difference"]).max()
        assert done["agrees"] == (f_number == 1)
    assert found[8] / found[1] == pytest.approx(8, rel=0.15)


def test_noisy_electrons_agree_within_their_noise(photosite: Any, tmp_path: Path) -> None:
    electrons = np.random.default_rng(5).poisson(SET_UP.mean_electrons(SHAPE)).astype(float)
    savemat(tmp_path / "shot.mat", {"electrons": electrons})
    done = photosite("compare", tmp_path / "shot.mat", "--unit", "e", "--tolerance", 0, "--json").json
    assert done["means"]["degrees_of_freedom"] == 72
    assert done["agrees"]
    brighter = photosite("compare", tmp_path / "shot.mat", "--unit", "e", "--luminance", 40.4, "--json").json
    assert not brighter["agrees"]


def test_plain_tiffs_are_validated(photosite: Any, tmp_path: Path) -> None:
    (frame,) = SET_UP.frames(SHAPE, seed=3)
    tifffile.imwrite(tmp_path / "shot.tif", frame.dn)
    done = photosite("compare", tmp_path / "shot.tif", "--seed", 4, "--json").json
    assert done["agrees"]
    assert done["noise"]["degrees_of_freedom"] == 72
    turned = photosite("compare", tmp_path / "shot.tif", "--cfa", "rggb", "--exposure", "0.32", "--json").json
    assert not turned["agrees"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.csv"], "no such file"),
        (["patches.csv", "--case", "d200", "--set-up", "none.json"], "no such file"),
        (["patches.csv", "--set-up", "empty.json"], "has no case"),
        (["patches.csv", "--set-up", "wrong.json"], "is not valid JSON"),
        (["patches.csv", "--set-up", "thin.json"], "'f_number' is missing"),
        (["patches.csv", "--set-up", "thin.json", "--f-number", "4"], "--f-number does not apply"),
        (["thin.json"], "'f_number' is missing"),
        (["a.mat"], "--unit e"),
        (["a.mat", "--unit", "e", "--cfa", "gbrg"], "--cfa must be that of the set-up, RG/GB"),
        (["patches.csv", "a.mat", "--unit", "dn"], "for 12 bits"),
        (["patches.csv", "--illuminant", "Q"], "illuminant"),
    ],
)
def test_invalid_calls(
    photosite: Any, patches: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(patches.parent)
    Path("empty.json").write_text("{}")
    Path("wrong.json").write_text("{'a': 1}")
    Path("thin.json").write_text('{"wavelength_nm": [400, 700], "d200": {"patch_photon_radiance": [[1, 1]]}}')
    savemat("a.mat", {"electrons": np.full((20, 30), 0.5)})
    done = photosite("compare", *arguments)
    assert done.status == 2
    assert message in done.err
    assert done.err.count("\n") == 1
    assert not done.out


def test_values_of_image_quality_are_columns(photosite: Any, tmp_path: Path) -> None:
    """Any measurement of the chart: frames of one set-up agree, of half the light differ."""
    set_up = ("--exposure", "1/20")
    for name, exposure in (("same", "1/20"), ("dim", "1/40")):
        size = ("--rows", "264", "--cols", "392", "--luminance", "200", "--illuminant", "D65")
        photosite("simulate", "--scene", "macbeth", *size, "--exposure", exposure, "-o", str(tmp_path / f"{name}.dng"))
    light = ("--luminance", "200", "--illuminant", "D65")
    wanted = ("--value", "noise.snr_18_db.G", "--value", "oecf.exponent")
    done = photosite("compare", str(tmp_path / "same.dng"), *set_up, *light, *wanted, "--json")
    found = done.json["image_quality"]
    assert found["agrees"]
    assert [each["name"] for each in found["values"] if each["name"].startswith("noise")] == ["noise.snr_18_db.G"]
    assert {each["name"].rpartition(".")[0] for each in found["values"]} == {"noise.snr_18_db", "oecf.exponent"}
    two = photosite("compare", str(tmp_path / "same.dng"), str(tmp_path / "dim.dng"), "--value", "oecf.exponent.G")
    assert "oecf.exponent.G" in two.out
    wrong = photosite("compare", str(tmp_path / "same.dng"), *set_up, "--value", "edge-sfr.mtf50")
    assert wrong.status == 2
    assert "edge-sfr" in wrong.err


def test_values_of_image_quality_need_mosaics(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "patches.csv"
    file.write_text("patch,R_e,G_e,B_e\nwhite,100,100,100\n")
    wrong = photosite("compare", str(file), "--value", "noise.snr_18_db")
    assert wrong.status == 2
    assert "mosaics" in wrong.err
