"""Flicker of pulsed lamps in closed form: the overlap of an exposure with the pulses, over all phases."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.studies.measurements.flicker import DETECTED, TOLERANCE, exposed, flicker_of_pulses
from photosite.values.uncertain import Missing

Array = NDArray[np.float64]


def measured(frames: list[Array]) -> Result:
    own = {"tolerance": TOLERANCE, "detected_above": DETECTED}
    image = ChartImage(tuple(frames), "raw", black=0.0, white=1e6)
    return measure(image, "uniform", only=["flicker"], options={"flicker": own})["flicker"]


def test_closed_form_is_that_of_all_phases() -> None:
    random = np.random.default_rng(41)
    for _ in range(50):
        duty, length = random.uniform(0.05, 0.95), random.uniform(0.05, 3.0)
        signal = exposed((np.arange(200_000) + 0.5) / 200_000, duty, length)
        found = flicker_of_pulses(duty, length)
        high, low = signal.max(), signal.min()
        assert (high - low) / (high + low) == pytest.approx(found["modulation"], abs=1e-4)
        assert np.mean(np.abs(signal - 1) <= TOLERANCE) == pytest.approx(found["mitigation_probability"], abs=1e-4)
        assert np.mean(signal >= DETECTED) == pytest.approx(found["detection_index"], abs=1e-4)


def test_a_simulated_clip() -> None:
    """Frames of the simulator under a pulsed lamp have the modulation of the closed form."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=40, cols=60)
    camera = ps.Camera(ps.DiffractionLimited(4, 50), sensor)
    lamp = ps.scenes.PulseFlicker(92.7, duty=0.3)
    scene = ps.scenes.DynamicScene(ps.charts.uniform("D65", 200), flicker=lamp)
    frames = list(camera.record(scene, frames=40, fps=30, exposure_s=1 / 250, seed=3))
    found = measure(frames, "uniform", only=["flicker"])["flicker"]
    assert found["modulation", "G"].value == pytest.approx(flicker_of_pulses(0.3, 92.7 / 250)["modulation"], abs=0.02)


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
