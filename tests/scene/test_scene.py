"""Scenes: what they refuse, and that they hold the radiance they were given."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.errors import InputError
from photosite.scene.scene import Scene

GRID = np.arange(400.0, 701.0, 10)


def cube(rows: int = 12, cols: int = 17, colours: int = 4, seed: int = 3) -> np.ndarray:
    """A radiance cube of `colours` spectra in equal measure."""
    rng = np.random.default_rng(seed)
    return 1e14 * rng.random((rows, cols, colours)) @ rng.random((colours, GRID.size))


def test_from_radiance_keeps_every_sample_within_the_tolerance() -> None:
    radiance = cube()
    for tolerance in (0.2, 1e-2, 1e-6):
        scene = Scene.from_radiance(radiance, GRID, tolerance=tolerance)
        again = np.einsum("kij,kl->ijl", scene.weights, scene.basis)
        rms = np.sqrt(((again - radiance) ** 2).mean() / (radiance**2).mean())
        assert rms <= tolerance + 1e-7  # float32 weights
        assert len(scene.basis) <= 4
    assert len(Scene.from_radiance(radiance, GRID, tolerance=0.2).basis) < 4


def test_from_radiance_of_darkness_is_dark() -> None:
    assert not Scene.from_radiance(np.zeros((3, 4, GRID.size)), GRID).weights.any()


def test_from_radiance_takes_any_memory_order() -> None:
    radiance = cube()
    plain = Scene.from_radiance(radiance, GRID, tolerance=1e-6)
    other = Scene.from_radiance(np.asfortranarray(radiance), GRID, tolerance=1e-6)
    assert plain.radiance(3, 5) == pytest.approx(other.radiance(3, 5), rel=1e-6)


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_radiance_that_cannot_be(bad: float) -> None:
    radiance = cube()
    radiance[2, 3, 4] = bad
    with pytest.raises(InputError, match="finite and not negative"):
        Scene.from_radiance(radiance, GRID)


def test_shapes_that_do_not_fit() -> None:
    with pytest.raises(InputError, match=r"weights \(2, 3, 4\), basis \(3, 31\), 31 wavelengths"):
        Scene(np.ones((2, 3, 4)), np.ones((3, 31)), GRID)
    with pytest.raises(InputError, match=r"\(wavelengths,\)"):
        Scene.uniform(np.ones((2, 31)), GRID)


def test_mean_luminance_scales_radiance() -> None:
    scene = Scene.from_radiance(cube(), GRID)
    brighter = scene.with_mean_luminance(3 * scene.mean_luminance_cd_m2())
    assert brighter.radiance(1, 1) == pytest.approx(3 * scene.radiance(1, 1), rel=1e-6)
    with pytest.raises(InputError, match="without light"):
        scene.scaled(0.0).with_mean_luminance(10)


def test_light_outside_is_the_share_of_the_response_beyond_the_grid() -> None:
    scene = Scene.uniform(np.ones(GRID.size), GRID)
    assert scene.light_outside([400, 700], [1, 1]) == 0.0
    assert scene.light_outside(np.arange(380.0, 781.0, 10), np.ones(41)) == pytest.approx(100 / 400, rel=1e-9)
    assert scene.light_outside([300, 900], [1, 1]) == pytest.approx(300 / 600, rel=1e-9)
    assert scene.light_outside([710, 720], [1, 1]) == 1.0
    assert scene.light_outside([550], [1]) == 0.0
