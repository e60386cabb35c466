"""Visual noise of white noise on even gray, in closed form."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.chart_image import chart_image
from photosite.metrics.charts.placed_chart import PlacedChart, placed_chart
from photosite.metrics.visual.viewing import luminance_sensitivity, pixels_per_degree
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy

Array = NDArray[np.float64]

SHAPE = 528, 784
VIEWING = {"pitch_mm": 0.1, "distance_mm": 300.0}
_GRAY = 0.2


def even_chart() -> PlacedChart:
    """Return a ColorChecker that fills the picture."""
    return placed_chart(chart_image(np.ones(SHAPE)), "macbeth")


def noisy_picture(random: np.random.Generator, sigma: Array) -> Array:
    """Return an even gray picture with white noise; `sigma` (3,) is that of the channels, which are alike."""
    return _GRAY + random.normal(0.0, 1.0, (*SHAPE, 1)) * np.asarray(sigma)


def visible_lightness(sigma: float) -> float:
    """Return the closed form of sigma L*: L* has the slope of its definition."""
    rows, cols = even_chart().patches[0].inside().shape
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(rows), np.fft.fftfreq(cols), indexing="ij"))
    weight = luminance_sensitivity(f * pixels_per_degree(VIEWING["pitch_mm"], VIEWING["distance_mm"])) / 3.0
    slope: float = 116.0 / 3.0 * _GRAY ** (-2.0 / 3.0)
    return sigma * math.sqrt(float(np.mean(weight**2))) * slope


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    sigma = 10 ** random.uniform(-3.0, -2.2)
    lightness = visible_lightness(sigma)
    truth = {
        ("sigma_lightness", ""): lightness,
        ("visual_noise_2013", ""): 3.0 * lightness,
        ("visual_noise_cpiq", ""): math.log10(1 + 23.0 * lightness**2),
    }
    return HiddenChart(noisy_picture(random, np.full(3, sigma)), "macbeth", truth, VIEWING)


STUDY = MeasurementStudy(_draw, "white noise of 0.1 to 0.6 % of white on gray; even light, no lens")
