"""Ghosts drawn into frames by plain NumPy, and the veiling glare of a simulated lens."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.optics.illumination import VeilingGlare
from photosite.studies.measurements.ghost import SHAPE, STUDY, lit_source
from photosite.studies.virtual_charts import RGGB


def measured(image: NDArray[np.float64], **options: float) -> Result:
    given = ChartImage((image,), "raw", RGGB, white=60000.0)
    return measure(given, "light-source", only=["ghost"], options={"ghost": options})["ghost"]


def test_intervals_hold_the_ghost_that_was_put_in() -> None:
    """Of 80 frames, 95 % intervals of a channel miss more than 10 in 1 of 250 runs."""
    random = np.random.default_rng(20261209)
    missed: dict[tuple[str, str], int] = {}
    for number in range(80):
        hidden = STUDY.draw(random, number)
        found = measure(hidden.frames, hidden.chart, only=["ghost"])["ghost"]
        for key, truth in hidden.truth_of(found).items():
            low, high = found[key].interval_95 or (np.nan, np.nan)
            missed[key] = missed.get(key, 0) + (not low <= truth <= high)
    print({" ".join(key): f"{100 * (1 - each / 80):.0f} %" for key, each in missed.items()})
    assert len(missed) == 6
    assert max(missed.values()) <= 10, missed


def test_a_smaller_ghost_and_a_saturated_source() -> None:
    random = np.random.default_rng(20261210)
    image = np.minimum(random.poisson(lit_source(1e-3, 0, 0, size=0.6, signal=4e6)) + 0.0, 60000.0)
    with pytest.raises(InputError, match="source_signal"):
        measured(image, size=0.6)
    found = measured(image, size=0.6, source_signal=4e6)
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
