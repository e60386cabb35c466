"""Charts with and without a light, and invalid options of all of them."""

from __future__ import annotations

import inspect
import math
import pickle
from typing import Any

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.scene import charts


@pytest.mark.parametrize(("name", "own"), [("slanted_edge", {"contrast": 10, "rows": 20}), ("color_checker_sg", {})])
def test_the_short_form_is_the_chart_under_a_light(name: str, own: dict[str, Any]) -> None:
    function = getattr(charts, name)
    short = function("D65", 30, distance_m=2, width_m=0.5, rule="rectangle", **own)
    scene = function.chart(**own).under("D65", 30, distance_m=2, width_m=0.5, rule="rectangle")
    for field in ("weights", "basis", "wavelength_nm"):
        np.testing.assert_array_equal(getattr(short, field), getattr(scene, field))
    assert (short.name, short.regions, short.distance_m, short.width_m) == (scene.name, scene.regions, 2, 0.5)


def test_wavelengths_of_gray_and_colored_charts() -> None:
    grid = np.arange(450.0, 651, 50)
    assert charts.ramp.chart().under("A", 5, wavelength_nm=grid).wavelength_nm.tolist() == grid.tolist()
    chart = charts.macbeth.chart(wavelength_nm=grid)
    assert chart.under("A").wavelength_nm.tolist() == grid.tolist()
    with raises(InputError, "the wavelengths of"):
        chart.under("A", wavelength_nm=grid)


def test_a_chart_function_shows_its_arguments_and_pickles() -> None:
    names = ["illuminant", "mean_luminance_cd_m2", "edition", "wavelength_nm", "distance_m", "width_m", "rule"]
    signature = inspect.signature(charts.color_checker_sg)
    assert list(signature.parameters) == names
    assert signature.parameters["illuminant"].default == "A"
    assert pickle.loads(pickle.dumps(charts.macbeth)) is charts.macbeth


@pytest.mark.parametrize(
    ("name", "options", "field"),
    [
        ("dead_leaves", {"smallest_radius": 0.1}, "smallest_radius"),
        ("dead_leaves", {"largest_radius": 0.7}, "largest_radius"),
        ("dead_leaves", {"seed": -1}, "seed"),
        ("dead_leaves", {"seed": 1.5}, "seed"),
        ("dead_leaves", {"supersampling": 0}, "supersampling"),
        ("dead_leaves", {"rows": 8000, "cols": 8000}, None),
        ("dead_leaves", {"contrast": 0.3}, "contrast"),
        ("ramp", {"contrast": math.inf, "logarithmic": True}, "contrast"),
        ("ramp", {"rows": 0}, "rows"),
        ("ramp", {"cols": 4.5}, "cols"),
        ("ramp", {"rows": 1 << 15, "cols": 1 << 15}, None),
        ("ramp", {"colz": 5}, None),
        ("checkerboard", {"square": 0.5}, "square"),
        ("checkerboard", {"square": 5000}, "square"),
        ("checkerboard", {"square": math.nan}, "square"),
        ("point_grid", {"pitch": 1}, "pitch"),
        ("point_grid", {"pitch": 300}, "pitch"),
        ("point_grid", {"pitch": 8, "diameter": 9.0}, "diameter"),
        ("point_grid", {"contrast": 1.0}, "contrast"),
        ("sinusoid", {"frequency": 0.6}, "frequency"),
        ("sinusoid", {"frequency": 0}, "frequency"),
        ("sinusoid", {"direction_deg": math.inf}, "direction_deg"),
        ("sinusoid", {"waveform": "sin"}, "waveform"),
        ("frequency_sweep", {"lowest": 0.2, "highest": 0.1}, "highest"),
        ("frequency_sweep", {"highest": 0.7}, "highest"),
        ("zone_plate", {"highest": math.nan}, "highest"),
        ("siemens_star", {"cycles": 0}, "cycles"),
        ("siemens_star", {"rows": 40, "cols": 40}, "patches"),
        ("siemens_star", {"contrast": 1.0}, "contrast"),
        ("slanted_edge", {"angle_deg": 45.0}, "angle_deg"),
        ("slanted_edge", {"angle_deg": math.nan}, "angle_deg"),
        ("slanted_edge", {"contrast": 1.0}, "contrast"),
        ("edge_star", {"cycles": 2.5}, "cycles"),
        ("edge_star", {"angle_deg": math.nan}, "angle_deg"),
        ("hdr_patches", {"decades": 0.0}, "decades"),
        ("hdr_patches", {"decades": 40.0}, "decades"),
        ("hdr_patches", {"patches": 1}, "patches"),
        ("hdr_patches", {"patches": 3.5}, "patches"),
        ("color_checker_sg", {"edition": "after2014"}, "edition"),
        ("color_checker_sg", {"wavelength_nm": [370.0, 500.0]}, "wavelength_nm"),
        ("macbeth", {"wavelength_nm": [350.0, 500.0]}, "wavelength_nm"),
        ("macbeth", {"mean_luminance_cd_m2": -1.0}, "mean_luminance_cd_m2"),
        ("uniform", {"mean_luminance_cd_m2": math.inf}, "mean_luminance_cd_m2"),
    ],
)
def test_invalid_options(name: str, options: dict[str, Any], field: str | None) -> None:
    with pytest.raises(InputError) as caught:
        getattr(charts, name)(**options)
    if field is not None:
        assert caught.value.what == field
