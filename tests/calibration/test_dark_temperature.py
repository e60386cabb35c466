"""Dark current at a temperature: simulated frames, and the doubling temperature measured from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.helpers.raising import raises

import photosite as ps
from photosite.calibration.dark.temperature import dark_temperature
from photosite.calibration.result import Calibration
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSet
from photosite.sensor.chip import MeasuredChip, no_blinking, no_defects
from photosite.sensor.readout import digital_numbers
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Measured

SENSOR = ps.load_sensor("nikon-d200").with_(
    rows=60,
    cols=80,
    cfa="mono",
    channels={"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}},
    black_level_dn=64,
    dark_current_e_per_s=Measured(40, 1),
    dcnu_percent=20,
    dark_current_temperature_c=25,
    dark_doubling_c=Measured(6.5, 0.1),
    gain_setting=100,
    gain_settings=[{"setting": 400, "analog_gain": 28}],
)
CAMERA = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), SENSOR)
DARK = np.zeros((60, 80), np.float32)


def calibrated(celsius: float) -> Calibration:
    frames = []
    for time_s in (0.01, 5.0):
        for n in range(8):
            raw = CAMERA.expose(DARK, time_s, temperature_c=celsius, frame=n, seed=int(celsius))
            frames.append(("dark", time_s, raw.dn, None, 100.0, celsius))
    return ps.calibrate(FrameSet.from_arrays(frames, bits=12, sensor=SENSOR))


def test_dark_current_doubles():
    """Mean of 4800 pixels against black level + K D 2^(dT / 6.5) t, 4.5 sigma."""
    for celsius in (25.0, 38.0, 5.0):
        raw = CAMERA.expose(DARK, 10.0, temperature_c=celsius)
        rate = 40 * 2 ** ((celsius - 25) / 6.5)
        gain = SENSOR.system_gain_dn_per_e
        spread = np.hypot(raw.dn.std(), 0) / np.sqrt(DARK.size)
        assert abs(raw.dn.mean() - 64 - gain * rate * 10) < 4.5 * spread
        assert raw.metadata["temperature_c"] == celsius
    warm = SENSOR.at_temperature(38)
    assert (
        warm.noise.dark_voltage_mv_per_s.standard_uncertainty
        > 4 * SENSOR.noise.dark_voltage_mv_per_s.standard_uncertainty
    )
    fast = warm.at_gain_setting(400).noise.dark_voltage_mv_per_s.value
    assert fast == pytest.approx(4 * SENSOR.at_gain_setting(400).noise.dark_voltage_mv_per_s.value)


def test_the_temperature_of_the_file_changes_nothing():
    assert (CAMERA.expose(DARK, 1.0, temperature_c=25).dn == CAMERA.expose(DARK, 1.0).dn).all()
    assert "temperature_c" not in CAMERA.expose(DARK, 1.0).metadata


def test_measured_maps_are_scaled(tmp_path: Path):
    maps = {name: np.zeros((60, 80), np.float32) for name in ("offset_dn", "offset_uncertainty_dn", "read_noise_dn")}
    chip = MeasuredChip(
        **maps,
        dark_rate_dn_per_s=np.full((60, 80), 20, np.float32),
        dark_rate_uncertainty_dn_per_s=np.zeros((60, 80), np.float32),
        read_noise_freedom=9,
        black_level_dn=64.0,
        system_gain_dn_per_e=0.1,
        reference_exposure_s=0.01,
        defects=no_defects(),
        blinking=no_blinking(),
    )
    sensor = SENSOR.with_(maps=chip.save(tmp_path / "chip.maps.h5"))
    means = [digital_numbers(sensor, DARK, 5.0, seed=1, temperature_c=celsius).mean() - 64 for celsius in (25.0, 31.5)]
    assert means[1] / means[0] == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize(
    ("sensor", "celsius", "what"),
    [
        (SENSOR.with_(dark_doubling_c=None), 30.0, "field 'dark_doubling_c' is missing"),
        (SENSOR.with_(dark_current_temperature_c=None), 30.0, "field 'dark_current_temperature_c' is missing"),
        (SENSOR, -300.0, "temperature_c"),
        (SENSOR, float("nan"), "temperature_c"),
    ],
)
def test_invalid_temperatures(sensor: ps.Sensor, celsius: float, what: str):
    with raises(InputError, what):
        sensor.at_temperature(celsius)


def test_files_keep_the_doubling_temperature(tmp_path: Path):
    SENSOR.save(tmp_path / "a.sensor.yaml")
    assert ps.load_sensor(tmp_path / "a.sensor.yaml").noise.dark_doubling_c == Measured(6.5, 0.1)
    with pytest.raises(InputError):
        SENSOR.with_(dark_doubling_c=0)


def test_the_doubling_temperature_is_measured():
    found = dark_temperature([calibrated(celsius) for celsius in (15.0, 25.0, 35.0)])
    assert found.doubling_c.interval_95 is not None
    low, high = found.doubling_c.interval_95
    assert low < 6.5 < high
    assert high - low < 0.6
    assert found.applied_to(SENSOR).noise.dark_doubling_c.standard_uncertainty > 0.0
    with raises(InputError, "calibrations"):
        dark_temperature([calibrated(15.0)])


class Stated:
    """What `dark_temperature` takes of a calibration."""

    def __init__(self, celsius: float, rate: float, uncertainty: float) -> None:
        self.temperature_c = (celsius, celsius)
        self.dark_current_dn_per_s = Estimate(rate, uncertainty)


def test_intervals_cover():
    """400 series of four temperatures, the coldest within its noise: 91.6 to 98.4 % are four binomial sigma."""
    rng = np.random.default_rng(4)
    inside, errors = 0, []
    celsius = np.array([0.0, 12.0, 24.0, 36.0])
    for _ in range(400):
        doubling = rng.uniform(5, 9)
        truth = 0.05 * 2 ** (celsius / doubling)
        u = np.hypot(0.05, 0.03 * truth)
        series = [Stated(*one) for one in zip(celsius, rng.normal(truth, u), u, strict=True)]
        found = dark_temperature(series).doubling_c  # type: ignore[arg-type]
        low, high = found.interval_95
        inside += low < doubling < high
        errors.append((1 / found.value - 1 / doubling) / (found.standard_uncertainty / found.value**2))
    assert 0.916 < inside / 400 < 0.984
    assert abs(np.mean(errors)) < 0.2


def test_equal_dark_currents_have_no_doubling_temperature():
    found = dark_temperature([Stated(c, 1.0 + 0.01 * (c == 10), 0.05) for c in (10.0, 20.0, 30.0)])  # type: ignore[list-item]
    assert found.doubling_c.value is None
    uneven = dark_temperature([Stated(*one, 0.01) for one in ((10.0, 1.0), (20.0, 2.0), (30.0, 5.0))])  # type: ignore[list-item]
    assert "beyond chance" in uneven.doubling_c.method
