"""The registry of effects in studies: each file of `studies/effects` defines one as `STUDY`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.finding import Finding
from photosite.sensor.model import Sensor
from photosite.studies.outcome import Outcomes, compare_estimates
from photosite.studies.plain_camera import Disturbance
from photosite.studies.virtual_lab import VirtualLab
from photosite.values.registry import registered
from photosite.values.uncertain import Missing

Range = tuple[float, float]
"""Lowest and highest value; the logarithm is drawn uniformly between them."""

AT_SATURATION = (
    *("saturation_dn", "saturation_capacity_e", "saturation_capacity_photons"),
    *("snr_max_db", "dynamic_range_db"),
)
"""Parameters at saturation."""
DARK_CURRENT = "dark_voltage_mv_per_s", "dark_current_dn_per_s", "dark_current_e_per_s"
READ_NOISE = (
    *("read_noise_mv", "read_noise_dn", "read_noise_e", "temporal_dark_noise_e"),
    "sensitivity_threshold_photons",
)
DSNU1288 = "dsnu1288_e", "dsnu1288_row_e", "dsnu1288_column_e", "dsnu1288_pixel_e"
RESPONSE = "responsivity_dn_per_photon", "quantum_efficiency_percent", "sensitivity_threshold_photons"
PRNU = (
    *("prnu_percent", "prnu1288_percent", "prnu1288_row_percent", "prnu1288_column_percent"),
    *("prnu1288_pixel_percent", "prnu1288_unfiltered_percent", "column_gain_percent"),
)
VOLTS = (
    *("read_noise_mv", "row_noise_mv", "column_noise_mv", "dsnu_mv"),
    *("dark_voltage_mv_per_s", "conversion_gain_uv_per_e"),
)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a random number whose logarithm is uniform."""
    return float(low * (high / low) ** rng.random())


@dataclass(frozen=True)
class Drawing:
    """What an effect is drawn with.

    Parameters
    ----------
    rng
        Source of the sensor's random numbers.
    sign
        +1 or -1, in turn over the sensors.
    bits, well_e
        Bits of the converter, and well capacity.
    read_noise_mv, read_noise_e, dsnu_e
        Read noise and DSNU of the sensor.
    """

    rng: np.random.Generator
    sign: float
    bits: int
    well_e: float
    read_noise_mv: float
    read_noise_e: float
    dsnu_e: float

    def between(self, low: float, high: float) -> float:
        """Return a number whose logarithm is uniform."""
        return log_uniform(self.rng, low, high)


@dataclass(frozen=True, kw_only=True)
class TrueTerms:
    """What an effect adds to the true parameters of a sensor.

    Parameters
    ----------
    read_variance_e2, offset_variance_e2, gain_variance
        Added to the variances of the read noise, of DSNU, and, relative, of PRNU and DCNU.
    gains
        Relative gains that alternate over the pixels, with the mean 1; their variance is in `gain_variance`.
    prnu_factor, dcnu_factor, border_gain
        Factors of the nonuniformities of single pixels; relative spread of the mean signal at the borders.
    dark_e_per_s, dark_variance
        Added to the mean of the dark current over the pixels, and to its variance.
    signal_of_well_e
        Signal of a full well; None where it is the charge.
    digital_scale, black_shift_dn
        Factor of digital numbers, and what is added to the black level before it.
    parameters
        Parameters of the effect itself.
    undefined
        Parameters that have no true value with the effect.
    """

    read_variance_e2: float = 0.0
    offset_variance_e2: float = 0.0
    gain_variance: float = 0.0
    gains: NDArray[np.float64] = field(default_factory=lambda: np.ones(1))
    prnu_factor: float = 1.0
    dcnu_factor: float = 1.0
    border_gain: float = 0.0
    dark_e_per_s: float = 0.0
    dark_variance: float = 0.0
    signal_of_well_e: float | None = None
    digital_scale: float = 1.0
    black_shift_dn: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    undefined: tuple[str, ...] = ()


Draw = Callable[[Drawing, Range], dict[str, Any]]
"""Returns fields of the sensor's section of noise or of effects, with a size within a range."""
Disturb = Callable[[Sensor, np.random.Generator], tuple[Disturbance, dict[str, float]]]
"""Draws an effect of random size on the frames of a plain camera, with the factors of `DisturbedLab`."""


@dataclass(frozen=True, kw_only=True)
class EffectStudy:
    """How studies draw an effect, and how they compare what a calibration finds of it; the name is that of its file.

    Parameters
    ----------
    draw
        Draws the effect for a virtual sensor; None for what is no part of a sensor.
    section
        Section of the sensor file that `draw` returns fields of.
    terms
        Called with the section of the effect, the sensor, and the quantum efficiency of each channel if the light is
        known; returns what the effect adds to the true parameters.
    truth
        Called with section and sensor; returns the true values of the finding's estimates.
    compare
        Called with finding, section and sensor; returns outcomes that `truth` does not give.
    measure
        Measures an effect that one calibration does not show, with the outcomes and the warnings.
    disturb
        Draws the effect on the frames of a plain camera, which shares no code with the engine.
    planned
        Whether the prediction of `photosite plan` has the effect, or is right without it.
    """

    draw: Draw | None = None
    section: Literal["noise", "effects"] = "effects"
    terms: Callable[[Any, Sensor, Sequence[float] | None], TrueTerms] | None = None
    truth: Callable[[Any, Sensor], Mapping[str, float]] | None = None
    compare: Callable[[Any, Any, Sensor], Outcomes] | None = None
    measure: Callable[[VirtualLab], tuple[Outcomes, tuple[str, ...]]] | None = None
    disturb: Disturb | None = None
    planned: bool = True


@cache
def effect_studies() -> Mapping[str, EffectStudy]:
    """Return the studies of all effects by name.

    Examples
    --------
    >>> effect_studies()["glow"].section
    'effects'
    """
    return MappingProxyType(registered("photosite.studies.effects", "STUDY"))


def stated_effects(sensor: Sensor) -> Iterator[tuple[str, EffectStudy, Any]]:
    """Yield name, study and section of each effect that a sensor states."""
    for name, study in effect_studies().items():
        section = sensor.noise if study.section == "noise" else getattr(sensor.effects, name, None)
        if section is not None:
            yield name, study, section


def true_terms(sensor: Sensor, efficiencies: Sequence[float] | None = None) -> tuple[TrueTerms, ...]:
    """Return the terms of all effects that a sensor has."""
    stated = stated_effects(sensor)
    return tuple(study.terms(section, sensor, efficiencies) for _, study, section in stated if study.terms is not None)


def effect_outcomes(found: Mapping[str, Finding | Missing], sensor: Sensor) -> Outcomes:
    """Compare the findings of all effects that a sensor states with the truth, by `effect.estimate`."""
    result: Outcomes = {}
    for name, study, section in stated_effects(sensor):
        finding, truth = found.get(name), {} if study.truth is None else study.truth(section, sensor)
        if isinstance(finding, Missing):
            result |= {f"{name}.{each}": finding.reason for each in truth}
        elif finding is not None:
            compared = {} if study.compare is None else study.compare(finding, section, sensor)
            compared |= compare_estimates(finding.estimates, truth)
            result |= {f"{name}.{each}": entry for each, entry in compared.items()}
    return result
