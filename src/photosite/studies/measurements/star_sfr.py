"""Responses of a sine star under a Gaussian blur on square pixels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measurement import Result
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy, Truth
from photosite.studies.virtual_charts import RGGB, blurred
from photosite.values.cfa import MONOCHROME

Array = NDArray[np.float64]

SIDE, CYCLES, _CELLS, _RADIUS = 280, 72, 5, 0.45
_DIRECTIONS = {"": None, "horizontal": 0.0, "falling diagonal": 0.25, "vertical": 0.5, "rising diagonal": 0.75}
"""Direction of the frequency in the middle of a sector, in half turns; None: all."""


def star_response(frequency: float, sigma: float, direction: float | None) -> float:
    """Return the mean over a sector, or over all directions, of a Gaussian blur times the pixel."""
    angle = np.pi * np.linspace(0.0, 0.5, 91) if direction is None else np.pi * (direction + np.linspace(-1, 1, 91) / 8)
    along = frequency * np.cos(angle), frequency * np.sin(angle)
    pixel = [np.sinc(each) / np.sinc(each / _CELLS) for each in along]
    return float(np.exp(-2.0 * (np.pi * sigma * frequency) ** 2) * (pixel[0] * pixel[1]).mean())


def star(sigma: float, *, turned_rad: float = 0.0, moved_px: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Return a star of full modulation and mean 0.5, turned and moved, as square pixels see it."""
    place: Array = (np.arange(SIDE * _CELLS) + 0.5) / _CELLS - SIDE / 2
    y, x = place[:, None] - moved_px[0], place - moved_px[1]
    angle = np.arctan2(x, -y) - turned_rad
    inside = np.hypot(y, x) < _RADIUS * SIDE
    light: Array = np.asarray(0.5 + 0.5 * inside * np.cos(CYCLES * angle), np.float64)
    return blurred(light, _CELLS, sigma)


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    sigma, moved = random.uniform(0.4, 1.1), random.uniform(-2.0, 2.0, 2)
    turned = random.uniform(-0.05, 0.05)
    light = 1.0 + random.uniform(-0.1, 0.1) * (number % 2) * np.linspace(-1, 1, SIDE)
    mean = 10 ** random.uniform(2.3, 3.7) * light * star(sigma, turned_rad=turned, moved_px=(moved[0], moved[1]))
    frame = random.poisson(np.maximum(mean, 0.0)) + random.normal(0.0, 5.0, mean.shape)
    image = ChartImage((frame,), "electrons", RGGB if number % 4 >= 2 else MONOCHROME)
    half = SIDE / 2
    turn = np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])
    square = np.array([(-half, -half), (-half, half), (half, half), (half, -half)]) * 0.94
    corners = tuple(map(tuple, square @ turn.T + half + moved))

    def truth(result: Result) -> Truth:
        values = {}
        for name, part in result.values:
            direction = _DIRECTIONS[part.partition(", ")[2]]
            level = {"mtf50": 0.5, "mtf10": 0.1}[name]
            found = brentq(lambda f, d=direction, at=level: star_response(f, sigma, d) - at, 1e-3, 1.4)
            values[name, part] = float(found)
        return values

    options = {"cycles": CYCLES, "rows": 3 * SIDE, "cols": 3 * SIDE, "patches": False}
    return HiddenChart(image, "siemens-star", truth, placing={"chart_options": options, "corners": corners})


STUDY = MeasurementStudy(
    _draw, "blur 0.4 to 1.1 pixels, turned by up to 3 degrees, 200 to 5000 electrons, uneven light, mosaics"
)
