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

File names are relative to the optics file. docs/optics.md describes all sections.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from photosite.color.spectrum import Spectrum
from photosite.errors import FileError, InputError
from photosite.files.atomic import atomic_folder
from photosite.files.validation import validated
from photosite.files.yaml import LARGEST_BYTES, check_version, dump_yaml, read_yaml
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import LateralColor
from photosite.optics.field_points import FieldPoints
from photosite.optics.io.npz import write_amplitude, write_design
from photosite.optics.io.sections import OpticsModel, Provenance, Read, described_by
from photosite.optics.io.tables import write_otf, write_psf
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.pupil import Pupil
from photosite.optics.tables import OtfTable, PsfTable
from photosite.optics.wavefront import Wavefront

SUFFIXES = (".yaml", ".yml")
Fields = dict[str, Any]
Tables = dict[str, Callable[[Path], None]]
"""Files beside the optics file: name -> writer."""

_LENS = Annotated[Any, described_by(OpticsModel)]


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
    lens: Lens | DiffractionLimited = validated(_LENS, data, path, section, read)
    return lens


def write_optics(
    lens: Lens | DiffractionLimited, path: str | PathLike[str], provenance: Mapping[str, str] | None = None
) -> None:
    """Write an optics file and the tables beside it, all or nothing.

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
        (folder / file.name).write_text(text, encoding="utf-8")
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
    """Return the fields of the file, and the tables beside it."""
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
        "focus_distance_m": _float(whole.focus_distance_m),
        "blur": blur,
        "relative_illumination": light and _points(light.field) | {"relative": _list(light.relative)},
        "distortion": curve and _points(curve.field) | {"percent": _list(100 * (curve.ratio - 1))},
        "lateral_color": color and _lateral_color(color),
        "veiling_glare": veil
        and _given({"fraction": float(veil.fraction), "spread_mm": veil.spread_m and float(veil.spread_m * 1e3)}),
    }
    return _given(fields), tables


def _given(fields: Fields) -> Fields:
    """Return the fields that are not None."""
    return {name: value for name, value in fields.items() if value is not None}


def _float(value: float | None) -> float | None:
    return None if value is None else float(value)


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
    """Return the section, and the tables that it names."""
    if type(blur) is Wavefront:
        return _wavefront(blur, stem)
    if type(blur) is OtfTable:
        otf, name = blur, f"{stem}.otf.csv"
        return {"kind": "otf", "file": name, "beyond": otf.beyond}, {name: lambda path: write_otf(otf, path)}
    if type(blur) is PsfTable:
        psf, name = blur, f"{stem}.psf.npz"
        section = {"kind": "psf", "file": name, "normalise": bool(psf.normalise)}
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
