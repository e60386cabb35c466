"""Calibration of several captures: values of each, ratios of sensitivity, and reasons where one cannot be given."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.raising import raises

import photosite as ps
from photosite.calibration.captures.each_capture import CaptureCalibration, calibrate_captures
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSet
from photosite.sensor.capture_readout import part_sensor
from photosite.sensor.readout import read_captures
from photosite.sensor.shot import Shot

PARTS = [
    {"name": "high"},
    {"name": "low", "charge": "shared", "charge_of": "high", "relative_gain": 0.3, "read_noise_e": 40},
    {"name": "short", "relative_exposure": 0.1, "read_noise_e": 4},
]
SENSOR = ps.load_sensor("sony-imx174").with_(
    rows=48, cols=48, read_noise_e=4, captures={"parts": PARTS, "combination": {"dn_per_e": 1}}
)
TRUTH = {"low": 1.0, "short": 0.1}


def frames(levels_e: list[float], size: int = 48) -> dict[str, FrameSet]:
    sensor = SENSOR.with_(rows=size, cols=size)
    taken: dict[str, list[tuple[str, float, np.ndarray]]] = {name: [] for name in sensor.captures.names}
    settings = [("dark", time_s, 0.0) for time_s in (0.01, 0.1)] + [("light", e / 1e6, e) for e in levels_e]
    for number, (kind, time_s, mean_e) in enumerate(setting for setting in settings for _ in range(4)):
        mean = np.full((size, size), mean_e, np.float32)
        captured = read_captures(sensor, None, mean, time_s, Shot(seed=5, frame=number))
        for name, dn in captured.items():
            taken[name].append((kind, time_s, dn))
    return {name: FrameSet.from_arrays(list_, bits=12) for name, list_ in taken.items()}


@pytest.fixture(scope="module")
def found() -> CaptureCalibration:
    return calibrate_captures(frames([*np.linspace(2000, 40000, 9), *np.linspace(60000, 400000, 7)]))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["high", "low", "short"])
def test_each_capture_has_its_gain_and_noise(found: CaptureCalibration, name: str) -> None:
    part = part_sensor(SENSOR, name)
    truth = {
        "system_gain_dn_per_e": part.system_gain_dn_per_e,
        "read_noise_e": part.electrons(part.noise.read_noise_mv.value),
        "saturation_capacity_e": part.saturation_capacity_e,
    }
    for parameter, value in truth.items():
        entry = getattr(found.captures[name], parameter)
        assert abs(entry.value - value) < 3.5 * entry.standard_uncertainty, parameter


@pytest.mark.slow
def test_ratios_of_sensitivity(found: CaptureCalibration) -> None:
    for name, truth in TRUTH.items():
        gain = SENSOR.captures[name].relative_gain.value
        signal, sensitivity = found.signal_ratio[name], found.sensitivity_ratio[name]
        # The photodiodes of 48 x 48 pixels have a mean response within 0.02 % of the nominal one.
        assert signal.value == pytest.approx(truth * gain, rel=2e-3)
        assert signal.standard_uncertainty < 2e-3 * signal.value
        assert abs(sensitivity.value - truth) < 3.5 * sensitivity.standard_uncertainty
        assert sensitivity.standard_uncertainty < 0.05 * truth
    assert "sensitivity_ratio" in found._table().to_dict()["parameter"]


@pytest.mark.slow
def test_no_common_levels() -> None:
    high, low = frames([3000, 9000, 15000, 21000])["high"], frames([4000, 10000, 16000, 22000])["low"]
    found = calibrate_captures({"high": high, "low": low})
    assert found.signal_ratio["low"].value is found.sensitivity_ratio["low"].value is None
    assert str(found.signal_ratio["low"].reason).startswith("0 levels")


def test_frames_of_one_size() -> None:
    sets = frames([1000, 2000])
    with raises(InputError, "frames"):
        calibrate_captures({"high": sets["high"], "low": frames([1000, 2000], size=32)["low"]})
    with raises(InputError, "frames"):
        calibrate_captures({"high": sets["high"]})
