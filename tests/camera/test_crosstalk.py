"""Gathered shares and angular response compared with loops over pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.camera.optical_stack import gathered, scale_by_angle


def plain(mosaic: NDArray[np.float64], fractions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Every pixel and neighbor; beyond the border, shifted by whole tiles into the frame."""
    (rows, cols), (period_r, period_c, size, _) = mosaic.shape, fractions.shape

    def back(index: int, length: int, period: int) -> int:
        while index < 0:
            index += period
        while index >= length:
            index -= period
        return index

    out = np.zeros_like(mosaic)
    for r, c in np.ndindex(rows, cols):
        for i, j in np.ndindex(size, size):
            source = back(r + i - size // 2, rows, period_r), back(c + j - size // 2, cols, period_c)
            out[r, c] += fractions[r % period_r, c % period_c, i, j] * mosaic[source]
    return out


@pytest.mark.parametrize(
    ("shape", "tile", "size"),
    [((12, 17), (1, 1), 3), ((9, 14), (2, 2), 5), ((7, 11), (3, 2), 3), ((6, 600), (2, 2), 5), ((6, 6), (6, 6), 9)],
)
def test_gathered_equals_the_sum_over_neighbours(shape: tuple[int, int], tile: tuple[int, int], size: int) -> None:
    rng = np.random.default_rng(3)
    mosaic, fractions = rng.random(shape), rng.random((*tile, size, size)) / size**2
    expected = plain(mosaic, fractions)
    assert np.abs(gathered(mosaic.astype(np.float32), fractions) - expected).max() < 3e-7 * expected.max() * size


@pytest.mark.parametrize("shape", [(2, 2), (3, 5), (1, 4), (2, 300)])
def test_frames_smaller_than_the_kernel(shape: tuple[int, int]) -> None:
    """One tile is enough: its pixels are their own neighbors."""
    tile = (min(shape[0], 2), 2)
    rng = np.random.default_rng(4)
    mosaic, fractions = rng.random(shape), rng.random((*tile, 7, 7)) / 49
    assert gathered(mosaic.astype(np.float32), fractions) == pytest.approx(plain(mosaic, fractions), rel=1e-5)


def test_angular_response_is_linear_between_angles() -> None:
    rng = np.random.default_rng(5)
    y, x = np.linspace(-0.8, 0.8, 24), np.linspace(-1.1, 1.1, 33)
    channel_of = np.array([[0, 1], [1, 2]])
    angle = np.radians([0, 5, 12, 30, 54])
    response = rng.random((3, 5))
    mosaic = np.ones((24, 33), np.float32)
    scale_by_angle(mosaic, y, x, channel_of, angle, response)
    for r, c in np.ndindex(mosaic.shape):
        expected = np.interp(math.atan(math.hypot(y[r], x[c])), angle, response[channel_of[r % 2, c % 2]])
        assert mosaic[r, c] == pytest.approx(expected, rel=1e-6)
