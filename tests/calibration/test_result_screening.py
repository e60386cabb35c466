"""Units, exposures and bits that cannot be true are named, with the likely cause; what can be true passes."""

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.checks.result_screening import (
    Implausible,
    of_variance,
    screen_dark_slope,
    screen_responsivity,
)
from photosite.calibration.checks.result_screening import (
    too_short_for_dark_current as too_short,
)
from photosite.errors import CalibrationError
from photosite.frames.frame_set import frame_set_from_arrays
from photosite.values.uncertain import Uncertain

GAIN, BLACK, READ_DN, EFFICIENCY = 0.5, 64.0, 2.0, 0.6
LEVELS = (200.0, 400.0, 800.0, 1600.0, 2400.0, 3200.0, 5000.0, 7000.0, 9000.0)
RATE = 1e5
"""Electrons per second of the flats."""


def shot(rng, electrons, *, bits=12, black=BLACK, shape=(24, 32)):
    dn = np.rint(black + GAIN * rng.poisson(electrons, shape) + rng.normal(0.0, READ_DN, shape))
    return np.clip(dn, 0, 2**bits - 1).astype(np.uint16)


def measurement(
    *, dark_e=lambda t: 20.0 * t, stated_s=lambda t: t, stated_photons=None, bits=12, black=BLACK, levels=LEVELS, seed=0
):
    """(kind, exposure, dn, photons) of a virtual camera; what is stated of its exposures and light may be wrong."""
    rng = np.random.default_rng([seed, 41])
    times = [electrons / RATE for electrons in levels]
    frames = [("dark", t, shot(rng, dark_e(t), bits=bits, black=black)) for t in (*times, 1.0, 4.0) for _ in range(6)]
    for t, electrons in zip(times, levels, strict=True):
        for _ in range(4):
            frames.append(("light", stated_s(t), shot(rng, electrons + dark_e(t), bits=bits, black=black)))
    if stated_photons is None:
        return frames
    return [(*frame, stated_photons(frame[1]) if frame[0] == "light" else 0.0) for frame in frames]


def calibrated(frames, bits=12):
    return calibrate(frame_set_from_arrays(frames, bits=bits))


def photons(t):
    return RATE * t / EFFICIENCY


def test_what_can_be_true_passes():
    calibration = calibrated(measurement(stated_photons=photons))
    for name, truth in (("system_gain_dn_per_e", GAIN), ("quantum_efficiency_percent", 100 * EFFICIENCY)):
        entry = getattr(calibration, name)
        assert abs(entry.value - truth) < 3.3 * entry.standard_uncertainty
    assert (
        abs(calibration.dark_current_e_per_s.value - 20.0) < 3.3 * calibration.dark_current_e_per_s.standard_uncertainty
    )
    assert not any("could not be true" in text or "shutter" in text for text in calibration.warnings)


def test_a_dark_level_that_falls_is_no_dark_current():
    calibration = calibrated(measurement(dark_e=lambda t: 40.0 - 5.0 * t))
    for name in ("dark_current_e_per_s", "dcnu_percent"):
        entry = getattr(calibration, name)
        assert entry.value is None
        assert "the dark level falls by" in entry.reason
        assert "black clamping" in entry.reason
        assert "unit" in entry.reason
    assert any(text.startswith("dark current could not be true") for text in calibration.warnings)
    assert calibration.system_gain_dn_per_e.value == pytest.approx(GAIN, rel=0.05)


def test_a_dark_current_of_none_comes_out_negative_half_the_time_and_is_no_nonsense():
    """Of 40 chips without dark current; honest intervals miss by twice their width once in 10 000."""
    values = [
        calibrated(measurement(dark_e=lambda t: 0.0, seed=s, levels=LEVELS[:3])).dark_current_e_per_s for s in range(40)
    ]
    assert {np.sign(entry.value) for entry in values} == {-1.0, 1.0}


