"""Noise of the frame that several captures of one exposure combine to, as variances in electrons of light.

Electrons of light are those of a photodiode of relative sensitivity and exposure 1. Captures of one charge share its
shot noise and PRNU. In a transition the variance of w x + (1 - w) y is integrated over the distribution of x, the more
sensitive capture, on which w depends. Transitions must not overlap. Effects count as in `photosite.sensor.noise_terms`.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.engine.roots import brentq
from photosite.sensor.capture_readout import capture_scale, captures_of, part_sensor
from photosite.sensor.captures import Combination
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2, NoiseTerms

Array = NDArray[np.float64]

_OF_CHARGE = frozenset({"shot", "prnu", "dcnu"})
_OF_READING = frozenset({"read", "dsnu", "rounding"})
NOISE_SOURCES = _OF_CHARGE | _OF_READING
"""Shot noise with that of the dark current, PRNU, dark current nonuniformity, read noise, DSNU and rounding."""
TEMPORAL_SOURCES = frozenset({"shot", "read", "rounding"})
"""The sources that change from frame to frame."""

# The distribution of the more sensitive capture in a transition: 7 standard deviations to each side.
_DEVIATES = np.linspace(-7.0, 7.0, 281)
_DEVIATE_WEIGHTS = np.exp(-0.5 * _DEVIATES**2)
_DEVIATE_WEIGHTS /= _DEVIATE_WEIGHTS.sum()

_LARGEST_DENOMINATOR = 16
"""Of the ratio of steps up to which rounding errors repeat within the noise."""

_LOWEST_E, _POINTS = 1e-3, 400
"""Where the search for a ratio begins, and its points up to saturation."""


class Transition(NamedTuple):
    """A transition from one capture to the next: light at its middle, and the ratio of either capture there."""

    above: str
    below: str
    light_e: float
    before_db: float
    after_db: float

    def __str__(self) -> str:
        return f"{self.above} to {self.below} at {self.light_e:.4g} e-"


class _Capture(NamedTuple):
    """Moments of a capture in units of light: mean, variance of its charge, and variance of its reading."""

    charge: str
    mean: Array
    charge_variance: Array
    reading_variance: Array
    # Of the reading to which a capture of overflowing charge is added
    parent_reading_variance: Array
    # Light at which the capture begins to fill, and from there to its saturation
    start_e: float
    range_e: float

    @property
    def saturation_e(self) -> float:
        return self.start_e + self.range_e

    @property
    def variance(self) -> Array:
        return self.charge_variance + self.reading_variance + self.parent_reading_variance


@dataclass(frozen=True)
class CombinedNoise:
    """Variances of the combined frame of an even surface.

    Parameters
    ----------
    sensor
        A sensor with captures.
    exposure_s
        Exposure time of the frame, for the dark current.
    sources
        Those of `NOISE_SOURCES` that count.

    Raises
    ------
    InputError
        If the sensor has no captures.

    Examples
    --------
    >>> import photosite as ps
    >>> noise = CombinedNoise(ps.load_sensor("split-pixel-automotive"), 1 / 60)
    >>> noise.variance_e2([0.0, 1e4]).round(1), round(noise.light_capacity_e)
    (array([1.40000e+00, 2.00126e+04]), 789993)
    """

    sensor: Sensor
    exposure_s: float = 0.0
    sources: Set[str] = NOISE_SOURCES

    def __post_init__(self) -> None:
        captures_of(self.sensor)

    def variance_e2(self, light_e: ArrayLike) -> Array:
        """Return the variance of the combined frame; above saturation, the last capture extrapolates."""
        variance = _combine(list(self._captures(light_e).values()), self._rule)
        if "rounding" not in self.sources:
            return variance
        return variance + self._output_rounding_e2(np.asarray(light_e, np.float64))

    def captures_db(self, light_e: ArrayLike) -> Mapping[str, Array]:
        """Return the signal-to-noise ratio of each capture by name; NaN where it is saturated."""
        found = self._captures(light_e)
        return {
            name: np.where(each.mean < each.saturation_e, _db(light_e, each.variance), np.nan)
            for name, each in found.items()
        }

    def snr_db(self, light_e: ArrayLike) -> Array:
        """Return the signal-to-noise ratio, 10 log10(S^2 / N); NaN above saturation."""
        light = np.asarray(light_e, np.float64)
        inside = light <= self.light_capacity_e * (1 + 1e-9)
        return np.where(inside, _db(light, self.variance_e2(light)), np.nan)

    @cached_property
    def light_capacity_e(self) -> float:
        """Light at which the combined frame saturates: by its last capture or its bit depth, less the dark signal."""
        *_, last = self._captures(0.0).values()
        highest_dn = (1 << self._rule.bits) - 1 - self._rule.black_level_dn.value
        return float(min(last.saturation_e, highest_dn / self._rule.dn_per_e.value) - last.mean)

    @cached_property
    def transitions(self) -> tuple[Transition, ...]:
        """The transitions, from the dark to the bright."""
        found = []
        for (above, dark), (below, _) in pairwise(self._captures(0.0).items()):
            level = dark.start_e + self._rule.switch_percent / 100.0 * dark.range_e - float(dark.mean)
            both = self._captures(level)
            ratios = (float(_db(level, both[name].variance)) for name in (above, below))
            found.append(Transition(above, below, level, *ratios))
        return tuple(found)

    @cached_property
    def snr_max_db(self) -> float:
        """The highest ratio."""
        grid = np.geomspace(_LOWEST_E, 1.0, 5 * _POINTS) * self.light_capacity_e
        return float(self.snr_db(grid).max())

    def signal_at_snr_e(self, snr_db: float) -> float | None:
        """Return the lowest signal at which the ratio reaches a value; None if it does not reach it."""

        def excess(light_e: float) -> float:
            return float(light_e**2 - 10.0 ** (snr_db / 10.0) * self.variance_e2(light_e))

        grid = np.geomspace(min(_LOWEST_E, 0.5 * self.light_capacity_e), self.light_capacity_e, _POINTS)
        reached = np.flatnonzero(grid**2 >= 10.0 ** (snr_db / 10.0) * self.variance_e2(grid))
        if not reached.size:
            return None
        first = int(reached[0])
        return float(brentq(excess, grid[first - 1] if first else 0.0, grid[first], xtol=1e-9, rtol=1e-12))

    @property
    def _rule(self) -> Combination:
        return captures_of(self.sensor).combination

    def _captures(self, light_e: ArrayLike) -> dict[str, _Capture]:
        light = np.asarray(light_e, np.float64)
        return {name: self._capture(name, light) for name in captures_of(self.sensor).names}

    def _capture(self, name: str, light: Array) -> _Capture:
        captures, one = captures_of(self.sensor), part_sensor(self.sensor, name)
        owner, factor = captures.owner(name), captures.light(name)
        charge_sensor = part_sensor(self.sensor, owner.name)
        values, terms = charge_sensor.noise, NoiseTerms(charge_sensor)
        dark_e = one.electrons(values.dark_voltage_mv_per_s.value) * self.exposure_s * owner.relative_exposure.value
        charge = light * factor + dark_e
        parts: dict[str, Array] = {
            "shot": terms.linear * charge,
            "prnu": terms.prnu2 * (light * factor) ** 2,
            "dcnu": np.asarray((values.dcnu_percent.value / 100.0 * dark_e) ** 2 * terms.independent_fraction),
        }
        nothing = np.zeros_like(charge)
        parent, well_e = nothing, 0.0
        if captures[name].charge == "overflow":
            parent = self._reading_e2(charge_sensor, charge)
            well_e = charge_sensor.pixel.well_capacity_e.value / factor
        scale = capture_scale(self.sensor, name)
        return _Capture(
            owner.name,
            charge / factor,
            self._counted(parts, nothing) / factor**2,
            self._reading_e2(one, charge) / factor**2,
            parent / factor**2,
            well_e,
            scale.saturation_dn / scale.dn_per_light_e,
        )

    def _reading_e2(self, one: Sensor, charge: Array) -> Array:
        """Return the variance of what is added behind the charge of a capture, in its electrons."""
        terms, steep = NoiseTerms(one), NoiseTerms(one).slope(charge) ** 2
        parts = {
            "read": terms.read_e2 / steep,
            "dsnu": terms.dsnu_e2 / steep,
            "rounding": terms.rounding_e2(charge),
        }
        return self._counted(parts, np.zeros_like(charge))

    def _counted(self, parts: Mapping[str, Array], nothing: Array) -> Array:
        """Return the sum of the variances of the sources that count."""
        return sum((part for source, part in parts.items() if source in self.sources), nothing)

    def _output_rounding_e2(self, light: Array) -> Array:
        """Return the variance of rounding the combination to the output's numbers, in units of light.

        Numbers of a capture are multiples of s in units of the output's step. For s = p / q in lowest terms, rounding
        has q errors of equal probability: their variance is (1 - 1 / q^2) / 12, none for an integer.
        """
        rule, captures = self._rule, captures_of(self.sensor)
        step = np.ones_like(light)
        if rule.companding is not None:
            linear = light * rule.dn_per_e.value + rule.black_level_dn.value
            step = np.maximum(rule.companding.step_dn(linear), 1.0)
        in_use = np.searchsorted([each.light_e for each in self.transitions], light)
        lattice = rule.dn_per_e.value / np.array(
            [capture_scale(self.sensor, name).dn_per_light_e for name in captures.names]
        )
        return np.asarray(QUANTIZATION_DN2 * _uneven(lattice[in_use] / step) * (step / rule.dn_per_e.value) ** 2)


@np.vectorize(otypes=[np.float64])
def _uneven(step: float) -> float:
    """Return 1 - 1 / q^2 for a number that is p / q in lowest terms, q at most 16."""
    return 1.0 - 1.0 / Fraction(step).limit_denominator(_LARGEST_DENOMINATOR).denominator ** 2


def _db(light_e: ArrayLike, variance: Array) -> Array:
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(np.asarray(light_e, np.float64) ** 2 / variance))


def _combine(captures: list[_Capture], rule: Combination) -> Array:
    """Return the variance of the light by the combination, from the least sensitive capture on."""
    rest = captures[-1]
    mean, variance = rest.mean, rest.variance
    loading = {each.charge: np.zeros_like(mean) for each in captures} | {rest.charge: np.ones_like(mean)}
    for each, following in reversed(list(pairwise(captures))):
        own = each.variance
        both = each.charge_variance * loading[each.charge]
        if following.parent_reading_variance.any() and following.charge == each.charge:
            both = both + each.reading_variance
        # Regression of what follows on this capture; without noise there is nothing to regress on.
        slope = np.divide(both, own, out=np.zeros_like(own), where=own > 0)
        spread = np.sqrt(own)[..., None] * _DEVIATES
        weight = rule.weight((each.mean[..., None] + spread - each.start_e) / each.range_e)
        other = mean[..., None] + slope[..., None] * spread
        value = weight * (each.mean[..., None] + spread) + (1.0 - weight) * other
        expected = np.asarray(value @ _DEVIATE_WEIGHTS)
        left = ((1.0 - weight) ** 2 @ _DEVIATE_WEIGHTS) * np.maximum(variance - slope * both, 0.0)
        fraction = weight @ _DEVIATE_WEIGHTS
        mean, variance = expected, ((value - expected[..., None]) ** 2) @ _DEVIATE_WEIGHTS + left
        loading = {name: (1.0 - fraction) * part + fraction * (name == each.charge) for name, part in loading.items()}
    return np.asarray(variance)
