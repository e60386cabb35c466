"""A chip's fixed pattern: keyed by the serial, spread as the file says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from photosite.sensor.chip import draw_chip
from photosite.sensor.io.sensor_file import load_sensor

SENSOR = load_sensor("nikon-d200").with_(rows=200, cols=300)
N = 200 * 300


def test_spreads_are_those_of_the_file() -> None:
    """Chi-square of 60 000 normal deviates, each way outside 1e-4: false alarms 4e-4 in all."""
    chip = draw_chip(SENSOR)
    for values, mean, spread in ((chip.prnu.map(), 0.0, 0.01126), (chip.offset_e.map(), 0.0, SENSOR.electrons(0.55))):
        square_sum = float(((values.astype(np.float64) - mean) ** 2).sum()) / spread**2
        assert stats.chi2.ppf(1e-4, N) < square_sum < stats.chi2.isf(1e-4, N)
        assert stats.kstest((values.ravel() - mean) / spread, "norm").pvalue > 1e-4


def test_dark_current_is_log_normal_with_the_mean_of_the_file() -> None:
    chip = draw_chip(SENSOR.with_(dark_voltage_mv_per_s=3.0, dcnu_percent=20.0))
    rate = chip.dark_rate_e_per_s.astype(np.float64)
    mean = SENSOR.electrons(3.0)
    assert rate.min() > 0
    assert rate.mean() == pytest.approx(mean, abs=4 * 0.2 * mean / np.sqrt(N))  # 4 sigma: 6e-5
    assert rate.std() / rate.mean() == pytest.approx(0.2, rel=0.03)  # 5 sigma of a log-normal's spread


def test_the_serial_alone_decides_the_pattern() -> None:
    chip = draw_chip(SENSOR)
    doubled = draw_chip(SENSOR.with_(prnu_percent=2.252, read_noise_mv=0))
    assert doubled.prnu.map() / 2 == pytest.approx(chip.prnu.map(), abs=1e-6)
    other = draw_chip(SENSOR.with_(serial="1"))
    correlation = np.corrcoef(chip.offset_e.map().ravel(), other.offset_e.map().ravel())[0, 1]
    assert abs(correlation) < 4 / np.sqrt(N)
    parts = np.corrcoef(chip.offset_e.map().ravel(), chip.prnu.map().ravel())[0, 1]
    assert abs(parts) < 4 / np.sqrt(N)


def test_what_does_not_vary_takes_no_memory() -> None:
    chip = draw_chip(SENSOR.with_(dsnu_mv=0))
    assert chip.offset_e.deviates.shape == (1, 1)
    assert chip.dark_rate_e_per_s.shape == (1, 1)
