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
    field = VirtualField(np.empty((rows, cols)), falloff)
    bright = 10 ** random.uniform(2.7, 4.2)
    prnu = random.normal(1.0, random.uniform(0.002, 0.01), (rows, cols))
    for r, c, name, level in ((0, 0, "R", 0.5), (0, 1, "G", 1.0), (1, 0, "G", 1.0), (1, 1, "B", 0.6)):
        y, x = np.arange(rows, dtype=np.float64) + 0.5, np.arange(cols, dtype=np.float64) + 0.5
        mean = level * bright * field.relative(name, y[r::2], x[c::2]) * prnu[r::2, c::2]
        field.electrons[r::2, c::2] = random.poisson(mean) + random.normal(0.0, 4.0, mean.shape)
    return field
