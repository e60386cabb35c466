"""The virtual gain series: sensor at a setting, frames and folder."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from virtual_gain_series import GainModel, gain_series_lab, gain_series_protocol

import photosite as ps
from photosite.errors import InputError
from photosite.sensor.model import Sensor


def base() -> Sensor:
    return ps.load_sensor("nikon-d200").with_(rows=32, cols=48, black_level_dn=200, analog_gain=1.0)


@pytest.mark.parametrize("proportional", [False, True])
def test_settings_in_closed_form(proportional: bool) -> None:
    """The variance in DN is (pre K)^2 + post^2; K is proportional to the setting, and to the ratio at the switch."""
    model = GainModel(0.3, 1.2, switch_at=400, conversion_gain_ratio=2.5, keeps_proportion=proportional)
    lowest = base().system_gain_dn_per_e
    for setting in (100.0, 200.0, 400.0, 800.0):
        sensor = model.sensor(base(), setting, 100.0)
        high = setting >= 400
        gain = lowest * setting / 100 * (2.5 if high and not proportional else 1.0)
        assert sensor.system_gain_dn_per_e == pytest.approx(gain, rel=1e-12)
        pre_e = 0.3 / (0.030 * (2.5 if high else 1.0))
        assert model.pre_amplifier_noise_e(sensor) == pytest.approx(pre_e, rel=1e-12)
        noise_dn = sensor.noise.read_noise_mv.value / sensor.mv_per_dn
        assert noise_dn == pytest.approx(math.hypot(pre_e * gain, 1.2), rel=1e-12)


def test_frames_in_memory_and_in_the_folder_are_equal(tmp_path: Path) -> None:
    lab = gain_series_lab(base(), GainModel(0.3, 1.2), (100, 400), gain_series_protocol(4, 3, 2), seed=3)
    lab.write(tmp_path / "stack")
    made, read = lab.frame_set(), ps.open_frames(tmp_path / "stack")
    assert read.gain_settings == made.gain_settings == (100.0, 400.0)
    assert read.frame_count == made.frame_count == 2 * (4 + 8 + 6)
    for setting in made.gain_settings:
        for one, other in zip(made.at_gain(setting).groups, read.at_gain(setting).groups, strict=True):
            assert (one.kind, one.exposure_s, len(one)) == (other.kind, other.exposure_s, len(other))
            for dn, again in zip(one, other, strict=True):
                np.testing.assert_array_equal(dn, again)
    assert read.sensor is not None
    assert read.sensor.readout.analog_gain.value == 1.0
    assert read.sensor.noise.read_noise_mv.assumed


def test_settings_share_the_fixed_pattern_only() -> None:
    lab = gain_series_lab(base().with_(dsnu_mv=5.0), GainModel(0.05, 0.1), (100, 101), gain_series_protocol(4, 2, 1))
    first, second = (next(iter(frames.of_kind("dark")[0])) for frames in map(lab.frame_set().at_gain, (100, 101)))
    assert (first != second).any()
    assert np.corrcoef(first.ravel(), second.ravel())[0, 1] > 0.9  # the fixed pattern is a hundred times the noise


@pytest.mark.parametrize("settings", [(), (0, 100), (200, 100), (100, 100)])
def test_settings_must_ascend(settings: tuple[float, ...]) -> None:
    with pytest.raises(InputError) as caught:
        gain_series_lab(base(), GainModel(0.3, 1.2), settings)
    assert caught.value.what == "settings"
