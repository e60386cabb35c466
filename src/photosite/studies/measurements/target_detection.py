"""Detection of targets under a Gaussian blur and white noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import j1, ndtr

from photosite.studies.measurement_study import HiddenChart, MeasurementStudy

Array = NDArray[np.float64]

CONTRAST, DIAMETER_PX = 0.1, 6.0


def noisy_edge(random: np.random.Generator, sigma: float, dark: float, bright: float, noise: float) -> Array:
    """Return an edge under a Gaussian blur, sampled at points, with white noise."""
    y, x = np.mgrid[:240, :220] + 0.5
    angle = math.radians(random.uniform(3, 8))
    step = ndtr(((x - 110) * math.cos(angle) + (y - 120) * math.sin(angle)) / sigma)
    return np.asarray(dark + (bright - dark) * step + random.normal(0, noise, x.shape))


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    sigma, dark = random.uniform(0.8, 1.6), random.uniform(100, 1000)
    bright = dark * random.uniform(2, 10)
    noise = (bright + dark) * random.uniform(0.005, 0.03)
    level = (bright + dark) / 2
    # Spots wider than pixels need no frequency above 0.5 cycles/pixel.
    spot = DIAMETER_PX / 2
    gaussian = CONTRAST * level / noise * math.sqrt(math.pi * spot**4 / (spot**2 + sigma**2))
    f = np.linspace(1e-6, 0.5, 5001)
    disc = 0.5 * DIAMETER_PX * j1(math.pi * DIAMETER_PX * f) / f
    integral = np.trapezoid(2 * np.pi * f * (disc * np.exp(-2 * (np.pi * sigma * f) ** 2)) ** 2, f)

    def bar(at: float) -> float:
        response = math.exp(-2 * (math.pi * sigma * at) ** 2)
        return CONTRAST * level / noise * response * math.sqrt(7) / (2 * at) - 2.8

    truth = {
        ("snr_gaussian", "M"): gaussian,
        ("snr_disc", "M"): CONTRAST * level / noise * math.sqrt(integral),
        ("resolved", "M"): float(brentq(bar, 1e-4, 0.5)),
    }
    options = {"contrast": CONTRAST, "diameter_px": DIAMETER_PX, "focal_length_mm": 50.0, "pitch_um": 5.0}
    return HiddenChart(noisy_edge(random, sigma, dark, bright, noise), "slanted-edge", truth, options)


STUDY = MeasurementStudy(_draw, "blur 0.8 to 1.6 pixels, 3 to 8 degrees, contrast 2 to 10, noise 1 to 6 % of the mean")
