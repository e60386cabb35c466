"""Probability that pixels of Gaussian signals show the contrast of their patches."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.special import ndtr

from photosite.metrics.chart_image import ChartImage
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_patches import color_checker, patches_in_light, relative_luminances

_BLACK = 1e4
_TOLERANCE = 0.5


def _probability(dark: float, bright: float, noise: tuple[float, float], contrast: float) -> float:
    """Return how often the ratio of two Gaussian signals less 1 is within the tolerance of a contrast.

    The dark signal must be above 0.
    """
    low, high = (1.0 + contrast * (1.0 + side * _TOLERANCE) for side in (-1.0, 1.0))
    ends = max(dark - 8.0 * noise[0], 0.0), dark + 8.0 * noise[0]
    at, weight = leggauss(200)
    signal = 0.5 * (ends[1] - ends[0]) * (at + 1.0) + ends[0]
    density = np.exp(-0.5 * ((signal - dark) / noise[0]) ** 2) / (noise[0] * math.sqrt(2.0 * math.pi))
    inside = ndtr((high * signal - bright) / noise[1]) - ndtr((low * signal - bright) / noise[1])
    return float(0.5 * (ends[1] - ends[0]) * weight @ (density * inside))


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    brightest, floor = 10 ** random.uniform(2.3, 3.5), random.uniform(2.0, 10.0)
    clean = patches_in_light(brightest)
    sigma = np.sqrt(clean + floor**2)
    frame = clean + sigma * random.normal(size=clean.shape) + _BLACK
    chart = color_checker()
    gray = [
        (patch.name, y) for (patch, y), known in zip(relative_luminances().items(), chart.gray, strict=True) if known
    ]
    truth = {}
    for (dark_name, one), (bright_name, other) in pairwise(sorted(gray, key=lambda each: each[1])):
        dark, bright = brightest * one, brightest * other
        noise = math.sqrt(dark + floor**2), math.sqrt(bright + floor**2)
        truth["probability", f"M, {dark_name} and {bright_name}"] = _probability(dark, bright, noise, other / one - 1.0)
    return HiddenChart(ChartImage((frame,), "raw", black=_BLACK, white=1e6), "macbeth", truth)


STUDY = MeasurementStudy(_draw, "200 to 3200 electrons, read noise 2 to 10 electrons, probabilities of 0 to 1")
