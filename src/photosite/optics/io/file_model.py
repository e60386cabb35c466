"""The sections of an optics file: what may stand in each, and what each becomes.

Numbers are numbers, not text that looks like one; a key that is not known is refused. Files that a section names are
beside the optics file.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.illumination import IlluminationTable
from photosite.optics.radial_table import FieldPoints
from photosite.optics.spread import VeilingGlare


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"a finite number is expected, not {value}")
    return value


Number = Annotated[float, Field(strict=True), AfterValidator(_finite)]
PositiveNumber = Annotated[float, Field(strict=True, gt=0), AfterValidator(_finite)]
Distance = Annotated[float, Field(strict=True, gt=0)]
"""May be .inf."""
Program = Literal["zemax", "codev", "iset"]


class Section(BaseModel):
    """A mapping of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _one_of(what: str, given: dict[str, bool]) -> None:
    said = [name for name, there in given.items() if there]
    if len(said) != 1:
        came = " and ".join(said) or "none of them"
        raise ValueError(f"{what} is given by one of {', '.join(given)}; here stand {came}")


class Transmittance(Section):
    """Of the glass: one number, or a table over wavelength, outside of which nothing passes."""

    wavelength_nm: tuple[PositiveNumber, ...] = ()
    transmittance: tuple[Annotated[float, Field(strict=True)], ...]

    @model_validator(mode="before")
    @classmethod
    def _one_number(cls, raw: Any) -> Any:
        if isinstance(raw, int | float) and not isinstance(raw, bool):
            return {"transmittance": (float(raw),)}
        return raw

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.transmittance) != max(len(self.wavelength_nm), 1):
            raise ValueError(
                f"one transmittance per wavelength: {len(self.wavelength_nm)} wavelengths, {len(self.transmittance)} "
                "transmittances"
            )
        if outside := [value for value in self.transmittance if not 0 <= value <= 1]:
            raise ValueError(f"transmittance is a fraction, 0 to 1, not {outside[0]:g}; percent are divided by 100")
        return self

    def build(self) -> float | Spectrum:
        """The number or table."""
        if not self.wavelength_nm:
            return self.transmittance[0]
        return Spectrum(np.array(self.wavelength_nm), np.array(self.transmittance))


def _floats(values: tuple[float, ...] | None) -> NDArray[np.float64] | None:
    return None if values is None else np.array(values, np.float64)


class _OverField(Section):
    height_mm: tuple[Number, ...] | None = None
    field_deg: tuple[Number, ...] | None = None

    def points(self) -> FieldPoints:
        try:
            return FieldPoints(_floats(self.height_mm), _floats(self.field_deg))
        except InputError as error:
            raise InputError(str(error).replace("angle_deg", "field_deg")) from None

    def _check_one(self, what: str, **others: bool) -> None:
        places = {"height_mm": self.height_mm is not None, "field_deg": self.field_deg is not None}
        _one_of(what, {**places, **others})


class RelativeIllumination(_OverField):
    """A table, or the listing of a lens-design program."""

    relative: tuple[PositiveNumber, ...] | None = None
    file: str | None = None
    program: Program = "zemax"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        self._check_one("relative illumination", file=self.file is not None)
        if (self.relative is None) != (self.file is not None):
            raise ValueError("'relative' goes with height_mm or field_deg, and only with those")
        return self

    def build(self, folder: Path) -> IlluminationTable:
        """The table."""
        if self.file is None:
            return IlluminationTable(self.points(), np.array(self.relative, np.float64))
        from photosite.optics.io.listings import ray_trace, zemax

        if self.program == "iset":
            return ray_trace.read_ray_trace(folder / self.file).relative_illumination()
        if self.program == "codev":
            raise ValueError("relative illumination of codev is not read; give field_deg and relative")
        return zemax.read_relative_illumination(folder / self.file)