def test_the_bound_is_twice_the_interval():
    t = np.array([0.1, 1.0])
    assert isinstance(screen_dark_slope(Uncertain.of(-4.0, 1.0), t), Implausible)
    assert screen_dark_slope(Uncertain.of(-3.8, 1.0), t).value == -3.8
    assert "temporal variance falls by 3.6" in screen_dark_slope(Uncertain.of(-4.0, 1.0), t, of_variance=True).reason
    assert isinstance(screen_responsivity(Uncertain.of(1.05, 0.01), Uncertain.of(1.0)), Implausible)
    assert screen_responsivity(Uncertain.of(1.03, 0.01), Uncertain.of(1.0)).value == 1.03


def test_photons_that_would_free_more_electrons_than_there_are_photons():
    calibration = calibrated(measurement(stated_photons=lambda t: photons(t) / 10))
    for name in (
        "quantum_efficiency_percent",
        "responsivity_dn_per_photon",
        "sensitivity_threshold_photons",
        "saturation_capacity_photons",
    ):
        entry = getattr(calibration, name)
        assert entry.value is None, name
        assert "quantum efficiency of 6" in entry.reason
        assert "none is above 100 %" in entry.reason
    assert calibration.saturation_capacity_e.value == pytest.approx((4095 - BLACK) / GAIN, rel=0.05)
    assert any(text.startswith("quantum efficiency could not be true") for text in calibration.warnings)


def test_flats_that_end_at_the_top_of_a_smaller_converter():
    levels = (50.0, 100.0, 150.0, 200.0, 300.0, 3000.0)
    with pytest.raises(CalibrationError, match=r"read 255 DN in every pixel, the top of a 8-bit.*12 bits are stated"):
        calibrated(measurement(bits=8, black=20.0, levels=levels))
    assert calibrated(measurement(bits=8, black=20.0, levels=levels), bits=8).saturation_dn.value == 255.0


