"""The sections of an optics file: their fields, and the value that each describes.

Numbers must be numbers, not text; unknown fields are rejected. Files that a section names are relative to the optics
file. A section reads them by the function `read` that its `build` is given, see `photosite.optics.io.formats.read`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.optics.checks import camera_wavelengths
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.field_points import FieldPoints
from photosite.optics.illumination import IlluminationTable
from photosite.optics.io.parser import Number, PositiveNumber, Section, located_at
from photosite.optics.protocols import Blur
from photosite.optics.pupil import Pupil
from photosite.optics.veiling_glare import VeilingGlare
from photosite.optics.wavefront import Wavefront
from photosite.optics.zernike import zernike_terms

Distance = Annotated[float, Field(strict=True, gt=0)]
"""May be .inf."""
Program = Literal["zemax", "iset"]

_PAIR = """n and m in quotes, such as "3,-1": 40"""


class Read(Protocol):
    """Reader of the files that an optics file names."""

    def __call__(self, holds: str, file: str, *, program: str | None = None, **options: Any) -> Any:
        """Return the value of a kind that a file holds."""
        ...


def _check_one_of(what: str, given: dict[str, bool]) -> None:
    names = [name for name, present in given.items() if present]
    if len(names) != 1:
        value = " and ".join(names) or "none of them"
        raise InputError(what, value=value, expected=f"given by one of {', '.join(given)}")


def _floats(values: tuple[float, ...] | None) -> NDArray[np.float64] | None:
    return None if values is None else np.array(values, np.float64)


class Transmittance(Section):
    """Transmittance of the glass: one number, or a table over wavelength."""

    wavelength_nm: tuple[PositiveNumber, ...] = ()
    transmittance: tuple[Annotated[float, Field(strict=True)], ...]

    @model_validator(mode="before")
    @classmethod
    def _one_number(cls, raw: Any) -> Any:
        if isinstance(raw, int | float) and not isinstance(raw, bool):
            return {"transmittance": (float(raw),)}
        return raw

    def build(self) -> float | Spectrum:
        """Return the number or table."""
        if not self.wavelength_nm and len(self.transmittance) == 1:
            return self.transmittance[0]
        return Spectrum(np.array(self.wavelength_nm), np.array(self.transmittance))


class _OverField(Section):
    height_mm: tuple[Number, ...] | None = None
    field_deg: tuple[Number, ...] | None = None

    def points(self) -> FieldPoints:
        try:
            return FieldPoints(_floats(self.height_mm), _floats(self.field_deg))
        except InputError as error:
            name = "field_deg" if error.what == "angle_deg" else error.what
            raise InputError(name, **error.fields) from None

    def _check_one(self, what: str, **others: bool) -> None:
        points = {"height_mm": self.height_mm is not None, "field_deg": self.field_deg is not None}
        _check_one_of(what, {**points, **others})


class RelativeIllumination(_OverField):
    """A table, or the listing of a lens-design program."""

    relative: tuple[PositiveNumber, ...] | None = None
    file: str | None = None
    program: Program = "zemax"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        self._check_one("relative_illumination", file=self.file is not None)
        if (self.relative is None) != (self.file is not None):
            raise InputError("relative", expected="given together with height_mm or field_deg, and only with those")
        return self

    def build(self, read: Read) -> IlluminationTable:
        """Return the table."""
        if self.file is not None:
            table: IlluminationTable = read("relative illumination", self.file, program=self.program)
            return table
        return IlluminationTable(self.points(), np.array(self.relative, np.float64))


class DistortionSection(_OverField):
    """A table, the polynomial of a calibration, or the listing of a lens-design program."""

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
        values = {"percent": self.percent is not None, "real_height_mm": self.real_height_mm is not None}
        if self.k1 is None and self.file is None:
            _check_one_of("a table of distortion", values)
        elif any(values.values()):
            raise InputError("percent, real_height_mm", expected="given with height_mm or field_deg only")
        if self.k1 is None and (self.k2 or self.k3):
            raise InputError("k1", expected="given with k2 and k3", hint="Give 0 if it is 0")
        return self

    def build(self, read: Read, focal_length_mm: float) -> tuple[Distortion, LateralColor | None]:
        """Return the distortion, and the lateral colour of a listing."""
        if self.k1 is not None:
            return Distortion.polynomial(self.k1, self.k2, self.k3, max_field_deg=self.max_field_deg), None
        if self.file is not None:
            distortion, color = read("distortion", self.file, program=self.program, wavelength_nm=self.wavelength_nm)
            return distortion, color
        if self.percent is not None:
            return Distortion.from_percent(self.points(), self.percent), None
        assert self.real_height_mm is not None
        return Distortion.from_real_heights(self.points(), self.real_height_mm, focal_length_mm), None


class LateralColorSection(_OverField):
    """Magnification of each wavelength, or displacements over the field."""

    wavelength_nm: tuple[PositiveNumber, ...]
    magnification: tuple[PositiveNumber, ...] | None = None
    shift_um: tuple[tuple[Number, ...], ...] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        self._check_one("lateral_color", magnification=self.magnification is not None)
        if (self.magnification is None) == (self.shift_um is None):
            raise InputError("shift_um", expected="one row per wavelength, given with height_mm or field_deg")
        return self

    def build(self) -> LateralColor:
        """Return the table."""
        if self.magnification is not None:
            return LateralColor.from_magnification(self.wavelength_nm, self.magnification)
        assert self.shift_um is not None
        return LateralColor(np.array(self.wavelength_nm), self.points(), self.shift_um)  # type: ignore[arg-type]


class Glare(Section):
    """Veiling glare."""

    fraction: Annotated[float, Field(strict=True, ge=0, lt=1)]
    spread_mm: PositiveNumber | None = None

    def build(self) -> VeilingGlare:
        """Return the value."""
        return VeilingGlare(self.fraction, None if self.spread_mm is None else self.spread_mm * 1e-3)


class Provenance(Section):
    """Source of the numbers."""

    source: str | None = None
    license: str | None = None
    created: str | None = None
    notes: str | None = None


class Diffraction(Section):
    """A lens without aberrations, with defocus of objects out of focus."""

    kind: Literal["diffraction"]

    def build(self, read: Read) -> Blur | None:
        """Return None."""
        return None


class PupilSection(Section):
    """The pupil, see `photosite.optics.pupil.Pupil`."""

    obscuration: Number = 0.0
    blades: Annotated[int, Field(strict=True)] = 0
    rotation_deg: Number = 0.0
    roundness: Number = 0.0
    vanes: Annotated[int, Field(strict=True)] = 0
    vane_width: Number = 0.0
    vane_rotation_deg: Number = 0.0
    amplitude: str | None = None

    def build(self, read: Read) -> Pupil:
        """Return the pupil, its array from an .npz file."""
        array = None if self.amplitude is None else read("pupil amplitude", self.amplitude)
        return Pupil(**self.model_dump(exclude={"amplitude"}), amplitude=array)


class ChromaticFocus(Section):
    """Focus shift by wavelength, um behind the sensor."""

    wavelength_nm: tuple[PositiveNumber, ...]
    shift_um: tuple[Number, ...]

    def build(self) -> Spectrum:
        """Return the table."""
        return Spectrum(camera_wavelengths(self.wavelength_nm), np.array(self.shift_um))


class WavefrontSection(Section):
    """Zernike coefficients and pupil, see `photosite.optics.wavefront.Wavefront`."""

    kind: Literal["wavefront"]
    zernike: dict[int | str, Number] = Field(default_factory=dict, description="{8: 50, 11: -20}, term: value")
    index: Literal["noll", "fringe", "nm"] = "noll"
    unit: Literal["nm", "waves"] = "nm"
    reference_nm: PositiveNumber | None = None
    norm: Literal["rms", "peak"] | None = None
    pupil: PupilSection = PupilSection()
    defocus_um: Number = 0.0
    chromatic_focus: ChromaticFocus | None = None

    @field_validator("zernike", mode="before")
    @classmethod
    def _terms(cls, raw: Any) -> Any:
        for key, value in raw.items() if isinstance(raw, Mapping) else ():
            if not isinstance(key, int | str) or value is None:
                raise InputError("zernike", value=str(key), expected=f"terms with values; for index nm {_PAIR}")
        return raw

    def build(self, read: Read) -> Blur:
        """Return the wavefront."""
        coefficients: dict[Any, float] = {}
        for key, value in self.zernike.items():
            with located_at("zernike", key):
                term = _term(key, self.index)
                zernike_terms({term: value}, self.index, self.norm)
                coefficients[term] = value
        with located_at("pupil"):
            pupil = self.pupil.build(read)
        with located_at("chromatic_focus"):
            shifts = None if self.chromatic_focus is None else self.chromatic_focus.build()
        return Wavefront(
            coefficients=coefficients,
            index=self.index,
            unit=self.unit,
            reference_nm=self.reference_nm,
            norm=self.norm,
            pupil=pupil,
            defocus_um=self.defocus_um,
            chromatic_focus=shifts,
        )


def _term(key: int | str, index: str) -> Any:
    """Return the key of a coefficient: a number, or (n, m) of "n,m"."""
    if index != "nm":
        if isinstance(key, int):
            return key
        raise InputError("Zernike term", value=key, expected=f"a whole number from 1 for index {index}")
    try:
        n, m = (int(part) for part in str(key).split(","))
    except ValueError:
        raise InputError("Zernike term", value=key, expected=f"for index nm {_PAIR}") from None
    return n, m


class OtfSection(Section):
    """OTFs by wavelength, see `photosite.optics.tables.OtfTable`."""

    kind: Literal["otf"]
    file: str
    beyond: Literal["zero", "diffraction"] = "zero"

    def build(self, read: Read) -> Blur:
        """Return the table."""
        table: Blur = read("OTFs", self.file, beyond=self.beyond)
        return table


class PsfSection(Section):
    """PSFs by wavelength, see `photosite.optics.tables.PsfTable`."""

    kind: Literal["psf"]
    file: str
    spacing_um: PositiveNumber | None = None
    wavelength_nm: tuple[PositiveNumber, ...] | None = None
    normalise: Annotated[bool, Field(strict=True)] = False

    def build(self, read: Read) -> Blur:
        """Return the table."""
        table: Blur = read("PSFs", self.file, **self.model_dump(include={"spacing_um", "wavelength_nm", "normalise"}))
        return table


class LensDesignSection(Section):
    """PSFs over the field, see `photosite.optics.lens_design.LensDesign`."""

    kind: Literal["lens_design"]
    source: str
    tolerance: PositiveNumber | None = None
    rank: Annotated[int, Field(strict=True, ge=1)] | None = None
    detail_um: PositiveNumber | None = None
    nodes: Annotated[int, Field(strict=True, ge=3)] | None = None
    symmetric: Annotated[bool, Field(strict=True)] | None = None
    first_row: Literal["top", "bottom"] | None = None

    def build(self, read: Read) -> Blur:
        """Return the design."""
        options = self.model_dump(exclude={"kind", "source"}, exclude_none=True)
        design: Blur = read("lens design", self.source, **options)
        return design


KINDS: dict[str, type[Section]] = {
    "diffraction": Diffraction,
    "wavefront": WavefrontSection,
    "otf": OtfSection,
    "psf": PsfSection,
    "lens_design": LensDesignSection,
}
"""Sections `blur` by their kind."""


class OpticsModel(Section):
    """The whole file."""

    photosite_optics: Literal[1] = 1
    name: str | None = None
    f_number: PositiveNumber
    focal_length_mm: PositiveNumber
    transmittance: Transmittance = Field(
        Transmittance(transmittance=(1.0,)), description="a number or {wavelength_nm, transmittance}"
    )
    falloff: Literal["none", "cos4"] = "none"
    focus_distance_m: Distance | None = None
    blur: dict[str, Any] | None = Field(None, description=f"{{kind: {' | '.join(KINDS)}, ...}}")
    relative_illumination: RelativeIllumination | None = None
    distortion: DistortionSection | None = None
    lateral_color: LateralColorSection | None = None
    veiling_glare: Glare | None = None
    provenance: Provenance | None = None
