"""The level at which pixels saturate: full wells are counted, developed and stated as saturated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.sensor.model import Sensor
from photosite.sensor.saturation_level import saturation_level_dn

SIZE = {"rows": 96, "cols": 128}
LENS = ps.DiffractionLimited(4, 50)
WELL = {"well_capacity_e": 8000, "system_gain_dn_per_e": 0.4, "black_level_dn": 100, "read_noise_e": 3, "dsnu_e": 1.5}
WELLS: dict[str, tuple[str, dict]] = {
    "full well": ("nikon-d200", WELL),
    "two gains": ("dual-gain-phone", {}),
    "split pixel": ("split-pixel-automotive", {}),
    "noisy": ("vendor-1.4um", {}),
    "monochrome": ("sony-imx174", {}),
    "column gains": ("nikon-d200", WELL | {"line_pattern": {"column_gain_percent": 1}}),
    "response curve": ("nikon-d200", WELL | {"response_curve": {"polynomial_percent": [-10]}}),
    "register": ("nikon-d200", WELL | {"em_gain": {"gain": 10, "register_well_e": 9000}}),
    "saved with 10 bits": ("nikon-d200", WELL | {"output": {"dropped_bits": 2}}),
    "black level subtracted": ("nikon-d200", WELL | {"output": {"subtract_black_level": True}}),
}


def sensor_of(name: str) -> Sensor:
    preset, changes = WELLS[name]
    return ps.load_sensor(preset).with_(**SIZE, **changes)


def uniform(sensor: Sensor, electrons: float) -> ps.RawFrame:
    mean = np.full((sensor.array.rows, sensor.array.cols), electrons, np.float32)
    return ps.Camera(LENS, sensor).expose(mean, 1 / 1000, seed=5)


@pytest.mark.parametrize("name", WELLS)
def test_full_pixels_are_saturated_and_others_are_not(name: str) -> None:
    sensor = sensor_of(name)
    full, level = uniform(sensor, 1e7), saturation_level_dn(sensor)
    assert full.white_level_dn == level < (1 << full.bits) - 1
    assert (full.dn >= level).mean() > 0.99
    below = 0.75 if sensor.captures is None else 0.9
    light = ps.Camera(LENS, sensor).auto_exposure_s(np.full((96, 128), 1.0, np.float32)) / 0.8 * below
    assert (uniform(sensor, light).dn >= level).mean() < 0.002


@pytest.mark.parametrize("name", ["google-pixel-4a", "nikon-d200", "raspberry-pi-hq", "sony-a7r2", "vendor-2.2um"])
def test_a_converter_that_saturates_first_gives_its_highest_number(name: str) -> None:
    sensor = ps.load_sensor(name).with_(**SIZE)
    raw = uniform(sensor, 1e5)
    assert raw.white_level_dn == (1 << sensor.readout.bits) - 1
    assert (raw.dn >= raw.white_level_dn).mean() > 0.99


@pytest.mark.parametrize("illuminant", ["A", "D65"])
@pytest.mark.parametrize("name", ["full well", "two gains", "split pixel", "noisy"])
def test_a_neutral_highlight_is_neutral(name: str, illuminant: str, tmp_path: Path) -> None:
    sensor = sensor_of(name)
    raw = ps.Camera(LENS, sensor).capture(ps.charts.uniform(illuminant, 1e6), 1 / 30, seed=1)
    raw.save(tmp_path / "shot.dng")
    read = ps.read_raw(tmp_path / "shot.dng")
    assert read.white_level_dn == raw.white_level_dn == saturation_level_dn(sensor)
    assert (read.bits, read.black_level_dn) == (raw.bits, raw.black_level_dn)
    for each in (raw, read):
        picture = ps.develop(each)[16:80, 16:112]
        assert np.quantile(picture, 0.01) > 0.999  # one full pixel in 740 is below the level
        assert np.quantile(np.ptp(picture, axis=2), 0.99) < 0.001


def test_the_noise_profile_is_that_of_the_stated_levels() -> None:
    sensor = sensor_of("full well")
    raw = uniform(sensor, 4000)
    assert raw.noise_profile is not None
    span = raw.white_level_dn - raw.black_level_dn
    scale, offset = raw.noise_profile[0]
    assert scale * span == pytest.approx(sensor.system_gain_dn_per_e)
    assert offset * span**2 == pytest.approx(0.4**2 * (3**2 + 1.5**2) + 1 / 12)


def test_a_capture_has_its_own_level() -> None:
    sensor = sensor_of("split pixel")
    full = uniform(sensor, 1e7)
    for name in full.captures:
        one = full.capture(name, sensor)
        assert (one.dn >= one.white_level_dn).mean() > 0.99
