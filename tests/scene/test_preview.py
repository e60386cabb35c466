"""Previews of scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.scene.scene import preview


@pytest.mark.parametrize("light", ["A", "D65", 2000, "F11"])
def test_white_and_gray_patches_look_gray_under_any_light(light: str | float) -> None:
    """The brightest 1 % is the white patch, which reflects evenly to 4 %; the chart's mean is redder than its light."""
    chart = ps.charts.macbeth(light, 40)
    seen = preview(chart)
    for name in ("white", "neutral 6.5", "neutral 3.5"):
        part = next(region for region in chart.regions if region.name == name)
        assert np.ptp(seen[part.r0, part.c0]) < 0.03, name


def test_without_reflectances_the_mean_replaces_the_light() -> None:
    chart = ps.charts.macbeth("A", 40)
    bare = replace(chart, reflectance=None)
    assert np.abs(preview(bare) - preview(chart)).max() > 0.05
    gray = ps.charts.checkerboard("A", 40, rows=16, cols=16, square=4)
    np.testing.assert_allclose(preview(replace(gray, reflectance=None)), preview(gray), atol=2e-3)


def test_preview_of_few_bright_points() -> None:
    points = ps.charts.point_grid("A", 40)
    assert float(np.quantile(points.weights, 0.99)) == 0.0
    seen = preview(points)
    assert seen.max() == pytest.approx(1.0, abs=2e-3)
    assert np.array_equal(seen.max(axis=2) > 0.5, points.weights[0] > 0.5 * points.weights.max())
    with raises(InputError, "white_cd_m2", value=0.0):
        preview(points.scaled(0.0))
