"""Edges: areas against many points and other formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest

from photosite.scene import charts


def pointwise(rows: int, cols: int, cycles: int, angle_deg: float, fine: int = 64) -> np.ndarray:
    """Fractions of a star's bright sectors by many points."""
    up = rows / 2 - (np.arange(rows * fine) + 0.5) / fine
    right = (np.arange(cols * fine) + 0.5) / fine - cols / 2
    turn = (np.arctan2(right[None, :], up[:, None]) - math.radians(angle_deg)) * cycles / (2 * math.pi)
    return (np.mod(turn, 1.0) < 0.5).reshape(rows, fine, cols, fine).mean(axis=(1, 3))


@pytest.mark.parametrize("angle", [-12.0, 0.0, 5.0, 40.0])
def test_slanted_edge_holds_exact_areas(angle: float) -> None:
    """Against each sample's area on the bright side by 64 x 64 points."""
    edge = charts.slanted_edge(angle_deg=angle, contrast=math.inf, rows=14, cols=20)
    fine = 64
    y = (np.arange(14 * fine) + 0.5) / fine - 7
    x = (np.arange(20 * fine) + 0.5) / fine - 10
    bright = x[None, :] > -math.tan(math.radians(angle)) * y[:, None]
    area = bright.reshape(14, fine, 20, fine).mean(axis=(1, 3))
    np.testing.assert_allclose(edge.weights[0], area, rtol=0, atol=1.5 / fine)
    assert edge.weights[0].mean() == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize(("rows", "cols", "cycles", "angle"), [(24, 31, 4, 5.0), (17, 20, 1, -70.0), (30, 30, 7, 0.0)])
def test_edge_star_holds_areas(rows: int, cols: int, cycles: int, angle: float) -> None:
    star = charts.edge_star(contrast=math.inf, rows=rows, cols=cols, cycles=cycles, angle_deg=angle)
    wanted = pointwise(rows, cols, cycles, angle)
    np.testing.assert_allclose(star.weights[0], wanted, rtol=0, atol=2 / 64)
    assert star.weights[0].mean() == pytest.approx(wanted.mean(), abs=1e-3)


@pytest.mark.parametrize("angle", [5.0, -12.0, 40.0])
def test_a_star_of_one_cycle_is_one_edge(angle: float) -> None:
    """A line through the center, whose fractions have a closed form."""
    edge = charts.slanted_edge(angle_deg=angle, contrast=math.inf, rows=40, cols=40).weights[0]
    star = charts.edge_star(angle_deg=angle, contrast=math.inf, cycles=1, rows=40, cols=40).weights[0]
    assert np.abs(star - edge).max() < 5e-4


def test_the_star_has_edges_near_the_vertical_the_horizontal_and_the_diagonals() -> None:
    """Four cycles turned by 5 degrees: bright just clockwise of 5, 95, 185 and 275 degrees, dark before."""
    star = charts.edge_star(contrast=4.0, rows=200, cols=200)
    weights = star.weights[0]
    for turn in range(8):
        for side, wanted in ((1.0, 1.0 if turn % 2 == 0 else 0.25), (-1.0, 0.25 if turn % 2 == 0 else 1.0)):
            angle = math.radians(5 + 45 * turn + 3 * side)
            row, col = int(100 - 75 * math.cos(angle)), int(100 + 75 * math.sin(angle))
            assert weights[row, col] == pytest.approx(wanted, abs=1e-6), (turn, side)


def test_slanted_squares_hold_their_areas() -> None:
    """Squares of 40.5 samples; a sample with a side holds the fraction that 40 x 40 points give."""
    squares = charts.slanted_squares(down=2, across=3, side=0.45, contrast=math.inf, rows=180, cols=270, angle_deg=7.0)
    dark = 1.0 - squares.weights[0].astype(float) / squares.weights.max()
    assert dark.sum() == pytest.approx(6 * 40.5**2, rel=1e-4)
    fine = (np.arange(180 * 40) + 0.5) / 40
    row, col = 100, np.arange(90, 135)  # across the middle square of the second line
    y, x = fine[row * 40 : (row + 1) * 40, None] - 135.0, (np.arange(45 * 40) + 0.5) / 40 + 90 - 135.0
    turn = math.radians(7.0)
    inside = (np.abs(x * math.cos(turn) + y * math.sin(turn)) < 20.25) & (
        np.abs(y * math.cos(turn) - x * math.sin(turn)) < 20.25
    )
    points = inside.reshape(40, 45, 40).mean(axis=(0, 2))
    assert np.abs(dark[row, col] - points).max() < 0.02
