"""What lies on the chip in front of its silicon: filters, microlenses, and the neighbours' share of a pixel's light.

The section `optical_stack` of a sensor file, and nothing else: `photosite.camera.optical_stack` applies it.
Channels' quantum
efficiencies are those behind the infrared filter and the cover glass, for light along the axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic_core import CoreSchema

from photosite.errors import did_you_mean
from photosite.sensor.quantity import NotNegative, Positive
from photosite.values.measured import Measured

Kernel = tuple[tuple[float, ...], ...]
"""Shares, rows by columns: how the electrons of the pixel in the middle end up around it."""

SUM_TOLERANCE = 1e-6
"""What a kernel's shares may lack of a sum of 1: files keep them in few digits."""
_LARGEST_KERNEL = 9
_RIGHT_ANGLE_DEG = 90.0


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, validate_default=True)


class Transmittance(_Section):
    """A filter's transmittance: a table over wavelength, or one number for all wavelengths.

    Examples
    --------
    >>> Transmittance(wavelength_nm=(600, 700), transmittance=(1, 0)).at([650, 675])
    array([0.5 , 0.25])
    >>> Transmittance.model_validate(0.92).at([400, 500])
    array([0.92, 0.92])
    """

    wavelength_nm: tuple[float, ...] | None = None
    transmittance: tuple[float, ...]
    source: str | None = None
    assumed: bool = False

    @model_validator(mode="before")
    @classmethod
    def _one_number(cls, raw: Any) -> Any:
        if _is_number(raw):
            return {"transmittance": (float(raw),)}
        if isinstance(raw, Mapping) and _is_number(raw.get("transmittance")):
            return {**raw, "transmittance": (float(raw["transmittance"]),)}
        if isinstance(raw, Mapping | Transmittance):
            return raw
        raise ValueError(f"a number, 0 to 1, or wavelength_nm and transmittance, lists of numbers, not {raw!r:.60}")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        grid, values = self.wavelength_nm, self.transmittance
        if grid is None and len(values) != 1:
            raise ValueError(f"transmittance has {len(values)} numbers and no wavelength_nm; give one for each")
        if grid is not None and (not grid or len(values) != len(grid)):
            raise ValueError(
                f"transmittance needs one number per wavelength: {len(grid)} wavelengths, {len(values)} transmittances"
            )
        if grid is not None:
            _check_increasing("wavelength_nm", grid)
        if outside := [t for t in values if not 0.0 <= t <= 1.0]:
            raise ValueError(f"transmittance is a fraction, 0 to 1, not {outside[0]:g}; percent are divided by 100")
        return self

    @model_serializer(mode="wrap")
    def _short(self, handler: SerializerFunctionWrapHandler) -> Any:
        whole = handler(self)
        bare = self.wavelength_nm is None and self.source is None and not self.assumed
        return self.transmittance[0] if bare else whole

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        number = {"type": "number", "minimum": 0, "maximum": 1}
        table = handler.resolve_ref_schema(handler(core_schema))
        values = table["properties"]["transmittance"]
        values["anyOf"] = [number, {"type": values.pop("type"), "items": values.pop("items")}]
        return {"anyOf": [number, table]}

    def at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Transmittance at wavelengths: linear between entries. Outside the table, where no channel responds, 0."""
        grid = np.asarray(wavelength_nm, dtype=np.float64)
        if self.wavelength_nm is None:
            return np.full(grid.shape, self.transmittance[0])
        return np.interp(grid, self.wavelength_nm, self.transmittance, left=0.0, right=0.0)


class LowPassFilter(_Section):
    """A birefringent low-pass filter: four spots of equal light, half the split to either side on each axis.

    Its transfer is cos(pi f split) on each axis. 0 is no split on that axis.
    """

    split_x_um: NotNegative = Measured(0.0)
    split_y_um: NotNegative = Measured(0.0)


class AngularResponse(_Section):
    """Response to light that comes in at an angle, relative to light along the axis: microlenses, deep pixels.

    Each pixel is taken at the angle of its chief ray, atan(image height / distance of the exit pupil); the cone of
    light around that ray is not averaged over.

    Examples
    --------
    >>> fall = AngularResponse(angle_deg=(0, 10, 30), relative_response=(1, 0.9, 0.5))
    >>> fall.of("G")
    (1.0, 0.9, 0.5)
    """

    angle_deg: tuple[float, ...]
    relative_response: tuple[float, ...] | dict[str, tuple[float, ...]]
    """One table for all channels, or one for each."""
    exit_pupil_mm: Positive | None = None
    """Distance of the lens's exit pupil from the sensor. None: that of a thin lens, its image distance."""
    source: str | None = None
    assumed: bool = False

    @field_validator("relative_response", mode="before")
    @classmethod
    def _numbers(cls, raw: Any) -> Any:
        """Checked here: of a choice of forms pydantic would complain about each."""
        rows = raw if isinstance(raw, Mapping) else {"": raw}
        for name, row in rows.items():
            if not (isinstance(row, list | tuple) and all(map(_is_number, row))):
                raise ValueError(f"{name or 'it'} must be a list of numbers, one per angle, not {row!r:.60}")
        return raw

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        angles = self.angle_deg
        if len(angles) < 2 or angles[0] != 0.0 or not angles[-1] < _RIGHT_ANGLE_DEG:
            raise ValueError("angle_deg goes in two entries or more from 0, the axis, to below 90 degrees")
        _check_increasing("angle_deg", angles)
        table = self.relative_response
        for name, row in table.items() if isinstance(table, dict) else [("", table)]:
            of = f" of {name}" if name else ""
            if len(row) != len(angles):
                raise ValueError(f"relative_response{of} needs one number per angle: {len(angles)}, not {len(row)}")
            if not all(math.isfinite(v) and v >= 0 for v in row):
                raise ValueError(f"relative_response{of} must be 0 or more at every angle")
            if row[0] != 1.0:
                raise ValueError(
                    f"relative_response{of} must be 1 at 0 degrees, where the quantum efficiency holds, not "
                    f"{row[0]:g}; divide it by that"
                )
        return self

    def of(self, channel: str) -> tuple[float, ...]:
        """(angles,) of a channel."""
        table = self.relative_response
        return table[channel] if isinstance(table, dict) else table


