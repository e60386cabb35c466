"""Flicker of pulsed lamps in closed form: the overlap of an exposure with the pulses, over all phases."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.values.uncertain import Missing

Array = NDArray[np.float64]
TOLERANCE, DETECTED = 0.2, 0.5


def exposed(phase: Array, duty: float, length: float) -> Array:
    """Return the light of pulses of mean 1 over exposures of `length` periods that begin at phases, over its mean."""

    def until(x: Array) -> Array:
        return (np.floor(x) * duty + np.minimum(x - np.floor(x), duty)) / duty

    return (until(phase + length) - until(phase)) / length


def truths(duty: float, length: float) -> dict[str, float]:
    """Return the closed forms: between its plateaus the overlap rises and falls along lines."""
    whole, rest = divmod(length, 1.0)
    high = (whole * duty + min(rest, duty)) / duty / length
    low = (whole * duty + max(rest - (1 - duty), 0.0)) / duty / length
    ramp = min(rest, duty, 1 - rest, 1 - duty)  # each of two, in periods
    # The overlap stays at its highest for |rest - duty|, at its lowest for the remaining part of the period.
    at_high = abs(rest - duty)
    at_low = 1 - 2 * ramp - at_high

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


def measured(frames: list[Array]) -> Result:
    own = {"tolerance": TOLERANCE, "detected_above": DETECTED}
    image = ChartImage(tuple(frames), "raw", black=0.0, white=1e6)
    return measure(image, "uniform", only=["flicker"], options={"flicker": own})["flicker"]


def test_closed_form_is_that_of_all_phases() -> None:
    random = np.random.default_rng(41)
    for _ in range(50):
        duty, length = random.uniform(0.05, 0.95), random.uniform(0.05, 3.0)
        signal = exposed((np.arange(200_000) + 0.5) / 200_000, duty, length)
        found = truths(duty, length)
        high, low = signal.max(), signal.min()
        assert (high - low) / (high + low) == pytest.approx(found["modulation"], abs=1e-4)
        assert np.mean(np.abs(signal - 1) <= TOLERANCE) == pytest.approx(found["mitigation_probability"], abs=1e-4)
        assert np.mean(signal >= DETECTED) == pytest.approx(found["detection_index"], abs=1e-4)


def test_intervals_hold_the_closed_forms() -> None:
    """Of 60 lamps, 95 % intervals miss more than 8 in 1 of 200 runs for each value."""
    random = np.random.default_rng(42)
    missed = dict.fromkeys(("modulation", "mitigation_probability", "detection_index"), 0)
    for _ in range(60):
        duty, length = random.uniform(0.1, 0.6), random.uniform(0.1, 2.5)
        rest = length % 1.0
        if min(abs(rest - duty), 1 - rest - duty if rest + duty < 1 else rest + duty - 1) < 0.1:
            duty = 0.5 * duty  # plateaus that some of the frames see
        level = 10 ** random.uniform(2, 4)
        mean = level * exposed(random.uniform(0, 1, 60), duty, length)
        found = measured([random.poisson(m, (20, 60)) + random.normal(0, 3, (20, 60)) for m in mean])
        for name, truth in truths(duty, length).items():
            low, high = found[name].interval_95 or (math.nan, math.nan)
            missed[name] += not low - 1e-9 <= truth <= high + 1e-9
        assert "flicker-in-step-with-frames" not in {entry.id for entry in found.diagnostics}
    print({name: f"{100 * (1 - count / 60):.0f} %" for name, count in missed.items()})
    assert max(missed.values()) <= 8, missed


def test_a_simulated_clip() -> None:
    """Frames of the simulator under a pulsed lamp have the modulation of the closed form."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=40, cols=60)
    camera = ps.Camera(ps.DiffractionLimited(4, 50), sensor)
    lamp = ps.scenes.PulseFlicker(92.7, duty=0.3)
    scene = ps.scenes.DynamicScene(ps.charts.uniform("D65", 200), flicker=lamp)
    frames = list(camera.record(scene, frames=40, fps=30, exposure_s=1 / 250, seed=3))
    found = measure(frames, "uniform", only=["flicker"])["flicker"]
    assert found["modulation", "G"].value == pytest.approx(truths(0.3, 92.7 / 250)["modulation"], abs=0.02)


def test_steady_light_few_frames_and_frames_in_step() -> None:
    random = np.random.default_rng(43)
    steady = measured([random.poisson(1000, (20, 60)).astype(float) for _ in range(30)])
    assert steady["mitigation_probability"].value == 1.0
    assert (steady["modulation"].value or 0) < 0.005
    assert not steady.diagnostics
    step = exposed(np.arange(30) * 0.5 % 1.0 + 0.1, 0.3, 0.4)
    found = measured([random.poisson(1000 * (0.2 + s), (20, 60)).astype(float) for s in step])
    assert [entry.size for entry in found.diagnostics] == [2]
    few = ChartImage(tuple(random.poisson(1000, (20, 60)) for _ in range(4)), "raw", white=1e6)
    assert isinstance(measure(few, "uniform", only=["flicker"]).results["flicker"], Missing)
