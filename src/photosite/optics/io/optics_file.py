"""Optics files: a lens in YAML.

photosite_optics: 1
name: my 50 mm
f_number: 2.8
focal_length_mm: 50
transmittance: 0.92                   # or {wavelength_nm: [...], transmittance: [...]}
falloff: cos4                         # or none; or instead of it:
relative_illumination: {field_deg: [0, 10, 20], relative: [1, 0.9, 0.7]}
focus_distance_m: 2                   # or .inf; without it, every object is in focus
blur: {kind: wavefront, zernike: {8: 50}, unit: nm}
distortion: {field_deg: [0, 10, 20], percent: [0, -0.5, -2]}
lateral_color: {wavelength_nm: [450, 550, 650], magnification: [1.0003, 1, 0.9998]}
veiling_glare: {fraction: 0.02}
provenance: {source: ..., license: ...}

File names are relative to the optics file. docs/howto/optics.md describes all sections.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    Field,
    PlainValidator,
    StrictBool,
    StrictInt,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from photosite.color.spectrum import Spectrum
from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.writing import atomic_folder
from photosite.files.yaml import LARGEST_BYTES, check_version, dump_yaml, read_yaml, validated
from photosite.optics.checks import camera_wavelengths
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import Distortion, LateralColor, combined_mapping
from photosite.optics.field_points import FieldPoints
from photosite.optics.illumination import IlluminationTable, VeilingGlare
from photosite.optics.io.tables import write_amplitude, write_design, write_otf, write_psf
from photosite.optics.lens import Blur, Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.pupil import Pupil
from photosite.optics.tables import OtfTable, PsfTable
from photosite.optics.wavefront import Wavefront
from photosite.optics.zernike import zernike_terms
from photosite.values.validated import Number, PositiveNumber, Section, located

SUFFIXES = (".yaml", ".yml")
Fields = dict[str, Any]
Tables = dict[str, Callable[[Path], None]]
"""Files beside the optics file: name -> writer."""

Program = Literal["zemax", "iset"]
Wavelengths = tuple[PositiveNumber, ...]

_PAIR = """n and m in quotes, such as "3,-1": 40"""


Read = Callable[..., Any]
"""Reader of the files that an optics file names: kind of value, file, **options -> value."""


def read_optics(path: Path, read: Read) -> Lens:
    """Return the lens of an optics file; `read` reads the files that it names.

    Raises
    ------
    FileError
        If the file is missing or does not describe a lens, or a file that it names is invalid; with the line.
    """
    data = read_yaml(path, "an optics file")
    check_version(path, data, "photosite_optics")
    found = parse_optics(data, path, read)
    return found if isinstance(found, Lens) else Lens(found)


def parse_optics(
    data: Mapping[str, Any], path: str | PathLike[str], read: Read, section: str = ""
) -> Lens | DiffractionLimited:
    """Return the lens of the fields of an optics file.

    Parameters
    ----------
    data
        The fields, as `photosite.files.yaml` reads them.
    path, section
        The file that holds them, for messages, and its section, if they are not at its top level.
    read
        Reader of the files that they name.

    Returns
    -------
    Lens or DiffractionLimited
        A `DiffractionLimited` if that can represent all fields: options of `photosite simulate` may then change it.

    Raises
    ------
    FileError
        As `read_optics`.
    """
    lens: Lens | DiffractionLimited = validated(Annotated[Any, described_by(OpticsModel)], data, path, section, read)
    return lens


def write_optics(
    lens: Lens | DiffractionLimited, path: str | PathLike[str], provenance: Mapping[str, str] | None = None
) -> None:
    """Write an optics file and the tables beside it.

    If writing fails, the files that were there are kept. The optics file has the SHA-256 of its table, so that one of
    another lens is an error when it is read.

    Parameters
    ----------
    lens
        The lens. Tables of its blur get files of their own: beside mine.optics.yaml, mine.optics.otf.csv, .psf.npz,
        .design.npz or .pupil.npz. Those of a lens that the file described before are removed.
    path
        A name that ends in .yaml or .yml.
    provenance
        Source of the numbers: texts `source`, `license`, `created`, `notes`. A lens that was read from a file does not
        carry the provenance of that file.

    Raises
    ------
    InputError
        If an optics file cannot represent the lens, or the provenance is invalid.
    FileError
        If the file cannot be written.
    """
    file = Path(path)
    fields, tables = _described(lens, file.stem)
    if provenance is not None:
        fields["provenance"] = _provenance(provenance)
    text = dump_yaml(fields)
    if len(text.encode()) > LARGEST_BYTES:
        raise InputError(f"the optics file would exceed {LARGEST_BYTES >> 20} MiB", hint="Thin the tables of the lens")
    if file.suffix.lower() not in SUFFIXES:
        expected = "one that ends in .yaml or .yml"
        raise FileError(file, "the name of an optics file", value=file.suffix, expected=expected)
    for name in (file.name, *tables):
        beside = file.with_name(name)
        if os.path.exists(beside) and not os.path.isfile(beside):
            raise FileError(beside, "cannot be written: it is a folder or a device, not a file")
    if not file.absolute().parent.is_dir():
        raise FileError(file, f"cannot be written: there is no folder {file.parent}")
    before = _tables_of(file)
    with atomic_folder(file.absolute().parent, add=True) as folder:
        for name, write in tables.items():
            write(folder / name)
            section = fields["blur"].get("pupil", fields["blur"])  # the one that names the table
            section["sha256"] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        (folder / file.name).write_text(dump_yaml(fields) if tables else text, encoding="utf-8")
    for name in before - set(tables):
        with suppress(OSError):  # a table that is no longer named does no harm
            file.with_name(name).unlink()


def _tables_of(file: Path) -> set[str]:
    """Return the names of tables that `write_optics` wrote beside this file before."""
    try:
        blur = read_yaml(file, "an optics file")["blur"]
        named = {str(blur.get("file")), str(blur.get("source")), str(blur.get("pupil", {}).get("amplitude"))}
    except (FileError, LookupError, TypeError, AttributeError):
        return set()
    return named & {f"{file.stem}.{kind}" for kind in ("otf.csv", "psf.npz", "design.npz", "pupil.npz")}


def _described(lens: Lens | DiffractionLimited, stem: str) -> tuple[Fields, Tables]:
    if type(lens) not in (Lens, DiffractionLimited):
        raise InputError("lens", value=type(lens), expected="a Lens or a DiffractionLimited, to be written")
    whole = lens if isinstance(lens, Lens) else Lens(lens)
    base, passed = whole.base, whole.base.transmittance
    blur, tables = (None, Tables()) if whole.blur is None else _blur_section(whole.blur, stem)
    light, curve, color, veil = whole.illumination, whole.distortion, whole.lateral_color, whole.veiling_glare
    fields = {
        "photosite_optics": 1,
        "name": whole.name,
        "f_number": float(base.f_number),
        "focal_length_mm": float(base.focal_length_mm),
        "transmittance": _table(passed, "transmittance") if isinstance(passed, Spectrum) else float(passed),
        "falloff": None if base.falloff == "none" else base.falloff,
        "focus_distance_m": None if whole.focus_distance_m is None else float(whole.focus_distance_m),
        "blur": blur,
        "relative_illumination": light and _points(light.field) | {"relative": _list(light.relative)},
        "distortion": curve and _points(curve.field) | {"percent": _list(100 * (curve.ratio - 1))},
        "lateral_color": color and _lateral_color(color),
        "veiling_glare": veil
        and _given({"fraction": float(veil.fraction), "spread_mm": veil.spread_m and float(veil.spread_m * 1e3)}),
    }
    return _given(fields), tables


def _given(fields: Fields) -> Fields:
    return {name: value for name, value in fields.items() if value is not None}


def _list(values: ArrayLike) -> list[Any]:
    result: list[Any] = np.asarray(values, np.float64).tolist()
    return result


def _table(spectrum: Spectrum, name: str) -> Fields:
    return {"wavelength_nm": _list(spectrum.wavelength_nm), name: _list(spectrum.values)}


def _points(points: FieldPoints) -> Fields:
    if points.height_mm is not None:
        return {"height_mm": _list(points.height_mm)}
    assert points.angle_deg is not None
    return {"field_deg": _list(points.angle_deg)}


def _lateral_color(color: LateralColor) -> Fields:
    waves = {"wavelength_nm": _list(color.wavelength_nm)}
    if not color.everywhere:
        return waves | _points(color.field) | {"shift_um": _list(color.shift_um)}
    height = color.field.height_mm
    if height is None or height.size != 1:
        hint = "Omit everywhere, or use LateralColor.from_magnification"
        raise InputError("lateral_color", expected="of one field point if it continues everywhere", hint=hint)
    return waves | {"magnification": _list(1 + color.shift_um[:, 0] / (1e3 * height[0]))}


def _provenance(given: Mapping[str, str]) -> Fields:
    try:
        return Provenance.model_validate(dict(given)).model_dump(exclude_none=True)
    except (ValidationError, TypeError, ValueError):
        expected = f"texts by name, of {', '.join(Provenance.model_fields)}"
        raise InputError("provenance", value=given, expected=expected) from None


def _blur_section(blur: object, stem: str) -> tuple[Fields, Tables]:
    if type(blur) is Wavefront:
        return _wavefront(blur, stem)
    if type(blur) is OtfTable:
        otf, name = blur, f"{stem}.otf.csv"
        return {"kind": "otf", "file": name, "beyond": otf.beyond}, {name: lambda path: write_otf(otf, path)}
    if type(blur) is PsfTable:
        psf, name = blur, f"{stem}.psf.npz"
        section = {"kind": "psf", "file": name, "normalise": bool(psf.normalize)}
        return section, {name: lambda path: write_psf(psf, path)}
    if type(blur) is LensDesign:
        design, name = blur, f"{stem}.design.npz"
        options = {key: getattr(design, key) for key in ("rank", "detail_um", "nodes")}
        section = {"kind": "lens_design", "source": name, "symmetric": bool(design.symmetric)}
        section |= {"tolerance": float(design.tolerance), **_given(options)}
        return section, {name: lambda path: write_design(design, path)}
    raise InputError("blur", value=type(blur), expected="a Wavefront, OtfTable, PsfTable or LensDesign, to be written")


def _wavefront(blur: Wavefront, stem: str) -> tuple[Fields, Tables]:
    coefficients = {
        f"{key[0]},{key[1]}" if isinstance(key, tuple | list) else int(key): float(value)
        for key, value in blur.coefficients.items()
    }
    section: Fields = {"kind": "wavefront", "zernike": coefficients}
    section |= _changed(blur, Wavefront(), ("index", "unit", "reference_nm", "norm", "defocus_um"))
    pupil, amplitude, tables = _changed(blur.pupil, Pupil(), _PUPIL_SHAPE), blur.pupil.amplitude, Tables()
    if amplitude is not None:
        pupil["amplitude"] = f"{stem}.pupil.npz"
        tables[pupil["amplitude"]] = lambda path: write_amplitude(amplitude, path)
    if pupil:
        section["pupil"] = pupil
    if blur.chromatic_focus is not None:
        section["chromatic_focus"] = _table(blur.chromatic_focus, "shift_um")
    return section, tables


_PUPIL_SHAPE = ("obscuration", "blades", "rotation_deg", "roundness", "vanes", "vane_width", "vane_rotation_deg")


def _changed(value: object, default: object, names: tuple[str, ...]) -> Fields:
    """Return the fields that differ from their defaults, as plain Python."""
    changed = {name: getattr(value, name) for name in names if getattr(value, name) != getattr(default, name)}
    return {name: entry.item() if hasattr(entry, "item") else entry for name, entry in changed.items()}


# The sections of an optics file: their fields, and the value that each describes.
#
# Numbers must be numbers, not text; unknown fields are rejected. Files that a section names are relative to the optics
# file. The context of the validation is the function that reads them, see `photosite.optics.io.formats.read`.


class Description(Section):
    """A section that describes a value, which `_build` returns.

    Its argument has the function that reads files as `context`, and the fields above the section as `data`.
    """

    def _build(self, info: ValidationInfo) -> Any:
        raise NotImplementedError

    def _read(self, info: ValidationInfo, holds: str, field: str, **options: Any) -> Any:
        """Return what the file that a field names holds; a missing file is an error of the field."""
        try:
            assert info.context is not None
            return info.context(holds, getattr(self, field), **options)
        except FileError as error:
            if os.path.exists(error.path):  # False for an invalid name
                raise
            raise located(InputError(f"there is no such file, {error.path}"), field) from None
        except InputError:
            raise
        except (OSError, ValueError) as error:  # an invalid name
            reason = getattr(error, "strerror", None) or error
            raise located(InputError(f"cannot be read: {reason}"), field) from None


def described_by(section: type[Description]) -> PlainValidator:
    """Return a validator that makes a value from the fields of its section."""

    def value(raw: Any, info: ValidationInfo) -> Any:
        return None if raw is None else section.model_validate(raw, context=info.context)._build(info)

    return PlainValidator(value)


def _check_one_of(what: str, **given: object) -> None:
    names = [name for name, value in given.items() if value is not None]
    if len(names) != 1:
        value = " and ".join(names) or "none of them"
        raise InputError(what, value=value, expected=f"given by one of {', '.join(given)}")


def _floats(values: tuple[float, ...] | None) -> NDArray[np.float64] | None:
    return None if values is None else np.array(values, np.float64)


class Transmittance(Description):
    """Transmittance of the glass: one number, or a table over wavelength."""

    wavelength_nm: Wavelengths = ()
    transmittance: tuple[Annotated[float, Field(strict=True)], ...]

    @model_validator(mode="before")
    @classmethod
    def _one_number(cls, raw: Any) -> Any:
        if isinstance(raw, int | float) and not isinstance(raw, bool):
            return {"transmittance": (float(raw),)}
        if not isinstance(raw, Mapping):
            raise InputError("transmittance", value=raw, expected="a number or {wavelength_nm, transmittance}")
        return raw

    def _build(self, info: ValidationInfo) -> float | Spectrum:
        if not self.wavelength_nm and len(self.transmittance) == 1:
            return self.transmittance[0]
        return Spectrum(camera_wavelengths(self.wavelength_nm), np.array(self.transmittance))


class _OverField(Description):
    height_mm: tuple[Number, ...] | None = None
    field_deg: tuple[Number, ...] | None = None

    def points(self) -> FieldPoints:
        try:
            return FieldPoints(_floats(self.height_mm), _floats(self.field_deg))
        except InputError as error:
            name = "field_deg" if error.what == "angle_deg" else error.what
            raise InputError(name, **error.fields) from None


class RelativeIllumination(_OverField):
    """A table, or the listing of a lens-design program."""

    relative: tuple[PositiveNumber, ...] | None = None
    file: str | None = None
    program: Program = "zemax"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_one_of("relative_illumination", height_mm=self.height_mm, field_deg=self.field_deg, file=self.file)
        if (self.relative is None) != (self.file is not None):
            raise InputError("relative", expected="given together with height_mm or field_deg, and only with those")
        return self

    def _build(self, info: ValidationInfo) -> Any:
        if self.file is not None:
            return self._read(info, "relative illumination", "file", program=self.program)
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
        _check_one_of("distortion", height_mm=self.height_mm, field_deg=self.field_deg, k1=self.k1, file=self.file)
        if self.k1 is None and self.file is None:
            _check_one_of("a table of distortion", percent=self.percent, real_height_mm=self.real_height_mm)
        elif self.percent is not None or self.real_height_mm is not None:
            raise InputError("percent, real_height_mm", expected="given with height_mm or field_deg only")
        if self.k1 is None and (self.k2 or self.k3):
            raise InputError("k1", expected="given with k2 and k3", hint="Give 0 if it is 0")
        return self

    def _build(self, info: ValidationInfo) -> Any:
        if self.k1 is not None:
            return Distortion.polynomial(self.k1, self.k2, self.k3, max_field_deg=self.max_field_deg), None
        if self.file is not None:
            return self._read(info, "distortion", "file", program=self.program, wavelength_nm=self.wavelength_nm)
        if self.percent is not None:
            return Distortion.from_percent(self.points(), self.percent), None
        focal_length_mm = info.data.get("focal_length_mm", 1.0)  # missing if it is invalid, which is another error
        return Distortion.from_real_heights(self.points(), self.real_height_mm or (), focal_length_mm), None


class LateralColorSection(_OverField):
    """Magnification of each wavelength, or displacements over the field."""

    wavelength_nm: Wavelengths
    magnification: tuple[PositiveNumber, ...] | None = None
    shift_um: tuple[tuple[Number, ...], ...] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        places = {"height_mm": self.height_mm, "field_deg": self.field_deg}
        _check_one_of("lateral_color", **places, magnification=self.magnification)
        if (self.magnification is None) == (self.shift_um is None):
            raise InputError("shift_um", expected="one row per wavelength, given with height_mm or field_deg")
        return self

    def _build(self, info: ValidationInfo) -> LateralColor:
        if self.magnification is not None:
            return LateralColor.from_magnification(self.wavelength_nm, self.magnification)
        return LateralColor(np.array(self.wavelength_nm), self.points(), self.shift_um)  # type: ignore[arg-type]


class Glare(Description):
    """Veiling glare."""

    fraction: Number
    spread_mm: PositiveNumber | None = None

    def _build(self, info: ValidationInfo) -> VeilingGlare:
        return VeilingGlare(self.fraction, None if self.spread_mm is None else self.spread_mm * 1e-3)


class Provenance(Section):
    """Source of the numbers."""

    source: str | None = None
    license: str | None = None
    created: str | None = None
    notes: str | None = None


class PupilSection(Description):
    """The pupil, see `photosite.optics.pupil.Pupil`."""

    obscuration: Number = 0.0
    blades: StrictInt = 0
    rotation_deg: Number = 0.0
    roundness: Number = 0.0
    vanes: StrictInt = 0
    vane_width: Number = 0.0
    vane_rotation_deg: Number = 0.0
    amplitude: str | None = None
    sha256: str | None = None

    def _build(self, info: ValidationInfo) -> Pupil:
        named = self.amplitude is not None
        array = self._read(info, "pupil amplitude", "amplitude", sha256=self.sha256) if named else None
        return Pupil(**self.model_dump(exclude={"amplitude", "sha256"}), amplitude=array)


class ChromaticFocus(Description):
    """Focus shift by wavelength, um behind the sensor."""

    wavelength_nm: Wavelengths
    shift_um: tuple[Number, ...]

    def _build(self, info: ValidationInfo) -> Spectrum:
        return Spectrum(camera_wavelengths(self.wavelength_nm), np.array(self.shift_um))


class Diffraction(Description):
    """A lens without aberrations, with defocus of objects out of focus."""

    kind: str

    def _build(self, info: ValidationInfo) -> None: ...


class WavefrontSection(Description):
    """Zernike coefficients and pupil, see `photosite.optics.wavefront.Wavefront`."""

    kind: str
    zernike: dict[int | str, Number] = Field(default_factory=dict)
    index: Literal["noll", "fringe", "nm"] = "noll"
    unit: Literal["nm", "waves"] = "nm"
    reference_nm: PositiveNumber | None = None
    norm: Literal["rms", "peak"] | None = None
    pupil: Annotated[Pupil, described_by(PupilSection)] = Field(default_factory=Pupil)
    defocus_um: Number = 0.0
    chromatic_focus: Annotated[Spectrum | None, described_by(ChromaticFocus)] = None

    @field_validator("zernike", mode="before")
    @classmethod
    def _terms(cls, raw: Any) -> Any:
        for key, value in raw.items() if isinstance(raw, Mapping) else ():
            if not isinstance(key, int | str) or value is None:
                raise InputError("zernike", value=str(key), expected=f"terms with values; for index nm {_PAIR}")
        return raw

    def _build(self, info: ValidationInfo) -> Any:
        coefficients: dict[Any, float] = {}
        for key, value in self.zernike.items():
            try:
                term = _term(key, self.index)
                zernike_terms({term: value}, self.index, self.norm)
            except InputError as error:
                raise located(error, "zernike", key) from None
            if term in coefficients:
                raise located(InputError("Zernike term", value=key, expected="stated once"), "zernike", key)
            coefficients[term] = value
        return Wavefront(coefficients, **{name: value for name, value in self if name not in ("kind", "zernike")})


def _term(key: int | str, index: str) -> Any:
    """Return the key of a coefficient: a number, or (n, m) of "n,m"."""
    if index != "nm":
        if isinstance(key, int) or (key.isdecimal() and len(key) < 7):
            return int(key)
        raise InputError("Zernike term", value=key, expected=f"a whole number from 1 for index {index}")
    try:
        n, m = (int(part) for part in str(key).split(","))
    except ValueError:
        raise InputError("Zernike term", value=key, expected=f"for index nm {_PAIR}") from None
    return n, m


class OtfSection(Description):
    """OTFs by wavelength, see `photosite.optics.tables.OtfTable`."""

    kind: str
    file: str
    sha256: str | None = None
    beyond: Literal["zero", "diffraction"] = "zero"

    def _build(self, info: ValidationInfo) -> Any:
        return self._read(info, "OTFs", "file", sha256=self.sha256, beyond=self.beyond)


class PsfSection(Description):
    """PSFs by wavelength, see `photosite.optics.tables.PsfTable`."""

    kind: str
    file: str
    sha256: str | None = None
    spacing_um: PositiveNumber | None = None
    wavelength_nm: Wavelengths | None = None
    normalise: StrictBool = False

    def _build(self, info: ValidationInfo) -> Any:
        stated = self.model_dump(exclude={"kind", "file", "normalise"})
        return self._read(info, "PSFs", "file", **stated, normalize=self.normalise)


class LensDesignSection(Description):
    """PSFs over the field, see `photosite.optics.lens_design.LensDesign`."""

    kind: str
    source: str
    sha256: str | None = None
    tolerance: PositiveNumber | None = None
    rank: Annotated[StrictInt, Field(ge=1)] | None = None
    detail_um: PositiveNumber | None = None
    nodes: Annotated[StrictInt, Field(ge=3)] | None = None
    symmetric: StrictBool | None = None
    first_row: Literal["top", "bottom"] | None = None

    def _build(self, info: ValidationInfo) -> Any:
        options = self.model_dump(exclude={"kind", "source"}, exclude_none=True)
        return self._read(info, "lens design", "source", **options)


KINDS: dict[str, type[Description]] = {
    "diffraction": Diffraction,
    "wavefront": WavefrontSection,
    "otf": OtfSection,
    "psf": PsfSection,
    "lens_design": LensDesignSection,
}
"""Sections `blur` by their kind."""


def _blur(raw: Any, info: ValidationInfo) -> Blur | None:
    """Return the blur of the section of its kind."""
    if raw is None:
        return None
    if not isinstance(raw, Mapping):
        raise InputError("blur", value=raw, expected=f"{{kind: {' | '.join(KINDS)}, ...}}")
    kind = raw.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError("kind", value=kind, expected="a kind of blur", hint=did_you_mean(str(kind), KINDS))
    blur: Blur | None = KINDS[kind].model_validate(raw, context=info.context)._build(info)
    return blur


class OpticsModel(Description):
    """The whole file."""

    photosite_optics: Literal[1] = 1
    name: str | None = None
    f_number: PositiveNumber
    focal_length_mm: PositiveNumber
    transmittance: Annotated[float | Spectrum, described_by(Transmittance)] = 1.0
    falloff: Literal["none", "cos4"] = "none"
    focus_distance_m: Annotated[float, Field(strict=True, gt=0)] | None = None
    blur: Annotated[Blur | None, PlainValidator(_blur)] = None
    relative_illumination: Annotated[IlluminationTable | None, described_by(RelativeIllumination)] = None
    distortion: Annotated[tuple[Distortion, LateralColor | None] | None, described_by(DistortionSection)] = None
    lateral_color: Annotated[LateralColor | None, described_by(LateralColorSection)] = None
    veiling_glare: Annotated[VeilingGlare | None, described_by(Glare)] = None
    provenance: Provenance | None = None

    def _build(self, info: ValidationInfo) -> Lens | DiffractionLimited:
        """Return the lens; a `DiffractionLimited` if that can represent all fields."""
        base = DiffractionLimited(self.f_number, self.focal_length_mm, self.transmittance, self.falloff)
        distortion, color = self.distortion or (None, None)
        if color is not None and self.lateral_color is not None:
            raise InputError("lateral_color", expected="omitted: the listing of distortion has it")
        color = color or self.lateral_color
        try:  # rejects tables that fold back together here rather than on the first frame
            combined_mapping(distortion, color, self.focal_length_mm * 1e-3)
        except InputError as error:
            raise located(error, "distortion" if self.lateral_color is None else "lateral_color") from None
        light, glare = self.relative_illumination, self.veiling_glare
        parts = (self.blur, self.focus_distance_m, light, distortion, color, glare, self.name)
        lens = Lens(base, *parts)
        return base if all(part is None for part in parts) else lens
