"""Lateral color of drawn dots."""

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
        height = {curve.part: float(curve.x[-1]) for curve in result.curves}
        half = float(np.hypot(*dots.electrons.shape)) / 2
        shift = {part: dots.shift_px[part[0]] * at for part, at in height.items()}
        return {("displacement_px", part): value for part, value in shift.items()} | {
            ("displacement_percent", part): 100.0 * value / half for part, value in shift.items()
        }

    return HiddenChart(ChartImage((dots.electrons,), "electrons", RGGB), "point-grid", truth)


STUDY = MeasurementStudy(_draw, "the dots of `distortion`, displaced by up to a pixel in red and blue")
