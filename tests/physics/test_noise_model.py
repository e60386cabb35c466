"""The sensor's noise compared with the moments of the equations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.sensor.readout import digital_numbers

MONO = load_sensor("nikon-d200").with_(
    rows=160,
    cols=200,
    cfa="mono",
    channels={"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}},
    black_level_dn=100,
    dark_voltage_mv_per_s=30.0,
)
PIXELS = 160 * 200
FRAMES = 40


def stack(sensor: Sensor, level_e: float, exposure_s: float = 0.5, frames: int = FRAMES) -> NDArray[np.float64]:
    mean = np.full((160, 200), level_e, np.float32)
    return np.stack([digital_numbers(sensor, mean, exposure_s, seed=5, frame=n) for n in range(frames)]).astype(float)


@pytest.mark.parametrize("level_e", [0.0, 500.0, 20000.0])
def test_temporal_and_spatial_moments(level_e: float) -> None:
    """Mean, temporal variance and fixed pattern of a stack, each within 4.5 sigma: false alarms below 1e-4 in all."""
    noise, gain = MONO.noise, MONO.system_gain_dn_per_e
    dark_e = MONO.electrons(noise.dark_voltage_mv_per_s.value) * 0.5
    read_e, dsnu_e = MONO.electrons(noise.read_noise_mv.value), MONO.electrons(noise.dsnu_mv.value)
    prnu = noise.prnu_percent.value / 100
    temporal = gain**2 * (level_e + dark_e + read_e**2) + 1 / 12
    fixed = gain**2 * (dsnu_e**2 + (prnu * level_e) ** 2)

    dn = stack(MONO, level_e)
    mean_map = dn.mean(axis=0)
    z_mean = (mean_map.mean() - (100 + gain * (level_e + dark_e))) / math.sqrt((fixed + temporal / FRAMES) / PIXELS)
    variance = dn.var(axis=0, ddof=1).mean()
    z_temporal = (variance / temporal - 1) / math.sqrt(2 / (PIXELS * (FRAMES - 1)))
    spatial = mean_map.var(ddof=1)
    z_spatial = (spatial / (fixed + temporal / FRAMES) - 1) / math.sqrt(2 / PIXELS)
    assert max(map(abs, (z_mean, z_temporal, z_spatial))) < 4.5


def test_prnu_does_not_change_dark_frames() -> None:
    strong = MONO.with_(prnu_percent=12.0)
    assert (stack(strong, 0.0, frames=2) == stack(MONO, 0.0, frames=2)).all()


def test_well_capacity_and_converter_limits() -> None:
    shallow = MONO.with_(well_capacity_e=10000, read_noise_mv=0, dsnu_mv=0)
    full = stack(shallow, 30000.0, frames=1)
    assert (full == round(100 + 10000 * MONO.system_gain_dn_per_e)).all()
    assert (stack(MONO, 60000.0, frames=1) == 4095).all()


def test_black_clips_at_zero_without_a_black_level() -> None:
    bare = MONO.with_(black_level_dn=0, dark_voltage_mv_per_s=0)
    dn = stack(bare, 0.0, frames=4)
    sigma_dn = MONO.system_gain_dn_per_e * math.hypot(MONO.electrons(0.52), MONO.electrons(0.55))
    expected = stats.norm.cdf(0.5 / sigma_dn)  # everything that rounds to 0 or below
    assert (dn == 0).mean() == pytest.approx(expected, abs=0.01)


def test_noise_sources_use_independent_random_numbers() -> None:
    """Read noise from 0 to 0.52 mV changes the frame by a deviate that is independent of shot noise."""
    fine = MONO.with_(bits=16, analog_gain=1.1014, black_level_dn=3000)
    mean = np.full((160, 200), 2000.0, np.float32)
    with_read = digital_numbers(fine, mean, 0.1, seed=9).astype(float)
    without = digital_numbers(fine.with_(read_noise_mv=0), mean, 0.1, seed=9).astype(float)
    dark_with = digital_numbers(fine, np.zeros_like(mean), 1e-9, seed=9).astype(float)
    dark_without = digital_numbers(fine.with_(read_noise_mv=0), np.zeros_like(mean), 1e-9, seed=9).astype(float)
    assert np.abs((with_read - without) - (dark_with - dark_without)).max() <= 2  # rounding of four frames


def test_neighbours_and_frames_are_uncorrelated() -> None:
    """Five correlations of 32 000 pairs within 4.5 sigma: false alarms below 4e-5."""
    dn = stack(MONO.with_(dsnu_mv=0, prnu_percent=0), 3000.0, frames=2)
    z = (dn - dn.mean()) / dn.std()
    pairs = [
        z[0, :, 1:] * z[0, :, :-1],
        z[0, 1:] * z[0, :-1],
        z[0, 2:] * z[0, :-2],
        z[0] * z[1],
        z[0, 1:, 1:] * z[1, :-1, :-1],
    ]
    for product in pairs:
        assert abs(product.mean()) * math.sqrt(product.size) < 4.5
