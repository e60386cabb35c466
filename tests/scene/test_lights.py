"""Mixed lights: the radiance is the sum over lights of the reflectance times the light."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from raising import raises
from scene_files import radiance

from photosite.color.colorimetry import luminance_cd_m2
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import photons_from_energy
from photosite.errors import InputError
from photosite.scene import charts
from photosite.scene.lights import gradient, mixed, spot
from photosite.scene.scene import Scene


def white(name: str, luminance: float, grid: np.ndarray) -> np.ndarray:
    photons = photons_from_energy(illuminant(name, grid), grid)
    return photons * luminance / luminance_cd_m2(photons, grid)


def direct(scene: Scene, lights: list[tuple[str, float, np.ndarray]]) -> np.ndarray:
    """(rows, cols, wavelengths): reflectance times the light that falls on each sample."""
    assert scene.reflectance is not None
    reflectance = np.einsum("kij,kl->ijl", scene.weights.astype(np.float64), scene.reflectance)
    light = sum(spread[:, :, None] * white(name, cd, scene.wavelength_nm) for name, cd, spread in lights)
    return reflectance * light


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_the_radiance_is_reflectance_times_all_the_light_within_the_tolerance(tolerance: float) -> None:
    chart = charts.macbeth("A", 20.0)
    scene = replace(chart, weights=chart.weights[:, ::3, ::3], regions=())
    rng = np.random.default_rng(1)
    maps = rng.random((3, *scene.shape))
    lights = [("D65", 200.0, maps[0]), ("FL11", 50.0, maps[1]), ("A", 5.0, maps[2])]
    lit = mixed(scene, lights, tolerance=tolerance)
    wanted = direct(scene, lights)
    error = np.sqrt(((radiance(lit) - wanted) ** 2).mean() / (wanted**2).mean())
    assert error < tolerance + 3e-7  # float32 weights and maps
    assert lit.relative_error == pytest.approx(error, abs=3e-7)
    assert len(lit.basis) <= (41 if tolerance < 1e-5 else 36)  # of 72
    assert lit.reflectance is None


def test_few_reflectances_and_lights_stay_as_they_are() -> None:
    scene = charts.slanted_edge(rows=20, cols=30)
    lights = [("D65", 100.0, np.ones(scene.shape)), ("A", 30.0, np.linspace(0, 1, 30) * np.ones((20, 1)))]
    lit = mixed(scene, lights)
    assert len(lit.basis) == 2
    np.testing.assert_allclose(radiance(lit), direct(scene, lights), rtol=3e-7)
    assert lit.relative_error == 0.0


def test_one_even_light_is_a_change_of_light() -> None:
    chart = charts.macbeth("A", 40.0)
    alone = mixed(chart, [("D65", 100.0, None)], tolerance=1e-7)
    changed = chart.with_illuminant("D65", alone.mean_luminance_cd_m2())
    for region in chart.regions:
        np.testing.assert_allclose(
            alone.radiance(region.r0, region.c0), changed.radiance(region.r0, region.c0), rtol=2e-4
        )


def test_luminance_is_that_of_a_white_where_the_spread_is_one() -> None:
    field = charts.uniform("A", 7.0)
    lit = mixed(field, [("D65", 120.0, None), ("A", 30.0, None)])
    assert lit.mean_luminance_cd_m2() == pytest.approx(150.0, rel=1e-6)


def test_gradients_and_spots() -> None:
    y, x = (np.arange(4)[:, None] + 0.5) / 4, (np.arange(6)[None, :] + 0.5) / 6
    assert np.broadcast_to(gradient(0.2, 1.0)(y, x), (4, 6))[2] == pytest.approx(0.2 + 0.8 * x[0])
    assert np.broadcast_to(gradient(1.0, 0.0, 90)(y, x), (4, 6))[:, 1] == pytest.approx(1 - y[:, 0])
    corners = gradient(0.0, 1.0, 45)(np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    assert corners == pytest.approx([0.0, 1.0], abs=1e-12)
    place = spot(0.25, 0.75, 0.1)(np.array([0.25, 0.35, 0.25]), np.array([0.75, 0.75, 0.85]))
    assert place == pytest.approx([1.0, 0.5, 0.5])


@pytest.mark.parametrize(
    ("lights", "field"),
    [
        ([], "lights"),
        ([("D65", -1.0, None)], "luminance_cd_m2"),
        ([("D65", 1.0, np.ones((3, 3)))], "distribution"),
        ([("A", 1.0, None), ("D65", 1.0, -np.ones((20, 30)))], "distribution"),
        ([("D66", 1.0, None)], "illuminant"),
        ([("D65", 1.0, lambda y, x: np.full((20, 30), math.nan))], "distribution"),
    ],
)
def test_invalid_lights(lights: list[object], field: str) -> None:
    with raises(InputError, field):
        mixed(charts.slanted_edge(rows=20, cols=30), lights)  # type: ignore[arg-type]


def test_a_scene_without_reflectance_cannot_be_relit() -> None:
    field = Scene.uniform(np.ones(3), [500, 550, 600], name="a lamp")
    with raises(InputError, "the light of"):
        mixed(field, [("D65", 1.0, None)])
    for call in (lambda: gradient(-1.0), lambda: spot(radius=0.0)):
        with pytest.raises(InputError):
            call()
