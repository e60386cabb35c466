"""Noise power spectra against white and filtered noise in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, gaussian_filter

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.metrics.noise_power import noise_power
from photosite.values.uncertain import Missing

Array = NDArray[np.float64]
RGGB = (("R", "G"), ("G", "B"))


def measured(frames: list[Array], cfa: tuple = (("M",),)) -> Result:  # type: ignore[type-arg]
    image = ChartImage(tuple(frames), "raw", cfa, black=0.0, white=1e6)
    return measure(image, "uniform", only=["noise-spectrum"])["noise-spectrum"]


def holds(result: Result, name: tuple[str, str], truth: float) -> bool:
    low, high = result[name].interval_95 or (np.nan, np.nan)
    return bool(low <= truth <= high)


def filtered(random: np.random.Generator, sigma: float, side: float) -> Array:
    """Return white noise after the kernel (side, 1, side) / (1 + 2 side) along rows and columns."""
    kernel = np.array([side, 1.0, side]) / (1.0 + 2.0 * side)
    noise = random.normal(0.0, sigma, (260, 330))
    return convolve1d(convolve1d(noise, kernel, axis=0, mode="wrap"), kernel, axis=1, mode="wrap")


def power(frequency: Array, side: float) -> Array:
    return ((1.0 + 2.0 * side * np.cos(2 * np.pi * frequency)) / (1.0 + 2.0 * side)) ** 2


def truths(sigma: float, side: float) -> dict[str, float]:
    """Return the closed forms on the grid of frequencies of a block of 64 samples."""
    f = np.fft.fftfreq(64)
    grid = sigma**2 * power(f, side)[:, None] * power(f, side)
    radius = 2.0 * np.hypot(f[:, None], f)
    near = np.abs(np.rint(64 * f)) < 3
    axes = np.abs(np.rint(64 * f)) < 2
    plain = ~axes[:, None] & ~axes & ~(near[:, None] & near)
    low, high = (grid[plain & (radius > a) & (radius <= b)].mean() for a, b in ((0.1, 0.25), (0.75, 1.0)))
    density = grid[plain].mean()
    return {"density": density, "high_over_low": high / low, "noise_area": low / density}


def test_filtered_noise_has_the_spectrum_of_its_filter() -> None:
    """Of 60 fields, white, smoothed or sharpened, 95 % intervals miss more than 8 in 1 of 200 runs."""
    random = np.random.default_rng(21)
    missed = dict.fromkeys(("density", "high_over_low", "noise_area"), 0)
    named = 0
    for number in range(60):
        side = 0.0 if number % 3 == 0 else random.uniform(-0.2, 0.4)
        sigma = 10 ** random.uniform(0, 2)
        tilt = np.linspace(0, random.uniform(-200, 200), 330)
        found = measured([5000.0 + tilt + filtered(random, sigma, side)])
        for name, truth in truths(sigma, side).items():
            missed[name] += not holds(found, (name, "M"), truth)
        ids = {entry.id for entry in found.diagnostics}
        named += side == 0.0 and bool(ids)
        if side > 0.1:
            assert ids == {"smoothed-noise"}
        if side < -0.1:
            assert ids == {"sharpened-noise"}
    print({name: f"{100 * (1 - count / 60):.0f} %" for name, count in missed.items()})
    assert max(missed.values()) <= 8, missed
    assert named == 0


def test_temporal_noise_fixed_pattern_and_rows() -> None:
    """Of 40 stacks, 95 % intervals miss more than 6 in 1 of 70 runs for each value."""
    random = np.random.default_rng(22)
    missed = dict.fromkeys(("temporal", "fixed", "row", "column"), 0)
    for _ in range(40):
        temporal, fixed, row = random.uniform(5, 20), random.uniform(10, 20), random.uniform(1, 4)
        pattern = random.normal(0, fixed, (200, 260))
        frames = [
            1000 + pattern + random.normal(0, temporal, pattern.shape) + random.normal(0, row, (200, 1))
            for _ in range(4)
        ]
        found = measured(frames)
        missed["temporal"] += not holds(found, ("density", "M, temporal"), temporal**2)
        missed["fixed"] += not holds(found, ("density", "M, fixed"), fixed**2)
        missed["row"] += not holds(found, ("row_noise", "M, temporal"), row)
        missed["column"] += not holds(found, ("column_noise", "M, temporal"), 0.0)
    print({name: f"{100 * (1 - count / 40):.0f} %" for name, count in missed.items()})
    assert max(missed.values()) <= 6, missed


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
