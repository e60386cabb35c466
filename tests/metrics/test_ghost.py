"""Ghosts drawn into frames by plain NumPy, and the veiling glare of a simulated lens."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.optics.illumination import VeilingGlare

RGGB = (("R", "G"), ("G", "B"))
SHAPE = (512, 768)
MIDDLE, RADIUS = np.array([154.0, 230.0]), 20.0
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
AWAY = [np.hypot(Y - r, X - c) for r, c in (MIDDLE, np.array(SHAPE) - MIDDLE)]


def measured(image: NDArray[np.float64], **options: float) -> Result:
    given = ChartImage((image,), "raw", RGGB, white=60000.0)
    return measure(given, "light-source", only=["ghost"], options={"ghost": options})["ghost"]


def drawn(ghost: float, glare: float, slope: float, size: float = 1.0, signal: float = 40000.0) -> NDArray[np.float64]:
    """Return the light of a source, of its ghost, and of glare that changes over the frame."""
    source, mirrored = (ndtr((radius - away) / 1.5) for radius, away in zip((RADIUS, size * RADIUS), AWAY, strict=True))
    return np.asarray(signal * (source + ghost * mirrored + glare * (1 + slope * (X / SHAPE[1] - 0.5))))


def test_intervals_hold_the_ghost_that_was_put_in() -> None:
    """Of 80 frames, 95 % intervals of a channel miss more than 10 in 1 of 250 runs."""
    random = np.random.default_rng(20261209)
    missed = {(name, channel): 0 for name in ("ghost_percent", "glare_percent") for channel in "RGB"}
    for _ in range(80):
        ghost, glare, slope = random.uniform(0, 3e-3), random.uniform(1e-4, 5e-3), random.uniform(-0.5, 0.5)
        inside = float(np.average(ndtr((RADIUS - AWAY[1][AWAY[1] < 0.75 * RADIUS]) / 1.5)))
        found = measured(random.poisson(drawn(ghost, glare, slope)) + random.normal(0, 4, SHAPE))
        at = 1 + slope * ((SHAPE[1] - MIDDLE[1]) / SHAPE[1] - 0.5)
        source = 1 + glare * (1 + slope * (MIDDLE[1] / SHAPE[1] - 0.5))
        for (name, channel), truth in {
            **{("ghost_percent", channel): ghost * inside / source for channel in "RGB"},
            **{("glare_percent", channel): glare * at / source for channel in "RGB"},
        }.items():
            low, high = found[name, channel].interval_95 or (np.nan, np.nan)
            missed[name, channel] += not low <= 100 * truth <= high
    print({" ".join(key): f"{100 * (1 - each / 80):.0f} %" for key, each in missed.items()})
    assert max(missed.values()) <= 10, missed


def test_a_larger_ghost_and_a_saturated_source() -> None:
    random = np.random.default_rng(20261210)
    image = np.minimum(random.poisson(drawn(1e-3, 0, 0, size=1.5, signal=4e6)) + 0.0, 60000.0)
    with pytest.raises(InputError, match="source_signal"):
        measured(image, size=1.5)
    found = measured(image, size=1.5, source_signal=4e6)
    assert found["ghost_percent", "G"].value == pytest.approx(0.1, rel=0.05)


def test_glare_of_a_lens_is_no_ghost() -> None:
    """Uniform veiling glare lights the mirrored place as all others."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=512, cols=768)
    scene = ps.charts.light_source("D65", 100)
    lens = ps.Lens(ps.DiffractionLimited(4, 50), veiling_glare=VeilingGlare(0.03))
    mean = ps.Camera(lens, sensor).mean_electrons(scene, exposure_s=1 / 600)
    found = measure(ChartImage((mean,), "electrons", sensor.array.cfa), "light-source", only=["ghost"])["ghost"]
    bright = scene.weights[0] / scene.weights[0].max()
    wanted = (0.97 * bright.min() + 0.03 * bright.mean()) / (0.97 + 0.03 * bright.mean())
    for channel in "RGB":
        assert abs(found["ghost_percent", channel].value or 1) < 1e-3
        assert found["glare_percent", channel].value == pytest.approx(100 * wanted, rel=0.03)
    map_ = found.maps[1]
    assert map_.part == "G"
    assert np.nanmedian(map_.values) == pytest.approx(100 * wanted, rel=0.03)


def test_frames_without_a_source() -> None:
    random = np.random.default_rng(4)
    for image in (random.poisson(np.full(SHAPE, 500.0)) + 0.0, random.normal(0, 4, SHAPE)):
        with pytest.raises(InputError):
            measured(image)
