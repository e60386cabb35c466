"""True parameters against hand calculation from the 2008 paper's Table 1."""

from __future__ import annotations

import math

import numpy as np
import pytest

import photosite as ps
from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene.scene import Scene
from photosite.sensor.effects.telegraph_noise import TelegraphNoise
from photosite.studies.truth import channel_efficiencies, full_well_reading_dn, true_parameters

LENS = DiffractionLimited(f_number=8, focal_length_mm=50)


def test_table_1_of_the_d200() -> None:
    """0.52 mV and 0.55 mV at 30 uV/e- and 7.98 e-/DN; 4095 DN come before the well of 36 000 e-."""
    truth = true_parameters(ps.load_sensor("nikon-d200").with_(dark_voltage_mv_per_s=0.3, black_level_dn=95))
    expected = {
        "read_noise_e": 520 / 30,
        "read_noise_dn": 520 / 30 / 7.98,
        "dsnu_e": 550 / 30,
        "dsnu1288_e": 550 / 30,
        "dark_current_e_per_s": 10,
        "system_gain_dn_per_e": 1 / 7.98,
        "saturation_dn": 4095,
        "saturation_capacity_e": 4000 * 7.98,
        "temporal_dark_noise_e": 520 / 30,
        "snr_max_db": 20 * math.log10(math.sqrt(4000 * 7.98)),
    }
    for name, value in expected.items():
        assert truth[name] == pytest.approx(value, rel=1e-6), name


def test_the_read_noise_contains_that_of_blinking_pixels() -> None:
    """1 % with 300 e- to 0.3 of the time in the upper level: 0.01 * 300^2 * 0.21 = 189 e-^2."""
    sensor = ps.load_sensor("nikon-d200")
    noise = TelegraphNoise(fraction=0.01, amplitude_e=300, amplitudes="equal", high_fraction=0.3)
    found, without = (true_parameters(one) for one in (sensor.with_(telegraph_noise=noise), sensor))
    for name in ("read_noise_e", "temporal_dark_noise_e"):
        assert found[name] ** 2 == pytest.approx(without[name] ** 2 + 189.0)
    assert found["read_noise_mv"] / found["read_noise_e"] == pytest.approx(0.030)
    assert found["dsnu_e"] == without["dsnu_e"]


def test_well_that_fills_before_the_converter_clips() -> None:
    sensor = ps.load_sensor("nikon-d200").with_(well_capacity_e=7980, black_level_dn=100)
    truth = true_parameters(sensor)
    assert truth["saturation_capacity_e"] == 7980
    assert truth["saturation_dn"] == pytest.approx(1100, rel=1e-6)


def test_full_wells_near_full_scale() -> None:
    """Against 4 million simulated readings of a well that ends 9 DN below full scale; 4.5 standard errors."""
    sensor = ps.load_sensor("nikon-d200").with_(well_capacity_e=4086 * 7.98, read_noise_mv=1.5, dsnu_mv=1)
    mean, sigma = 4086 * 7.98 * sensor.system_gain_dn_per_e, math.hypot(1.5, 1) / sensor.mv_per_dn
    readings = np.random.default_rng(1).normal(mean, sigma, 4_000_000)
    clipped = np.clip(np.rint(readings), 0, 4095)
    assert abs(clipped.mean() - full_well_reading_dn(sensor)) < 4.5 * clipped.std() / 2000
    assert clipped.mean() < mean - 0.1


def test_snr_at_the_sensitivity_threshold_is_1() -> None:
    """EMVA 1288's SNR of a pixel without pattern: mu / sqrt(read^2 + 1 / (12 K^2) + mu)."""
    sensor = ps.load_sensor("nikon-d200")
    truth = true_parameters(sensor, Scene.uniform([1e15, 1e15], [500, 510]), LENS)
    gain = truth["system_gain_dn_per_e"]
    mu = truth["sensitivity_threshold_photons"] * truth["quantum_efficiency_percent"] / 100
    snr = mu / math.sqrt(truth["read_noise_e"] ** 2 + 1 / (12 * gain**2) + mu)
    assert snr == pytest.approx(1, rel=1e-9)
    assert truth["dynamic_range_db"] == pytest.approx(20 * math.log10(truth["saturation_capacity_e"] / mu), rel=1e-9)


def test_efficiency_at_one_wavelength_is_that_of_the_file_times_the_fill_factor() -> None:
    sensor = ps.load_sensor("nikon-d200")
    line = Scene.uniform([1e15], [530.0])
    found = dict(zip(sensor.channel_names, channel_efficiencies(sensor, line, LENS), strict=True))
    for name, value in (("R", 0.052462), ("G", 0.680440), ("B", 0.028510)):
        assert found[name] == pytest.approx(0.9 * value, rel=1e-9)
    truth = true_parameters(sensor, line, LENS)
    mean = 0.9 * (0.052462 + 2 * 0.680440 + 0.028510) / 4
    assert truth["quantum_efficiency_percent"] == pytest.approx(100 * mean, rel=1e-9)
    assert truth["saturation_capacity_photons"] == pytest.approx(truth["saturation_capacity_e"] / (0.9 * 0.680440))


def test_names_are_those_of_the_calibration() -> None:
    truth = true_parameters(ps.load_sensor("nikon-d200"), Scene.uniform([1e15], [530.0]), LENS)
    assert set(truth) <= set(PARAMETER_LABELS)
