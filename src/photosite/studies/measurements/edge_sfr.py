"""Responses of edges under a Gaussian blur on square pixels."""

from __future__ import annotations

import numpy as np

from photosite.metrics.measurement import Result
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy, Truth
from photosite.studies.virtual_charts import kind_of_edge

LEVELS = {"mtf50": 0.5, "mtf50p": 0.5, "mtf30": 0.3, "mtf10": 0.1}


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    edge = kind_of_edge(random, number)
    values = {name: edge.crossing(level) for name, level in LEVELS.items()}
    values |= {"response_nyquist": edge.response(0.5), "edge_rise": edge.rise()}

    def truth(result: Result) -> Truth:
        parts = {part for _, part in result.values}
        return {(name, part): value for name, value in values.items() for part in parts if value is not None}

    return HiddenChart(edge.image, "slanted-edge", truth)


STUDY = MeasurementStudy(
    _draw,
    "blur 0.3 to 1.2 pixels, 2.5 to 9 degrees, contrast 2 to 20, 300 to 20 000 electrons, bent by up to "
    "2 pixels, light that changes by up to 20 %, mosaics",
)
