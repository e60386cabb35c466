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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from photosite.color.spectrum import Spectrum
from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.atomic import atomic_folder
from photosite.files.yaml import LARGEST_BYTES, dump_yaml, line_of, read_yaml
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import LateralColor, combined_mapping
from photosite.optics.field_points import FieldPoints
from photosite.optics.io.npz import write_amplitude, write_design
from photosite.optics.io.parser import Parser
from photosite.optics.io.sections import KINDS, OpticsModel, Provenance, Read
from photosite.optics.io.tables import write_otf, write_psf
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.protocols import Blur
from photosite.optics.pupil import Pupil
from photosite.optics.tables import OtfTable, PsfTable
from photosite.optics.wavefront import Wavefront

VERSION_KEY = "photosite_optics"
SUFFIXES = (".yaml", ".yml")
Fields = dict[str, Any]
Tables = dict[str, Callable[[Path], None]]
"""Files beside the optics file: name -> writer."""


def read_optics(path: Path, read: Read) -> Lens:
    """Return the lens of an optics file.

    Parameters
    ----------
    path
        The file.
    read
        Reader of the files that it names.

    Raises
    ------
    FileError
        If the file is missing or does not describe a lens, or a file that it names is invalid; with the line.
    """
    data = read_yaml(path, "an optics file")
    if not isinstance(data, dict) or data.get(VERSION_KEY) != 1:
        line = line_of(data, VERSION_KEY)
        raise FileError(path, f"does not describe a lens: it has no '{VERSION_KEY}: 1'", line)
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
    path
        The file that holds them, for messages.
    read
        Reader of the files that they name.
    section
        Section of that file, if they are not at its top level.

    Returns
    -------
    Lens or DiffractionLimited
        A `DiffractionLimited` if that can represent all fields: options of `photosite simulate` may then change it.

    Raises
    ------
    FileError
        As `read_optics`.
    """
    parser = Parser(Path(path), data, section)
    model = parser.validated(OpticsModel, data)
    base = parser.built(  # the model has checked the other fields
        "transmittance",
        lambda: DiffractionLimited(model.f_number, model.focal_length_mm, model.transmittance.build(), model.falloff),
    )
    blur = _blur(parser, read) if model.blur is not None else None
    illumination = distortion = lateral = glare = None
    if (light := model.relative_illumination) is not None:
        illumination = parser.built("relative_illumination", lambda: light.build(read))
    if (curve := model.distortion) is not None:
        distortion, lateral = parser.built("distortion", lambda: curve.build(read, model.focal_length_mm))
    if (color := model.lateral_color) is not None:
        if lateral is not None:
            clash = InputError("lateral_color", expected="omitted: the listing of distortion has it")
            raise parser.located(clash, ("lateral_color",))
        lateral = parser.built("lateral_color", color.build)
    if (veil := model.veiling_glare) is not None:
        glare = parser.built("veiling_glare", veil.build)
    # Tables that fold back together are rejected here rather than on the first frame.
    key = "lateral_color" if model.lateral_color is not None else "distortion"
    parser.built(key, lambda: combined_mapping(distortion, lateral, model.focal_length_mm * 1e-3))
    lens = parser.built(
        "falloff" if illumination is not None and model.falloff != "none" else "focus_distance_m",
        lambda: Lens(base, blur, model.focus_distance_m, illumination, distortion, lateral, glare, model.name),
    )
    more = (blur, model.focus_distance_m, illumination, distortion, lateral, glare, model.name)
    return base if all(part is None for part in more) else lens


def _blur(parser: Parser, read: Read) -> Blur | None:
    """Return the blur of the section of its kind."""
    section = parser.data["blur"]
    kind = section.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        hint = did_you_mean(str(kind), KINDS)
        raise parser.located(InputError("kind", value=kind, expected="a kind of blur", hint=hint), ("blur",))
    model: Any = parser.validated(KINDS[kind], section, ("blur",))
    blur: Blur | None = parser.built("blur", lambda: model.build(read))
    return blur


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

    Examples
    --------
    >>> import tempfile
    >>> lens = Lens(DiffractionLimited(2.8, 50), Wavefront({8: 50.0}), focus_distance_m=2.0, name="mine")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_optics(lens, f"{folder}/mine.optics.yaml", {"source": "made up"})
    ...     print(Path(folder, "mine.optics.yaml").read_text(), end="")
    photosite_optics: 1
    name: mine
    f_number: 2.8
    focal_length_mm: 50.0
    transmittance: 1.0
    focus_distance_m: 2.0
    blur:
      kind: wavefront
      zernike:
        8: 50.0
    provenance:
      source: made up
    """
    file = Path(path)
    fields, tables = _described(lens, file.stem)
    if provenance is not None:
        fields["provenance"] = _provenance(provenance)
    text = dump_yaml(fields)
    if len(text.encode()) > LARGEST_BYTES:
        raise InputError(f"the optics file would exceed {LARGEST_BYTES >> 20} MiB", hint="Thin the tables of the lens")
    if file.suffix.lower() not in SUFFIXES:
        raise FileError(
            file, "the name of an optics file", value=file.suffix, expected="one that ends in .yaml or .yml"
        )
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
    base, fields = whole.base, Fields(photosite_optics=1)
    if whole.name is not None:
        fields["name"] = str(whole.name)
    fields |= {"f_number": float(base.f_number), "focal_length_mm": float(base.focal_length_mm)}
    passed = base.transmittance
    if isinstance(passed, Spectrum):
        fields["transmittance"] = {
            "wavelength_nm": _list(passed.wavelength_nm),
            "transmittance": _list(passed.values),
        }
    else:
        fields["transmittance"] = float(passed)
    if base.falloff != "none":
        fields["falloff"] = base.falloff
    if whole.focus_distance_m is not None:
        fields["focus_distance_m"] = float(whole.focus_distance_m)
    tables: Tables = {}
    if whole.blur is not None:
        fields["blur"], tables = _blur_section(whole.blur, stem)
    if (light := whole.illumination) is not None:
        fields["relative_illumination"] = _points(light.field) | {"relative": _list(light.relative)}
    if (curve := whole.distortion) is not None:
        fields["distortion"] = _points(curve.field) | {"percent": _list(100 * (curve.ratio - 1))}
    if whole.lateral_color is not None:
        fields["lateral_color"] = _lateral_color(whole.lateral_color)
    if (veil := whole.veiling_glare) is not None:
        fields["veiling_glare"] = {"fraction": float(veil.fraction)}
        if veil.spread_m is not None:
            fields["veiling_glare"]["spread_mm"] = float(veil.spread_m * 1e3)
    return fields, tables


