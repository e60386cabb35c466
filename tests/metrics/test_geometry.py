"""Distortion and lateral color: distortion put into a lens, and frames without dots."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.optics.distortion import Distortion

RGGB = (("R", "G"), ("G", "B"))
BOTH = ["distortion", "lateral-color"]


def test_distortion_of_a_lens() -> None:
    """A barrel of 2.2 % put into a lens comes back within 0.005 % from a frame without noise."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=432, cols=648)
    lens = ps.Lens(ps.DiffractionLimited(8, 5), distortion=Distortion.polynomial(-0.15, max_field_deg=35))
    chart: dict[str, Any] = {"pitch": 32, "diameter": 12.0}
    scene = ps.charts.point_grid("D65", 40, **chart)
    image = ps.Camera(lens, sensor).mean_electrons(scene, exposure_s=1.0)
    whole = ChartImage((image,), "electrons", sensor.array.cfa)
    found = measure(whole, "point-grid", only=["distortion"], chart_options=chart)["distortion"]
    curve = found.curves[0]
    half_m = np.hypot(432, 648) / 2 * float(sensor.pixel.width_um) * 1e-6
    tangent = curve.x * half_m / lens.image_distance_m(scene.distance_m)
    assert (found["distortion_percent"].value or 0) < -1.0
    np.testing.assert_allclose(curve.y, -15.0 * tangent**2, atol=0.005)


def test_frames_without_dots_are_refused() -> None:
    random = np.random.default_rng(6)
    even = random.poisson(np.full((320, 432), 1000.0)).astype(float)
    for name in BOTH:
        with pytest.raises(InputError):
            measure(ChartImage((even,), "electrons", RGGB), "point-grid", only=[name])[name]
