"""Scenes reduced to few spectra: negative values within the reduction error become 0, larger ones are an error."""

from __future__ import annotations

import numpy as np
import pytest

import photosite as ps
from photosite.errors import InputError

GRID = np.arange(400.0, 701, 10)


def rare_colours() -> np.ndarray:
    """Return a scene of smooth spectra with few points of narrow spectra on black."""
    rng = np.random.default_rng(0)
    wide = np.exp(-(((GRID - 600) / 120) ** 2)), np.exp(-(((GRID - 520) / 60) ** 2))
    radiance = rng.uniform(0.2, 1, (200, 300, 1)) * wide[0] + rng.uniform(0, 0.3, (200, 300, 1)) * wide[1]
    radiance[80:120] = 0
    for k in range(12):
        radiance[100, 20 + 22 * k] = np.exp(-(((GRID - 410 - 22 * k) / 8) ** 2))
    return 1e15 * radiance


@pytest.fixture
def camera() -> ps.Camera:
    sensor = ps.load_sensor("nikon-d200").with_(rows=200, cols=300)
    return ps.Camera(ps.DiffractionLimited(f_number=2, focal_length_mm=50), sensor)


def test_negative_values_within_the_reduction_error_become_0(camera: ps.Camera) -> None:
    whole = camera.mean_electrons(ps.Scene.from_radiance(rare_colours(), GRID, tolerance=1e-6), 0.1)
    scene = ps.Scene.from_radiance(rare_colours(), GRID, tolerance=1e-2)
    again = np.einsum("kij,kl->ijl", scene.weights[:, 90:110], scene.basis)
    assert again.min() < -1e13  # there is something below 0 to be dealt with
    mean = camera.mean_electrons(scene, 0.1)
    assert mean.min() == 0.0
    assert np.sqrt(((mean - whole) ** 2).mean() / (whole**2).mean()) < 2 * scene.relative_error


def test_negative_light_beyond_the_reduction_error_is_an_error(camera: ps.Camera) -> None:
    weights = np.ones((1, 200, 300), np.float32)
    weights[0, :20] = -0.1
    scene = ps.Scene(weights, np.full((1, GRID.size), 1e15), GRID, relative_error=1e-3)
    with pytest.raises(InputError, match="radiance is negative in places"):
        camera.mean_electrons(scene, 0.1)