def _list(values: ArrayLike) -> list[Any]:
    found: list[Any] = np.asarray(values, np.float64).tolist()
    return found


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
        fields: Fields = Provenance.model_validate(dict(given)).model_dump(exclude_none=True)
    except (ValidationError, TypeError, ValueError):
        expected = f"texts by name, of {', '.join(Provenance.model_fields)}"
        raise InputError("provenance", value=given, expected=expected) from None
    return fields


def _blur_section(blur: object, stem: str) -> tuple[Fields, Tables]:
    """Return the section, and the tables that it names."""
    match blur:
        case Wavefront() if type(blur) is Wavefront:
            return _wavefront(blur, stem)
        case OtfTable() if type(blur) is OtfTable:
            name = f"{stem}.otf.csv"
            return {"kind": "otf", "file": name, "beyond": blur.beyond}, {name: lambda path: write_otf(blur, path)}
        case PsfTable() if type(blur) is PsfTable:
            name = f"{stem}.psf.npz"
            section = {"kind": "psf", "file": name, "normalise": bool(blur.normalise)}
            return section, {name: lambda path: write_psf(blur, path)}
        case LensDesign() if type(blur) is LensDesign:
            name = f"{stem}.design.npz"
            options = {"symmetric": bool(blur.symmetric), "tolerance": float(blur.tolerance), "rank": blur.rank}
            options |= {"detail_um": blur.detail_um, "nodes": blur.nodes}
            section = {"kind": "lens_design", "source": name}
            section |= {key: value for key, value in options.items() if value is not None}
            return section, {name: lambda path: write_design(blur, path)}
    raise InputError("blur", value=type(blur), expected="a Wavefront, OtfTable, PsfTable or LensDesign, to be written")


def _wavefront(blur: Wavefront, stem: str) -> tuple[Fields, Tables]:
    default = Wavefront()
    section: Fields = {"kind": "wavefront", "zernike": _coefficients(blur)}
    for name in ("index", "unit", "reference_nm", "norm", "defocus_um"):
        if (value := getattr(blur, name)) != getattr(default, name):
            section[name] = value if isinstance(value, str) else float(value)
    pupil, tables = _pupil(blur.pupil, stem)
    if pupil:
        section["pupil"] = pupil
    if (focus := blur.chromatic_focus) is not None:
        section["chromatic_focus"] = {"wavelength_nm": _list(focus.wavelength_nm), "shift_um": _list(focus.values)}
    return section, tables


def _coefficients(blur: Wavefront) -> dict[int | str, float]:
    return {
        f"{key[0]},{key[1]}" if isinstance(key, tuple | list) else int(key): float(value)
        for key, value in blur.coefficients.items()
    }


def _pupil(pupil: Pupil, stem: str) -> tuple[Fields, Tables]:
    """Return the fields of a pupil that differ from an open circle."""
    section: Fields = {}
    for name in ("obscuration", "blades", "rotation_deg", "roundness", "vanes", "vane_width", "vane_rotation_deg"):
        if value := getattr(pupil, name):
            section[name] = int(value) if name in ("blades", "vanes") else float(value)
    amplitude = pupil.amplitude
    if amplitude is None:
        return section, {}
    section["amplitude"] = f"{stem}.pupil.npz"
    return section, {section["amplitude"]: lambda path: write_amplitude(amplitude, path)}
