"""Soft dark spots put into even fields."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.chart_image import ChartImage
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import RGGB

Array = NDArray[np.float64]
SHAPE = (480, 640)


def spotted(random: np.random.Generator, spots: list[tuple[float, float, float, float]], level: float) -> Array:
    """Return a field with falloff and spots of (row, col, radius, depth), flat inside of half the radius."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    light = 1.0 - 0.2 * (((y - 240) / 400) ** 2 + ((x - 320) / 400) ** 2)
    for row, col, radius, depth in spots:
        away = np.hypot(y - row, x - col) / radius
        light *= 1.0 - depth * np.clip(1.5 - away, 0.0, 1.0)
    channel = np.where((np.indices(SHAPE).sum(axis=0) % 2) == 1, 1.0, 0.6)
    return np.asarray(random.poisson(level * light * channel) + random.normal(0, 3, SHAPE))


def random_spots(random: np.random.Generator, count: int) -> list[tuple[float, float, float, float]]:
    """Return spots that do not touch: row, col, radius and depth."""
    cells = random.choice(12, count, replace=False)
    return [
        (
            80.0 + 160 * (cell // 4) + random.uniform(-20, 20),
            80.0 + 160 * (cell % 4) + random.uniform(-20, 20),
            random.uniform(10, 13),
            random.uniform(0.04, 0.1),
        )
        for cell in cells
    ]


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    spots = random_spots(random, 1 + number % 3)
    frame = spotted(random, spots, 10 ** random.uniform(3.7, 4.3))
    truth = {("deepest_percent", ""): 100 * max(spot[3] for spot in spots)}
    return HiddenChart(ChartImage((frame,), "raw", RGGB, black=0.0, white=1e6), "uniform", truth)


STUDY = MeasurementStudy(_draw, "one to three spots of 4 to 10 % and 10 to 13 pixels, with falloff, in mosaics")
