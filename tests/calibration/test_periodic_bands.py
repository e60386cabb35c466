"""Periodic bands: amplitudes of sines, and the stated rate of false alarms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from photosite.calibration.chip_maps.temporal_noise import BAND_P_VALUE, find_bands

LINES = 500


@pytest.mark.parametrize("count", [1, 8])
def test_false_alarms_for_independent_lines(count) -> None:
    """1000 profiles; binomial at 1e-4 with twice the rate, because the background is the median of 65 frequencies."""
    rng = np.random.default_rng(1)
    alarms = sum(bool(find_bands(rng.normal(0, 1, (count, LINES)))) for _ in range(1000))
    assert alarms <= stats.binom.isf(1e-4, 1000, 2 * BAND_P_VALUE)


@pytest.mark.parametrize("cycles", [12, 100, 229])
def test_a_sine_is_found_with_its_amplitude(cycles) -> None:
    """Random phase in each of 10 frames; amplitude within 5 standard uncertainties."""
    rng = np.random.default_rng(2)
    phase = rng.uniform(0, 2 * np.pi, (10, 1))
    wave = 0.4 * np.sin(2 * np.pi * cycles / LINES * np.arange(LINES) + phase) + rng.normal(0, 0.5, (10, LINES))
    (band,) = find_bands(wave)
    assert band.cycles_per_pixel == cycles / LINES
    assert abs(band.amplitude_dn - 0.4) < 5 * band.standard_uncertainty_dn
    assert band.standard_uncertainty_dn < 0.02
    assert band.false_alarm_probability < 1e-9


def test_a_sine_between_two_frequencies_is_one_band() -> None:
    rng = np.random.default_rng(3)
    wave = 3 * np.sin(2 * np.pi * 60.5 / LINES * np.arange(LINES)) + rng.normal(0, 0.1, LINES)
    (band,) = find_bands(wave[None])
    assert band.cycles_per_pixel * LINES in (60, 61)
    assert 0.8 * 3 < band.amplitude_dn < 3


def test_uncertainties_are_those_of_the_amplitude() -> None:
    """Standard deviation over 400 profiles against the mean stated uncertainty: known to 3.5 %."""
    rng = np.random.default_rng(4)
    wave = 2 * np.sin(2 * np.pi * 50 / LINES * np.arange(LINES))
    bands = [find_bands((wave + rng.normal(0, 1, LINES))[None])[0] for _ in range(400)]
    spread = np.std([band.amplitude_dn for band in bands])
    assert np.mean([band.standard_uncertainty_dn for band in bands]) == pytest.approx(spread, rel=0.18)


def test_shading_and_few_lines_have_no_bands() -> None:
    lines = np.linspace(-1, 1, LINES)
    rng = np.random.default_rng(5)
    assert find_bands((5 * lines**3 + 3 * lines**2 + rng.normal(0, 0.5, LINES))[None]) == ()
    assert find_bands(np.sin(np.arange(100))[None]) == ()
    assert find_bands(np.zeros((2, LINES))) == ()
