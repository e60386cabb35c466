"""Responses of dead leaves under a Gaussian blur on square pixels."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measurement import Result
from photosite.scene.scene_request import SceneRequest
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy, Truth
from photosite.studies.virtual_charts import RGGB, blurred, response
from photosite.values.cfa import MONOCHROME

CELLS, SIDE = 3, 240
OPTIONS = {
    "rows": CELLS * SIDE,
    "cols": CELLS * SIDE,
    "smallest_radius": 2.0,
    "largest_radius": 100.0,
    "supersampling": 4,
}


@cache
def leaves() -> NDArray[np.float64]:
    """Return the samples of the chart, which are squares."""
    return np.asarray(SceneRequest("dead-leaves", OPTIONS).scene().weights[0].astype(np.float64))


def mtf50_of(sigma: float) -> float:
    """Return the frequency at which the blur times the pixel is 0.5."""
    return float(brentq(lambda f: float(response(np.array(f), sigma)) - 0.5, 0.05, 0.9))


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    sigma = random.uniform(0.6, 1.2)
    light = 1.0 + random.uniform(-0.1, 0.1) * (number % 2) * np.linspace(-1, 1, SIDE)
    mean = 10 ** random.uniform(2.3, 3.7) * light * np.maximum(blurred(leaves(), CELLS, sigma, squares=True), 0.0)
    frames = tuple(random.poisson(mean) + random.normal(0.0, 5.0, mean.shape) for _ in range(2))
    off = random.uniform(0.0, 1.0, (4, 2))
    inwards = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    corners = tuple(map(tuple, np.array([(0, 0), (0, SIDE), (SIDE, SIDE), (SIDE, 0)]) + inwards * off))
    image = ChartImage(frames, "raw", RGGB if number % 4 >= 2 else MONOCHROME, white=1e5)

    def truth(result: Result) -> Truth:
        return {key: mtf50_of(sigma) for key in result.values}

    return HiddenChart(image, "dead-leaves", truth, placing={"chart_options": OPTIONS, "corners": corners})


STUDY = MeasurementStudy(
    _draw,
    "blur 0.6 to 1.2 pixels, corners off by up to a pixel, 200 to 5000 electrons, uneven light, mosaics, 2 frames",
)
