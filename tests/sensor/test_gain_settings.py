"""Sensor files with several gain settings, and frames simulated at them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.sensor.io.sensor_file import dump_sensor, parse_sensor
from photosite.values.uncertain import Measured

FILE = """\
photosite_sensor: 1
name: Mine
array: {rows: 24, cols: 32, cfa: mono}
pixel: {pitch_um: 3.45, full_well_e: 10500}
channels:
  M: {wavelength_nm: [400, 700], quantum_efficiency: [0.5, 0.6]}
noise: {read_noise_e: 2.4, dsnu_e: 1.1, prnu_percent: 0.6, dark_current_e_per_s: 1.5}
readout:
  bits: 12
  black_level_dn: 64
  system_gain_dn_per_e: {value: 0.39, standard_uncertainty: 0.004}
gain_setting: 100
gain_settings:
- {setting: 200, system_gain_dn_per_e: 0.78, read_noise_e: 2.0} # the same pixel
- setting: 800
  system_gain_dn_per_e: {value: 3.12, standard_uncertainty: 0.02}
  read_noise_dn: 4.68
  full_well_e: 4000
"""


def facts(sensor: ps.Sensor) -> list[float]:
    noise = sensor.noise
    in_volts = [noise.read_noise_mv, noise.dsnu_mv, noise.dark_voltage_mv_per_s]
    electrons = [sensor.electrons(entry.value) for entry in in_volts]
    return [sensor.system_gain_dn_per_e, *electrons, sensor.pixel.well_capacity_e.value]


@pytest.mark.parametrize(
    ("setting", "expected"),
    [(100, [0.39, 2.4, 1.1, 1.5, 10500]), (200, [0.78, 2.0, 1.1, 1.5, 10500]), (800, [3.12, 1.5, 1.1, 1.5, 4000])],
)
def test_values_at_a_setting(setting: float, expected: list[float]) -> None:
    sensor = parse_sensor(FILE, "mine.yaml")
    assert sensor.all_gain_settings == (100, 200, 800)
    at = sensor.at_gain_setting(setting)
    assert (at.gain_setting, at.all_gain_settings) == (setting, (100, 200, 800))
    assert facts(at) == pytest.approx(expected)
    assert at.at_gain_setting(100) == sensor
    again = parse_sensor(dump_sensor(at), "again.yaml")
    for each in (100, 200, 800):
        assert facts(again.at_gain_setting(each)) == pytest.approx(facts(sensor.at_gain_setting(each)))


def test_uncertainty_of_the_gain_at_a_setting() -> None:
    """The read noise at 200 is in electrons, and K is exact there; DSNU has that of the first setting, in electrons."""
    sensor = parse_sensor(FILE, "mine.yaml")
    relative = {}
    for setting in (100, 800):
        at = sensor.at_gain_setting(setting)
        names = ["conversion_gain_uv_per_e", "analog_gain"]
        fraction = 1.0 / np.array([at.measured(name).value for name in names])
        relative[setting] = float(np.sqrt(fraction @ at.covariance_of(names) @ fraction))  # swing is exact
    assert relative == pytest.approx({100: 0.004 / 0.39, 800: 0.02 / 3.12})


def test_another_conversion_gain_keeps_electrons() -> None:
    """Noise and dark current that a setting does not state are those above in electrons, and stay so in files.

    By hand: 160 uV/e- and 1 V at 12 bits are 160e-6 * 4096 = 0.65536 DN/e-; the dark current remains 1.5 e-/s, which
    is 0.24 mV/s there. Its uncertainty does not contain that of the conversion gain of the first setting.
    """
    old = "- {setting: 200, system_gain_dn_per_e: 0.78, read_noise_e: 2.0} # the same pixel"
    file = FILE.replace(old, "- {setting: 200, conversion_gain_uv_per_e: 160}").replace(
        "dark_current_e_per_s: 1.5", "dark_current_e_per_s: {value: 1.5, standard_uncertainty: 0.1}"
    )
    sensor = parse_sensor(file, "mine.yaml")
    at = sensor.at_gain_setting(200)
    assert facts(at) == pytest.approx([0.65536, 2.4, 1.1, 1.5, 10500])
    dark = at.noise.dark_voltage_mv_per_s
    assert (dark.value, dark.standard_uncertainty) == pytest.approx((0.24, 0.016))
    names = ["dark_voltage_mv_per_s", "conversion_gain_uv_per_e"]
    assert at.covariance_of(names)[0, 1] == pytest.approx(0.0, abs=1e-12)
    for each in (sensor.with_(serial="2"), at):
        again = parse_sensor(dump_sensor(each), "again.yaml")
        for setting in (100, 200, 800):
            assert facts(again.at_gain_setting(setting)) == pytest.approx(facts(sensor.at_gain_setting(setting)))


def test_settings_that_are_no_iso_are_written_as_such() -> None:
    sensor = parse_sensor(FILE, "mine.yaml")
    factor = sensor.with_(gain_setting_is_iso=False)
    for one, written in ((sensor, False), (factor, True), (factor.with_(gain_setting_is_iso=True), False)):
        for text in (dump_sensor(one), dump_sensor(ps.Sensor.model_validate(one.model_dump()))):
            assert ("gain_setting_is_iso: false" in text, "gain_setting_is_iso" in text) == (written, written)
            assert parse_sensor(text, "x").gain_setting_is_iso is not written


@pytest.mark.parametrize("noise", ["read_noise_dn: 1.0", "read_noise_mv: 1.0"])
def test_the_same_volts_at_another_gain_are_written(noise: str) -> None:
    """The same DN or volts at two gains are different electrons: neither may be left out of a file as a repeat."""
    gains = {
        "read_noise_dn: 1.0": ("system_gain_dn_per_e: 0.78", 1 / 0.78),
        "read_noise_mv: 1.0": ("conversion_gain_uv_per_e: 160", 1e3 / 160),
    }
    gain, expected_e = gains[noise]
    old = "system_gain_dn_per_e: 0.78, read_noise_e: 2.0"
    file = FILE.replace("read_noise_e: 2.4", noise).replace(old, f"{gain}, {noise}")
    sensor = parse_sensor(file.replace("pitch_um:", "conversion_gain_uv_per_e: 40, pitch_um:"), "mine.yaml")
    fewer = sensor.with_(gain_settings=sensor.gain_settings[:1])
    for file in (dump_sensor(fewer), dump_sensor(ps.Sensor.model_validate(fewer.model_dump()))):
        again = parse_sensor(file, "again.yaml").at_gain_setting(200)
        assert again.electrons(again.noise.read_noise_mv.value) == pytest.approx(expected_e)


def test_files_keep_the_units_of_their_settings() -> None:
    sensor = parse_sensor(FILE, "mine.yaml")
    lines = dump_sensor(sensor.with_(read_noise_e=Measured(2.3))).splitlines()
    assert [line for line in lines if line not in FILE.splitlines()] == [
        "noise: {read_noise_e: 2.3, dsnu_e: 1.1, prnu_percent: 0.6, dark_current_e_per_s: 1.5}"
    ]


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("setting: 200", "setting: 100", "gain_setting"),
        ("setting: 200", "setting: 900", "gain_settings"),
        ("gain_setting: 100\n", "", "field 'gain_setting' is missing"),
        ("read_noise_e: 2.0", "read_noise_e: -2.0", "value"),
        ("read_noise_e: 2.0", "read_noise_e: 2.0, read_noise_dn: 9.0", "read_noise_dn"),
        ("read_noise_e: 2.0", "pitch_um: 2.0", "unknown field 'pitch_um'"),
        ("{setting: 200, ", "{", "field 'setting' is missing"),
        ("read_noise_e: 2.0", "read_noise_mv: 0.2", "read_noise_mv"),
    ],
)
def test_invalid_settings(old: str, new: str, what: str) -> None:
    assert old in FILE
    with raises(FileError, what, path="mine.yaml"):
        parse_sensor(FILE.replace(old, new, 1), "mine.yaml")


def test_unknown_settings() -> None:
    with raises(InputError, "gain_setting", value=400, expected="one of 100, 200, 800"):
        parse_sensor(FILE, "mine.yaml").at_gain_setting(400)
    with raises(InputError, "gain_setting", value=100):
        ps.load_sensor("nikon-d200").at_gain_setting(100)


def test_frames_at_a_setting(tmp_path: Path) -> None:
    sensor = parse_sensor(FILE, "mine.yaml")
    lens = ps.DiffractionLimited(f_number=4, focal_length_mm=8)
    grey = ps.charts.uniform("A", 20)
    slow, fast = (ps.Camera(lens, sensor, gain_setting=setting).capture(grey, 0.004) for setting in (100, 200))
    assert (fast.dn.mean() - 64) / (slow.dn.mean() - 64) == pytest.approx(2.0, rel=0.05)
    factor = ps.Camera(lens, sensor.with_(gain_setting_is_iso=False), gain_setting=200).capture(grey, 0.004)
    for frame, iso in ((fast, 200), (factor, None)):
        frame.save(tmp_path / f"{iso}.dng")
        assert ps.read_raw(tmp_path / f"{iso}.dng").metadata["gain_setting"] == 200
        with tifffile.TiffFile(tmp_path / f"{iso}.dng") as file:
            tag = file.pages[0].tags.get(34855)  # type: ignore[union-attr]
        assert iso == (None if tag is None else tag.value)


def test_camera_file_with_a_setting(tmp_path: Path) -> None:
    (tmp_path / "mine.sensor.yaml").write_text(FILE)
    camera = tmp_path / "mine.camera.yaml"
    camera.write_text("photosite_camera: 1\nsensor: mine.sensor.yaml\ngain_setting: 800\n")
    assert ps.load_camera(camera).camera.sensor.gain_setting == 800
    camera.write_text("photosite_camera: 1\nsensor: mine.sensor.yaml\ngain_setting: 400\n")
    with raises(FileError, "gain_setting") as caught:
        ps.load_camera(camera)
    assert caught.value.line == 3
