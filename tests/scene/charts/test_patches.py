"""Charts of any reflectances, and of grays over several decades."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

from photosite.color.colorimetry import luminance_cd_m2
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import photons_from_energy
from photosite.errors import InputError
from photosite.scene import charts

GRID = np.arange(400.0, 701.0, 5)


def reflectances(count: int, seed: int = 2) -> np.ndarray:
    """(count, wavelengths): smooth, and of as many kinds."""
    rng = np.random.default_rng(seed)
    middle, width, height = rng.uniform(400, 700, count), rng.uniform(20, 90, count), rng.uniform(0.2, 0.9, count)
    return height[:, None] * np.exp(-(((GRID - middle[:, None]) / width[:, None]) ** 2)) + 0.03


def test_every_patch_has_its_reflectance_under_the_light() -> None:
    wanted = reflectances(18)
    chart = charts.reflectance_chart(wanted, GRID, rows=3, cols=6).under("FL11", 70.0)
    light = photons_from_energy(illuminant("FL11", GRID), GRID)
    seen = np.stack([chart.radiance(r.r0, r.c0) for r in chart.regions])
    scale = seen.sum() / (wanted * light).sum()
    assert np.abs(seen / (scale * light) - wanted).max() < 3e-5
    assert np.mean(luminance_cd_m2(seen, GRID)) == pytest.approx(70.0, rel=1e-6)
    assert chart.name == "chart, illuminant FL11"


def test_regions_are_in_order_of_rows_and_of_one_color() -> None:
    chart = charts.reflectance_chart(reflectances(5), GRID, rows=2, cols=3, names=list("abcde")).under("A")
    assert [r.name for r in chart.regions] == list("abcde")
    assert chart.regions[3].r0 == chart.regions[0].r0 + 32
    assert chart.regions[3].c0 == chart.regions[0].c0
    for region in chart.regions:
        inside = chart.weights[:, region.r0 - 4 : region.r1 + 4, region.c0 - 4 : region.c1 + 4]
        assert (inside == inside[:, :1, :1]).all()
    assert not chart.weights[:, 36:64, 68:].any()  # the sixth place stays black


def test_the_basis_is_the_fewest_spectra() -> None:
    grays = np.linspace(0.05, 0.9, 30)[:, None] * np.ones(GRID.size)
    assert len(charts.reflectance_chart(grays, GRID, rows=5, cols=6).weights) == 1
    assert len(charts.reflectance_chart(reflectances(100), GRID, rows=10, cols=10).weights) <= GRID.size


def test_a_chart_takes_another_light() -> None:
    chart = charts.reflectance_chart(reflectances(6), GRID, rows=2, cols=3).under("A", 40)
    direct = charts.reflectance_chart(reflectances(6), GRID, rows=2, cols=3).under("D65", 40)
    day = chart.with_illuminant("D65", direct.mean_luminance_cd_m2())
    np.testing.assert_allclose(day.basis, direct.basis, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"reflectance": np.ones((4, 7))}, "reflectance"),
        ({"reflectance": -reflectances(4)}, "reflectance"),
        ({"reflectance": np.full((4, 61), np.nan)}, "reflectance"),
        ({"rows": 1, "cols": 3}, "4 patches do not fit on 1 rows of 3"),
        ({"names": ["a", "b"]}, "names"),
        ({"names": ["a", "b", "a", "c"]}, "names"),
    ],
)
def test_invalid_charts(change: dict[str, object], field: str) -> None:
    arguments: dict[str, object] = {"reflectance": reflectances(4), "wavelength_nm": GRID, "rows": 2, "cols": 2}
    with raises(InputError, field):
        charts.reflectance_chart(**arguments | change)  # type: ignore[arg-type]


def test_a_black_chart_has_no_luminance() -> None:
    chart = charts.reflectance_chart(np.zeros((4, 61)), GRID, rows=2, cols=2)
    with raises(InputError, "'chart' under this light"):
        chart.under("A", 40)


def test_grays_cover_six_decades_and_are_named_by_density() -> None:
    chart = charts.hdr_patches("D65", 1000.0, decades=6, patches=36)
    levels = np.array([chart.weights[0, r.r0, r.c0] for r in chart.regions], np.float64)
    assert levels[0] / levels[-1] == pytest.approx(1e6, rel=1e-6)
    assert np.diff(np.log10(levels)) == pytest.approx(np.full(35, -6 / 35), rel=1e-5)
    assert -np.log10(levels) == pytest.approx([float(r.name.split()[1]) for r in chart.regions], abs=0.005)
    seen = [float(luminance_cd_m2(chart.radiance(r.r0, r.c0), chart.wavelength_nm)) for r in chart.regions]
    assert np.mean(seen) == pytest.approx(1000.0, rel=1e-6)
    # Successive patches are neighbors, so that dark ones are far from bright ones.
    corners = np.array([(r.r0, r.c0) for r in chart.regions])
    assert (np.abs(np.diff(corners, axis=0)).sum(axis=1) == 32).all()
