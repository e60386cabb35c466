"""Images of charts with known image quality, by plain NumPy: no code of the simulator or of the measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

Array = NDArray[np.float64]
_CELLS = 5


@dataclass(frozen=True)
class VirtualEdge:
    """An edge under a Gaussian blur on square pixels, with shot and read noise."""

    electrons: Array
    sigma_px: float
    angle_rad: float

    def response(self, frequency: float) -> float:
        """Return the response across the edge: the Gaussian times the pixel."""
        blur = math.exp(-2.0 * (math.pi * self.sigma_px * frequency) ** 2)
        across = np.sinc(frequency * math.cos(self.angle_rad)) * np.sinc(frequency * math.sin(self.angle_rad))
        return blur * float(across)

    def crossing(self, level: float) -> float | None:
        """Return the frequency at which the response is a level; None if that is above 1 cycle/pixel."""
        if self.response(0.999) > level:
            return None
        return float(brentq(lambda frequency: self.response(frequency) - level, 1e-6, 0.999))


def virtual_edge(random: np.random.Generator, *, bent: bool = False, uneven: bool = False) -> VirtualEdge:
    """Return an edge of random blur, angle, contrast and light; bent by distortion, under uneven light."""
    rows, cols = 100, 90
    sigma, angle = random.uniform(0.3, 1.2), math.radians(random.uniform(2.5, 9.0) * random.choice([-1, 1]))
    contrast, bright = random.uniform(2.0, 20.0), 10 ** random.uniform(2.5, 4.3)
    part = (np.arange(_CELLS) + 0.5) / _CELLS
    y, x = ((np.arange(size)[:, None] + part).ravel() for size in (rows, cols))
    at = cols / 2 + random.uniform(-3, 3) + math.tan(angle) * (y - rows / 2)
    if bent:
        at = at + random.uniform(-2, 2) * ((y - rows / 2) / (rows / 2)) ** 2
    distance = (x - at[:, None]) * math.cos(angle) * random.choice([-1, 1])
    step = ndtr(distance / sigma).reshape(rows, _CELLS, cols, _CELLS).mean(axis=(1, 3))
    mean = bright * (1 / contrast + (1 - 1 / contrast) * step)
    if uneven:
        along = random.uniform(-0.1, 0.1) * np.linspace(-1, 1, rows)[:, None]
        mean = mean * (1 + random.uniform(-0.1, 0.1) * np.linspace(-1, 1, cols) + along)
    return VirtualEdge(random.poisson(mean) + random.normal(0.0, 5.0, mean.shape), sigma, angle)
