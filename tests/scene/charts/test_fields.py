"""Plain fields: means over samples, and the luminance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from photosite.scene import charts
from photosite.scene.charts import coverage


def test_uniform_has_the_given_luminance() -> None:
    assert charts.uniform("FL2", 7.0).mean_luminance_cd_m2() == pytest.approx(7.0, rel=1e-12)


def test_a_linear_ramp_has_equal_steps_and_a_logarithmic_one_equal_factors() -> None:
    linear = charts.ramp(contrast=100.0, rows=2, cols=40).weights[0, 1].astype(np.float64)
    assert np.diff(linear) == pytest.approx(np.full(39, 0.99 / 40), rel=1e-5)
    logarithmic = charts.ramp(contrast=1e6, logarithmic=True, rows=2, cols=40).weights[0, 1].astype(np.float64)
    assert logarithmic[1:] / logarithmic[:-1] == pytest.approx(np.full(39, 10 ** (6 / 40)), rel=1e-6)


def test_a_logarithmic_ramp_is_the_mean_over_each_sample() -> None:
    """Against 4000 points a sample; the integral of the whole has a closed form, (1 - 1/c) / ln c."""
    line = charts.ramp(contrast=50.0, logarithmic=True, rows=1, cols=5).weights[0, 0]
    points = 50.0 ** ((np.arange(20_000) + 0.5) / 20_000 - 1)
    assert line == pytest.approx(points.reshape(5, 4000).mean(axis=1), rel=1e-6)
    assert line.mean() == pytest.approx((1 - 1 / 50) / math.log(50), rel=1e-6)


def test_a_checkerboard_of_any_size_holds_exact_shares() -> None:
    """Squares of 2.75 samples against 64 x 64 points a sample, whose borders are on quarters: exact too."""
    board = charts.checkerboard(square=2.75, contrast=math.inf, rows=12, cols=17).weights[0]
    fine = 64
    row, col = ((np.arange(count * fine) + 0.5) / fine // 2.75 for count in (12, 17))
    points = ((row[:, None] + col[None, :]) % 2 == 0).reshape(12, fine, 17, fine).mean(axis=(1, 3))
    np.testing.assert_allclose(board, points, rtol=0, atol=1e-6)


def test_discs_cover_the_area_of_circles() -> None:
    """The whole is pi R^2; single samples against 400 x 400 points."""
    share = coverage.disc(11, 13, 5.3, 6.9, 3.7)
    assert share.sum() == pytest.approx(math.pi * 3.7**2, rel=1e-12)
    fine = 400
    row, col = ((np.arange(count * fine) + 0.5) / fine for count in (11, 13))
    inside = (row[:, None] - 5.3) ** 2 + (col[None, :] - 6.9) ** 2 < 3.7**2
    np.testing.assert_allclose(share, inside.reshape(11, fine, 13, fine).mean(axis=(1, 3)), rtol=0, atol=1e-3)
    tiny = coverage.disc(3, 3, 1.5, 1.5, 0.1)
    assert tiny[1, 1] == pytest.approx(math.pi * 0.01, rel=1e-12)
    assert tiny.sum() == pytest.approx(tiny[1, 1], rel=1e-12)


@pytest.mark.parametrize(("pitch", "diameter"), [(16, 5.0), (16, 16.0), (15, 0.4), (15, 15.0)])
def test_points_are_complete_and_on_their_grid(pitch: int, diameter: float) -> None:
    grid = charts.point_grid(pitch=pitch, diameter=diameter, rows=6 * pitch, cols=4 * pitch).weights[0]
    assert grid.sum() == pytest.approx(24 * math.pi * diameter**2 / 4, rel=1e-6)
    assert (grid[: 2 * pitch, :pitch] == grid[pitch : 3 * pitch, pitch : 2 * pitch]).all()
    # Symmetric round the sample in the middle of the field.
    middle = grid[
        3 * pitch - pitch // 2 : 3 * pitch + pitch // 2 + 1, 2 * pitch - pitch // 2 : 2 * pitch + pitch // 2 + 1
    ]
    np.testing.assert_allclose(middle, middle[::-1, ::-1], rtol=0, atol=1e-6)


def test_points_of_one_sample() -> None:
    grid = charts.point_grid(pitch=10, rows=35, cols=41, contrast=100).weights[0]
    assert grid[17, 20] == grid[7, 30] == 1.0
    assert (grid == 1.0).sum() == 3 * 5  # rows 7, 17, 27; columns 0, 10, .. 40
    assert grid.min() == pytest.approx(0.01)
