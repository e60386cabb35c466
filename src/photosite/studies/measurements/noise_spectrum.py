"""Spectra of white and filtered noise, of fixed pattern and of row noise, in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from photosite.metrics.chart_image import ChartImage
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy

Array = NDArray[np.float64]


def filtered(random: np.random.Generator, sigma: float, side: float) -> Array:
    """Return white noise after the kernel (side, 1, side) / (1 + 2 side) along rows and columns."""
    kernel = np.array([side, 1.0, side]) / (1.0 + 2.0 * side)
    noise = random.normal(0.0, sigma, (260, 330))
    return np.asarray(convolve1d(convolve1d(noise, kernel, axis=0, mode="wrap"), kernel, axis=1, mode="wrap"))


def _power(frequency: Array, side: float) -> Array:
    return np.asarray(((1.0 + 2.0 * side * np.cos(2 * np.pi * frequency)) / (1.0 + 2.0 * side)) ** 2)


def _filtered_truth(sigma: float, side: float) -> dict[tuple[str, str], float]:
    """Return the closed forms on the grid of frequencies of a block of 64 samples."""
    f: Array = np.fft.fftfreq(64).astype(np.float64)
    grid = sigma**2 * _power(f, side)[:, None] * _power(f, side)
    radius = 2.0 * np.hypot(f[:, None], f)
    near = np.abs(np.rint(64 * f)) < 3
    axes = np.abs(np.rint(64 * f)) < 2
    plain = ~axes[:, None] & ~axes & ~(near[:, None] & near)
    low, high = (float(grid[plain & (radius > a) & (radius <= b)].mean()) for a, b in ((0.1, 0.25), (0.75, 1.0)))
    density = float(grid[plain].mean())
    return {("density", "M"): density, ("high_over_low", "M"): high / low, ("noise_area", "M"): low / density}


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    if number % 2:
        return _stack(random)
    side = 0.0 if number % 3 == 0 else random.uniform(-0.2, 0.4)
    sigma = 10 ** random.uniform(0, 2)
    tilt = np.linspace(0, random.uniform(-200, 200), 330)
    frame = 5000.0 + tilt + filtered(random, sigma, side)
    return HiddenChart(_raw([frame]), "uniform", _filtered_truth(sigma, side))


def _stack(random: np.random.Generator) -> HiddenChart:
    temporal, fixed, row = random.uniform(5, 20), random.uniform(10, 20), random.uniform(1, 4)
    pattern = random.normal(0, fixed, (200, 260))
    frames = [
        1000 + pattern + random.normal(0, temporal, pattern.shape) + random.normal(0, row, (200, 1)) for _ in range(4)
    ]
    truth = {
        ("density", "M, temporal"): temporal**2,
        ("density", "M, fixed"): fixed**2,
        ("row_noise", "M, temporal"): row,
        ("column_noise", "M, temporal"): 0.0,
    }
    return HiddenChart(_raw(frames), "uniform", truth)


def _raw(frames: list[Array]) -> ChartImage:
    return ChartImage(tuple(frames), "raw", black=0.0, white=1e6)


STUDY = MeasurementStudy(
    _draw, "one frame of white, smoothed or sharpened noise in uneven light; four of temporal noise, pattern and rows"
)
