"""Information capacity of a Gaussian blur and white noise."""

from __future__ import annotations

import numpy as np

from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import virtual_edge

_READ_NOISE_E = 5.0


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    edge = virtual_edge(random, bent=number % 2 == 1)
    dark, bright = edge.levels
    frequency = np.linspace(0.0, 0.5, 2001)
    response = np.array([edge.response(f) for f in frequency])
    noise = (dark + bright) / 2 + _READ_NOISE_E**2
    power = (bright - dark) ** 2 / 12.0
    integrand = np.log2(1.0 + power * response**2 / noise) * 2 * np.pi * frequency
    truth = {
        ("capacity", "M"): float(np.trapezoid(integrand, frequency)),
        ("neq_zero", "M"): ((dark + bright) / 2) ** 2 / noise,
    }
    return HiddenChart(edge.image, "slanted-edge", truth)


STUDY = MeasurementStudy(_draw, "as for edge-sfr, in even light, of one channel")
