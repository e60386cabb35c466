"""A laboratory whose frames an effect of random size disturbs, for the coverage study."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet
from photosite.sensor.model import Sensor
from photosite.studies.plain_camera import Effect, PlainCamera, bands, bent, convolved, darker_corners
from photosite.studies.protocol import ShootingProtocol
from photosite.studies.truth import AT_SATURATION, as_defined, true_parameters
from photosite.studies.virtual_lab import nominal_sensor


@dataclass(frozen=True)
class DisturbedLab:
    """A laboratory that measures a monochrome sensor with a plain camera, whose frames an effect disturbs.

    Parameters
    ----------
    true_sensor, protocol, level, seed
        As for `virtual_lab`. The light is metered.
    effect
        What disturbs the frames.
    factors
        Factor of each parameter whose true value the effect changes; NaN for one that then has none. The row noise is
        relative to the read noise of the sensor, which has no row noise; the coupling of pixels is relative to 1.
    """

    true_sensor: Sensor
    protocol: ShootingProtocol
    level: float
    effect: Effect
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
        return self.camera.frame_set(self.protocol, self.effect, self.seed)

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


Draw = Callable[[Sensor, np.random.Generator], tuple[Effect, dict[str, float]]]
"""Draws an effect of random size for a sensor, with the factors of `DisturbedLab`."""


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.random())


def bend(sensor: Sensor, rng: np.random.Generator) -> tuple[Effect, dict[str, float]]:
    """Draw a response bent by 0.5 to 10 % at saturation, of either sign, with the second to fourth power."""
    size = _between(rng, 0.005, 0.1) * rng.choice([-1.0, 1.0])
    return Effect(charge=bent(size, int(rng.integers(2, 5)), sensor.saturation_capacity_e)), {}


def crosstalk(sensor: Sensor, rng: np.random.Generator) -> tuple[Effect, dict[str, float]]:
    """Draw crosstalk of 0.5 to 3 % of the charge to each next pixel."""
    a = _between(rng, 0.005, 0.03)
    weights = ((0.0, a, 0.0), (a, 1.0 - 4.0 * a, a), (0.0, a, 0.0))
    spread = float(np.linalg.norm(weights))
    return Effect(charge=convolved(weights)), {
        "prnu_percent": spread,
        "prnu1288_percent": spread,
        "dcnu_percent": spread,
        "interpixel_coupling_percent": a,
    }


def flicker(sensor: Sensor, rng: np.random.Generator) -> tuple[Effect, dict[str, float]]:
    """Draw bands of 0.2 to 2 % with a period of 10 to 40 rows."""
    return Effect(light=bands(_between(rng, 0.002, 0.02), _between(rng, 10.0, 40.0))), {}


_ROW_NOISE = ("row_noise_dn", "row_noise_e", "row_noise_mv")


def row_noise(sensor: Sensor, rng: np.random.Generator) -> tuple[Effect, dict[str, float]]:
    """Draw row noise of 0.1 to 1 times the read noise."""
    share = _between(rng, 0.1, 1.0)
    sigma_dn = sensor.noise.read_noise_mv.value / sensor.mv_per_dn * share
    total = dict.fromkeys(
        ("read_noise_dn", "read_noise_e", "read_noise_mv", "temporal_dark_noise_e"), math.hypot(1.0, share)
    ) | dict.fromkeys(_ROW_NOISE, share)
    return Effect(numbers=lambda values, noise: values + noise.normal(0.0, sigma_dn, (len(values), 1))), total


def hot_pixels(sensor: Sensor, rng: np.random.Generator) -> tuple[Effect, dict[str, float]]:
    """Draw 0.3 to 1 % hot pixels with 100 to 500 e-/s."""
    share, hot = _between(rng, 0.003, 0.01), _between(rng, 100.0, 500.0)
    truth = true_parameters(sensor)
    usual, spread = truth["dark_current_e_per_s"], truth["dcnu_percent"] / 100.0
    mean = (1.0 - share) * usual + share * hot
    variance = (1.0 - share) * ((spread * usual) ** 2 + (usual - mean) ** 2) + share * (hot - mean) ** 2
    of_mean = dict.fromkeys(("dark_current_e_per_s", "dark_current_dn_per_s", "dark_voltage_mv_per_s"), mean / usual)
    return Effect(hot=(share, hot)), of_mean | {"dcnu_percent": math.sqrt(variance) / mean / spread}


def shading(sensor: Sensor, rng: np.random.Generator) -> tuple[Effect, dict[str, float]]:
    """Draw corners 2 to 20 % darker than the center."""
    light = darker_corners((sensor.array.rows, sensor.array.cols), _between(rng, 0.01, 0.1))
    spread = math.hypot(1.0, 100.0 * float(light.std()) / sensor.noise.prnu_percent.value)
    return Effect(light=lambda values, noise: values * light), {"prnu_percent": spread, "prnu1288_percent": math.nan}


def wrong_level(sensor: Sensor, rng: np.random.Generator) -> tuple[Effect, dict[str, float]]:
    """Draw one of 16 levels, after 6 steps of dark frames, whose light is 1 to 10 % off the stated one."""
    return Effect(wrong_level=(6 + int(rng.integers(16)), 1.0 + _between(rng, 0.01, 0.1) * rng.choice([-1.0, 1.0]))), {}


def bend_and_wrong_level(sensor: Sensor, rng: np.random.Generator) -> tuple[Effect, dict[str, float]]:
    """Draw a response bent by 1 to 3 % with the third power, and one of 16 levels whose light is 4 % off."""
    size = _between(rng, 0.01, 0.03) * rng.choice([-1.0, 1.0])
    level = 6 + int(rng.integers(16)), 1.0 + 0.04 * rng.choice([-1.0, 1.0])
    return Effect(charge=bent(size, 3, sensor.saturation_capacity_e), wrong_level=level), {}
