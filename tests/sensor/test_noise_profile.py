"""Noise profiles: closed forms both ways, and what they refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.sensor.noise_profile import NoiseProfile, sensor_noise_profile
from photosite.values.uncertain import Measured


def sensor(**changes):
    known = {"black_level_dn": 95, "prnu_percent": 0, **changes}
    return ps.load_sensor("nikon-d200").with_(rows=400, cols=600, **known)


def test_slope_and_offset_in_closed_form():
    s = sensor(dark_voltage_mv_per_s=3)
    profile = sensor_noise_profile(s, exposure_s=2.0, gain_setting=100)
    span, gain = 4095 - 95, s.system_gain_dn_per_e
    assert profile.channels == ("R", "G", "B")
    assert profile.slope[0].value == pytest.approx(gain / span, rel=1e-14)
    electrons2 = s.electrons(0.52) ** 2 + s.electrons(0.55) ** 2 + s.electrons(3) * 2.0
    assert profile.offset[2].value == pytest.approx((electrons2 * gain**2 + 1 / 12) / span**2, rel=1e-12)
    assert profile.system_gain_dn_per_e.value == pytest.approx(gain, rel=1e-14)


def test_sensor_from_profile_gives_gain_and_noise_back():
    s = sensor()
    again = sensor_noise_profile(s).sensor(sensor(conversion_gain_uv_per_e=1, read_noise_mv=9, dsnu_mv=9))
    assert again.pixel.conversion_gain_uv_per_e.value == pytest.approx(30, rel=1e-12)
    assert again.noise.read_noise_mv.value == pytest.approx(math.hypot(0.52, 0.55), rel=1e-12)
    assert again.noise.dsnu_mv.value == 0
    assert again.noise.dsnu_mv.assumed


def test_frames_of_the_imported_sensor_have_the_profiles_noise():
    """Variance over 240 000 pixels: 0.29 % standard error, 4.5 of them; three levels, a false alarm in 10^5 each."""
    profile = NoiseProfile(("R", "G", "B"), (Measured(3e-5),) * 3, (Measured(2e-6),) * 3, 200, 95, 4095)
    imported = profile.sensor(sensor(dark_voltage_mv_per_s=0))
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), imported)
    for level in (0.0, 0.1, 0.6):
        raw = camera.expose(np.full((400, 600), level / 3e-5, np.float32), 1e-3, seed=4)
        signal = (raw.dn - 95.0) / 4000
        assert abs(signal.var() / (3e-5 * level + 2e-6) - 1) < 4.5 * math.sqrt(2 / signal.size)


@pytest.mark.parametrize("field", ["conversion_gain_uv_per_e", "voltage_swing_v", "read_noise_mv", "black_level_dn"])
def test_uncertainties_are_those_of_small_changes(field):
    """First-order propagation against the difference that one standard uncertainty makes."""
    at = {"conversion_gain_uv_per_e": 30.0, "voltage_swing_v": 1.08, "read_noise_mv": 0.52, "black_level_dn": 95.0}[
        field
    ]
    u = 1e-4 * at
    uncertain = sensor_noise_profile(sensor(**{field: Measured(at, u)}), 1.0)
    plain, shifted = (sensor_noise_profile(sensor(**{field: at + step}), 1.0) for step in (0.0, u))
    for name in ("slope", "offset"):
        change = abs(getattr(shifted, name)[0].value - getattr(plain, name)[0].value)
        assert getattr(uncertain, name)[0].standard_uncertainty == pytest.approx(change, rel=1e-3, abs=1e-20)


def test_levels_of_another_converter():
    profile = NoiseProfile(("M",), (Measured(1e-3, 1e-5),), (Measured(4e-6),), None, 95, 4095)
    wide = profile.at_levels(16 * 95.0, 65535.0)
    assert wide.system_gain_dn_per_e.value == pytest.approx(16 * profile.system_gain_dn_per_e.value)
    assert wide.dark_noise_dn.value == pytest.approx(16 * profile.dark_noise_dn.value)
    assert wide.slope[0].standard_uncertainty / wide.slope[0].value == pytest.approx(0.01)
    assert wide.at_levels(95, 4095).slope[0].value == pytest.approx(1e-3)


def test_invalid_profiles():
    one = (Measured(1e-4),)
    with raises(InputError, "slope", value=-1e-4):
        NoiseProfile(("M",), (Measured(-1e-4),), one)
    with raises(InputError, "a noise profile needs one slope"):
        NoiseProfile(("R", "G"), one, one)
    with raises(InputError, "black_level_dn, white_level_dn"):
        NoiseProfile(("M",), one, one, black_level_dn=10, white_level_dn=5)
    with raises(InputError, "the noise profile does not state its black"):
        _ = NoiseProfile(("M",), one, one).system_gain_dn_per_e
    negative = NoiseProfile(("M",), one, (Measured(-1e-6),))
    with raises(InputError, "offset"):
        _ = negative.at_levels(10, 4095).dark_noise_dn


def test_an_offset_below_rounding_leaves_no_read_noise():
    profile = NoiseProfile(("M",), (Measured(1e-4),), (Measured(0.5 / 12 / 4000**2),))
    assert profile.sensor(sensor()).measured("read_noise_mv").value == 0.0
    assert [entry.id for entry in profile.diagnostics(sensor())] == ["negative-dark-noise"]
