"""Gain series statistics: scale of the settings, search for the switch, coverage of the two parts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom

from photosite.calibration.gain_series.series_statistics import (
    FALSE_ALARMS,
    ReadNoise,
    find_setting_scale,
    find_switch,
    log_amplification,
    step_in_gain,
    step_in_read_noise,
)
from photosite.values.uncertain import COVERAGE_95

GAIN_U, NOISE_U = 0.005, 0.01


def draw(rng, count, switch=None, nominal=0.02, scatter=0.0, proportional=False, pre_e=3.0, post_dn=1.2, ratio=2.5):
    """Draw a series with inexact settings and a read noise that scatters about its model."""
    settings = 100.0 * 2.0 ** np.arange(count)
    high = np.arange(count) >= (count if switch is None else switch)
    gain = 0.001 * settings * np.exp(rng.normal(0.0, nominal, count))
    if not proportional:
        gain = np.where(high, ratio * gain, gain)
    pre = np.where(high, pre_e / ratio, pre_e)
    variance = ((pre * gain) ** 2 + post_dn**2) * (1.0 + rng.normal(0.0, scatter, count))
    measured = gain * (1.0 + rng.normal(0.0, GAIN_U, count))
    noise = variance * (1.0 + rng.normal(0.0, NOISE_U, count))
    return settings, ReadNoise(measured, GAIN_U * measured, noise, NOISE_U * noise)


def steps_of(settings, noise):
    rest = np.log(noise.gain) - log_amplification(settings, find_setting_scale(settings, noise.gain))
    gain_step = step_in_gain(rest, (noise.gain_uncertainty / noise.gain) ** 2)
    return gain_step, step_in_read_noise(noise)


def test_false_alarms_without_a_switch():
    """120 series, with exact and inexact settings: no more finds than the stated 1 % allows (one in 10^4)."""
    rng = np.random.default_rng(1)
    found = sum(
        find_switch(*steps_of(*draw(rng, count, nominal=nominal, scatter=scatter))) is not None
        for count in (5, 8)
        for nominal, scatter in ((0.0, 0.0), (0.05, 0.0), (0.05, 0.05))
        for _ in range(20)
    )
    assert found <= binom.ppf(1 - 1e-4, 120, FALSE_ALARMS)


@pytest.mark.parametrize("proportional", [False, True])
def test_switch_is_found_at_its_position(proportional):
    """20 series of 8 settings with 2 % errors and a switch at the fourth to seventh setting; coverage at 1e-4.

    At lower settings the post-amplifier noise hides the pre-amplifier noise, and a proportional camera shows no switch.
    """
    rng = np.random.default_rng(7)
    held = 0
    for trial in range(20):
        where = 3 + trial % 4
        switch = find_switch(*steps_of(*draw(rng, 8, switch=where, scatter=0.02, proportional=proportional)))
        assert switch is not None, trial
        assert switch.p_value < FALSE_ALARMS
        assert "read noise" in switch.seen_in or not proportional
        held += switch.first <= where <= switch.last
    assert held >= binom.ppf(1e-4, 20, 0.95)


def test_inexact_settings_are_not_a_switch():
    """All settings from the fourth on amplify 15 % more than nominal; the pre-amplifier noise has no step."""
    settings = 100.0 * 2.0 ** np.arange(8)
    gain = 0.001 * settings * np.where(np.arange(8) >= 3, 1.15, 1.0)
    variance = (3.0 * gain) ** 2 + 1.2**2
    assert find_switch(*steps_of(settings, ReadNoise(gain, 0.002 * gain, variance, 0.005 * variance))) is None


def test_step_down_is_not_a_switch():
    """The lowest setting is extended, with the gain of the next: the gain per setting falls, the noise does not."""
    settings = 50.0 * 2.0 ** np.arange(8)
    gain = 0.001 * np.maximum(settings, 100.0)
    variance = (3.0 * gain) ** 2 + 1.2**2
    assert find_switch(*steps_of(settings, ReadNoise(gain, 0.002 * gain, variance, 0.005 * variance))) is None


def test_two_parts_exactly():
    gain = np.array([0.1, 0.3, 1.0, 4.0])
    fit = ReadNoise(gain, 0.01 * gain, (2.5 * gain) ** 2 + 0.8**2, 0.01 * gain).two_parts()
    np.testing.assert_allclose(fit.parameters, [2.5**2, 0.8**2], rtol=1e-9)
    assert fit.chi_square < 1e-15


def test_intervals_of_the_two_parts_cover():
    """200 series with sampling noise only: coverage of the 95 % intervals within 4 standard errors."""
    rng = np.random.default_rng(11)
    inside = np.zeros(2)
    chi_square = []
    for _ in range(200):
        _, noise = draw(rng, 7)
        fit = noise.two_parts()
        off = np.abs(fit.parameters - [9.0, 1.44]) / np.sqrt(np.diag(fit.covariance))
        inside += off < COVERAGE_95
        chi_square.append(fit.chi_square)
    # Slightly above 95 %, because a large random scatter widens the uncertainty.
    assert (0.95 - 4 * math.sqrt(0.95 * 0.05 / 200) < inside / 200).all()
    assert (inside / 200 < 0.99).all()
    assert np.mean(chi_square) == pytest.approx(5.0, abs=4 * math.sqrt(2 * 5 / 200))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("switch", [None, 3])
def test_setting_scales_are_identified(seed, switch):
    rng = np.random.default_rng([seed, 3])
    for scale, settings in (
        ("proportional", np.array([100.0, 200, 400, 800, 1600, 3200])),
        ("tenths of a decibel", np.array([0.0, 60, 120, 180, 240, 300])),
        ("decibels", np.array([0.0, 6, 12, 18, 24, 30])),
    ):
        gain = 0.1 * np.exp(log_amplification(settings, scale) + rng.normal(0, 0.02, 6))
        if switch is not None:
            gain[switch:] *= 3.0
        assert find_setting_scale(settings, gain) == scale
