"""Random telegraph noise: the stated rate of false alarms, and blinking pixels found."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from photosite.calibration.chip_maps.pixel_noise import (
    BLINKING_P_VALUE,
    find_blinking,
    least_visits,
    ratio_limit,
    two_levels,
)


def test_division_is_the_best_of_all() -> None:
    """Against an exhaustive search."""
    rng = np.random.default_rng(1)
    series = rng.normal(0, 1, (50, 24)) + 6 * (rng.random((50, 24)) < rng.uniform(0, 1, (50, 1)))
    found = two_levels(series)
    for i, readings in enumerate(np.sort(series, axis=1)):
        cuts = range(least_visits(24), 24 - least_visits(24) + 1)
        within = [np.var(readings[:k]) * k + np.var(readings[k:]) * (24 - k) for k in cuts]
        best = int(np.argmin(within))
        k = list(cuts)[best]
        assert found.within[i] == pytest.approx(within[best] / 22)
        assert found.ratio[i] == pytest.approx((np.var(readings) * 24 - within[best]) / within[best])
        assert (found.lower[i], found.upper[i]) == pytest.approx((readings[:k].mean(), readings[k:].mean()))
        assert found.high_fraction[i] == (24 - k) / 24


@pytest.mark.parametrize("frames", [12, 40, 150])
def test_false_alarms_for_normal_noise(frames) -> None:
    """The ratio alone, with another generator than the limit's: binomial of 400 000, each side 1e-4.

    The limit is fitted to 600 draws of the tail, so the rate is known to a fifth.
    """
    rng = np.random.Generator(np.random.MT19937(7))
    count, alarms = 400_000 if frames < 100 else 100_000, 0
    for _ in range(10):
        alarms += np.count_nonzero(two_levels(rng.standard_normal((count // 10, frames))).ratio > ratio_limit(frames))
    low, high = (
        stats.binom.ppf(1e-4, count, BLINKING_P_VALUE / 1.5),
        stats.binom.isf(1e-4, count, BLINKING_P_VALUE * 1.5),
    )
    assert low <= alarms <= high


def test_false_alarms_for_pixels_with_large_variance() -> None:
    """The noisiest percent of normal pixels, rounded: at most 4 of 4000 (rate 1e-4 each; Poisson at 1e-4)."""
    rng = np.random.default_rng(3)
    series = np.round(rng.normal(64, 2, (400_000, 16)))
    noisy = series[np.argsort(series.var(axis=1))[-4000:]]
    assert np.count_nonzero(find_blinking(noisy)[0]) <= 4


@pytest.mark.parametrize("noise", ["rounded", "uniform", "one outlier", "heavy tail"])
def test_other_noise_without_two_levels_is_not_blinking(noise) -> None:
    rng = np.random.default_rng(5)
    shape = (4000, 40)
    series = {
        "rounded": lambda: np.round(rng.normal(64.5, 0.4, shape)),  # half 64, half 65
        "uniform": lambda: rng.uniform(0, 30, shape),
        "one outlier": lambda: rng.normal(64, 2, shape) + 500 * (np.arange(40) == 7),
        "heavy tail": lambda: 64 + 2 * rng.standard_t(4, shape),
    }[noise]()
    # For a uniform distribution, 40 frames sometimes have levels this far apart by chance.
    assert np.count_nonzero(find_blinking(series)[0]) <= (120 if noise == "uniform" else 8)


@pytest.mark.parametrize(("frames", "amplitude"), [(16, 12.0), (40, 7.0), (150, 5.0)])
def test_blinking_pixels_are_found_with_their_levels(frames, amplitude) -> None:
    """Upper level in 30 to 70 % of the frames: 98 % found, amplitudes unbiased."""
    rng = np.random.default_rng(frames)
    high = rng.random((3000, frames)) < rng.uniform(0.3, 0.7, (3000, 1))
    series = np.round(rng.normal(64, 3, (3000, frames)) + 3 * amplitude * high)
    found, levels = find_blinking(series)
    visited = np.minimum(high.sum(axis=1), frames - high.sum(axis=1)) >= least_visits(frames)
    assert np.mean(found[visited]) > 0.98
    measured = (levels.upper - levels.lower)[found]
    assert measured.mean() == pytest.approx(3 * amplitude, rel=0.015)
    assert np.sqrt(levels.within[found].mean()) == pytest.approx(3.0, rel=0.03)
