"""A moving edge in front of a rolling shutter against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

import photosite as ps
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.values.uncertain import Missing

Array = NDArray[np.float64]
FPS = 30.0


def moving(random: np.random.Generator, velocity: float, line_s: float, exposure_s: float, times: Array) -> list[Array]:
    """Return frames of an edge under a Gaussian blur, on square pixels, whose exposures begin row by row."""
    rows, cols, parts = 120, 160, 5
    sigma, level = 0.7, 10 ** random.uniform(2.7, 4)
    x = (np.arange(cols * parts) + 0.5) / parts
    frames = []
    for start in times:
        begin = start + line_s * (np.arange(rows) - rows / 2)
        # The mean over the exposure, by the middle of 40 parts of it.
        at = cols / 2 + velocity * (begin[:, None] + exposure_s * (np.arange(40) + 0.5) / 40)
        fine = ndtr((x - at[..., None]) / sigma).mean(axis=1)
        mean = level * (0.2 + 0.8 * fine.reshape(rows, cols, parts).mean(axis=2))
        frames.append(random.poisson(mean) + random.normal(0, 3, mean.shape))
    return frames


def measured(frames: list[Array], **own: float) -> Result:
    options = {"moving-edge": {"fps": FPS, "static_slope": 0.0, **own}}
    image = ChartImage(tuple(frames), "raw", black=0.0, white=1e6)
    return measure(image, "slanted-edge", only=["moving-edge"], options=options)["moving-edge"]


def test_intervals_hold_the_truth() -> None:
    """Of 40 clips, 95 % intervals miss more than 6 in 1 of 70 runs for each value."""
    random = np.random.default_rng(51)
    missed = dict.fromkeys(("skew", "blur", "velocity", "line_time_us", "exposure_ms"), 0)
    for _ in range(40):
        velocity = random.uniform(150, 400) * random.choice([-1, 1])
        line_s, exposure_s = random.uniform(1e-5, 1e-4), random.uniform(3, 6) / abs(velocity)
        frames = moving(random, velocity, line_s, exposure_s, (np.arange(4) - 1.5) / FPS)
        found = measured(frames)
        truth = {
            "skew": velocity * line_s,
            "blur": abs(velocity) * exposure_s,
            "velocity": velocity,
            "line_time_us": 1e6 * line_s,
            "exposure_ms": 1e3 * exposure_s,
        }
        for name, value in truth.items():
            low, high = found[name].interval_95 or (math.nan, math.nan)
            missed[name] += not low <= value <= high
    print({name: f"{100 * (1 - count / 40):.0f} %" for name, count in missed.items()})
    assert max(missed.values()) <= 6, missed


def test_jitter_of_frames() -> None:
    """Of 40 clips of 12 frames, 95 % intervals of the jitter miss more than 7 in 1 of 200 runs."""
    random = np.random.default_rng(52)
    missed = 0
    for _ in range(40):
        true = random.uniform(0.3, 2.0)
        times = (np.arange(12) - 5.5) / FPS + random.normal(0, true * 1e-3, 12)
        found = measured(moving(random, 120.0, 2e-5, 0.02, times))["jitter_ms"]
        low, high = found.interval_95 or (math.nan, math.nan)
        missed += not low <= true <= high
    print(f"{100 * (1 - missed / 40):.0f} %")
    assert missed <= 7
    steady = measured(moving(random, 120.0, 2e-5, 0.02, (np.arange(8) - 3.5) / FPS))
    assert (steady["jitter_ms"].value or 0) < 0.1


def test_a_simulated_clip() -> None:
    """The simulator's rolling shutter and motion come back: line time, exposure time and velocity."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=120, cols=200, line_time_us=50)
    camera = ps.Camera(ps.DiffractionLimited(4, 50), sensor, cells_per_pixel=3)
    edge = ps.charts.slanted_edge("D65", 30, angle_deg=0, rows=360, cols=600)
    scene = ps.scenes.DynamicScene(edge, motion=ps.scenes.Motion(cols_per_s=300))
    frames = list(camera.record(scene, frames=3, fps=FPS, exposure_s=1 / 50, seed=5))
    options = {"moving-edge": {"fps": FPS}}
    placed = {"chart_options": {"angle_deg": 0}}
    found = measure(frames, "slanted-edge", only=["moving-edge"], options=options, **placed)["moving-edge"]
    assert found["velocity"].value == pytest.approx(300, rel=0.01)
    assert found["line_time_us"].value == pytest.approx(50, rel=0.05)
    assert found["exposure_ms"].value == pytest.approx(20, rel=0.03)


def test_frames_that_cannot_serve() -> None:
    random = np.random.default_rng(53)
    still = moving(random, 0.0, 1e-5, 0.01, np.zeros(2))
    found = measured(still)
    assert found["blur"].value is None
    assert found["line_time_us"].value is None
    for options in ({}, {"moving-edge": {"fps": 30}}):
        noise = ChartImage((random.normal(1000, 5, (120, 160)),) * 2, "raw", black=0.0, white=1e6)
        assert isinstance(
            measure(noise, "slanted-edge", only=["moving-edge"], options=options).results["moving-edge"], Missing
        )
