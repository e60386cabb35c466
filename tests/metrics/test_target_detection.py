"""Detection of targets against closed forms of a Gaussian blur and white noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import brentq
from scipy.special import j1, ndtr

from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result

Array = NDArray[np.float64]
CONTRAST, DIAMETER = 0.1, 6.0


def edge(random: np.random.Generator, sigma: float, dark: float, bright: float, noise: float) -> Array:
    """Return an edge under a Gaussian blur, sampled at points, with white noise."""
    y, x = np.mgrid[:240, :220] + 0.5
    angle = math.radians(random.uniform(3, 8))
    step = ndtr(((x - 110) * math.cos(angle) + (y - 120) * math.sin(angle)) / sigma)
    return np.asarray(dark + (bright - dark) * step + random.normal(0, noise, x.shape))


def measured(frame: Array) -> Result:
    own = {"contrast": CONTRAST, "diameter_px": DIAMETER, "focal_length_mm": 50.0, "pitch_um": 5.0}
    found = measure(frame, "slanted-edge", only=["target-detection"], options={"target-detection": own})
    return found["target-detection"]


def truths(sigma: float, level: float, noise: float) -> dict[str, float]:
    """Return the closed forms; those of spots wider than pixels need no frequency above 0.5 cycles/pixel."""
    spot = DIAMETER / 2
    gaussian = CONTRAST * level / noise * math.sqrt(math.pi * spot**4 / (spot**2 + sigma**2))
    f = np.linspace(1e-6, 0.5, 5001)
    disc = 0.5 * DIAMETER * j1(math.pi * DIAMETER * f) / f
    integral = np.trapezoid(2 * np.pi * f * (disc * np.exp(-2 * (np.pi * sigma * f) ** 2)) ** 2, f)

    def bar(at: float) -> float:
        response = math.exp(-2 * (math.pi * sigma * at) ** 2)
        return CONTRAST * level / noise * response * math.sqrt(7) / (2 * at) - 2.8

    return {
        "snr_gaussian": gaussian,
        "snr_disc": CONTRAST * level / noise * math.sqrt(integral),
        "resolved": float(brentq(bar, 1e-4, 0.5)),
    }


def test_intervals_hold_the_closed_forms() -> None:
    """Of 60 edges, 95 % intervals miss more than 8 in 1 of 200 runs for each value."""
    random = np.random.default_rng(31)
    missed = dict.fromkeys(("snr_gaussian", "snr_disc", "resolved"), 0)
    for _ in range(60):
        sigma, dark = random.uniform(0.8, 1.6), random.uniform(100, 1000)
        bright = dark * random.uniform(2, 10)
        noise = (bright + dark) * random.uniform(0.005, 0.03)
        found = measured(edge(random, sigma, dark, bright, noise))
        for name, truth in truths(sigma, (bright + dark) / 2, noise).items():
            low, high = found[name].interval_95 or (np.nan, np.nan)
            missed[name] += not low <= truth <= high
    print({name: f"{100 * (1 - count / 60):.0f} %" for name, count in missed.items()})
    assert max(missed.values()) <= 8, missed


def test_ranges_are_those_of_the_cycles() -> None:
    """A target of 2.3 m with N cycles at the resolved frequency: range = size focal length frequency / (N pitch)."""
    found = measured(edge(np.random.default_rng(32), 1.0, 500, 2000, 20))
    resolved = found["resolved"].value or 0.0
    for task, cycles in (("detection", 1), ("recognition", 4), ("identification", 8)):
        assert found[f"{task}_range"].value == pytest.approx(2.3 * 0.05 * resolved / (cycles * 5e-6))


def test_spectrum_of_the_noise_is_used() -> None:
    """Blurring noise and target alike leaves the ideal observer's SNR; taking the noise as white would raise it."""
    random = np.random.default_rng(33)
    sharp, smooth = [], []
    for _ in range(6):
        frame = edge(random, 1.0, 500, 3000, 60)
        sharp.append(measured(frame)["snr_gaussian"].value)
        found = measured(gaussian_filter(frame, 0.7, mode="reflect"))
        smooth.append(found["snr_gaussian"].value)
        assert "colored-noise-beside-edge" in {entry.id for entry in found.diagnostics}
    assert np.mean(smooth) == pytest.approx(np.mean(sharp), rel=0.05)