@pytest.mark.parametrize("low", [1, 7])
def test_some_pixels_that_respond_less_do_not_hide_the_top(low):
    frames = measurement(bits=10, levels=(*LEVELS[:4], 6000.0))
    frames = [
        (kind, t, np.where(np.arange(dn.size).reshape(dn.shape) < low, dn // 2 + 32, dn)) for kind, t, dn in frames
    ]
    with pytest.raises(CalibrationError, match=r"read 1023 DN in 9.* % of the pixels, the top of a 10-bit converter"):
        calibrated(frames, bits=16)
    assert calibrated(frames, bits=10).saturation_dn.value == pytest.approx(1023.0, abs=6.0)


def test_numbers_moved_up_to_sixteen_bits():
    frames = [(kind, t, dn << 4) for kind, t, dn in measurement()]
    with pytest.raises(CalibrationError, match=r"multiples of 16: they are those of a 12-bit converter moved up by 4"):
        calibrated(frames, bits=16)


def test_mixed_units_are_named_with_their_factor():
    frames = measurement(stated_s=lambda t: 1e3 * t if 0.007 < t < 0.02 else t)  # two levels in ms
    with pytest.raises(CalibrationError, match=r"off by a thousand: units are mixed"):
        calibrated(frames)


def test_exchanged_levels_are_named():
    wrong = {0.004: 0.016, 0.016: 0.004}
    frames = measurement(stated_s=lambda t: wrong.get(round(t, 6), t))
    with pytest.raises(CalibrationError, match=r"does not go with the stated exposure times.*levels were exchanged"):
        calibrated(frames)


def test_a_lamp_that_was_dimmed_against_the_exposure():
    rng = np.random.default_rng(5)
    frames = [f for f in measurement() if f[0] == "dark"]
    frames += [("light", t, shot(rng, 1500.0)) for t in (0.001, 0.002, 0.004, 0.008) for _ in range(4)]
    with pytest.raises(CalibrationError, match=r"the signal is the same whatever is stated: automatic exposure"):
        calibrated(frames)


def test_photons_that_the_signal_does_not_know_of():
    frames = measurement(stated_photons=lambda t: round(photons(t) * [0.2, 1.0, 5.0][int(1e6 * t) // 2000 % 3]))
    with pytest.raises(CalibrationError, match=r"stated photons.*it goes with the exposure times instead"):
        calibrated(frames)


def test_a_dark_group_that_was_lit_is_named():
    frames = measurement()
    lit = {0.032: 2000.0}
    rng = np.random.default_rng(7)
    frames = [
        (kind, t, shot(rng, lit[round(t, 6)]) if kind == "dark" and round(t, 6) in lit else dn)
        for kind, t, dn in frames
    ]
    with pytest.raises(CalibrationError, match=r"dark frames at 0\.032 s read .* light fell on them"):
        calibrated(frames)


def test_darks_that_grow_like_flats_are_told():
    calibration = calibrated(measurement(dark_e=lambda t: 0.02 * RATE * min(t, 1.0)))
    assert not any("leaked" in text for text in calibration.warnings)
    lit = measurement(dark_e=lambda t: 0.6 * RATE * min(t, 0.1), levels=LEVELS[:5])
    calibration = calibrated([frame for frame in lit if frame[1] < 0.1])
    assert any("if light leaked in" in text for text in calibration.warnings)


def test_exposures_that_no_shutter_makes_are_told():
    frames = [(kind, 1e-6 * t if kind == "light" else 1e-3 * t, dn) for kind, t, dn in measurement()]
    calibration = calibrated(frames)
    assert any("hardly a shutter is as fast" in text for text in calibration.warnings)


@pytest.mark.parametrize(
    ("off", "factor", "unit"), [(1e-6, "1000 or more", "microseconds"), (4e-8, "1000000 or more", "milliseconds")]
)
def test_exposures_in_another_unit_give_no_dark_current(off, factor, unit):
    calibration = calibrated([(kind, off * t, dn) for kind, t, dn in measurement()])
    for name in (
        "dark_current_e_per_s",
        "dark_current_from_variance_e_per_s",
        "dark_voltage_mv_per_s",
        "dcnu_percent",
    ):
        entry = getattr(calibration, name)
        assert entry.value is None, name
        assert "an EMVA descriptor's times are nanoseconds" in entry.reason, name
        assert f"off by a factor of {factor}" in entry.reason, name
        assert f"{unit} where nanoseconds belong" in entry.reason, name
    assert any(text.startswith("dark current could not be true") for text in calibration.warnings)
    assert not any("shutter" in text for text in calibration.warnings)  # said once
    assert calibration.read_noise_dn.value == pytest.approx(READ_DN, rel=0.05)


def test_the_factor_of_another_unit():
    assert too_short(np.array([2e-5, 1e-4])) is None
    assert too_short(np.array([0.0, 1.0])) is None
    assert "factor of 1000 or more (0.001 to 0.02 s), microseconds" in too_short(np.array([1e-6, 2e-5])).reason
    assert "factor of 1000000000 or more (1e-05 to 0.002 s), seconds" in too_short(np.array([1e-14, 2e-12])).reason


def test_maps_hold_no_dark_rate_in_another_unit():
    frames = frame_set_from_arrays([(kind, 1e-6 * t, dn) for kind, t, dn in measurement(levels=LEVELS[:4])], bits=12)
    chip = calibrate(frames, maps=True).chip
    assert chip.dark_rate_dn_per_s is None
    assert chip.prnu is not None


def test_a_variance_that_does_not_grow_is_no_dark_current_where_the_level_fell():
    fallen = screen_dark_slope(Uncertain.of(-9.0, 1.0), np.array([0.1, 1.0]))
    withheld = of_variance(Uncertain.of(1.0, 0.5), fallen)
    assert isinstance(withheld, Implausible)
    assert "does not grow beyond chance" in withheld.reason
    assert "the dark level falls" in withheld.reason
    clamped = Uncertain.of(5.0, 0.5)  # a camera that holds its dark level shows it here alone
    assert of_variance(clamped, fallen) is clamped
    assert of_variance(Uncertain.of(1.0, 0.5), Uncertain.of(1.0, 0.5)).value == 1.0


def test_a_lens_cap_left_on_is_no_flat():
    frames = [(kind, t, dn) for kind, t, dn in measurement() if kind == "dark"]
    with pytest.raises(CalibrationError, match="no more than the darks'"):
        calibrated(frames + [("light", 0.01 * k, dn - np.uint16(1)) for k in (1, 2) for _, _, dn in frames[:4]])