class Crosstalk(_Section):
    """What a pixel's neighbours get of it: a kernel for each colour of the pixel that gives.

    A kernel's middle entry stays in the pixel, the one above the middle goes to the pixel in the row before, and so
    on. `optical` is light that has passed this pixel's filter and is collected next door, `electrical` is charge that
    diffuses from the pixel that has collected it. Light shared first, then charge.

    Examples
    --------
    >>> plus = ((0, 0.01, 0), (0.01, 0.96, 0.01), (0, 0.01, 0))
    >>> Crosstalk(electrical={"M": plus}).electrical["M"][1][1]
    0.96
    """

    optical: dict[str, Kernel] | None = None
    electrical: dict[str, Kernel] | None = None

    @field_validator("optical", "electrical")
    @classmethod
    def _shares(cls, kernels: dict[str, Kernel] | None) -> dict[str, Kernel] | None:
        for name, kernel in (kernels or {}).items():
            size = len(kernel)
            if size % 2 == 0 or size > _LARGEST_KERNEL or any(len(row) != size for row in kernel):
                lengths = sorted({len(row) for row in kernel} or {0})
                form = f"{size} rows of {lengths[0]}" + (f" to {lengths[-1]}" if len(lengths) > 1 else "")
                expected = f"square and odd, from 1 x 1 to {_LARGEST_KERNEL} x {_LARGEST_KERNEL}"
                raise ValueError(f"the kernel of {name} must be {expected}, not {form}")
            shares = np.array(kernel)
            if not (np.isfinite(shares).all() and (shares >= 0).all()):
                raise ValueError(f"the kernel of {name} holds shares of electrons, 0 to 1; one is {shares.min():g}")
            total = float(shares.sum())
            if abs(total - 1.0) > SUM_TOLERANCE:
                raise ValueError(
                    f"the kernel of {name} must sum to 1, for no electron is lost or made, not {total:.7g}; divide "
                    "it by its sum, and put what is lost into the quantum efficiency"
                )
        return kernels

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.optical is None and self.electrical is None:
            raise ValueError("give 'optical' or 'electrical', a kernel for each channel; or leave crosstalk out")
        return self


