"""Noise power spectra against white and filtered noise in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.metrics.noise_power import noise_power
from photosite.studies.measurements.noise_spectrum import filtered
from photosite.values.uncertain import Missing

Array = NDArray[np.float64]
RGGB = (("R", "G"), ("G", "B"))


def measured(frames: list[Array], cfa: tuple = (("M",),)) -> Result:  # type: ignore[type-arg]
    image = ChartImage(tuple(frames), "raw", cfa, black=0.0, white=1e6)
    return measure(image, "uniform", only=["noise-spectrum"])["noise-spectrum"]


def test_smoothed_and_sharpened_noise_is_named() -> None:
    """White noise is named in fewer than 1 of 10 000 fields."""
    random = np.random.default_rng(21)
    for number in range(24):
        side = 0.0 if number % 3 == 0 else float(random.choice([-0.15, 0.2, 0.35]))
        tilt = np.linspace(0, random.uniform(-200, 200), 330)
        found = measured([5000.0 + tilt + filtered(random, 10 ** random.uniform(0, 2), side)])
        expected = set() if side == 0.0 else {"smoothed-noise" if side > 0.0 else "sharpened-noise"}
        assert {entry.id for entry in found.diagnostics} == expected


def test_mosaic_has_the_frequencies_of_its_samples() -> None:
    """White noise of a channel has the variance times the area of a tile, up to 0.25 cycles/pixel."""
    frame = np.random.default_rng(23).normal(2000, 10, (400, 400))
    found = measured([frame], RGGB)
    for channel in "RGB":
        assert found["density", channel].value == pytest.approx(400, rel=0.05)
        curve = next(each for each in found.curves if each.part == channel)
        assert 0.2 < curve.x.max() <= 0.25
        assert found["noise_area", channel].value == pytest.approx(4, rel=0.15)
    assert not found.diagnostics


def test_integral_is_the_variance_and_smoothing_is_gaussian() -> None:
    random = np.random.default_rng(24)
    noise = gaussian_filter(random.normal(0, 30, (1024, 1024)), 1.0, mode="wrap")
    found = noise_power([noise], 1, 64)
    frequency, level, spread = found.radial()
    expected = 900 * np.exp(-((2 * np.pi * frequency) ** 2))
    assert np.all(np.abs(level - expected) < 5 * spread + 0.02 * expected + 0.09)  # 1e-4 of the power at 0
    square = found.frequency[:, None] ** 2 + found.frequency**2
    whole = np.where(np.isnan(found.power), 900 * np.exp(-((2 * np.pi) ** 2) * square), found.power)
    assert whole.sum() / 64**2 == pytest.approx(noise.var(), rel=0.02)


def test_clipped_fields_are_refused() -> None:
    frame = np.random.default_rng(25).normal(1e6, 10, (200, 200))
    image = ChartImage((frame,), "raw", black=0.0, white=1e6)
    assert isinstance(measure(image, "uniform", only=["noise-spectrum"]).results["noise-spectrum"], Missing)
