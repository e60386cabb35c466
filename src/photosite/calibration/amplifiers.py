"""The amplifiers of a chip that its files name: each is calibrated by itself, and the chip has their mean gain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.dark.dark_result import DarkResult
from photosite.calibration.light.light_frames import LightResult
from photosite.calibration.measurements import Measurements
from photosite.calibration.parameters import Parameters
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.diagnostic import DiagnosticKind, one_in
from photosite.values.estimate import Estimate, signed_square
from photosite.values.region import Region
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured, Missing, Uncertain, Value, derive, weighted_mean

DIFFERENT_P_VALUE = 1e-3
"""Fraction of chips of equal amplifiers whose gains may differ as far."""

AMPLIFIER_GAINS = DiagnosticKind(
    "amplifier-gains",
    "note",
    "The files name the parts of the chip that amplifiers of their own read, and their gains differ.",
    "The system gain is the mean of theirs, and temporal noise of the chip is that at this gain. The gain of the mean "
    "variance against the mean signal, which the emva1288 block has, is higher.",
    "Nothing: the report has each amplifier, and the sensor file their gains where they are equal parts.",
    ("system_gain_dn_per_e", "read_noise_*", "row_noise_*", "column_noise_*", "*_e", "*_e_per_s"),
    "largest difference of two gains, relative to their mean",
    f"below {one_in(DIFFERENT_P_VALUE)} sets",
)
AMPLIFIER_UNKNOWN = DiagnosticKind(
    "amplifier-unknown",
    "warning",
    "The frames of one amplifier of the chip, by themselves, cannot be calibrated.",
    "The system gain is that of the mean variance against the mean signal, which is above the mean of different gains.",
    "--region calibrates one amplifier, and its message says what it lacks.",
    ("system_gain_dn_per_e", "*_e", "*_e_per_s"),
)


@dataclass(frozen=True)
class Amplifier(Shown):
    """An amplifier: the part of the chip that it reads, and the parameters of this part."""

    region: Region
    parameters: Parameters

    def to_dict(self) -> dict[str, Any]:
        """Return rows and columns from the first to the one after the last, and the parameters."""
        place = self.region
        return {
            "rows": [place.r0, place.r1],
            "cols": [place.c0, place.c1],
            "parameters": {name: entry.to_dict() for name, entry in self.parameters.estimates().items()},
        }


@dataclass(frozen=True)
class AmplifierGains:
    """The gains of amplifiers that differ.

    Parameters
    ----------
    gains, uncertainties, weights
        (n,) system gains in DN per electron, their standard uncertainties, and the amplifiers' shares of the pixels.
    names
        Their names.
    """

    gains: NDArray[np.float64]
    uncertainties: NDArray[np.float64]
    weights: NDArray[np.float64]
    names: tuple[str, ...]

    @classmethod
    def of(cls, amplifiers: Mapping[str, Amplifier]) -> AmplifierGains | None:
        """Return the gains; None where one is missing, or they do not differ beyond chance."""
        found = cls.known(amplifiers)
        return found if found is not None and _differ(found.gains, found.uncertainties) else None

    @classmethod
    def known(cls, amplifiers: Mapping[str, Amplifier]) -> AmplifierGains | None:
        """Return the gains; None where one is missing."""
        found = [each.parameters.system_gain_dn_per_e for each in amplifiers.values()]
        if len(found) < 2 or any(entry.value is None or not entry.standard_uncertainty for entry in found):
            return None
        gains, u = (np.array([getattr(entry, name) for entry in found]) for name in ("value", "standard_uncertainty"))
        pixels = np.array([math.prod(each.region.shape) for each in amplifiers.values()], float)
        return cls(gains, u, pixels / pixels.sum(), tuple(amplifiers))

    @property
    def mean(self) -> float:
        """Mean over the pixels."""
        return float(self.weights @ self.gains)

    @property
    def variance_factor(self) -> float:
        """Variance at the mean gain, over the mean variance of the same noise in electrons."""
        return self.mean**2 / float(self.weights @ self.gains**2)

    @property
    def difference(self) -> float:
        """Largest difference, relative to the mean."""
        return float(np.ptp(self.gains)) / self.mean

    def __str__(self) -> str:
        each = ", ".join(f"{name} {gain:.4g}" for name, gain in zip(self.names, self.gains, strict=True))
        return (
            f"the amplifiers differ in gain ({each} DN/e-): the system gain is their mean, and noise of all is that at "
            f"the mean gain"
        )

    def light(self, light: LightResult) -> LightResult:
        """Return the light frames with the mean of the gains in place of that of all pixels together."""
        if not isinstance(light.gain, Uncertain):
            return light
        ratio, own = self.mean / light.gain.value, light.gain.standard_uncertainty
        more = max(float((self.weights * self.uncertainties) @ (self.weights * self.uncertainties)) - own**2, 0.0)

        def scaled(gain: Value) -> Value:
            return derive(lambda k: k * ratio + Uncertain.of(0.0, math.sqrt(more)), gain)

        channels = tuple(
            replace(each, gain=scaled(each.gain), straight_gain=scaled(each.straight_gain)) for each in light.channels
        )
        return replace(light, channels=channels, gain=scaled(light.gain), straight_gain=scaled(light.straight_gain))

    def dark(self, dark: DarkResult) -> DarkResult:
        """Return the dark frames with their temporal variances at the mean gain."""
        return replace(
            dark, channels=tuple(map(self._at_mean_gain, dark.channels)), pooled=self._at_mean_gain(dark.pooled)
        )

    def _at_mean_gain(self, m: Measurements) -> Measurements:
        factor = self.variance_factor
        names = ("read_variance", "row_variance", "column_variance", "dark_variance", "dark_variance_slope")
        scaled: dict[str, Any] = {name: derive(lambda v: v * factor, getattr(m, name)) for name in names}
        return replace(m, **scaled)


def _differ(values: NDArray[np.float64], u: NDArray[np.float64]) -> bool:
    """Return whether values differ beyond chance, given their standard uncertainties."""
    from scipy.special import chdtrc

    middle = float((values / u**2).sum() / (1.0 / u**2).sum())
    return bool(chdtrc(len(values) - 1, float((((values - middle) / u) ** 2).sum())) <= DIFFERENT_P_VALUE)


def within_amplifiers(amplifiers: Mapping[str, Amplifier], chip: Parameters) -> dict[str, Estimate]:
    """Return DSNU, PRNU and DCNU about the mean of each amplifier; DSNU at the system gain of the chip."""
    pixels = [float(math.prod(each.region.shape)) for each in amplifiers.values()]

    def of(name: str, scale: Value = _ONE) -> Estimate:
        method = f"root of the mean square over the amplifiers; {getattr(chip, name).method}"
        squares = []
        for each in amplifiers.values():
            if isinstance(found := getattr(each.parameters, name).uncertain, Missing):
                return Estimate.of(found, method)
            u = found.standard_uncertainty  # of a deviation of 0, the variance is about 2 u^2 uncertain
            squares.append(found.apply(signed_square, partial(_twice_hypot, u)))
        if isinstance(scale, Missing):
            return Estimate.of(scale, method)
        return Estimate.of_variance(weighted_mean(squares, pixels), method, scale)

    gain, volts = chip.system_gain_dn_per_e.uncertain, chip.conversion_gain_uv_per_e.uncertain
    return {
        "dsnu_dn": of("dsnu_e", gain),
        "dsnu_e": of("dsnu_e"),
        "dsnu_mv": of("dsnu_e", derive(lambda uv: 1e-3 * uv, volts)),
        "prnu_percent": of("prnu_percent"),
        "dcnu_percent": of("dcnu_percent"),
    }


_ONE = Uncertain(1.0)


def _twice_hypot(u: float, value: float) -> float:
    return 2.0 * math.hypot(value, u)


def amplifier_channels(amplifiers: Mapping[str, Amplifier], rows: int, cols: int) -> ReadoutChannels | None:
    """Return amplifiers as readout channels; None where they are alike, or not equal parts of the array.

    Offsets are those of the black levels, where all are known.
    """
    found = AmplifierGains.known(amplifiers)
    if found is None:
        return None
    places = [each.region for each in amplifiers.values()]
    tops, lefts = sorted({each.r0 for each in places}), sorted({each.c0 for each in places})
    shape = len(tops), len(lefts)
    equal = [-(-k * rows // shape[0]) for k in range(shape[0])], [-(-k * cols // shape[1]) for k in range(shape[1])]
    if (tops, lefts) != equal or math.prod(shape) != len(places):
        return None
    order = np.argsort([each.r0 * cols + each.c0 for each in places])
    differ = _differ(found.gains, found.uncertainties)
    gains, source = (
        found.gains[order] if differ else np.full(len(order), found.mean),
        "measured from the frames of each amplifier",
    )
    blacks = [list(amplifiers.values())[k].parameters.black_level_dn for k in order]

    def table(values: NDArray[np.float64], u: NDArray[np.float64]) -> list[list[Measured]]:
        cells = [Measured(float(v), float(each), source) for v, each in zip(values, u, strict=True)]
        return [cells[k : k + shape[1]] for k in range(0, len(cells), shape[1])]

    offsets = None
    if all(entry.value is not None and entry.standard_uncertainty for entry in blacks):
        black = np.array([entry.value or 0.0 for entry in blacks])
        u = np.array([entry.standard_uncertainty or 0.0 for entry in blacks])
        if differ or _differ(black, u):
            offsets = table((black - found.weights[order] @ black) / gains, u / gains)
    relative = table(gains / found.mean, found.uncertainties[order] / found.mean) if differ else None
    if relative is None and offsets is None:
        return None
    return ReadoutChannels.model_validate(
        {"arrangement": "blocks", "relative_gain": relative, "offset_e": offsets},
    )