class DistortionSection(_OverField):
    """A table, a calibration's polynomial, or the listing of a lens-design program."""

    percent: tuple[Number, ...] | None = None
    real_height_mm: tuple[Number, ...] | None = None
    k1: Number | None = None
    k2: Number = 0.0
    k3: Number = 0.0
    max_field_deg: PositiveNumber = 45.0
    file: str | None = None
    program: Program = "zemax"
    wavelength_nm: PositiveNumber | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        self._check_one("distortion", k1=self.k1 is not None, file=self.file is not None)
        table = self.k1 is None and self.file is None
        values = {"percent": self.percent is not None, "real_height_mm": self.real_height_mm is not None}
        if table:
            _one_of("a table of distortion", values)
        elif any(values.values()):
            raise ValueError("percent and real_height_mm go with height_mm or field_deg")
        if self.k1 is None and (self.k2 or self.k3):
            raise ValueError("k2 and k3 go with k1; give k1 too, 0 if it is so")
        return self

    def build(self, folder: Path, focal_length_mm: float) -> tuple[Distortion, LateralColor | None]:
        """The curve, and the lateral colour that a listing holds with it."""
        if self.k1 is not None:
            return Distortion.polynomial(self.k1, self.k2, self.k3, max_field_deg=self.max_field_deg), None
        if self.file is not None:
            from photosite.optics.io.listings import codev, ray_trace, zemax

            if self.program == "iset":
                return ray_trace.read_ray_trace(folder / self.file).distortion(self.wavelength_nm)
            if self.program == "codev":
                return codev.read_distortion(folder / self.file), None
            return zemax.read_distortion(folder / self.file, wavelength_nm=self.wavelength_nm)
        if self.percent is not None:
            return Distortion.from_percent(self.points(), self.percent), None
        assert self.real_height_mm is not None
        return Distortion.from_real_heights(self.points(), self.real_height_mm, focal_length_mm), None


class LateralColorSection(_OverField):
    """Magnification of each wavelength, or shifts over the field."""

    wavelength_nm: tuple[PositiveNumber, ...]
    magnification: tuple[PositiveNumber, ...] | None = None
    shift_um: tuple[tuple[Number, ...], ...] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        self._check_one("lateral colour", magnification=self.magnification is not None)
        if (self.magnification is None) == (self.shift_um is None):
            raise ValueError("'shift_um', a row for each wavelength, goes with height_mm or field_deg")
        return self

    def build(self) -> LateralColor:
        """The table."""
        if self.magnification is not None:
            return LateralColor.from_magnification(self.wavelength_nm, self.magnification)
        assert self.shift_um is not None
        if len({len(row) for row in self.shift_um}) > 1:
            raise ValueError("rows of shift_um differ in length; each holds one shift for every place in the field")
        return LateralColor(np.array(self.wavelength_nm), self.points(), np.array(self.shift_um))


class Glare(Section):
    """Veiling glare."""

    fraction: Annotated[float, Field(strict=True, ge=0, lt=1)]
    spread_mm: PositiveNumber | None = None

    def build(self) -> VeilingGlare:
        """The value."""
        return VeilingGlare(self.fraction, None if self.spread_mm is None else self.spread_mm * 1e-3)


class Provenance(Section):
    """Where the numbers come from."""

    source: str | None = None
    license: str | None = None
    created: str | None = None
    notes: str | None = None


class OpticsModel(Section):
    """The whole file."""

    photosite_optics: Literal[1] = 1
    name: str | None = None
    f_number: PositiveNumber
    focal_length_mm: PositiveNumber
    transmittance: Transmittance = Transmittance(transmittance=(1.0,))
    falloff: Literal["none", "cos4"] = "none"
    focus_distance_m: Distance | None = None
    blur: dict[str, Any] | None = None
    relative_illumination: RelativeIllumination | None = None
    distortion: DistortionSection | None = None
    lateral_color: LateralColorSection | None = None
    veiling_glare: Glare | None = None
    provenance: Provenance | None = None
