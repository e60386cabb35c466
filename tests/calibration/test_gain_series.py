"""Calibrated gain series of virtual cameras: true values and conversion-gain switch are recovered."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from tests.helpers.diagnosed import limits
from virtual_gain_series import GainModel, gain_series_lab

import photosite as ps
from photosite.calibration.gain_series.calibrate_series import analyse_series, calibrate_series
from photosite.errors import CalibrationError, InputError
from photosite.frames.frame_set import FrameSet

SETTINGS = (100, 200, 400, 800, 1600, 3200)
PRE_MV, POST_DN = 0.2, 1.5


def lab(seed, settings=SETTINGS, **changes):
    d200 = ps.load_sensor("nikon-d200")
    base = d200.with_(
        rows=64, cols=96, cfa="mono", channels={"M": d200.channels["G"].model_dump()}, black_level_dn=200,
        analog_gain=1.0, well_capacity_e=60_000, serial=str(seed),
    )  # fmt: skip
    model = GainModel(PRE_MV, POST_DN, **changes)
    return model, gain_series_lab(base, model, settings, seed=seed)


def check(entry, true):
    """4.5 standard uncertainties; about 120 figures in this file: a false alarm in 1200 runs with other seeds."""
    assert entry.value is not None, entry.reason
    assert 0 < entry.standard_uncertainty < 0.25 * true
    assert abs(entry.value - true) < 4.5 * entry.standard_uncertainty


@pytest.mark.parametrize(
    ("seed", "switch"), [(0, {}), (1, {"switch_at": 800}), (2, {"switch_at": 800, "keeps_proportion": True})]
)
def test_true_values_are_recovered(seed, switch):
    model, shot = lab(seed, **switch)
    series = calibrate_series(shot.frame_set())
    assert series.settings == SETTINGS
    assert series.scale == "proportional"
    for step, laboratory in zip(series.steps, shot.labs, strict=True):
        true, found = laboratory.camera.sensor, step.calibration
        check(found.system_gain_dn_per_e, true.system_gain_dn_per_e)
        check(found.read_noise_e, true.electrons(true.noise.read_noise_mv.value))
        check(found.black_level_dn, 200.0)
        check(found.saturation_capacity_e, true.saturation_capacity_e)
        # Millivolts at the pixel use the nominal analog gains, which do not include a hidden change at the switch.
        hidden = model.conversion_gain_ratio if model.keeps_proportion and step.setting >= 800 else 1.0
        check(found.read_noise_mv, true.noise.read_noise_mv.value / hidden)
        check(found.conversion_gain_uv_per_e, true.pixel.conversion_gain_uv_per_e.value / hidden)
    assert (series.switch is not None) == bool(switch)
    starts = (0, 3) if switch else (0,)
    assert [mode.settings[0] for mode in series.modes] == [SETTINGS[start] for start in starts]
    for mode, start in zip(series.modes, starts, strict=True):
        check(mode.pre_amplifier_noise_e, model.pre_amplifier_noise_e(shot.labs[start].camera.sensor))
        assert mode.chi_square < 20
    check(series.modes[0].post_amplifier_noise_dn, POST_DN)
    if series.switch is not None:
        assert series.switch.between == (400, 800)
        low, high = series.switch.between_95
        assert low <= 400
        assert high >= 800
        assert "read noise" in series.switch.seen_in
        assert ("gain per setting" in series.switch.seen_in) == (not model.keeps_proportion)
        check(series.switch.gain_ratio, 1.0 if model.keeps_proportion else 3.0)
        check(series.switch.read_noise_ratio, 1 / 3)
        at_switch = "passes 1 DN per electron where the conversion gain switches, between 400 and 800"
        assert model.keeps_proportion or at_switch in series.unity_gain.reason
        content = json.loads(json.dumps(series.to_dict(), allow_nan=False))
        assert [entry["setting"] for entry in content["settings"]] == list(SETTINGS)
        assert content["settings"][0]["parameters"]["system_gain_dn_per_e"]["standard_uncertainty"] > 0
        assert content["conversion_gain_switch"]["between"] == [400, 800]
        assert content["conversion_gain_switch"]["gain_ratio"]["value"] == series.switch.gain_ratio.value
        assert content["modes"][1]["settings"] == [800, 1600, 3200]
        assert content["modes"][0]["pre_amplifier_noise_e"]["value"] > 0


def test_unity_gain_and_sensors_of_the_settings():
    """The sensor of a setting has its gain and noise, in the units of a simulation."""
    _, shot = lab(1)
    series = calibrate_series(shot.frame_set())
    check(series.unity_gain, 100 / shot.labs[0].camera.sensor.system_gain_dn_per_e)
    for step, laboratory in zip(series.steps, shot.labs, strict=True):
        true, found = laboratory.camera.sensor, step.calibration.sensor
        assert found.system_gain_dn_per_e == pytest.approx(step.calibration.system_gain_dn_per_e.value, rel=1e-12)
        assert found.readout.analog_gain.value == pytest.approx(true.readout.analog_gain.value, rel=1e-12)
        assert found.readout.analog_gain.assumed
        noise_dn = found.noise.read_noise_mv.value / found.mv_per_dn
        assert noise_dn == pytest.approx(step.calibration.read_noise_dn.value, rel=1e-12)
    assert series.sensor.gain_setting_is_iso
    assert not replace(series, scale="decibels").sensor.gain_setting_is_iso
    below = analyse_series(series.steps[:2])
    check(below.unity_gain, 100 / shot.labs[0].camera.sensor.system_gain_dn_per_e)
    assert "extrapolated from the settings 100 to 200" in below.unity_gain.method
    assert limits(below)["few-gain-settings"] == 2


def test_progress_counts_all_settings():
    _, shot = lab(0, settings=(100, 200))
    seen = []
    calibrate_series(shot.frame_set(), progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1] >= 120
    assert all(b[0] == a[0] + 1 for a, b in pairwise(seen))


def test_invalid_series():
    dn = np.zeros((2, 2), np.uint16)
    one = FrameSet.from_arrays([("dark", 0.1, dn, 0.0, 100.0)], bits=12)
    with pytest.raises(CalibrationError) as caught:
        calibrate_series(one)
    assert (caught.value.what, caught.value.value) == ("number of gain settings", 1)
    mixed = FrameSet.from_arrays([("dark", 0.1, dn, 0.0, 100.0), ("dark", 0.1, dn, 0.0)], bits=12)
    with pytest.raises(CalibrationError) as caught:
        calibrate_series(mixed)
    assert caught.value.what.startswith("some frames have no gain setting, such as frame 1 (dark, 1/10 s)")
    assert caught.value.arguments == {"where": "gain_setting=100"}
    _, shot = lab(0, settings=(100, 200))
    frames = shot.frame_set()
    dark = replace(frames, groups=frames.of_kind("dark"))
    with pytest.raises(CalibrationError) as caught:
        calibrate_series(dark)
    assert "no light frames" in caught.value.what
    with pytest.raises(InputError) as invalid:
        calibrate_series(frames).at(150)
    assert (invalid.value.what, invalid.value.value) == ("setting", 150)
