"""Overlap of exposures with the steps of a running light, in closed form."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.chart_image import ChartImage
from photosite.scene.scene_request import SceneRequest, chart_options
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy

Array = NDArray[np.float64]

STEP_MS, STATED_S = 0.5, 2e-3
WHITE_E = 5e4
_UNEQUAL = 0.01


@cache
def lit_lamps() -> Array:
    """Return the chart, 1 in its lamps."""
    light = SceneRequest("led-bar", {}).scene().weights[0].astype(np.float64)
    return np.asarray(light / light.max())


def unequal_lamps(random: np.random.Generator) -> Array:
    """Return (lines, lamps) relative lights."""
    shape = chart_options("led-bar")
    return 1.0 + random.normal(0.0, _UNEQUAL, (shape["lines"], shape["lamps"]))


def running_light(random: np.random.Generator, exposure: float, per_row: float, lamps: Array) -> Array:
    """Return a frame that begins at any time; times are in steps, those of the rows `per_row` apart."""
    lines, count = lamps.shape
    chart = lit_lamps()
    rows, cols = chart.shape
    start = (random.uniform(0.0, count) + per_row * (np.arange(rows) + 0.5)) % count
    number = np.arange(count)
    part = np.zeros((rows, count))
    for turn in (-count, 0, count):
        ends = np.minimum(number + 1 + turn, start[:, None] + exposure), np.maximum(number + turn, start[:, None])
        part += np.maximum(ends[0] - ends[1], 0.0)
    light = part * lamps.repeat(rows // lines, axis=0)
    mean = 100.0 + 8000.0 * chart * light.repeat(cols // count, axis=1)
    return np.asarray(random.poisson(mean) + random.normal(0.0, 5.0, mean.shape))


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    exposure, per_row = random.uniform(3.2, 13.0), random.uniform(-0.005, 0.01)
    lamps = unequal_lamps(random)
    frames = tuple(running_light(random, exposure, per_row, lamps) for _ in range(4 if number % 2 else 1))
    truth = {
        ("exposure_ms", ""): exposure * STEP_MS,
        ("exposure_error_percent", ""): 100.0 * (1e-3 * exposure * STEP_MS / STATED_S - 1.0),
        ("lamps_lit", ""): exposure,
        ("line_time_us", ""): 1e3 * per_row * STEP_MS,
    }
    image = ChartImage(frames, "raw", white=WHITE_E, exposure_s=STATED_S)
    return HiddenChart(image, "led-bar", truth, {"step_ms": STEP_MS})


STUDY = MeasurementStudy(_draw, "3 to 13 lamps lit, lines of either direction, lamps that differ by 1 %, 1 or 4 frames")
