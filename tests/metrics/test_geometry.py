"""Distortion and lateral color: coverage against drawn dots, distortion put into a lens, and frames without dots."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from virtual_fields import virtual_dots

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.optics.distortion import Distortion

RGGB = (("R", "G"), ("G", "B"))
CHARTS = 30
BOTH = ["distortion", "lateral-color"]


def test_intervals_hold_the_truth() -> None:
    """Of 30 charts, 95 % intervals miss more than 5 in 1 of 300 runs; half as wide ones miss about 10."""
    random = np.random.default_rng(4)
    missed: dict[str, int] = {}
    for _ in range(CHARTS):
        dots = virtual_dots(random)
        found = measure(ChartImage((dots.electrons,), "electrons", RGGB), "point-grid", only=BOTH)
        distortion, color = found["distortion"], found["lateral-color"]
        height = float(distortion.curves[0].x[-1])
        rows, cols = np.array(dots.electrons.shape) / np.hypot(*dots.electrons.shape)
        local = dots.distortion(np.linspace(0, height, 2001))
        corner, middle, beside = dots.distortion(height * np.array([1.0, rows, cols]))
        truth = {
            "distortion_percent": 100 * local[np.argmax(np.abs(local))],
            "tv_distortion_percent": 100 * ((1 + corner) / (1 + middle) - 1),
            "line_distortion_vertical_percent": 100 * (corner - beside) * height * cols / (2 * rows),
        }
        values = [(name, value, distortion[name]) for name, value in truth.items()]
        for part, curve in zip(("R - G", "B - G"), color.curves, strict=True):
            values.append((part, dots.shift_px[part[0]] * curve.x[-1], color["displacement_px", part]))
        for name, value, estimate in values:
            low, high = estimate.interval_95 or (np.nan, np.nan)
            missed[name] = missed.get(name, 0) + (not low <= value <= high)
    assert max(missed.values()) <= 5, missed


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
