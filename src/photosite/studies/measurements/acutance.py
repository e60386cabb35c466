"""Acutance and square-root integral of a Gaussian blur on square pixels."""

from __future__ import annotations

import numpy as np

from photosite.metrics.measurement import Result
from photosite.metrics.visual.acutance import acutance, square_root_integral
from photosite.metrics.visual.viewing import pixels_per_degree
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy, Truth
from photosite.studies.virtual_charts import kind_of_edge

_PITCH_MM, _DISTANCE_MM, _LUMINANCE_CD_M2, _WIDTH_DEG = 0.1, 300.0, 100.0, 40.0


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    edge = kind_of_edge(random, number)
    frequency = np.linspace(0.0, 0.5, 501)
    response = np.array([edge.response(f) for f in frequency])
    cpd = frequency * pixels_per_degree(_PITCH_MM, _DISTANCE_MM)
    values = {
        "acutance": acutance(cpd, response)[0],
        "sqri": square_root_integral(cpd, response, _LUMINANCE_CD_M2, _WIDTH_DEG)[0],
    }

    def truth(result: Result) -> Truth:
        return {(name, part): values[name] for name, part in result.values}

    options = {"pitch_mm": _PITCH_MM, "distance_mm": _DISTANCE_MM}
    return HiddenChart(edge.image, "slanted-edge", truth, options)


STUDY = MeasurementStudy(_draw, "as for edge-sfr")
