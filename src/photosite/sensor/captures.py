"""Captures: several readings of one exposure, and how a sensor combines them to a frame of high dynamic range."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from photosite.errors import InputError
from photosite.sensor.quantity import NO_UNIT, Fraction, NotNegative, Positive, UnitInterval, about, check_length
from photosite.values.uncertain import Measured
from photosite.values.validated import Section

_Percent = Annotated[float, Field(ge=0.0, le=100.0)]
_Number = Annotated[int, Field(ge=0, strict=True)]


class Capture(Section):
    """One reading of the exposure: values relative to those of the sensor file, or in place of them."""

    name: str = about("Name of the capture.", NO_UNIT, "small", min_length=1)
    relative_sensitivity: Fraction = about(
        "Electrons of its photodiode over those of the sensor's pixel: area times response.",
        "1",
        0.01,
        default=Measured(1.0),
    )
    relative_exposure: Fraction = about("Exposure time over that of the frame.", "1", 0.0625, default=Measured(1.0))
    crosstalk: dict[str, UnitInterval] = about(
        "Fraction of the electrons of another capture's photodiode that arrive in this one, by its name.",
        "1",
        {"large": 0.001},
        keys="captures",
        default={},
    )
    relative_gain: Positive = about(
        "System gain over that of the sensor file, such as a lower conversion gain.", "1", 0.25, default=Measured(1.0)
    )
    read_noise_e: NotNegative | None = about(
        "Temporal dark noise; default that of the sensor.", "e-", 3.0, default=None
    )
    well_capacity_e: Positive | None = about(
        "Electrons at which the capture saturates; default that of the sensor.", "e-", 22000, default=None
    )
    dark_current_e_per_s: NotNegative | None = about(
        "Mean dark current; default that of the sensor. For a separate charge.", "e-/s", 4.2, default=None
    )
    charge: Literal["own", "shared", "overflow"] = about(
        "own: a separate photodiode or exposure; shared: the charge of `charge_of`, read again; overflow: the charge "
        "beyond the well of `charge_of`, in a second capacitor.",
        NO_UNIT,
        "shared",
        default="own",
    )
    charge_of: str | None = about("Capture whose charge this one reads.", NO_UNIT, "high", default=None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.charge == "own") != (self.charge_of is None):
            expected = "the name of a capture, with charge 'shared' or 'overflow' only"
            raise InputError("charge_of", value=self.charge_of, expected=expected)
        given = self.model_fields_set & {"relative_sensitivity", "relative_exposure", "crosstalk"}
        if self.charge_of is not None:
            if self.dark_current_e_per_s is not None:
                given = given | {"dark_current_e_per_s"}
            changed = sorted(name for name in given if getattr(self, name) != type(self).model_fields[name].default)
            if changed:
                raise InputError(changed[0], value=getattr(self, changed[0]), expected="that of charge_of")
        return self


class Companding(Section):
    """A piecewise linear table from linear to companded numbers.

    Examples
    --------
    >>> table = Companding(linear_dn=(0, 1024, 65535), companded_dn=(0, 1024, 4095), bits=12)
    >>> table.decompand([1000, 4095])
    array([ 1000., 65535.])
    """

    linear_dn: tuple[_Number, ...] = about(
        "Linear numbers of the knees, ascending; the first and the last are the ends of the range.",
        "DN",
        [0, 2048, 65536, 16777215],
        min_length=2,
    )
    companded_dn: tuple[_Number, ...] = about(
        "Companded numbers of the knees, ascending.", "DN", [0, 1024, 2560, 4095], over="linear_dn", min_length=2
    )
    bits: int = about("Bit depth of the companded numbers.", "bit", 12, ge=1, le=16, strict=True)

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_length("companded_dn", self.companded_dn, "knee", len(self.linear_dn))
        for name in ("linear_dn", "companded_dn"):
            if (np.diff(getattr(self, name)) <= 0).any():
                raise InputError(name, value=getattr(self, name), expected="ascending")
        if self.companded_dn[-1] >= 1 << self.bits:
            raise InputError("companded_dn", value=self.companded_dn[-1], expected=f"at most {(1 << self.bits) - 1}")
        return self

    def decompand(self, companded_dn: ArrayLike) -> NDArray[np.float64]:
        """Return the linear numbers of companded ones, between the whole numbers where the table compresses."""
        return np.asarray(np.interp(np.asarray(companded_dn), self.companded_dn, self.linear_dn))

    def step_dn(self, linear_dn: ArrayLike) -> NDArray[np.float64]:
        """Return the linear numbers per companded one."""
        piece = np.clip(np.searchsorted(self.linear_dn, linear_dn, side="right") - 1, 0, len(self.linear_dn) - 2)
        return np.asarray((np.diff(self.linear_dn) / np.diff(self.companded_dn))[piece])


class Combination(Section):
    """How captures become one frame: the first one that is not too bright, with a blend at the transition."""

    switch_percent: _Percent = about(
        "Signal at the middle of a transition, of the saturation of the more sensitive capture.",
        "%",
        80.0,
        default=80.0,
    )
    blend_percent: _Percent = about(
        "Range of signals over which the two are blended, its weight linear in it; of the same saturation.",
        "%",
        10.0,
        default=10.0,
    )
    dn_per_e: Positive = about(
        "Linear output per electron of a photodiode with relative sensitivity and exposure 1.", "DN/e-", 16.0
    )
    bits: int = about("Bit depth of the linear output.", "bit", 24, default=24, ge=1, le=24, strict=True)
    black_level_dn: NotNegative = about("Linear output without light or dark current.", "DN", 64, default=Measured(0.0))
    companding: Companding | None = about(
        "Piecewise linear companding of the linear output; None for linear output.",
        NO_UNIT,
        {"linear_dn": [0, 2048, 16777215], "companded_dn": [0, 1024, 4095], "bits": 12},
        default=None,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.switch_percent + self.blend_percent / 2 > 100.0:
            expected = f"at most {200 - 2 * self.switch_percent:g}, so that the transition ends below saturation"
            raise InputError("blend_percent", value=self.blend_percent, expected=expected)
        if self.switch_percent - self.blend_percent / 2 < 0.0:
            raise InputError("blend_percent", value=self.blend_percent, expected="at most twice switch_percent")
        if self.black_level_dn.value >= (1 << self.bits) - 1:
            raise InputError("black_level_dn", value=self.black_level_dn.value, expected="below the highest number")
        if self.companding is not None and self.companding.linear_dn[-1] < (1 << self.bits) - 1:
            last = self.companding.linear_dn[-1]
            raise InputError("companding.linear_dn", value=last, expected=f"{(1 << self.bits) - 1}, the last")
        return self

    @property
    def output_bits(self) -> int:
        """Bit depth of the frame, companded if it is."""
        return self.bits if self.companding is None else self.companding.bits

    @property
    def output_black_level_dn(self) -> float:
        """Black level of the frame, companded if it is."""
        black = self.black_level_dn.value
        if self.companding is None:
            return black
        return float(np.interp(black, self.companding.linear_dn, self.companding.companded_dn))

    @property
    def transition(self) -> tuple[float, float]:
        """Signals, relative to saturation, at which a transition begins and ends."""
        middle, half = self.switch_percent / 100.0, self.blend_percent / 200.0
        return middle - half, middle + half

    def weight(self, signal: ArrayLike) -> NDArray[np.float64]:
        """Return the weight of the more sensitive capture at its signal, relative to its saturation.

        Examples
        --------
        >>> Combination(dn_per_e=1).weight([0.7, 0.8, 0.9])
        array([1. , 0.5, 0. ])
        """
        middle, width = self.switch_percent / 100.0, self.blend_percent / 100.0
        above = np.asarray(signal, np.float64) - middle
        if width == 0.0:
            return np.where(above < 0.0, 1.0, 0.0)
        return np.asarray(np.clip(0.5 - above / width, 0.0, 1.0))


class Captures(Section):
    """Several captures of one exposure, from the most to the least sensitive.

    Examples
    --------
    >>> two = Captures(
    ...     parts=({"name": "high"}, {"name": "low", "charge": "shared", "charge_of": "high", "relative_gain": 0.25}),
    ...     combination={"dn_per_e": 16},
    ... )
    >>> two.light("low")
    1.0
    """

    parts: tuple[Capture, ...] = about(
        "The captures, from the most to the least sensitive.",
        NO_UNIT,
        [{"name": "large"}, {"name": "small", "relative_sensitivity": 0.01}],
        min_length=1,
    )
    combination: Combination = about("How the captures become one frame.", NO_UNIT, {"dn_per_e": 16.0})

    @model_validator(mode="after")
    def _check(self) -> Self:
        names = self.names
        if len(set(names)) < len(names):
            raise InputError("parts", value=list(names), expected="captures of different names")
        owners: list[str] = []
        for number, part in enumerate(self.parts):
            where = f"parts[{number}]"
            if part.charge == "own":
                owners.append(part.name)
            elif part.charge_of not in owners:
                expected = "an earlier capture with charge 'own'"
                raise InputError("charge_of", where=where, value=part.charge_of, expected=expected)
        for number, part in enumerate(self.parts):
            if unknown := sorted(set(part.crosstalk) - {name for name in owners if name != part.name}):
                expected = "names of other captures with charge 'own'"
                raise InputError("crosstalk", where=f"parts[{number}]", value=unknown, expected=expected)
        return self

    def check(self, well_capacity_e: float, converter_range_e: float) -> None:
        """Raise `InputError` if a capture whose charge overflows saturates in the converter before its well is full."""
        for part in self.parts:
            if part.charge != "overflow":
                continue
            owner = self.owner(part.name)
            well_e = well_capacity_e if owner.well_capacity_e is None else owner.well_capacity_e.value
            highest_e = converter_range_e / owner.relative_gain.value
            if well_e > highest_e:
                expected = f"at most {highest_e:.6g}, the converter's range, for a charge that overflows"
                raise InputError("well_capacity_e", where="captures.parts", value=well_e, expected=expected)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the captures, from the most to the least sensitive."""
        return tuple(part.name for part in self.parts)

    def __getitem__(self, name: str) -> Capture:
        part = next((part for part in self.parts if part.name == name), None)
        if part is None:
            raise InputError("capture", value=name, expected=f"one of {', '.join(self.names)}")
        return part

    def with_dark_current(self, ratio: float) -> Captures:
        """Return the captures with the dark currents that they state multiplied by a ratio."""
        parts = []
        for part in self.parts:
            if (old := part.dark_current_e_per_s) is not None:
                scaled = replace(old, value=old.value * ratio, standard_uncertainty=old.standard_uncertainty * ratio)
                part = part.model_copy(update={"dark_current_e_per_s": scaled})
            parts.append(part)
        return self.model_copy(update={"parts": tuple(parts)})

    def owner(self, name: str) -> Capture:
        """Return the capture whose charge a capture reads: itself, or that of `charge_of`."""
        part = self[name]
        return part if part.charge_of is None else self[part.charge_of]

    def sensitivity(self, name: str) -> float:
        """Return the electrons of a capture's photodiode over those of the sensor's pixel, crosstalk included."""
        owner = self.owner(name)
        lost = sum(part.crosstalk.get(owner.name, 0.0) for part in self.parts)
        gained = sum(fraction * self[other].relative_sensitivity.value for other, fraction in owner.crosstalk.items())
        return owner.relative_sensitivity.value * (1.0 - lost) + gained

    def light(self, name: str) -> float:
        """Return the electrons of a capture over those of the sensor's pixel in the frame's exposure time."""
        return self.sensitivity(name) * self.owner(name).relative_exposure.value
