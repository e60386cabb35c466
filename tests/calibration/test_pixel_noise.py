"""Temporal variances of single pixels, moderated by those of the channel."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from photosite.calibration.chip_maps.pixel_noise import NoiseSpread, moderated, noise_spread

FREEDOM = 15


def draw(true_variance, seed):
    rng = np.random.default_rng(seed)
    true = np.asarray(true_variance, float)
    return (true * rng.chisquare(FREEDOM, true.shape) / FREEDOM).astype(np.float32)


def inverse_chi_square(scale, freedom, count, seed):
    return scale * freedom / np.random.default_rng([seed, 9]).chisquare(freedom, count)


@pytest.mark.parametrize("freedom", [4.0, 20.0, 80.0])
def test_the_spread_of_true_variances_is_found(freedom) -> None:
    """The quartiles of 200 000 pixels give the freedom to 5 %, or 15 % if it is large, and the scale to 1 %."""
    found = noise_spread(draw(inverse_chi_square(9.0, freedom, 200_000, 1), 2), FREEDOM)
    assert found.variance == pytest.approx(9.0, rel=0.01)
    assert found.freedom == pytest.approx(freedom, rel=0.05 if freedom < 50 else 0.15)


def test_equal_pixels_have_one_variance_despite_outliers() -> None:
    true = np.full(100_000, 9.0)
    true[:1000] = 400.0
    found = noise_spread(draw(true, 3), FREEDOM)
    assert found.variance == pytest.approx(9.0, rel=0.02)
    assert found.freedom > 200


def test_uncertainties_from_moderated_variances_cover() -> None:
    """Normalized squared deviations average to 1; with unmoderated variances they average to 15/13."""
    true = inverse_chi_square(4.0, 20.0, 200_000, 4)
    variance = draw(true, 5)
    best = moderated(variance, FREEDOM, noise_spread(variance, FREEDOM))
    z2 = np.random.default_rng(6).standard_normal(true.shape) ** 2 * true / best
    assert np.mean(z2) == pytest.approx(1.0, abs=5 * z2.std() / math.sqrt(z2.size))
    own = np.mean(np.random.default_rng(6).standard_normal(true.shape) ** 2 * true / variance)
    assert own == pytest.approx(FREEDOM / (FREEDOM - 2), rel=0.03)


@pytest.mark.parametrize("freedom", [8.0, math.inf])
def test_limits_are_exceeded_as_rarely_as_asked(freedom) -> None:
    """400 000 ordinary pixels: binomial, each side outside 1e-4."""
    true = np.full(400_000, 5.0) if math.isinf(freedom) else inverse_chi_square(5.0, freedom, 400_000, 7)
    variance = draw(true, 8)
    for probability in (0.5, 0.01, 1e-4):
        beyond = np.count_nonzero(variance > NoiseSpread(5.0, freedom).limit(probability, FREEDOM))
        low, high = stats.binom.ppf([1e-4, 1 - 1e-4], variance.size, probability)
        assert low <= beyond <= high


def test_outlier_keeps_its_variance() -> None:
    values = np.array([3.0, 1000.0], np.float32)
    for freedom in (30.0, math.inf):
        assert moderated(values, FREEDOM, NoiseSpread(4.0, freedom))[1] == 1000.0
    assert moderated(values, FREEDOM, NoiseSpread(4.0, math.inf))[0] == 4.0


def test_noise_below_rounding_uses_the_mean() -> None:
    values = np.zeros(1000, np.float32)
    values[::10] = 0.1
    assert noise_spread(values, FREEDOM) == NoiseSpread(pytest.approx(0.01), math.inf)