class OpticalStack(_Section):
    """What lies in front of the silicon. Whatever is not given is not there.

    Examples
    --------
    >>> stack = OpticalStack(cover_glass=0.92, low_pass_filter={"split_x_um": 6, "split_y_um": 6})
    >>> stack.transmittance_at([500]), stack.low_pass_filter.split_x_um.value
    (array([0.92]), 6.0)
    """

    infrared_filter: Transmittance | None = None
    cover_glass: Transmittance | None = None
    low_pass_filter: LowPassFilter | None = None
    angular_response: AngularResponse | None = None
    crosstalk: Crosstalk | None = None

    @property
    def filters(self) -> dict[str, Transmittance]:
        """The filters there are, by name."""
        named = {"infrared_filter": self.infrared_filter, "cover_glass": self.cover_glass}
        return {name: found for name, found in named.items() if found is not None}

    def transmittance_at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """(wavelengths,) of the filters together."""
        product = np.ones(np.shape(wavelength_nm))
        for found in self.filters.values():
            product = product * found.at(wavelength_nm)
        return product

    def knots_nm(self) -> NDArray[np.float64]:
        """Wavelengths at which some filter's table has an entry."""
        return np.unique([nm for found in self.filters.values() for nm in found.wavelength_nm or ()]).astype(np.float64)

    def check(
        self, responds_nm: Mapping[str, tuple[float, float] | None], shape: tuple[int, int], tile: tuple[int, int]
    ) -> None:
        """That the stack fits the sensor behind it.

        Parameters
        ----------
        responds_nm
            For each channel the first and last wavelength at which it responds, None where at none.
        shape, tile
            (rows, cols) of the array and of its colour filter array's tile.

        Raises
        ------
        ValueError
            If a table by channel names others than the sensor's, a filter is not known wherever a channel responds,
            or crosstalk has no whole tile.
        """
        self._check_names(list(responds_nm))
        for name, filter_ in self.filters.items():
            for channel, ends in responds_nm.items():
                if ends is None or filter_.wavelength_nm is None:
                    continue
                first, last = filter_.wavelength_nm[0], filter_.wavelength_nm[-1]
                if not first <= ends[0] <= ends[1] <= last:
                    raise ValueError(
                        f"optical_stack.{name} is known from {first:g} to {last:g} nm, but channel {channel} responds "
                        f"from {ends[0]:g} to {ends[1]:g} nm; say what the filter passes there, 0 where it blocks"
                    )
        if self.crosstalk is not None and (shape[0] < tile[0] or shape[1] < tile[1]):
            raise ValueError(
                f"optical_stack.crosstalk needs an array of one whole tile or more, {tile[0]} x {tile[1]} pixels, "
                f"not {shape[0]} x {shape[1]}"
            )

    def _check_names(self, channels: list[str]) -> None:
        tables: dict[str, Any] = {}
        if self.angular_response is not None:
            tables["angular_response.relative_response"] = self.angular_response.relative_response
        if self.crosstalk is not None:
            tables |= {"crosstalk.optical": self.crosstalk.optical, "crosstalk.electrical": self.crosstalk.electrical}
        for place, table in tables.items():
            if not isinstance(table, dict):
                continue
            for name in table:
                if name not in channels:
                    raise ValueError(f"optical_stack.{place} has '{name}'; {did_you_mean(name, channels)}")
            if missing := [name for name in channels if name not in table]:
                raise ValueError(f"optical_stack.{place} lacks {', '.join(missing)}; give every channel its own")


def _is_number(raw: Any) -> bool:
    return isinstance(raw, int | float) and not isinstance(raw, bool)


def _check_increasing(name: str, values: tuple[float, ...]) -> None:
    if not all(map(math.isfinite, values)) or any(b <= a for a, b in pairwise(values)):
        raise ValueError(f"{name} must increase from entry to entry")
