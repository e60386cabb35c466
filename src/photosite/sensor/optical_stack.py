"""The optical stack in front of the silicon: filters, microlenses and crosstalk.

The section `optical_stack` of a sensor file; `photosite.camera.optical_stack` applies it. The channels' quantum
efficiencies are those behind the infrared filter and the cover glass, for light along the axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic_core import CoreSchema

from photosite.errors import InputError, did_you_mean
from photosite.sensor.quantity import (
    NO_UNIT,
    Increasing,
    NotNegative,
    Positive,
    UnitInterval,
    about,
    check_length,
    is_number,
)
from photosite.values.uncertain import Measured
from photosite.values.validated import Section

Kernel = tuple[tuple[float, ...], ...]
"""Rows by columns: how the electrons of the center pixel are distributed over its neighborhood."""

SUM_TOLERANCE = 1e-6
"""Tolerance of a kernel's sum, for fractions written with few digits."""
_LARGEST_KERNEL = 9
_RIGHT_ANGLE_DEG = 90.0


class Transmittance(Section):
    """A filter's transmittance: a table over wavelength, or one number for all wavelengths.

    Examples
    --------
    >>> Transmittance(wavelength_nm=(600, 700), transmittance=(1, 0)).at([650, 675])
    array([0.5 , 0.25])
    >>> Transmittance.model_validate(0.92).at([400, 500])
    array([0.92, 0.92])
    """

    wavelength_nm: Increasing | None = about(
        "Wavelengths of the table, increasing; none for one number.", "nm", [400.0, 700.0], default=None
    )
    transmittance: tuple[UnitInterval, ...] = about(
        "Transmittance at each wavelength, or one number.", "1", 0.92, over="wavelength_nm"
    )
    source: str | None = about("Origin of the values.", NO_UNIT, "data sheet of the filter", default=None)
    assumed: bool = about("Whether the values are an assumption.", NO_UNIT, True, default=False)

    @model_validator(mode="before")
    @classmethod
    def _from_number(cls, raw: Any) -> Any:
        if is_number(raw):
            return {"transmittance": (float(raw),)}
        if isinstance(raw, Mapping) and is_number(raw.get("transmittance")):
            return {**raw, "transmittance": (float(raw["transmittance"]),)}
        if isinstance(raw, Mapping | Transmittance):
            return raw
        raise InputError("transmittance", value=raw, expected="a number from 0 to 1, or a table over wavelength_nm")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.wavelength_nm is not None:
            check_length("transmittance", self.transmittance, "wavelength", len(self.wavelength_nm))
        elif len(self.transmittance) != 1:
            raise InputError(f"transmittance has {len(self.transmittance)} entries, but there is no wavelength_nm")
        return self

    @model_serializer(mode="wrap")
    def _short(self, handler: SerializerFunctionWrapHandler) -> Any:
        complete = handler(self)
        number_only = self.wavelength_nm is None and self.source is None and not self.assumed
        return self.transmittance[0] if number_only else complete

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        number = {"type": "number", "minimum": 0, "maximum": 1}
        table = handler.resolve_ref_schema(handler(core_schema))
        values = table["properties"]["transmittance"]
        values["anyOf"] = [number, {"type": values.pop("type"), "items": values.pop("items")}]
        return {"anyOf": [number, table]}

    def at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Return the transmittance at wavelengths: linear between entries, 0 outside the table."""
        grid = np.asarray(wavelength_nm, dtype=np.float64)
        if self.wavelength_nm is None:
            return np.full(grid.shape, self.transmittance[0])
        return np.interp(grid, self.wavelength_nm, self.transmittance, left=0.0, right=0.0)


class LowPassFilter(Section):
    """A birefringent low-pass filter: four spots of equal light, at half the split to either side on each axis.

    Its transfer function is cos(pi f split) on each axis.
    """

    split_x_um: NotNegative = about("Distance of the two spots along a row.", "um", 3.0, default=Measured(0.0))
    split_y_um: NotNegative = about("Distance of the two spots along a column.", "um", 3.0, default=Measured(0.0))


class AngularResponse(Section):
    """Response to light at an angle, relative to light along the axis, from microlenses and deep pixels.

    It is evaluated at the angle of each pixel's chief ray, atan(image height / distance of the exit pupil), and not
    averaged over the cone of light around that ray.

    Examples
    --------
    >>> fall = AngularResponse(angle_deg=(0, 10, 30), relative_response=(1, 0.9, 0.5))
    >>> fall.of("G")
    (1.0, 0.9, 0.5)
    """

    angle_deg: Increasing = about("Angles of incidence, from 0, increasing.", "deg", [0.0, 10.0, 20.0])
    relative_response: tuple[float, ...] | dict[str, tuple[float, ...]] = about(
        "Response at each angle, relative to 0 degrees: one table for all channels, or one for each.",
        "1",
        [1.0, 0.97, 0.9],
        over="angle_deg",
        keys="channels",
    )
    exit_pupil_mm: Positive | None = about(
        "Distance of the lens's exit pupil from the sensor; by default that of a thin lens, its image distance.",
        "mm",
        60.0,
        default=None,
    )
    source: str | None = about("Origin of the table.", NO_UNIT, "data sheet, figure 7", default=None)
    assumed: bool = about("Whether the table is an assumption.", NO_UNIT, True, default=False)

    @field_validator("relative_response", mode="before")
    @classmethod
    def _check_numbers(cls, raw: Any) -> Any:
        # Checked here, since for a union Pydantic reports an error for each of its types.
        for name, row in (raw if isinstance(raw, Mapping) else {"": raw}).items():
            if not (isinstance(row, list | tuple) and all(map(is_number, row))):
                raise InputError(name or "the table", value=row, expected="a list of numbers, one per angle")
        return raw

    @model_validator(mode="after")
    def _check(self) -> Self:
        angles = self.angle_deg
        if len(angles) < 2 or angles[0] != 0.0 or not angles[-1] < _RIGHT_ANGLE_DEG:
            raise InputError("angle_deg", value=angles, expected="two or more angles from 0 to below 90 degrees")
        table = self.relative_response
        for name, row in table.items() if isinstance(table, dict) else [("", table)]:
            place = f"relative_response.{name}" if name else "relative_response"
            check_length(place, row, "angle", len(angles))
            if not all(math.isfinite(v) and v >= 0 for v in row):
                raise InputError(place, value=row, expected="finite and 0 or above at all angles")
            if row[0] != 1.0:
                hint = "Divide the table by that value: at 0 degrees the quantum efficiency is valid"
                raise InputError(place, value=row[0], expected="1 at 0 degrees", hint=hint)
        return self

    def of(self, channel: str) -> tuple[float, ...]:
        """Return the (angles,) response of a channel."""
        table = self.relative_response
        return table[channel] if isinstance(table, dict) else table


class Crosstalk(Section):
    """Crosstalk kernels, one for each color of the pixel that light or charge leaves.

    A kernel's center stays in the pixel, the entry above the center goes to the pixel in the row before, and so on.
    `optical` is light that has passed this pixel's filter and is collected by a neighbor; `electrical` is charge that
    diffuses from the pixel that collected it. Light is distributed first, then charge.

    Examples
    --------
    >>> plus = ((0, 0.01, 0), (0.01, 0.96, 0.01), (0, 0.01, 0))
    >>> Crosstalk(electrical={"M": plus}).electrical["M"][1][1]
    0.96
    """

    optical: dict[str, Kernel] | None = about(
        "Per channel, where light that passed its filter is collected: odd square kernel with sum 1.",
        "1",
        {"M": [[0.0, 0.01, 0.0], [0.01, 0.96, 0.01], [0.0, 0.01, 0.0]]},
        keys="channels",
        default=None,
    )
    electrical: dict[str, Kernel] | None = about(
        "Per channel, where charge that it generated is collected: odd square kernel with sum 1.",
        "1",
        {"M": [[0.0, 0.01, 0.0], [0.01, 0.96, 0.01], [0.0, 0.01, 0.0]]},
        keys="channels",
        default=None,
    )

    @field_validator("optical", "electrical")
    @classmethod
    def _check_kernels(cls, kernels: dict[str, Kernel] | None) -> dict[str, Kernel] | None:
        for name, kernel in (kernels or {}).items():
            size = len(kernel)
            if size % 2 == 0 or size > _LARGEST_KERNEL or any(len(row) != size for row in kernel):
                expected = f"square and odd, from 1 x 1 to {_LARGEST_KERNEL} x {_LARGEST_KERNEL}"
                raise InputError(f"kernel of {name}", value=[len(row) for row in kernel], expected=expected)
            fractions = np.array(kernel)
            if not (np.isfinite(fractions).all() and (fractions >= 0).all()):
                raise InputError(f"kernel of {name}", value=float(fractions.min()), expected="0 or above everywhere")
            if abs((total := float(fractions.sum())) - 1.0) > SUM_TOLERANCE:
                hint = "Divide it by its sum, and include losses in the quantum efficiency"
                raise InputError(f"sum of the kernel of {name}", value=total, expected="1", hint=hint)
        return kernels

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.optical is None and self.electrical is None:
            raise InputError("'optical' and 'electrical' are both missing", hint="Give one of them, or omit crosstalk")
        return self


class OpticalStack(Section):
    """The parts in front of the silicon; None for parts that the sensor does not have.

    Examples
    --------
    >>> stack = OpticalStack(cover_glass=0.92, low_pass_filter={"split_x_um": 6, "split_y_um": 6})
    >>> stack.transmittance_at([500]), stack.low_pass_filter.split_x_um.value
    (array([0.92]), 6.0)
    """

    infrared_filter: Transmittance | None = about(
        "Transmittance of the infrared filter.",
        "1",
        {"wavelength_nm": [300, 640, 700, 1100], "transmittance": [0.95, 0.95, 0.0, 0.0]},
        default=None,
    )
    cover_glass: Transmittance | None = about("Transmittance of the cover glass.", "1", 0.92, default=None)
    low_pass_filter: LowPassFilter | None = about(
        "Birefringent low-pass filter.", NO_UNIT, {"split_x_um": 3.0, "split_y_um": 3.0}, default=None
    )
    angular_response: AngularResponse | None = about(
        "Response to light at an angle.",
        NO_UNIT,
        {"angle_deg": [0.0, 20.0, 40.0], "relative_response": [1.0, 0.9, 0.7]},
        default=None,
    )
    crosstalk: Crosstalk | None = about(
        "Light and charge that reach neighboring pixels.",
        NO_UNIT,
        {"electrical": {"M": [[0.0, 0.01, 0.0], [0.01, 0.96, 0.01], [0.0, 0.01, 0.0]]}},
        default=None,
    )

    @property
    def filters(self) -> dict[str, Transmittance]:
        """The filters that are not None, by name."""
        named = {"infrared_filter": self.infrared_filter, "cover_glass": self.cover_glass}
        return {name: found for name, found in named.items() if found is not None}

    def transmittance_at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Return the (wavelengths,) transmittance of all filters together."""
        return math.prod(
            (found.at(wavelength_nm) for found in self.filters.values()), start=np.ones(np.shape(wavelength_nm))
        )

    def knots_nm(self) -> NDArray[np.float64]:
        """Return the wavelengths of all entries of the filters' tables."""
        return np.unique([nm for found in self.filters.values() for nm in found.wavelength_nm or ()]).astype(np.float64)

    def check(
        self, responds_nm: Mapping[str, tuple[float, float] | None], shape: tuple[int, int], tile: tuple[int, int]
    ) -> None:
        """Raise `InputError` unless the stack is consistent with the sensor.

        Tables must have the sensor's channels, filters must cover each channel's response (first and last wavelength),
        and an array with crosstalk must not be smaller than the tile of its color filter array.
        """
        self._check_channels(list(responds_nm))
        for name, filter_ in self.filters.items():
            for channel, ends in responds_nm.items():
                if ends is None or filter_.wavelength_nm is None:
                    continue
                first, last = filter_.wavelength_nm[0], filter_.wavelength_nm[-1]
                if not first <= ends[0] <= ends[1] <= last:
                    raise InputError(
                        "wavelength_nm",
                        where=f"optical_stack.{name}",
                        value=(first, last),
                        expected=f"{ends[0]:g} to {ends[1]:g} nm or more, the response of channel {channel}",
                        hint="Add entries, with 0 where the filter blocks",
                    )
        if self.crosstalk is not None and (shape[0] < tile[0] or shape[1] < tile[1]):
            expected = f"at least one tile, {tile[0]} x {tile[1]} pixels, with optical_stack.crosstalk"
            raise InputError("the array", value=shape, expected=expected)

    def _check_channels(self, channels: list[str]) -> None:
        angular, crosstalk = self.angular_response, self.crosstalk
        tables: dict[str, Any] = {
            "angular_response.relative_response": angular and angular.relative_response,
            "crosstalk.optical": crosstalk and crosstalk.optical,
            "crosstalk.electrical": crosstalk and crosstalk.electrical,
        }
        for place, table in tables.items():
            names = table if isinstance(table, dict) else channels
            if unknown := [name for name in names if name not in channels]:
                hint = did_you_mean(unknown[0], channels)
                raise InputError(f"unknown channel '{unknown[0]}'", where=f"optical_stack.{place}", hint=hint)
            if missing := [name for name in channels if name not in names]:
                raise InputError(f"the channels {', '.join(missing)} are missing", where=f"optical_stack.{place}")
