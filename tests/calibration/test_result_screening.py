"""Results that cannot be true are withheld, with the likely cause; results that can be true pass."""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.checks.result_screening import (
    Implausible,
    screen_dark_slope,
    screen_responsivity,
    screen_variance_slope,
    too_short_for_dark_current,
)
from photosite.calibration.dark.dark_frames import measure_dark_frames
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.reduce import reduce_frames
from photosite.frames.frame_set import FrameSet
from photosite.values.uncertain import Uncertain

GAIN, BLACK, READ_DN, EFFICIENCY = 0.5, 64.0, 2.0, 0.6
LEVELS = (200.0, 400.0, 800.0, 1600.0, 2400.0, 3200.0, 5000.0, 7000.0, 9000.0)
RATE = 1e5
"""Electrons per second of the flats."""


def measurement(*, dark_e=lambda t: 20.0 * t, photon_factor=None, time_factor=1.0, levels=LEVELS, seed=0):
    """A frame set of a virtual camera; stated exposure times and photons are multiplied by a factor."""
    rng = np.random.default_rng([seed, 41])

    def shot(electrons):
        dn = np.rint(BLACK + GAIN * rng.poisson(electrons, (24, 32)) + rng.normal(0.0, READ_DN, (24, 32)))
        return np.clip(dn, 0, 4095).astype(np.uint16)

    times = [electrons / RATE for electrons in levels]
    frames = [("dark", time_factor * t, shot(dark_e(t)), 0.0) for t in (*times, 1.0, 4.0) for _ in range(6)]
    for t, electrons in zip(times, levels, strict=True):
        photons = (photon_factor or 0.0) * RATE * t / EFFICIENCY
        frames += [("light", time_factor * t, shot(electrons + dark_e(t)), photons) for _ in range(4)]
    if photon_factor is None:
        frames = [frame[:3] for frame in frames]
    return FrameSet.from_arrays(frames, bits=12)


def test_plausible_results_pass():
    calibration = calibrate(measurement(photon_factor=1.0))
    for name, truth in (
        ("system_gain_dn_per_e", GAIN),
        ("quantum_efficiency_percent", 100 * EFFICIENCY),
        ("dark_current_e_per_s", 20.0),
    ):
        entry = getattr(calibration, name)
        assert abs(entry.value - truth) < 3.3 * entry.standard_uncertainty
    assert not {"implausible", "exposure-unit"} & set(limits(calibration))


def test_a_dark_level_that_falls_gives_no_dark_current():
    calibration = calibrate(measurement(dark_e=lambda t: 40.0 - 5.0 * t))
    for name in ("dark_current_e_per_s", "dcnu_percent"):
        entry = getattr(calibration, name)
        assert (entry.value, entry.reason_id) == (None, "implausible")
    assert "implausible" in limits(calibration)
    assert calibration.system_gain_dn_per_e.value == pytest.approx(GAIN, rel=0.05)


def test_without_dark_current_half_of_the_slopes_are_negative_and_none_is_withheld():
    """16 chips without dark current: all of one sign once in 30 000; honest intervals miss by twice their width once in
    10 000."""
    signs = set()
    for seed in range(16):
        frames = measurement(dark_e=lambda t: 0.0, seed=seed, levels=LEVELS[:2])
        with FrameReader(frames) as reader:
            slope = measure_dark_frames(reduce_frames(reader), reader).pooled.dark_slope
        assert isinstance(slope, Uncertain)
        signs.add(np.sign(slope.value))
    assert signs == {-1.0, 1.0}


def test_the_limit_is_twice_the_interval():
    t = np.array([0.1, 1.0])
    assert isinstance(screen_dark_slope(Uncertain.of(-4.0, 1.0), t), Implausible)
    assert screen_dark_slope(Uncertain.of(-3.8, 1.0), t).value == -3.8
    assert isinstance(screen_dark_slope(Uncertain.of(-4.0, 1.0), t, variance=True), Implausible)
    assert isinstance(screen_responsivity(Uncertain.of(1.05, 0.01), Uncertain.of(1.0)), Implausible)
    assert screen_responsivity(Uncertain.of(1.03, 0.01), Uncertain.of(1.0)).value == 1.03


def test_a_quantum_efficiency_above_100_percent_is_withheld():
    calibration = calibrate(measurement(photon_factor=0.1))
    for name in (
        "quantum_efficiency_percent",
        "responsivity_dn_per_photon",
        "sensitivity_threshold_photons",
        "saturation_capacity_photons",
    ):
        entry = getattr(calibration, name)
        assert (entry.value, entry.reason_id) == (None, "implausible"), name
    assert calibration.saturation_capacity_e.value == pytest.approx((4095 - BLACK) / GAIN, rel=0.05)
    assert "implausible" in limits(calibration)


@pytest.mark.parametrize("off", [1e-6, 4e-8])
def test_exposure_times_in_another_unit_give_no_dark_current(off):
    calibration = calibrate(measurement(time_factor=off))
    for name in ("dark_current_e_per_s", "dark_current_from_variance_e_per_s", "dark_voltage_mv_per_s", "dcnu_percent"):
        entry = getattr(calibration, name)
        assert (entry.value, entry.reason_id) == (None, "implausible"), name
    assert "implausible" in limits(calibration)
    assert "exposure-unit" not in limits(calibration)  # one warning is enough
    assert calibration.read_noise_dn.value == pytest.approx(READ_DN, rel=0.05)


def test_the_factor_of_another_unit():
    assert too_short_for_dark_current(np.array([2e-5, 1e-4])) is None
    assert too_short_for_dark_current(np.array([0.0, 1.0])) is None
    for exposures, text in (
        ((1e-6, 2e-5), "factor of 1000 or more (0.001 to 0.02 s), microseconds"),
        ((1e-14, 2e-12), "factor of 1000000000 or more (1e-05 to 0.002 s), seconds"),
    ):
        assert text in too_short_for_dark_current(np.array(exposures)).reason


def test_maps_hold_no_dark_rate_in_another_unit():
    chip = calibrate(measurement(time_factor=1e-6, levels=LEVELS[:4]), maps=True).chip
    assert chip.dark_rate_dn_per_s is None
    assert chip.prnu is not None


def test_a_variance_that_does_not_grow_is_withheld_where_the_level_falls():
    fallen = screen_dark_slope(Uncertain.of(-9.0, 1.0), np.array([0.1, 1.0]))
    withheld = screen_variance_slope(Uncertain.of(1.0, 0.5), fallen)
    assert isinstance(withheld, Implausible)
    clamped = Uncertain.of(5.0, 0.5)  # black level clamping: the dark current shows in the variance only
    assert screen_variance_slope(clamped, fallen) is clamped
    assert screen_variance_slope(Uncertain.of(1.0, 0.5), Uncertain.of(1.0, 0.5)).value == 1.0


def test_two_levels_that_scatter_by_chance_are_not_named():
    """2.4 standard uncertainties with one degree of freedom: one clean set in 60."""
    found = calibrate(measurement(levels=(1000.0, 2000.0), seed=5))
    assert "scattered-photon-transfer" not in limits(found)
