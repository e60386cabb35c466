"""Saturation, linear range and gain on hand-written light levels."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from photosite.calibration.photon_transfer.photon_transfer import (
    LightLevels,
    find_saturation,
    fit_gain,
    gain_value,
    linear_levels,
)
from photosite.values.uncertain import Missing, Uncertain


def levels(signal, shot, *, white_fraction=None, x=None, signal_sigma=1e-3, shot_sigma=0.1):
    signal, shot = np.asarray(signal, float), np.asarray(shot, float)
    m = len(signal)
    white = np.zeros(m) if white_fraction is None else np.asarray(white_fraction, float)
    return LightLevels(
        abscissa="photons_per_pixel",
        x=np.arange(1.0, m + 1) * 100 if x is None else np.asarray(x, float),
        exposure_s=np.arange(1.0, m + 1) * 0.01,
        signal=signal,
        signal_covariance=np.diag(np.broadcast_to(signal_sigma, m) ** 2.0),
        shot=shot,
        shot_covariance=np.diag(np.broadcast_to(shot_sigma, m) ** 2.0),
        noise=shot + 1.0,
        noise_uncertainty=np.zeros(m),  # all uncertainty is in `shot_covariance`
        noise_rounding=np.zeros(m),
        dark_noise=(),
        dark_fraction=np.zeros((m, 0)),
        mean=signal + 64,
        spread=np.full(m, 4.0),
        mean_variance=np.full(m, 1e-4),
        frame_scatter=np.zeros(m),
        clipped=white > 1e-3,
        white_fraction=white,
        group=np.arange(m),
        frames=np.full(m, 2.0),
        trusted=np.ones(m, bool),
    )


RISING = [100.0, 200.0, 300.0, 400.0]


@pytest.mark.parametrize("spread", [0.5, 1.0, 1.5])
def test_full_pixels_that_change_with_the_frame_alone(spread):
    """Equal pixels whose level moves by whole frames: the spread is the noise, or beside it by chance."""
    curve = replace(
        levels([*RISING, 500.0, 500.0], [20.0, 40.0, 60.0, 80.0, 0.0, 0.0]),
        spread=np.array([4.0, 4.0, 4.0, 4.0, spread, spread]),
        frame_scatter=np.full(6, 0.04),
    )
    found = find_saturation(curve, white=65535).level_dn
    assert found.value == 564.0
    assert 0.2 <= found.standard_uncertainty <= 0.2 * (1 + 1e-3)


def test_saturation_is_where_the_variance_is_largest():
    curve = levels([*RISING, 490.0, 500.0], [20.0, 40.0, 60.0, 80.0, 50.0, 0.0], white_fraction=[0, 0, 0, 0, 0.3, 1])
    found = find_saturation(curve, white=564)
    assert found.index == 3
    assert found.signal == 400.0
    assert found.level_dn.value == 564.0
    assert linear_levels(curve, found).tolist() == [True, True, False, False, False, False]


def test_the_interval_of_the_largest_variance_is_that_of_all_possible_sensors():
    """Sensors with any clipping level, selected by their largest measured variance at 400."""
    curve = levels([*RISING, 490.0, 500.0], [20.0, 40.0, 60.0, 80.0, 50.0, 0.0], white_fraction=[0, 0, 0, 0, 0.3, 1])
    fine = np.linspace(200.0, 600.0, 4001)
    measured = np.searchsorted(fine, [100.0 * k for k in range(3, 7)])
    possible = []
    for clip in np.linspace(300.0, 600.0, 3001):
        variance = fine * norm.sf((fine - clip) / (clip * 4.0 / 300.0))
        if np.argmax(variance[measured]) == 1:
            possible.append(fine[np.argmax(variance)])
    x = find_saturation(curve, white=564).x
    low, high = min(possible), max(possible)
    assert x.value == pytest.approx((low + high) / 2, abs=1.5)
    assert x.standard_uncertainty == pytest.approx((high - low) / np.sqrt(12), rel=0.04)
    assert x.interval_95 == pytest.approx((low + 0.025 * (high - low), high - 0.025 * (high - low)), abs=3.0)


def test_a_well_that_fills_below_full_scale_is_saturation_too():
    curve = levels([*RISING, 410.0, 410.0], [20.0, 40.0, 60.0, 80.0, 1.0, 0.2])
    found = find_saturation(curve, white=4095)
    assert found.index == 3
    assert found.level_dn.value == 474.0
    assert found.level_dn.standard_uncertainty == pytest.approx(0.01)


def test_single_frames_saturate_at_the_brightest_level():
    curve = levels([*RISING, 500.2, 500.1], [np.nan] * 6, white_fraction=[0, 0, 0, 0, 1, 1])
    found = find_saturation(curve, white=564)
    assert (found.index, found.signal) == (4, 500.2)
    assert found.x.id == "single-flat-fields"


def test_a_rising_variance_is_not_saturation():
    found = find_saturation(levels(RISING, [20.0, 41.0, 62.0, 80.0]), white=4095)
    assert found.index is None
    assert isinstance(found.x, Missing)
    assert isinstance(found.level_dn, Missing)


def test_scatter_of_the_variance_is_not_saturation():
    """A brighter level 5 % below the largest variance is noise, not clipping."""
    found = find_saturation(levels(RISING, [20.0, 40.0, 61.0, 58.0]), white=4095)
    assert found.index is None


def test_partial_clipping_gives_full_scale():
    curve = levels(RISING, [20.0, 40.0, 60.0, 55.0], white_fraction=[0, 0, 0, 0.2])
    found = find_saturation(curve, white=470)
    assert found.level_dn.value == 470.0


def test_clipped_pixels_are_at_full_scale_exactly():
    """Some pixels of the brightest flat fields do not clip, and lower their mean."""
    clipped = find_saturation(levels([1000, 2000, 3980], [400, 800, 0.5], white_fraction=[0, 0, 0.998]), 4095)
    assert (clipped.level_dn.value, clipped.level_dn.standard_uncertainty) == (4095.0, 0.0)


def test_gain_is_the_weighted_slope_through_the_origin():
    shot_sigma = np.array([0.1, 0.3, 0.5, 1.0])
    curve = levels(RISING, [20.05, 40.1, 59.8, 80.3], shot_sigma=shot_sigma)
    fit = fit_gain([curve], [np.ones(4, bool)])
    y, w = curve.signal, 1 / shot_sigma**2
    assert fit.parameters[0] == pytest.approx((w * y) @ curve.shot / ((w * y) @ y), rel=1e-6)


def test_the_signal_s_uncertainty_counts_by_its_effect_on_the_variance():
    """Effective variance: u(shot)^2 + K^2 u(signal)^2."""
    signal_sigma = np.array([5.0, 0.1, 0.1, 0.1])
    curve = levels(RISING, [20.5, 40.0, 60.0, 80.0], signal_sigma=signal_sigma)
    fit = fit_gain([curve], [np.ones(4, bool)])
    w = 1 / (0.1**2 + (fit.parameters[0] * signal_sigma) ** 2)
    y = curve.signal
    assert fit.parameters[0] == pytest.approx((w * y) @ curve.shot / ((w * y) @ y), rel=1e-6)
    assert fit.covariance[0, 0] == pytest.approx(1 / ((w * y) @ y), rel=1e-4)


def test_channels_are_fitted_together():
    a = levels([100.0, 200.0], [20.0, 40.2])
    b = levels([50.0, 80.0], [10.1, 16.0])
    fit = fit_gain([a, b], [np.ones(2, bool), np.ones(2, bool)])
    y, v = np.array([100, 200, 50, 80.0]), np.array([20, 40.2, 10.1, 16.0])
    assert fit.parameters[0] == pytest.approx(y @ v / (y @ y), rel=1e-6)
    assert fit.degrees_of_freedom == 3


def test_a_variance_that_does_not_rise_gives_no_gain():
    fit = fit_gain([levels(RISING, [0.1, -0.1, 0.05, -0.1])], [np.ones(4, bool)])
    assert "does not rise" in gain_value(fit).reason
    assert "two frames" in gain_value(None).reason


def test_gain_and_read_noise_are_correlated_by_shared_darks():
    """A high dark variance is subtracted from every level, which makes the gain low by its fraction in the fit."""
    dark = Uncertain.of(5.0, 0.2)
    curve = levels(RISING, [20.0, 40.0, 60.0, 80.0], shot_sigma=0.5)
    curve = replace(
        curve, dark_noise=(dark,), dark_fraction=np.ones((4, 1)), shot_covariance=np.diag(np.full(4, 0.5**2)) + 0.2**2
    )
    fit = fit_gain([curve], [np.ones(4, bool)])
    gain = gain_value(fit)
    assert gain.standard_uncertainty == pytest.approx(np.sqrt(fit.covariance[0, 0]), rel=1e-9)
    assert gain.covariance(dark) == pytest.approx(-fit.estimator[0].sum() * 0.2**2)
    assert gain.covariance(dark) < 0


def test_weights_do_not_bias_the_line_downwards():
    """1000 photon transfers of eight levels, each variance with an uncertainty of 5 % of itself: a fit weighted by
    those uncertainties is low by twice the square of that, 0.5 %; the standard error here is 0.055 %."""
    rng = np.random.default_rng(8)
    signal = np.linspace(100.0, 800.0, 8)
    gains = []
    for _ in range(1000):
        shot = 0.2 * signal * (1 + 0.05 * rng.standard_normal(8))
        curve = levels(signal, shot, shot_sigma=0.05 * shot, signal_sigma=1e-6)
        curve = replace(curve, noise=shot, noise_uncertainty=0.05 * shot)
        gains.append(fit_gain([curve], [np.ones(8, bool)]).parameters[0])
    assert np.mean(gains) == pytest.approx(0.2, rel=0.0016)
