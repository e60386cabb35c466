"""The two chi-squares by themselves, on patches small enough for their corrections to matter."""

from functools import lru_cache

import numpy as np
import pytest

from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.validation.agreement import chi_square_of_means, chi_square_of_noise
from photosite.values.region import Region

PATCHES = [Region(str(i), i, i + 1, 0, 12) for i in range(5000)]
ALL = np.ones((5000, 1), dtype=bool)


@lru_cache
def patches(seed, level=1000.0, noise=20.0):
    """5000 patches of 12 pixels."""
    rng = np.random.default_rng(seed)
    return patch_statistics(RawFrame(np.rint(rng.normal(level, noise, (5000, 12))).astype(np.uint16), 12), PATCHES)


@pytest.mark.parametrize("noise", [20.0, 60.0])
def test_squared_differences_of_means_average_to_one(noise):
    # Welch's t of 11 to 22 degrees of freedom: without (nu - 2) / nu the average would be 1.10 to 1.22. Over 5000
    # patches it is known to 0.025; the bound is 3.5 of those.
    test = chi_square_of_means(patches(1), patches(2, noise=noise), ALL)
    assert test.degrees_of_freedom == 5000
    assert test.statistic / 5000 == pytest.approx(1.0, abs=0.0875)


def test_squared_differences_grow_with_the_difference():
    # d^2 / (2 s^2 / n) on top of 1: 20 DN is 2.45 standard errors of the difference.
    test = chi_square_of_means(patches(3, 1020.0), patches(1), ALL)
    assert test.statistic / 5000 == pytest.approx(1 + 20**2 / (2 * 20**2 / 12), rel=0.07)
    assert test.p_value < 1e-12


def test_a_tolerance_takes_its_share_off():
    one, other = patches(5, 1030.0, 0.0), patches(6, 1000.0, 0.0)
    # No noise: both means are good to 1 / sqrt(12) DN, with 22 degrees of freedom.
    for tolerance, beyond in ((0.0, 30.0), (0.02, 10.0), (0.03, 0.0), (0.05, 0.0)):
        test = chi_square_of_means(one, other, ALL, tolerance)
        assert test.statistic == pytest.approx(5000 * beyond**2 * 6 * 20 / 22)


def test_noise_free_patches_agree_in_noise():
    assert chi_square_of_noise(patches(5, 1030.0, 0.0), patches(6, 1000.0, 0.0), ALL).statistic == 0.0


def test_noise_within_its_tolerance_agrees():
    quiet, loud = patches(1), patches(10, noise=24.0)
    sharp = chi_square_of_noise(loud, quiet, ALL)
    lenient = chi_square_of_noise(loud, quiet, ALL, 0.2)
    assert sharp.p_value < 1e-12
    assert lenient.p_value > 0.5


@lru_cache
def stack(seed, frames, temporal=6.0, pattern=4.0):
    """A chip of its own for each seed: 1500 patches of 100 pixels, fixed pattern and noise from frame to frame."""
    rng = np.random.default_rng(seed)
    fixed = rng.normal(1000.0, pattern, (1500, 100))
    noise = rng.normal(0.0, temporal, (frames, 1500, 100))
    regions = [Region(str(i), i, i + 1, 0, 100) for i in range(1500)]
    return patch_statistics([RawFrame(np.rint(fixed + dn).astype(np.uint16), 12) for dn in noise], regions)


@pytest.mark.parametrize(("frames", "pattern"), [(1, 4.0), (3, 0.0), (3, 12.0), (5, 4.0)])
def test_noise_test_has_the_stated_false_alarm_rate_for_any_number_of_frames(frames, pattern):
    from scipy.stats import kstest

    one, other = stack(11, frames, pattern=pattern), stack(12, frames, pattern=pattern)
    tests = [chi_square_of_noise(one, other, np.arange(1500)[:, None] // 10 == k) for k in range(150)]
    # The mean of 1500 squares is known to 0.037; 150 p-values are uniform, and 5 % of them, give or take 1.8 %, say
    # "differ" at 0.05.
    assert np.mean([test.statistic for test in tests]) / 10 == pytest.approx(1.0, abs=0.13)
    found = np.array([test.p_value for test in tests])
    assert kstest(found, "uniform").pvalue > 1e-3
    assert (found < 0.05).mean() < 0.12


def test_more_frames_tell_smaller_differences_of_noise():
    few, many = (
        chi_square_of_noise(stack(13, n, 6.15), stack(14, n), np.ones((1500, 1), bool)).statistic for n in (1, 5)
    )
    assert many - 1500 > 2 * (few - 1500) > 0
