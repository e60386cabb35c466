"""Values below 0 beside a blurred point, and negative light, which is an error."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError


@pytest.mark.parametrize(("blades", "distance_m"), [(0, 1.5), (3, 5.0)])
def test_defocused_point_on_black_is_not_negative(blades: int, distance_m: float) -> None:
    """Rounding of the transforms beside a wide, dim image is not an error, and light is conserved."""
    lens = ps.Lens(
        ps.DiffractionLimited(2.8, 50), ps.optics.Wavefront(pupil=ps.optics.Pupil(blades=blades)), focus_distance_m=2.0
    )
    grid = np.array([400.0, 550.0, 700.0])
    weights = np.zeros((1, 128, 192), np.float32)
    weights[0, 64, 96] = 1.0
    mono = {"cfa": "mono", "channels": {"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}}}
    camera = ps.Camera(lens, ps.load_sensor("nikon-d200").with_(rows=128, cols=192, **mono))
    spectrum = np.full(grid.size, 1e16)
    even = camera.mean_electrons(ps.Scene.uniform(spectrum, grid, distance_m), 0.01)[0, 0]
    mean = camera.mean_electrons(ps.Scene(weights, spectrum[None], grid, distance_m), 0.01)
    assert mean.min() >= 0
    assert mean.max() < 0.02 * even
    assert mean.sum(dtype=np.float64) == pytest.approx(even, rel=0.01)


def test_negative_light_is_an_error_for_any_blur() -> None:
    lens = ps.Lens(
        ps.DiffractionLimited(2.8, 50), ps.optics.Wavefront(pupil=ps.optics.Pupil(blades=6)), focus_distance_m=2.0
    )
    grid = np.arange(400.0, 701.0, 100)
    weights = np.ones((1, 64, 96), np.float32)
    weights[0, 30:34, 40:44] = -1.0
    camera = ps.Camera(lens, ps.load_sensor("nikon-d200").with_(rows=64, cols=96))
    with raises(InputError, "the scene's radiance is negative"):
        camera.mean_electrons(ps.Scene(weights, np.full((1, grid.size), 1e16), grid, 2.0), 0.01)
