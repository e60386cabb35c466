"""Flat fields with crosstalk: virtual measurements and true parameters agree with the camera."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from virtual_monochromator import MonochromatorRun, without_spectra

import photosite as ps
from photosite.camera.optical_stack import channel_mixing
from photosite.sensor.model import Sensor
from photosite.studies.conditions import condition
from photosite.studies.protocol import ShootingProtocol, Step
from photosite.studies.truth import measured_truth, true_parameters
from photosite.studies.virtual_lab import nominal_sensor, virtual_lab
from photosite.values.cfa import channel_mask

LEAK = {"R": 0.03, "G": 0.015, "B": 0.005}
KERNELS = {
    name: ((0.0, leak, 0.0), (2 * leak, 1 - 6 * leak, 2 * leak), (0.0, leak, 0.0)) for name, leak in LEAK.items()
}
STEEP = {"angle_deg": (0.0, 5.0, 40.0), "relative_response": (1.0, 0.7, 0.1)}
PROTOCOL = ShootingProtocol("flats", (Step("dark", 0.01, 2), Step("light", 0.01, 4), Step("light", 0.04, 4)))


def leaky(sensor: Sensor, kernels: dict[str, Any] = KERNELS) -> Sensor:
    return sensor.with_(crosstalk={"optical": kernels, "electrical": kernels})


def plain_sensor() -> Sensor:
    return ps.load_sensor("nikon-d200").with_(rows=120, cols=160, prnu_percent=0, dsnu_mv=0, black_level_dn=64)


def by_channel(sensor: Sensor, values: np.ndarray) -> np.ndarray:
    return np.array([values[channel_mask(sensor.array.cfa, n, values.shape)].mean() for n in sensor.channel_names])


def mixed_by_hand(alone: np.ndarray) -> np.ndarray:
    """Return channel means after applying the kernels twice on a periodic mosaic, pixel by pixel."""
    cfa = np.tile([["R", "G"], ["G", "B"]], (2, 2))
    electrons = np.select([cfa == name for name in "RGB"], alone)
    for _ in range(2):
        after = np.zeros_like(electrons)
        for r, c, i, j in np.ndindex(4, 4, 3, 3):
            after[(r + i - 1) % 4, (c + j - 1) % 4] += KERNELS[cfa[r, c]][i][j] * electrons[r, c]
        electrons = after
    return np.array([electrons[cfa == name].mean() for name in "RGB"])


def test_channels_of_a_flat_field_equal_those_of_a_uniform_scene() -> None:
    """4 frames of 19 200 pixels: means within 4.5 standard errors of shot noise, read noise and rounding."""
    bare = plain_sensor()
    lab = virtual_lab(leaky(bare), PROTOCOL, level=0.6, seed=5)
    sensor, gain = lab.camera.sensor, lab.camera.sensor.system_gain_dn_per_e
    for exposure_s in (0.01, 0.04):
        alone = by_channel(bare, replace(lab.camera, sensor=bare).mean_electrons(lab.light, exposure_s))
        seen = by_channel(sensor, lab.camera.mean_electrons(lab.light, exposure_s))
        np.testing.assert_allclose(seen, channel_mixing(sensor) @ alone, rtol=1e-5)
        np.testing.assert_allclose(seen, mixed_by_hand(alone), rtol=1e-5)
        assert abs(seen / alone - 1).max() > 0.05
        frames = [frame.dn for _, step, frame in lab.frames() if step.exposure_s == exposure_s and step.kind == "light"]
        shot = (by_channel(sensor, np.mean(frames, axis=0)) - 64) / gain
        read_e = sensor.electrons(sensor.noise.read_noise_mv.value)
        pixels = [4 * channel_mask(sensor.array.cfa, name, (120, 160)).sum() for name in sensor.channel_names]
        error = np.sqrt((seen + read_e**2 + 1 / (12 * gain**2)) / pixels)
        assert (abs(shot - seen) < 4.5 * error).all()


def test_calibration_light_is_perpendicular() -> None:
    steep = plain_sensor().with_(angular_response=STEEP)
    lab = virtual_lab(steep, PROTOCOL, level=0.6)
    behind_a_lens = lab.camera.mean_electrons(lab.light, 0.04)
    assert behind_a_lens[0, 0] < 0.99 * behind_a_lens[60, 80]
    even = virtual_lab(plain_sensor(), PROTOCOL, level=0.6)
    shots = [[frame.dn for _, _, frame in each.frames()][-1].astype(float) for each in (lab, even)]
    np.testing.assert_allclose(shots[0].mean(), shots[1].mean(), rtol=1e-3)
    corner = shots[0][:24, :32].mean() - 64
    assert corner / (shots[0][48:72, 64:96].mean() - 64) == pytest.approx(1, abs=4.5 * math.sqrt(2 / 768 / 1e4))
    assert lab.camera.sensor.optical_stack == nominal_sensor(steep).optical_stack  # the saved sensor keeps it


def test_a_calibration_with_crosstalk_finds_the_truth() -> None:
    """Quantum efficiency, saturation in photons and the rest, each within 4 of its standard uncertainties.

    The kernels are symmetric. Otherwise green pixels in red rows and in blue rows differ, which is measured as PRNU.
    """
    even = {
        name: ((0.0, 2 * leak, 0.0), (2 * leak, 1 - 8 * leak, 2 * leak), (0.0, 2 * leak, 0.0))
        for name, leak in LEAK.items()
    }
    family = condition("bright-cfa-12")
    sensor = leaky(family.sensor(3), even)
    lab = virtual_lab(sensor, family.protocol, level=2.3, seed=3, photons_known=True)
    found = ps.calibrate(lab.frame_set())
    truth = measured_truth(lab, found)
    for name in (
        "quantum_efficiency_percent",
        "responsivity_dn_per_photon",
        "saturation_capacity_photons",
        "system_gain_dn_per_e",
        "prnu_percent",
    ):
        measured = getattr(found, name)
        assert abs(measured.value - truth[name]) < 4 * measured.standard_uncertainty, name
    bare = true_parameters(family.sensor(3), lab.light, lab.camera.optics)
    assert truth["quantum_efficiency_percent"] == pytest.approx(bare["quantum_efficiency_percent"], rel=1e-9)
    mixed = true_parameters(sensor, lab.light, lab.camera.optics)
    assert mixed["saturation_capacity_photons"] > 1.02 * bare["saturation_capacity_photons"]


def test_monochromator_bands_include_crosstalk_and_its_nominal_sensor_does_not() -> None:
    bare = plain_sensor()
    leaks, holds = (MonochromatorRun(each, (450.0, 550.0)) for each in (leaky(bare), bare))
    for band in (0, 1):
        alone = np.array(list(holds.electron_rate(band).values()))
        np.testing.assert_allclose(list(leaks.electron_rate(band).values()), mixed_by_hand(alone), rtol=1e-9)
    assert without_spectra(leaky(bare).with_(cover_glass=0.9)).optical_stack is None
