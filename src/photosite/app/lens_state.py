"""The lens of the page: f-number and focal length, and the other fields of an optics file."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field
from pydantic.config import JsonDict, JsonValue

from photosite.app.places import Part, Places, Text
from photosite.camera.file import DEFAULT_F_NUMBER, DEFAULT_FOCAL_LENGTH_MM
from photosite.errors import InputError
from photosite.optics.io.formats import load_optics, parse_optics
from photosite.optics.lens import Optics

Numbers = Annotated[tuple[float, ...], Field(max_length=1000)]
FieldPlaces = Literal["field_deg", "height_mm"]


def _of(
    default: Any,
    description: str,
    *,
    only: dict[str, JsonValue] | None = None,
    unit: str | None = None,
    over: str | None = None,
    slider: tuple[float, float] | None = None,
    example: Any = None,
    **constraints: Any,
) -> Any:
    """Return a field with what the form states of it; `only` is as in `FormField`."""
    stated: JsonDict = {}
    for name, value in (("only", only), ("unit", unit), ("over", over), ("slider", slider and list(slider))):
        if value is not None:
            stated[name] = value  # type: ignore[assignment]
    examples = None if example is None else [example]
    return Field(default, description=description, json_schema_extra=stated, examples=examples, **constraints)


_PLACES_ARE = "Places as field angles in degrees, or as image heights in mm."
_PLACES = "Places from the axis, 0, outwards: field angles in degrees, or image heights in mm."
_NM = (450.0, 550.0, 650.0)
_ANGLES = (0.0, 10.0, 20.0)


class TransmittanceState(Part):
    """Transmittance of the glass over the wavelength."""

    wavelength_nm: Numbers = _of(_NM, "Wavelengths of the table; beyond it nothing is transmitted.")
    transmittance: Numbers = _of((0.9, 0.95, 0.93), "Transmittance at each wavelength.", over="wavelength_nm")


class PupilState(Part):
    """The pupil."""

    obscuration: float = _of(0.0, "Diameter of the central obscuration over that of the pupil.", ge=0, lt=1)
    blades: int = _of(0, "Blades of the iris, 3 or more. 0: a circle.", ge=0, le=360, slider=(0, 12))
    rotation_deg: float = _of(0.0, "Angle of the first corner, from right towards up.", slider=(0, 120))
    roundness: float = _of(0.0, "Curvature of the blades: 0 straight, 1 arcs of the full circle.", ge=0, le=1)
    vanes: int = _of(0, "Spider vanes, evenly spaced.", ge=0, le=12)
    vane_width: float = _of(0.0, "Width of a vane over the diameter of the pupil; above 0 with vanes.", ge=0, lt=0.5)
    vane_rotation_deg: float = _of(0.0, "Angle of the first vane, from right towards up.", slider=(0, 120))


class ChromaticFocusState(Part):
    """Longitudinal chromatic aberration."""

    wavelength_nm: Numbers = _of(_NM, "Wavelengths of the table.")
    shift_um: Numbers = _of((-10.0, 0.0, 12.0), "Distance of the focus behind the sensor.", over="wavelength_nm")


class WavefrontState(Part):
    """Zernike coefficients, focus and pupil."""

    zernike: Annotated[dict[Text, float], Field(max_length=200)] = _of(
        {}, "Coefficient by term: a number from 1 on, such as 8; n,m such as 3,-1 with the index nm.", example={"8": 50}
    )
    index: Literal["noll", "fringe", "nm"] = _of("noll", "Numbering of the terms.")
    unit: Literal["nm", "waves"] = _of("nm", "Unit of the coefficients: nm of optical path, or waves.")
    reference_nm: float = _of(550.0, "Wavelength of the unit waves.", gt=0, le=1e5, only={"unit": ["waves"]})
    norm: Literal["rms", "peak"] | None = _of(
        None, "Meaning of a coefficient of 1: RMS over the circle, or peak at the rim. None: peak for fringe, else rms."
    )
    defocus_um: float = _of(
        0.0, "Distance of the focus behind the sensor; negative in front of it.", slider=(-100, 100)
    )
    pupil: PupilState | None = _of(None, "Shape of the pupil. None: a circle.", example={"blades": 7, "roundness": 0.5})
    chromatic_focus: ChromaticFocusState | None = _of(
        None,
        "Focus by wavelength. None: the same for all.",
        example=ChromaticFocusState().model_dump(),
    )

    def fields(self) -> dict[str, Any]:
        """Return the section `blur` of an optics file."""
        left_out = {"reference_nm"} if self.unit == "nm" else set()
        return {"kind": "wavefront", **self.model_dump(exclude_none=True, exclude=left_out)}


class IlluminationState(Part):
    """Relative illumination over the field."""

    places_are: FieldPlaces = _of("field_deg", _PLACES_ARE)
    places: Numbers = _of(_ANGLES, _PLACES)
    relative: Numbers = _of((1.0, 0.9, 0.7), "Illumination relative to that on the axis.", over="places")

    def fields(self) -> dict[str, Any]:
        """Return the section of an optics file."""
        return {self.places_are: self.places, "relative": self.relative}


class DistortionState(Part):
    """Distortion; fields of another kind are ignored."""

    kind: Literal["polynomial", "table"] = _of(
        "polynomial", "A polynomial in the squared tangent of the field angle, as in OpenCV, or a table."
    )
    k1: float = _of(-0.1, "Coefficient of the square.", only={"kind": ["polynomial"]}, slider=(-0.5, 0.5))
    k2: float = _of(0.0, "Coefficient of the fourth power.", only={"kind": ["polynomial"]}, slider=(-0.5, 0.5))
    k3: float = _of(0.0, "Coefficient of the sixth power.", only={"kind": ["polynomial"]}, slider=(-0.5, 0.5))
    max_field_deg: float = _of(
        45.0, "Field angle at which the polynomial ends.", only={"kind": ["polynomial"]}, gt=0, lt=90
    )
    places_are: FieldPlaces = _of("field_deg", _PLACES_ARE, only={"kind": ["table"]})
    places: Numbers = _of(_ANGLES, _PLACES, only={"kind": ["table"]})
    percent: Numbers = _of((0.0, -0.5, -2.0), "Real over ideal image height, less 1.", unit="%", over="places")

    def fields(self) -> dict[str, Any]:
        """Return the section of an optics file."""
        if self.kind == "table":
            return {self.places_are: self.places, "percent": self.percent}
        return self.model_dump(include={"k1", "k2", "k3", "max_field_deg"})


class LateralColorState(Part):
    """Lateral chromatic aberration; fields of another kind are ignored."""

    kind: Literal["magnification", "shift"] = _of(
        "magnification", "Image height of each wavelength relative to the others, or displacements over the field."
    )
    wavelength_nm: Numbers = _of(_NM, "Wavelengths.")
    magnification: Numbers = _of(
        (1.0003, 1.0, 0.9998), "Relative image height of each wavelength.", only={"kind": ["magnification"]}
    )
    places_are: FieldPlaces = _of("field_deg", _PLACES_ARE, only={"kind": ["shift"]})
    places: Numbers = _of(_ANGLES, _PLACES, only={"kind": ["shift"]})
    shift_um: Annotated[tuple[Numbers, ...], Field(max_length=1000)] = _of(
        ((0.0, 1.0, 3.0), (0.0, 0.0, 0.0), (0.0, -1.0, -2.0)),
        "Outward displacement at each place, a row for each wavelength.",
        only={"kind": ["shift"]},
    )

    def fields(self) -> dict[str, Any]:
        """Return the section of an optics file."""
        if self.kind == "magnification":
            return self.model_dump(include={"wavelength_nm", "magnification"})
        return {"wavelength_nm": self.wavelength_nm, self.places_are: self.places, "shift_um": self.shift_um}


class GlareState(Part):
    """Veiling glare."""

    fraction: float = _of(0.02, "Scattered share of all light.", ge=0, lt=1, slider=(0, 0.2))
    spread_mm: float | None = _of(
        None, "Length in exp(-distance / spread) on the sensor. None: uniform over the frame.", gt=0, slider=(0.1, 20)
    )

    def fields(self) -> dict[str, Any]:
        """Return the section of an optics file."""
        return self.model_dump(exclude_none=True)


_AS_DIFFRACTION_LIMITED = "As for `photosite.DiffractionLimited`."
_PLAIN = ("f_number", "focal_length_mm", "transmittance", "falloff")


class LensState(Part):
    """A lens by the fields of an optics file, or an optics file, which replaces them."""

    source: Text | None = Field(None, description="An optics file, file:NAME or upload:ID. None: the fields below.")
    f_number: float = Field(DEFAULT_F_NUMBER, description=_AS_DIFFRACTION_LIMITED)
    focal_length_mm: float = Field(DEFAULT_FOCAL_LENGTH_MM, description=_AS_DIFFRACTION_LIMITED)
    transmittance: float = Field(1.0, description=_AS_DIFFRACTION_LIMITED)
    falloff: Literal["none", "cos4"] = Field("none", description=_AS_DIFFRACTION_LIMITED)
    transmittance_table: TransmittanceState | None = _of(
        None, "Transmittance by wavelength, in place of the number.", example=TransmittanceState().model_dump()
    )
    focus_distance_m: float | None = _of(
        None, "Distance in focus, from the lens. None: every object is in focus.", gt=0, le=1e9, slider=(0.1, 100)
    )
    blur: WavefrontState | None = _of(
        None, "Aberrations, focus and pupil. None: diffraction.", example=WavefrontState(zernike={"8": 50}).model_dump()
    )
    relative_illumination: IlluminationState | None = _of(
        None, "The whole falloff as a table, with the falloff none.", example=IlluminationState().model_dump()
    )
    distortion: DistortionState | None = _of(
        None, "Real against ideal image height.", example=DistortionState().model_dump()
    )
    lateral_color: LateralColorState | None = _of(
        None, "Image height by wavelength.", example=LateralColorState().model_dump()
    )
    veiling_glare: GlareState | None = _of(None, "Light scattered over the sensor.", example=GlareState().model_dump())

    @property
    def fields(self) -> dict[str, Any]:
        """The fields of an optics file that are not at their defaults."""
        found: dict[str, Any] = {"f_number": self.f_number, "focal_length_mm": self.focal_length_mm}
        if self.transmittance_table is not None:
            found["transmittance"] = self.transmittance_table.model_dump()
        elif self.transmittance != 1.0:
            found["transmittance"] = self.transmittance
        if self.falloff != "none":
            found["falloff"] = self.falloff
        if self.focus_distance_m is not None:
            found["focus_distance_m"] = self.focus_distance_m
        parts = (self.blur, self.relative_illumination, self.distortion, self.lateral_color, self.veiling_glare)
        names = ("blur", "relative_illumination", "distortion", "lateral_color", "veiling_glare")
        return found | {name: part.fields() for name, part in zip(names, parts, strict=True) if part is not None}

    @property
    def diffraction_limited(self) -> bool:
        """Whether the fields are those of `photosite.DiffractionLimited`, with one transmittance."""
        return self.source is None and self.transmittance_table is None and self.fields.keys() <= {*_PLAIN}


def lens(state: LensState, places: Places) -> Optics:
    """Return the lens of a state; the same object again for recently used ones, so that it keeps its PSF."""
    if state.source is None:
        return _lens_of(state.model_dump_json())
    path = places.path(state.source)
    if path is None:
        raise InputError("lens", value=state.source, expected="an optics file")
    return _loaded(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _lens_of(text: str) -> Optics:
    return parse_optics(LensState.model_validate_json(text).fields, "the lens")


@lru_cache(maxsize=8)
def _loaded(path: Path, changed_ns: int) -> Optics:
    """Return the lens of an optics file, read again when that file changes."""
    return load_optics(path)
