"""Even fields, dots and flare of known image quality, by plain NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VirtualField:
    """An even field with falloff and a gradient of its own in each channel of an RGGB mosaic, with noise and PRNU."""

    electrons: Array
    falloff: dict[str, Array]
    level: dict[str, float]

    def relative(self, channel: str, row: Array, col: Array) -> Array:
        """Return the light of a channel at rows and columns, relative to the middle of the frame."""
        a, b, down, along = self.falloff[channel]
        rows, cols = self.electrons.shape
        y, x = row[:, None] / rows - 0.5, col / cols - 0.5
        square = (x**2 * cols**2 + y**2 * rows**2) / (rows**2 + cols**2) * 4.0
        return np.asarray(1.0 - a * square - b * square**2 + down * y + along * x)


def virtual_field(random: np.random.Generator, *, even: bool = False) -> VirtualField:
    """Return a field of random falloff and light; without falloff if even."""
    rows, cols = 180, 240
    common = np.array([random.uniform(0, 0.4), random.uniform(0, 0.2), *random.uniform(-0.1, 0.1, 2)])
    falloff = {name: (common + random.normal(0, 0.02, 4)) * (not even) for name in "RGB"}
    bright = 10 ** random.uniform(2.7, 4.2)
    field = VirtualField(np.empty((rows, cols)), falloff, {"R": 0.5 * bright, "G": bright, "B": 0.6 * bright})
    prnu = random.normal(1.0, random.uniform(0.002, 0.01), (rows, cols))
    for r, c, name in ((0, 0, "R"), (0, 1, "G"), (1, 0, "G"), (1, 1, "B")):
        y, x = np.arange(rows, dtype=np.float64) + 0.5, np.arange(cols, dtype=np.float64) + 0.5
        mean = field.level[name] * field.relative(name, y[r::2], x[c::2]) * prnu[r::2, c::2]
        field.electrons[r::2, c::2] = random.poisson(mean) + random.normal(0.0, 4.0, mean.shape)
    return field


@dataclass(frozen=True)
class VirtualDots:
    """Gaussian dots of a tilted chart under radial distortion, on an RGGB mosaic with noise.

    The distortion is k1 r^2 + k2 r^4 of the ideal image height r in half diagonals; `shift_px` is the lateral color of
    a channel at the corner, in proportion to the height.
    """

    electrons: Array
    coefficients: tuple[float, float]
    shift_px: dict[str, float]

    def distortion(self, height: Array) -> Array:
        """Return real over ideal image height less one."""
        return np.asarray(self.coefficients[0] * height**2 + self.coefficients[1] * height**4)


def virtual_dots(random: np.random.Generator) -> VirtualDots:
    """Return dots of random pose, distortion, lateral color, blur and light."""
    rows, cols = 320, 432
    half = float(np.hypot(rows, cols)) / 2
    k1, k2 = random.uniform(-0.08, 0.08), random.uniform(-0.03, 0.03)
    shift = {"R": random.uniform(-1, 1), "G": 0.0, "B": random.uniform(-1, 1)}
    y, x = np.mgrid[-6:7, -8:9].reshape(2, -1) * 27.0 / half
    turn = random.uniform(-0.03, 0.03)
    y, x = y * np.cos(turn) + x * np.sin(turn), x * np.cos(turn) - y * np.sin(turn)
    scale = 1 + random.uniform(-0.05, 0.05) * y + random.uniform(-0.05, 0.05) * x
    y, x = y / scale + random.uniform(-0.01, 0.01), x / scale + random.uniform(-0.01, 0.01)
    square = y**2 + x**2
    stretch = 1 + k1 * square + k2 * square**2
    sigma, bright = random.uniform(1.8, 3.0), 10 ** random.uniform(2.7, 4.0)
    mean = np.full((rows, cols), 30.0)
    for r, c, name in ((0, 0, "R"), (0, 1, "G"), (1, 0, "G"), (1, 1, "B")):
        color = stretch * (half + shift[name])
        down, along = np.arange(r, rows, 2) + 0.5 - rows / 2, np.arange(c, cols, 2) + 0.5 - cols / 2
        vertical, horizontal = (
            np.exp(-0.5 * ((places[:, None] - at * color) / sigma) ** 2) for places, at in ((down, y), (along, x))
        )
        mean[r::2, c::2] += bright * vertical @ horizontal.T
    noisy = random.poisson(mean) + random.normal(0.0, 3.0, mean.shape)
    return VirtualDots(noisy, (k1, k2), shift)
