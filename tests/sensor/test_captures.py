"""Sensors with several captures of one exposure: the captures, their combination, and invalid descriptions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from tests.helpers.raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.capture_readout import combined, part_sensor
from photosite.sensor.captures import Companding
from photosite.sensor.chip import MeasuredChip, no_blinking, no_defects
from photosite.sensor.io.sensor_file import load_measured_chip
from photosite.sensor.readout import digital_numbers, read_captures
from photosite.sensor.shot import Shot

BASE = ps.load_sensor("nikon-d200").with_(rows=100, cols=120, black_level_dn=64, prnu_percent=0, dsnu_mv=0)
fits = pytest.importorskip("astropy.io.fits")
SPLIT = {
    "parts": [
        {"name": "high"},
        {"name": "low", "charge": "shared", "charge_of": "high", "relative_gain": 0.25, "read_noise_e": 20},
        {
            "name": "small",
            "relative_sensitivity": 0.02,
            "read_noise_e": 5,
            "crosstalk": {"high": 0.001},
            "well_capacity_e": 8000,
        },
    ],
    "combination": {"dn_per_e": 4, "bits": 24, "black_level_dn": 16},
}
SENSOR = BASE.with_(well_capacity_e=60000, captures=SPLIT)


def numbers(sensor: ps.Sensor, mean_e: float, **options: Any) -> dict[str, np.ndarray[Any, np.dtype[np.uint16]]]:
    mean = np.full((sensor.array.rows, sensor.array.cols), mean_e, np.float32)
    return read_captures(sensor, load_measured_chip(sensor), mean, 0.01, Shot(seed=3, **options))


def test_captures_have_their_gain_noise_and_light() -> None:
    mean_e, black = 12000.0, 64
    parts = {name: dn.astype(float) - black for name, dn in numbers(SENSOR, mean_e).items()}
    electrons = {name: parts[name] / part_sensor(SENSOR, name).system_gain_dn_per_e for name in parts}
    light = {"high": 0.999, "low": 0.999, "small": 0.02 + 0.001}
    read = {"high": SENSOR.electrons(SENSOR.noise.read_noise_mv.value), "low": 20.0, "small": 5.0}
    for name, each in electrons.items():
        step = 1 / part_sensor(SENSOR, name).system_gain_dn_per_e
        variance = light[name] * mean_e + read[name] ** 2 + step**2 / 12
        count = each.size
        assert abs(each.mean() - light[name] * mean_e) < 5 * np.sqrt(variance / count)
        assert each.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / count))
    # The shot noise of a shared charge is common, the read noise is not; photodiodes are independent.
    shared = np.cov(electrons["high"].ravel(), electrons["low"].ravel())[0, 1]
    assert shared == pytest.approx(0.999 * mean_e, rel=0.06)
    assert abs(np.corrcoef(electrons["high"].ravel(), electrons["small"].ravel())[0, 1]) < 0.05


def test_first_capture_is_that_of_the_sensor_without_the_others() -> None:
    mean = np.full((100, 120), 9000, np.float32)
    captures = {"parts": [{"name": "only"}], "combination": {"dn_per_e": 1}}
    alone = digital_numbers(BASE, mean, 0.01, seed=3)
    assert (read_captures(BASE.with_(captures=captures), None, mean, 0.01, Shot(seed=3))["only"] == alone).all()


def test_combination_of_known_numbers() -> None:
    gain, small = SENSOR.system_gain_dn_per_e, 0.021
    high_dn = min(gain * 60000, 4095 - 64)
    signal = np.array([0.5, 0.8, 0.9]) * high_dn  # below, in the middle of and above the transition
    frames = {"high": 64 + signal, "low": np.array([64, 264, 1064]), "small": np.array([64, 64, 64])}
    light = {"high": signal / gain / 0.999, "low": (frames["low"] - 64) / (gain / 4) / 0.999}
    expected = [light["high"][0], (light["high"][1] + light["low"][1]) / 2, light["low"][2]]
    got = combined(SENSOR, frames)
    assert got.dtype == np.uint32
    assert got.tolist() == [int(4 * value + 16 + 0.5) for value in expected]
    bright = {"high": np.array([4095]), "low": np.array([4095]), "small": np.array([1064])}
    assert combined(SENSOR, bright).tolist() == [int(4 * 1000 / gain / small + 16 + 0.5)]
    with raises(InputError, "captures"):
        combined(SENSOR, {"high": signal})


def test_overflow_adds_to_the_first_well() -> None:
    parts = [
        {"name": "well", "well_capacity_e": 5000},
        {"name": "capacitor", "charge": "overflow", "charge_of": "well", "well_capacity_e": 25000},
    ]
    sensor = BASE.with_(captures={"parts": parts, "combination": {"dn_per_e": 1, "bits": 20}})
    for mean_e, capacitor_e in ((3000, 0), (20000, 15000), (90000, 25000)):
        frames = numbers(sensor, mean_e)
        found = (frames["capacitor"].astype(float) - 64).mean() / sensor.system_gain_dn_per_e
        assert found == pytest.approx(capacitor_e, abs=10)
        assert combined(sensor, frames).mean() == pytest.approx(min(mean_e, 30000), rel=0.005)


def test_raw_frame_has_captures_and_regions_are_parts_of_the_frame() -> None:
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), SENSOR)
    ramp = np.geomspace(1, 2e6, 120, dtype=np.float32) * np.ones((100, 1), np.float32)
    raw = camera.expose(ramp, 0.01, seed=1)
    assert set(raw.captures) == {"high", "low", "small"}
    assert (raw.dn.dtype, raw.bits, raw.black_level_dn) == (np.uint32, 24, 16)
    part = camera.expose(ramp, 0.01, seed=1, region=(11, 30, 41, 99))
    assert (part.dn == raw.dn[11:30, 41:99]).all()
    assert all((part.captures[name] == raw.captures[name][11:30, 41:99]).all() for name in raw.captures)
    assert (combined(SENSOR, raw.captures) == raw.dn).all()
    assert (digital_numbers(SENSOR, ramp, 0.01, seed=1) == raw.dn).all()
    # Up to saturation, the mean of a column is its light.
    dn = raw.dn.mean(axis=0) - 16
    lit = (ramp[0] > 1000) & (ramp[0] < 250_000)
    assert dn[lit] / 4 == pytest.approx(ramp[0][lit], rel=0.03)
    clean = camera.clean_dn(ramp)[0] - 16
    assert clean[lit] / 4 == pytest.approx(ramp[0][lit], rel=0.01)


def test_companded_frame(tmp_path: Path) -> None:
    table = {"linear_dn": [0, 2048, 65536, 2**24 - 1], "companded_dn": [0, 1024, 2560, 4095], "bits": 12}
    sensor = SENSOR.with_(combination={**SPLIT["combination"], "companding": table})
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    ramp = np.geomspace(1, 2e6, 120, dtype=np.float32) * np.ones((100, 1), np.float32)
    camera_of_linear = ps.Camera(camera.optics, SENSOR)
    raw, linear = camera.expose(ramp, 0.01, seed=1), digital_numbers(SENSOR, ramp, 0.01, seed=1)
    assert (raw.dn.dtype, raw.bits, raw.black_level_dn) == (np.uint16, 12, 8)
    companding = Companding(**table)
    error = companding.decompand(raw.dn) - linear
    assert (np.abs(error) <= companding.step_dn(linear) / 2 + 1e-6).all()
    raw.save(tmp_path / "a.dng")
    assert (ps.read_raw(tmp_path / "a.dng").dn == raw.dn).all()
    # Developed as the linear frame of the same exposure
    pictures = [ps.develop(one) for one in (raw, camera_of_linear.expose(ramp, 0.01, seed=1))]
    assert np.abs(pictures[0] - pictures[1]).max() < 0.02


def test_automatic_exposure_reaches_the_last_capture() -> None:
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), SENSOR)
    rate = np.full((100, 120), 1e5, np.float32)
    exposure_s = camera.auto_exposure_s(rate)
    exposed, saturated = (
        camera.expose(mean, exposure_s, seed=1).dn.mean() - 16 for mean in (rate * np.float32(exposure_s), rate * 1e3)
    )
    assert 0.7 < exposed / saturated < 0.85


def test_files_of_more_than_16_bits(tmp_path: Path) -> None:
    dn = np.random.default_rng(1).integers(0, 2**24, (23, 31), dtype=np.uint32)
    dn[0, :2] = 0, 2**24 - 1
    frame = RawFrame(dn, bits=24, black_level_dn=16, exposure_s=0.01, metadata={"kind": "light"})
    for name in ("a.tif", "a.h5"):
        frame.save(tmp_path / name)
        again = ps.read_raw(tmp_path / name)
        assert (again.dn.dtype, again.bits, again.black_level_dn, again.exposure_s) == (np.uint32, 24, 16, 0.01)
        assert (again.dn == dn).all()
    for name in ("a.dng", "a.png"):
        with raises(InputError, "bits", where=name):
            frame.save(tmp_path / name)
    # Files of other programs: the bit depth is the caller's, and larger numbers are an error.
    tifffile.imwrite(tmp_path / "b.tif", dn // 4096)
    with raises(FileError, "the file does not state its bit depth"):
        ps.read_raw(tmp_path / "b.tif")
    short = ps.read_raw(tmp_path / "b.tif", bits=12)
    assert (short.dn.dtype, short.bits) == (np.uint16, 12)
    assert (short.dn == dn // 4096).all()
    with raises(FileError, "dn"):
        ps.read_raw(tmp_path / "b.tif", bits=10)
    fits.PrimaryHDU(dn).writeto(tmp_path / "c.fits")
    assert (ps.read_raw(tmp_path / "c.fits", bits=24).dn == dn).all()
    (tmp_path / "stack").mkdir()
    frame.save(tmp_path / "stack" / "a.tif")
    frames = ps.open_frames(tmp_path / "stack")
    assert frames.bits == 24
    assert (next(iter(frames.groups[0])) == dn).all()


def test_overflow_needs_a_converter_that_reads_the_full_well() -> None:
    parts = [{"name": "well"}, {"name": "capacitor", "charge": "overflow", "charge_of": "well"}]
    with raises(InputError, "well_capacity_e", where="captures.parts"):
        BASE.with_(well_capacity_e=60000, captures={"parts": parts, "combination": {"dn_per_e": 1}})


def test_file_keeps_captures(tmp_path: Path) -> None:
    SENSOR.save(tmp_path / "a.sensor.yaml")
    again = ps.load_sensor(tmp_path / "a.sensor.yaml")
    assert again.captures == SENSOR.captures
    assert again.with_(captures=None).captures is None


def knees(linear: list[int], companded: list[int]) -> dict[str, Any]:
    return {"companding": {"linear_dn": linear, "companded_dn": companded, "bits": 12}}


@pytest.mark.parametrize(
    ("parts", "combination", "what"),
    [
        ([{"name": "a"}, {"name": "a"}], {}, "parts"),
        ([{"name": "a", "charge": "shared"}], {}, "charge_of"),
        ([{"name": "a", "charge": "shared", "charge_of": "b"}, {"name": "b"}], {}, "charge_of"),
        ([{"name": "a"}, {"name": "b", "charge": "shared", "charge_of": "a", "relative_sensitivity": 0.1}], {},
         "relative_sensitivity"),
        ([{"name": "a", "crosstalk": {"b": 0.1}}], {}, "crosstalk"),
        ([{"name": "a"}], {"switch_percent": 99}, "blend_percent"),
        ([{"name": "a"}], knees([0, 9], [0, 9]), "companding.linear_dn"),
        ([{"name": "a"}], knees([0, 9, 9], [0, 9, 10]), "linear_dn"),
    ],
)  # fmt: skip
def test_invalid_captures(parts: list[Any], combination: dict[str, Any], what: str) -> None:
    with raises(InputError, what):
        BASE.with_(captures={"parts": parts, "combination": {"dn_per_e": 1, **combination}})


def test_measured_maps_are_those_of_the_first_capture(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    chip = MeasuredChip(
        offset_dn=rng.normal(0, 3, (100, 120)).astype(np.float32),
        offset_uncertainty_dn=np.zeros((100, 120), np.float32),
        read_noise_dn=np.full((100, 120), 1.5, np.float32),
        read_noise_freedom=15,
        prnu=rng.normal(0, 0.02, (100, 120)).astype(np.float32),
        prnu_uncertainty=np.zeros((100, 120), np.float32),
        black_level_dn=64.0,
        system_gain_dn_per_e=BASE.system_gain_dn_per_e,
        reference_exposure_s=0.01,
        defects=no_defects(),
        blinking=no_blinking(),
    )
    sensor = BASE.with_(maps=chip.save(tmp_path / "a.maps.h5"))
    with_captures = sensor.with_(well_capacity_e=60000, captures=SPLIT)
    mean = np.full((100, 120), 9000, np.float32)
    alone = digital_numbers(sensor.with_(well_capacity_e=60000), mean * np.float32(0.999), 0.01, seed=3)
    parts = numbers(with_captures, 9000)
    assert np.abs(parts["high"].astype(int) - alone).max() <= 1
    # A charge that is read twice has one response; another photodiode has its own.
    shown = {name: np.corrcoef(dn.ravel(), chip.prnu.ravel())[0, 1] for name, dn in parts.items()}
    assert shown["low"] > 0.3 > abs(shown["small"])
    assert abs(shown["small"]) < 0.05


def test_interpixel_capacitance_acts_on_each_capture() -> None:
    fraction = 2.0
    coupled = SENSOR.with_(interpixel_capacitance={"coupling_percent": fraction})
    kept = coupled.effects.interpixel_capacitance.variance_factor
    for name, dn in numbers(coupled, 12000.0).items():
        plain = numbers(SENSOR, 12000.0)[name]
        assert dn.mean() == pytest.approx(plain.mean(), rel=2e-3)
        one = part_sensor(SENSOR, name)
        read = (one.electrons(one.noise.read_noise_mv.value) * one.system_gain_dn_per_e) ** 2 + 1 / 12
        assert dn.var() == pytest.approx(kept * (plain.var() - read) + read, rel=0.05)
    region = numbers(coupled, 12000.0, region=(3, 20, 5, 30))
    assert all((region[name] == dn[3:20, 5:30]).all() for name, dn in numbers(coupled, 12000.0).items())
    light = np.array([2000.0, 12000.0])
    drop = ps.capture_budget(coupled, light).captures_db["high"] - ps.capture_budget(SENSOR, light).captures_db["high"]
    assert 0.1 < drop[1] < -10 * np.log10(kept)
    with raises(InputError, "effects.blooming"):
        SENSOR.with_(blooming={"drained": 0.9})


def test_captures_get_warm() -> None:
    dark = {"dark_current_e_per_s": 1000, "dark_current_temperature_c": 20, "dark_doubling_c": 10}
    parts = [{"name": "a"}, {"name": "b", "relative_sensitivity": 0.1, "dark_current_e_per_s": 500}]
    sensor = BASE.with_(**dark, captures={"parts": parts, "combination": {"dn_per_e": 1}})
    black = np.zeros((100, 120), np.float32)
    cold, warm = (read_captures(sensor, None, black, 1.0, Shot(seed=1, temperature_c=t)) for t in (20, 30))
    for name, rate in (("a", 1000), ("b", 500)):
        rise = (warm[name].astype(float) - cold[name]).mean() / sensor.system_gain_dn_per_e
        assert rise == pytest.approx(rate, rel=0.03)
