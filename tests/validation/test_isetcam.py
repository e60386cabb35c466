"""docs/validation/isetcam.md says by how much ISETCam and photosite differ, by convention.

These tests compute its numbers again.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.scene.scene import Scene
from photosite.validation.patch_values import PatchComparison, compare_values
from photosite.validation.set_up import SetUp, read_set_up
from photosite.validation.tool_comparison import compare

DOCS = Path(__file__).parents[2] / "docs" / "validation" / "isetcam.md"


def rows() -> dict[str, str]:
    """The tables' rows by their first cell: what the second says."""
    lines = [line for line in DOCS.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {row[0]: row[1] for row in cells}


def span(result: PatchComparison) -> str:
    percent = 100 * result.relative_difference
    return f"{percent.min():+.2f} to {percent.max():+.2f} %"


@pytest.fixture(scope="module")
def case(isetcam_results: Path) -> dict[str, SetUp]:
    rules = ("rectangle", "trapezoid")
    return {rule: read_set_up(isetcam_results, "d200", integration=rule)[0] for rule in rules}  # type: ignore[arg-type]


def test_the_same_inputs_by_the_rectangle_rule(isetcam_results: Path, case: dict[str, SetUp]) -> None:
    set_up, theirs = read_set_up(isetcam_results, integration="rectangle")
    assert theirs is not None
    result = compare(theirs, set_up, tolerance_percent=0.001)
    assert result.agrees
    assert isinstance(result, PatchComparison)
    assert result.reasons[0].startswith("largest difference -0.000398 % (green, G)")
    assert rows()["electrons, by ISETCam's rectangle rule"] == "-0.0004 to +0.0002 %"
    percent = 100 * result.relative_difference
    assert f"{percent.min():+.4f} to {percent.max():+.4f} %" == "-0.0004 to +0.0002 %"


def test_the_patches_are_in_the_stated_order(case: dict[str, SetUp]) -> None:
    """The neutrals, by name, grow darker; under another order they would not."""
    values = case["rectangle"].patch_values("e")
    neutrals = ["white", "neutral 8", "neutral 6.5", "neutral 5", "neutral 3.5", "black"]
    green = [values.mean[values.names.index(name), 1] for name in neutrals]
    assert (np.diff(green) < 0).all()
    red, blue = (values.mean[values.names.index(name)] for name in ("red", "blue"))
    assert red[0] > 8 * blue[0]


def test_the_trapezoidal_rule(isetcam_results: Path, case: dict[str, SetUp]) -> None:
    theirs = read_set_up(isetcam_results, "d200")[1]
    assert theirs is not None
    result = compare_values(theirs, case["trapezoid"].patch_values("e"))
    assert not result.agrees
    assert rows()["integral over wavelength: rectangle, not trapezoidal"] == span(result)
    # Why: the rectangle rule gives the first and last wavelength twice the weight.
    facts = json.loads((isetcam_results).read_text())
    light, efficiency = (np.array(facts["d200"][key]) for key in ("patch_photon_radiance", "quantum_efficiency_rgb"))
    ends = (light[:, :1] * efficiency[0] + light[:, -1:] * efficiency[-1]) / 2
    expected = ends / (light @ efficiency - ends)
    assert np.asarray(result.relative_difference) == pytest.approx(expected, abs=1e-5)


def test_the_chart_and_its_lamp(isetcam_results: Path, case: dict[str, SetUp]) -> None:
    theirs = read_set_up(isetcam_results, "d200")[1]
    assert theirs is not None
    set_up = case["rectangle"]
    chart = ps.charts.macbeth("A", 40, wavelength_nm=set_up.wavelength_nm, rule="rectangle")
    result = compare_values(theirs, SetUp.from_chart(set_up.camera, chart, set_up.exposure_s).patch_values("e"))
    assert not result.agrees
    assert rows()["chart and lamp: ISETCam's own files, not Ohta's ColorChecker under CIE A"] == span(result)


def test_constants_of_light(isetcam_results: Path, case: dict[str, SetUp]) -> None:
    facts = json.loads((isetcam_results).read_text())
    published = facts["d200"]["result"]["patch_luminance_cd_m2"]
    grid, light = facts["wavelength_nm"], facts["d200"]["patch_photon_radiance"]
    ours = [Scene.uniform(row, grid).mean_luminance_cd_m2("rectangle") for row in light]
    ratio = np.array(published) / ours - 1
    assert rows()["luminance, by the rectangle rule"] == f"{100 * ratio.min():+.4f} to {100 * ratio.max():+.4f} %"
    assert ratio.mean() == pytest.approx(6.626176e-34 / 6.62607015e-34 - 1, abs=2e-6)
    lens = case["rectangle"].camera.optics
    falls = lens.irradiance_per_radiance(np.array([550.0]), 1.2)[0]
    percent = 100 * (facts["d200"]["result"]["irradiance_over_radiance"] / falls - 1)
    assert abs(percent) < 1e-8
    assert rows()["irradiance over radiance"] == "below 1e-8 %"


def read_out(rng: np.random.Generator, mean_e: float, read_e: float, dsnu_e: float, prnu: float) -> np.ndarray:
    """ISETCam's order: shot and read noise, then the fixed pattern, which multiplies and adds; anew at each call."""
    n = 200_000
    volts = np.round(mean_e + math.sqrt(mean_e) * rng.standard_normal(n)) + read_e * rng.standard_normal(n)
    return np.asarray(volts * (1 + prnu * rng.standard_normal(n)) + dsnu_e * rng.standard_normal(n))


def test_noise_of_both_orders(case: dict[str, SetUp]) -> None:
    """Closed forms that the table's numbers come from, each against pixels drawn that way."""
    sensor = case["rectangle"].camera.sensor
    read_e = sensor.electrons(sensor.noise.read_noise_mv.value)
    dsnu_e = sensor.electrons(sensor.noise.dsnu_mv.value)
    prnu = sensor.noise.prnu_percent.value / 100
    mean_e = 18_000.0
    temporal = mean_e + read_e**2
    pattern = (prnu * mean_e) ** 2 + dsnu_e**2
    theirs = temporal * (1 + prnu**2) + pattern  # over pixels and, the pattern being drawn anew, over frames
    drawn = [read_out(np.random.default_rng(seed), mean_e, read_e, dsnu_e, prnu) for seed in (1, 2)]
    # Standard deviations of 200 000 values are known to 0.16 %; five of these: one false alarm in a million.
    assert np.std(drawn[0]) == pytest.approx(math.sqrt(theirs), rel=8e-3)
    assert np.std(drawn[0] - drawn[1]) / math.sqrt(2) == pytest.approx(math.sqrt(theirs), rel=8e-3)
    table = rows()
    between = math.sqrt(theirs / temporal) - 1
    over = math.sqrt(theirs / (temporal + pattern)) - 1
    assert table["noise from frame to frame at 18 000 e-"] == f"{100 * between:+.1f} %"
    assert table["noise over the pixels of a frame at 18 000 e-"] == f"{100 * over:+.4f} %"
    assert table["read noise in the dark"] == f"{100 * (math.sqrt(1 + prnu**2) - 1):+.4f} %"


def test_photosites_noise_is_that_of_the_formula(case: dict[str, SetUp]) -> None:
    """Two frames of one even field: their difference holds no fixed pattern."""
    sensor = case["rectangle"].camera.sensor.with_(rows=400, cols=400)
    camera = replace(case["rectangle"].camera, sensor=sensor)
    mean = np.full((400, 400), 18_000.0, np.float32)
    one, two = (
        camera.expose(mean, 0.1, seed=1, frame=n).dn.astype(float) / sensor.system_gain_dn_per_e for n in (0, 1)
    )
    read_e = sensor.electrons(sensor.noise.read_noise_mv.value)
    quantized = 1 / 12 / sensor.system_gain_dn_per_e**2
    expected = math.sqrt(18_000.0 + read_e**2 + quantized)
    assert np.std(one - two) / math.sqrt(2) == pytest.approx(expected, rel=9e-3)
