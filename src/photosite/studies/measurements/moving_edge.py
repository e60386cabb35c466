"""An edge that moves in front of a rolling shutter, in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from photosite.metrics.chart_image import ChartImage
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy

Array = NDArray[np.float64]
FPS = 30.0


def moving_edge(
    random: np.random.Generator, velocity: float, line_s: float, exposure_s: float, times: NDArray[np.floating[Any]]
) -> list[Array]:
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


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    if number % 2:
        jitter_ms = random.uniform(0.3, 2.0)
        times = (np.arange(12) - 5.5) / FPS + random.normal(0, jitter_ms * 1e-3, 12)
        return _hidden(moving_edge(random, 120.0, 2e-5, 0.02, times), {"jitter_ms": jitter_ms, "velocity": 120.0})
    velocity = random.uniform(150, 400) * random.choice([-1, 1])
    line_s, exposure_s = random.uniform(1e-5, 1e-4), random.uniform(3, 6) / abs(velocity)
    frames = moving_edge(random, velocity, line_s, exposure_s, (np.arange(4) - 1.5) / FPS)
    truth = {
        "skew": velocity * line_s,
        "blur": abs(velocity) * exposure_s,
        "velocity": velocity,
        "line_time_us": 1e6 * line_s,
        "exposure_ms": 1e3 * exposure_s,
    }
    return _hidden(frames, truth)


def _hidden(frames: list[Array], truth: dict[str, float]) -> HiddenChart:
    image = ChartImage(tuple(frames), "raw", black=0.0, white=1e6)
    options = {"fps": FPS, "static_slope": 0.0}
    return HiddenChart(image, "slanted-edge", {(name, ""): value for name, value in truth.items()}, options)


STUDY = MeasurementStudy(
    _draw,
    "150 to 400 pixels/s, line times of 10 to 100 us, motion of 3 to 6 pixels; 12 frames with jitter of 0.3 to 2 ms",
)
