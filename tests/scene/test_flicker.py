"""Waveforms of lamps: mean 1, and integrals against closed forms and sums of many samples."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.scene.flicker import PulseFlicker, SineFlicker, TableFlicker

FLICKERS = [
    SineFlicker(100.0, depth=0.3, phase_deg=40.0),
    PulseFlicker(250.0, duty=0.3, phase_deg=100.0),
    TableFlicker(120.0, (1.0, 2.0, 0.5, 0.0, 1.5)),
]


@pytest.mark.parametrize("flicker", FLICKERS)
def test_the_integral_is_the_limit_of_sums(flicker) -> None:
    begin = np.array([0.0, 0.0123, 1.7, -0.4])
    length = np.array([0.0004, 0.01, 0.033, 0.0021])
    samples = 200_000
    middle = (np.arange(samples) + 0.5) / samples
    sums = flicker.light(begin[:, None] + length[:, None] * middle).mean(axis=1) * length
    assert flicker.integral_s(begin, begin + length) == pytest.approx(sums, rel=1e-4)


@pytest.mark.parametrize("flicker", FLICKERS)
def test_the_mean_over_whole_periods_is_one_at_any_time(flicker) -> None:
    period = 1 / flicker.frequency_hz
    begin = np.array([0.0, 0.3 * period, 86_400.0])
    assert flicker.integral_s(begin, begin + 3 * period) == pytest.approx(3 * period, rel=1e-9)


def test_an_exposure_keeps_sinc_of_the_depth_of_mains() -> None:
    lamp = SineFlicker(100.0, depth=0.3)
    begin = np.linspace(0, 0.01, 1001)
    for exposure in (0.001, 0.004, 0.013):
        mean = lamp.integral_s(begin, begin + exposure) / exposure
        assert (mean.max() - mean.min()) / 2 == pytest.approx(0.3 * abs(np.sinc(100 * exposure)), rel=1e-4)


def test_pulses_have_their_duty() -> None:
    lamp = PulseFlicker(1000.0, duty=0.2)
    begin = (np.arange(1000) + 0.5) * 1e-6
    lit = lamp.integral_s(begin, begin + 1e-9) > 0
    assert lit.mean() == pytest.approx(0.2)
    assert lamp.light(begin)[lit] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: SineFlicker(0.0, 0.2), "frequency_hz"),
        (lambda: SineFlicker(100.0, 1.1), "depth"),
        (lambda: PulseFlicker(100.0, 0.0), "duty"),
        (lambda: TableFlicker(100.0, (1.0, -0.1)), "table"),
        (lambda: TableFlicker(100.0, (0.0, 0.0)), "table"),
    ],
)
def test_invalid_waveforms(make, field) -> None:
    with raises(InputError, field):
        make()
