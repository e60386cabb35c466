"""A laboratory whose frames are disturbed by a random size, for the coverage study."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import AT_SATURATION, Disturb, effect_studies, log_uniform
from photosite.studies.plain_camera import Disturbance, PlainCamera, bent, darker_corners
from photosite.studies.protocol import ShootingProtocol
from photosite.studies.truth import as_defined, true_parameters
from photosite.studies.virtual_lab import nominal_sensor


@dataclass(frozen=True)
class DisturbedLab:
    """A laboratory that measures a monochrome sensor with a plain camera, whose frames are disturbed.

    Parameters
    ----------
    true_sensor, protocol, level, seed
        As for `virtual_lab`. The light is metered.
    disturbance
        What disturbs the frames.
    factors
        Factor of each parameter whose true value the disturbance changes; NaN for one that then has none. The row
        noise is relative to the read noise of the sensor, which has no row noise; the coupling of pixels is
        relative to 1.
    """

    true_sensor: Sensor
    protocol: ShootingProtocol
    level: float
    disturbance: Disturbance
    factors: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0

    @property
    def camera(self) -> PlainCamera:
        """The plain camera."""
        sensor, truth = self.true_sensor, true_parameters(self.true_sensor)
        (channel,) = sensor.channels.values()
        return PlainCamera(
            shape=(sensor.array.rows, sensor.array.cols),
            gain=truth["system_gain_dn_per_e"],
            black_dn=truth["black_level_dn"],
            read_noise_e=truth["read_noise_e"],
            dsnu_dn=truth["dsnu_dn"],
            prnu=truth["prnu_percent"] / 100.0,
            electrons_per_s=self.level * sensor.saturation_capacity_e / (self.protocol.longest_light_s or 1.0),
            dark_e_per_s=truth["dark_current_e_per_s"],
            dcnu=truth["dcnu_percent"] / 100.0,
            bits=sensor.readout.bits,
            quantum_efficiency=channel.quantum_efficiency[0] * sensor.pixel.fill_factor.value,
            sensor=nominal_sensor(sensor),
        )

    def frame_set(self) -> FrameSet:
        """Return the frames as `calibrate` takes them."""
        return self.camera.frame_set(self.protocol, self.disturbance, self.seed)

    def truth(self, calibration: Calibration) -> dict[str, float]:
        """Return the true parameters, except those at saturation."""
        truth = true_parameters(self.true_sensor)
        truth |= {
            f"row_noise_{unit}": truth[f"read_noise_{unit}"]
            for unit in ("dn", "e", "mv")
            if f"row_noise_{unit}" in self.factors
        }
        if "interpixel_coupling_percent" in self.factors:
            truth["interpixel_coupling_percent"] = 100.0
        truth = {name: self.factors.get(name, 1.0) * value for name, value in truth.items()}
        efficiency = self.camera.quantum_efficiency or 1.0
        threshold_e = math.sqrt(truth["read_noise_e"] ** 2 + 1 / (12 * truth["system_gain_dn_per_e"] ** 2) + 0.25) + 0.5
        truth |= {
            "quantum_efficiency_percent": 100.0 * efficiency,
            "responsivity_dn_per_photon": truth["system_gain_dn_per_e"] * efficiency,
            "sensitivity_threshold_photons": threshold_e / efficiency,
        }
        truth = as_defined(truth, self.true_sensor, calibration)
        return {name: value for name, value in truth.items() if name not in AT_SATURATION and math.isfinite(value)}


def _shading(sensor: Sensor, rng: np.random.Generator) -> tuple[Disturbance, dict[str, float]]:
    """Draw corners 2 to 20 % darker than the center."""
    light = darker_corners((sensor.array.rows, sensor.array.cols), log_uniform(rng, 0.01, 0.1))
    spread = math.hypot(1.0, 100.0 * float(light.std()) / sensor.noise.prnu_percent.value)
    return Disturbance(light=lambda values, *_: values * light), {"prnu_percent": spread, "prnu1288_percent": math.nan}


def _wrong_level(sensor: Sensor, rng: np.random.Generator) -> tuple[Disturbance, dict[str, float]]:
    """Draw one of 16 levels, after 6 steps of dark frames, whose light is 1 to 10 % off the stated one."""
    return Disturbance(
        wrong_level=(6 + int(rng.integers(16)), 1.0 + log_uniform(rng, 0.01, 0.1) * rng.choice([-1.0, 1.0]))
    ), {}


def _bend_and_wrong_level(sensor: Sensor, rng: np.random.Generator) -> tuple[Disturbance, dict[str, float]]:
    """Draw a response bent by 1 to 3 % with the third power, and one of 16 levels whose light is 4 % off."""
    size = log_uniform(rng, 0.01, 0.03) * rng.choice([-1.0, 1.0])
    level = 6 + int(rng.integers(16)), 1.0 + 0.04 * rng.choice([-1.0, 1.0])
    return Disturbance(charge=bent(size, 3, sensor.saturation_capacity_e), wrong_level=level), {}


def disturbances() -> Mapping[str, Disturb]:
    """Return what can disturb frames, by name: effects that have a `disturb`, and errors of the light."""
    others = {"shading": _shading, "wrong_level": _wrong_level, "bend_and_wrong_level": _bend_and_wrong_level}
    return {name: study.disturb for name, study in effect_studies().items() if study.disturb is not None} | others
