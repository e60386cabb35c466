"""Ghosts and glare of a light source, in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from photosite.metrics.chart_image import ChartImage
from photosite.scene.scene_request import chart_options
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import RGGB

Array = NDArray[np.float64]

SHAPE = (512, 768)
_BLUR_PX = 1.5
_SOURCE = np.array([154.0, 230.0])
_Y, _X = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
_RADIUS = chart_options("light-source")["diameter"] * SHAPE[1] / chart_options("light-source")["cols"] / 2.0


def _away(middle: Array) -> Array:
    return np.asarray(np.hypot(_Y - middle[0], _X - middle[1]))


def lit_source(ghost: float, glare: float, slope: float, size: float = 1.0, signal: float = 40000.0) -> Array:
    """Return the light of a source, of its ghost, and of glare that changes along the rows."""
    source, mirrored = (
        ndtr((radius - _away(middle)) / _BLUR_PX)
        for radius, middle in ((_RADIUS, _SOURCE), (size * _RADIUS, np.array(SHAPE) - _SOURCE))
    )
    return np.asarray(signal * (source + ghost * mirrored + glare * (1 + slope * (_X / SHAPE[1] - 0.5))))


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    ghost, glare = random.uniform(0, 3e-3) * (number % 4 > 0), random.uniform(1e-4, 5e-3)
    slope = random.uniform(-0.5, 0.5) * (number % 2)
    frame = random.poisson(lit_source(ghost, glare, slope)) + random.normal(0, 4, SHAPE)
    beside, at = (1 + slope * (col / SHAPE[1] - 0.5) for col in (SHAPE[1] - _SOURCE[1], _SOURCE[1]))
    values = {"ghost_percent": 100 * ghost / (1 + glare * at), "glare_percent": 100 * glare * beside / (1 + glare * at)}
    truth = {(name, channel): value for name, value in values.items() for channel in "RGB"}
    return HiddenChart(ChartImage((frame,), "raw", RGGB, white=60000.0), "light-source", truth)


STUDY = MeasurementStudy(_draw, "ghosts of 0 to 0.3 %, glare of 0.01 to 0.5 % that changes by up to half, mosaics")
