"""Distortion of drawn dots."""

from __future__ import annotations

import numpy as np

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measurement import Result
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy, Truth
from photosite.studies.virtual_charts import RGGB
from photosite.studies.virtual_fields import virtual_dots


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    dots = virtual_dots(random)

    def truth(result: Result) -> Truth:
        height = float(result.curves[0].x[-1])
        rows, cols = np.array(dots.electrons.shape) / np.hypot(*dots.electrons.shape)
        local = dots.distortion(np.linspace(0, height, 2001))
        corner, middle, beside = dots.distortion(height * np.array([1.0, rows, cols]))
        values = {
            "distortion_percent": 100 * local[np.argmax(np.abs(local))],
            "tv_distortion_percent": 100 * ((1 + corner) / (1 + middle) - 1),
            "line_distortion_horizontal_percent": 100 * (corner - middle) * height * rows / (2 * rows),
            "line_distortion_vertical_percent": 100 * (corner - beside) * height * cols / (2 * rows),
        }
        return {(name, ""): float(value) for name, value in values.items()}

    return HiddenChart(ChartImage((dots.electrons,), "electrons", RGGB), "point-grid", truth)


STUDY = MeasurementStudy(
    _draw, "distortion of up to 10 %, tilt and rotation, lateral color, blur, 500 to 10 000 electrons, mosaics"
)
