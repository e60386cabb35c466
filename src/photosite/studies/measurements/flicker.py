"""Flicker of pulsed lamps in closed form: the overlap of an exposure with the pulses, over all phases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.chart_image import ChartImage
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy

Array = NDArray[np.float64]
TOLERANCE, DETECTED = 0.2, 0.5
_FRAMES = 60


def exposed(phase: Array, duty: float, length: float) -> Array:
    """Return the light of pulses of mean 1 over exposures of `length` periods that begin at phases, over its mean."""

    def until(x: Array) -> Array:
        return np.asarray((np.floor(x) * duty + np.minimum(x - np.floor(x), duty)) / duty)

    return (until(phase + length) - until(phase)) / length


def flicker_of_pulses(duty: float, length: float) -> dict[str, float]:
    """Return the closed forms: between its plateaus the overlap rises and falls along lines."""
    whole, rest = divmod(length, 1.0)
    high = (whole * duty + min(rest, duty)) / duty / length
    low = (whole * duty + max(rest - (1 - duty), 0.0)) / duty / length
    ramp = min(rest, duty, 1 - rest, 1 - duty)  # each of two, in periods
    # The overlap stays at its highest for |rest - duty|, at its lowest for the remaining part of the period.
    at_low = 1 - 2 * ramp - abs(rest - duty)

    def below(level: float) -> float:
        """Return the part of the phases with a signal at or below a level."""
        if level >= high:
            return 1.0
        if level < low:
            return 0.0
        return at_low + 2 * ramp * (level - low) / (high - low)

    return {
        "modulation": (high - low) / (high + low),
        "mitigation_probability": below(1 + TOLERANCE) - below(1 - TOLERANCE - 1e-12),
        "detection_index": 1 - below(DETECTED - 1e-12),
    }


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    duty, length = random.uniform(0.1, 0.6), random.uniform(0.1, 2.5)
    rest = length % 1.0
    if min(abs(rest - duty), 1 - rest - duty if rest + duty < 1 else rest + duty - 1) < 0.1:
        duty = 0.5 * duty  # plateaus that some of the frames see
    level = 10 ** random.uniform(2, 4)
    mean = level * exposed(random.uniform(0, 1, _FRAMES), duty, length)
    uneven = np.linspace(1.0, random.uniform(0.8, 1.2), 60)
    frames = [random.poisson(m * uneven, (20, 60)) + random.normal(0, 3, (20, 60)) for m in mean]
    truth = {(name, "M"): value for name, value in flicker_of_pulses(duty, length).items()}
    options = {"tolerance": TOLERANCE, "detected_above": DETECTED}
    return HiddenChart(ChartImage(tuple(frames), "raw", black=0.0, white=1e6), "uniform", truth, options)


STUDY = MeasurementStudy(
    _draw, "duty 5 to 60 %, exposures of 0.1 to 2.5 periods, 100 to 10 000 electrons, uneven light"
)
