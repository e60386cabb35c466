"""Lenses to optics files, which `photosite.optics.io.optics_file.load_optics` reads back as the same lens."""

from __future__ import annotations

import csv
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
from photosite.errors import FileError, InputError
from photosite.files.atomic import atomic_folder
from photosite.files.yaml import LARGEST_BYTES, dump_yaml, read_yaml
from photosite.optics.compound import Lens
from photosite.optics.distortion import LateralColor
from photosite.optics.io.file_model import Provenance
from photosite.optics.io.npz import write_amplitude, write_design
from photosite.optics.io.table_files import PLANE, RADIAL
from photosite.optics.lens import DiffractionLimited
from photosite.optics.lens_design import LensDesign
from photosite.optics.pupil import Pupil
from photosite.optics.radial_table import FieldPoints
from photosite.optics.tables import OtfTable, PsfTable
from photosite.optics.wavefront import Wavefront

Fields = dict[str, Any]
Sides = dict[str, Callable[[Path], None]]
"""Files beside the optics file: what ends their names, and what writes each."""

_SUFFIXES = (".yaml", ".yml")


def write_optics(
    lens: Lens | DiffractionLimited, path: str | PathLike[str], provenance: Mapping[str, str] | None = None
) -> None:
    """Write an optics file, and the tables that do not fit in it beside it; all of them or nothing.

    Parameters
    ----------
    lens
        The lens. Tables of its blur get files of their own: of mine.optics.yaml mine.optics.otf.csv, and .psf.npz,
        .design.npz and .pupil.npz likewise. Those of a lens that stood in the file before are removed.
    path
        A name that ends in .yaml or .yml.
    provenance
        Where its numbers come from: texts `source`, `license`, `created`, `notes`. A lens read from a file does not
        carry those of that file.

    Raises
    ------
    InputError
        If something of the lens has no place in such a file, as a blur of one's own; or the provenance is none.
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from photosite.optics.io.optics_file import load_optics
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
    fields, sides = _described(lens, file.stem)
    if provenance is not None:
        fields["provenance"] = _provenance(provenance)
    text = dump_yaml(fields)
    if len(text.encode()) > LARGEST_BYTES:
        raise InputError(f"this lens's tables make an optics file of more than {LARGEST_BYTES >> 20} MiB: thin them")
    if file.suffix.lower() not in _SUFFIXES:
        raise FileError(file, f"cannot be written: an optics file's name ends in {' or '.join(_SUFFIXES)}")
    for name in (file.name, *sides):
        place = file.with_name(name)
        if os.path.exists(place) and not os.path.isfile(place):
            raise FileError(place, "cannot be written: it is a folder or a device, not a file")
    if not file.absolute().parent.is_dir():
        raise FileError(file, f"cannot be written: there is no folder {file.parent}")
    before = _sides_of(file)
    with atomic_folder(file.absolute().parent, add=True) as folder:
        for name, write in sides.items():
            write(folder / name)
        (folder / file.name).write_text(text, encoding="utf-8")
    for name in before - set(sides):
        with suppress(OSError):  # a table that is no longer named does no harm
            file.with_name(name).unlink()


def _sides_of(file: Path) -> set[str]:
    """Names, as `write_optics` gives them, of the tables of a lens that was written there before; none of others'."""
    try:
        blur = read_yaml(file, "an optics file")["blur"]
        named = {str(blur.get("file")), str(blur.get("source")), str(blur.get("pupil", {}).get("amplitude"))}
    except (FileError, LookupError, TypeError, AttributeError):
        return set()
    return named & {f"{file.stem}.{kind}" for kind in ("otf.csv", "psf.npz", "design.npz", "pupil.npz")}


def _described(lens: Lens | DiffractionLimited, stem: str) -> tuple[Fields, Sides]:
    """The fields of the file, and the files beside it."""
    if type(lens) not in (Lens, DiffractionLimited):
        raise InputError(f"an optics file describes a Lens or a DiffractionLimited; this is a {type(lens).__name__}")
    whole = lens if isinstance(lens, Lens) else Lens(lens)
    base, fields = whole.base, Fields(photosite_optics=1)
    if whole.name is not None:
        fields["name"] = str(whole.name)
    fields |= {"f_number": float(base.f_number), "focal_length_mm": float(base.focal_length_mm)}
    fields["transmittance"] = _transmittance(base.transmittance)
    if base.falloff != "none":
        fields["falloff"] = base.falloff
    if whole.focus_distance_m is not None:
        fields["focus_distance_m"] = float(whole.focus_distance_m)
    sides: Sides = {}
    if whole.blur is not None:
        fields["blur"], sides = _blur(whole.blur, stem)
    if (light := whole.illumination) is not None:
        fields["relative_illumination"] = _places(light.field) | {"relative": _list(light.relative)}
    if (curve := whole.distortion) is not None:
        fields["distortion"] = _places(curve.field) | {"percent": _list(100 * (curve.ratio - 1))}
    if whole.lateral_color is not None:
        fields["lateral_color"] = _lateral_color(whole.lateral_color)
    if (veil := whole.veiling_glare) is not None:
        fields["veiling_glare"] = {"fraction": float(veil.fraction)}
        if veil.spread_m is not None:
            fields["veiling_glare"]["spread_mm"] = float(veil.spread_m * 1e3)
    return fields, sides


def _list(values: ArrayLike) -> list[Any]:
    found: list[Any] = np.asarray(values, np.float64).tolist()
    return found


def _transmittance(value: float | Spectrum) -> float | Fields:
    if isinstance(value, Spectrum):
        return {"wavelength_nm": _list(value.wavelength_nm), "transmittance": _list(value.values)}
    return float(value)


def _places(points: FieldPoints) -> Fields:
    if points.height_mm is not None:
        return {"height_mm": _list(points.height_mm)}
    assert points.angle_deg is not None
    return {"field_deg": _list(points.angle_deg)}


def _lateral_color(color: LateralColor) -> Fields:
    waves = {"wavelength_nm": _list(color.wavelength_nm)}
    if not color.everywhere:
        return waves | _places(color.field) | {"shift_um": _list(color.shift_um)}
    height = color.field.height_mm
    if height is None or height.size != 1:
        raise InputError(
            "a lateral colour that goes on everywhere is a magnification of each wavelength in an optics file; this "
            "one has several places: leave 'everywhere' out, or use LateralColor.from_magnification"
        )
    return waves | {"magnification": _list(1 + color.shift_um[:, 0] / (1e3 * height[0]))}


def _provenance(said: Mapping[str, str]) -> Fields:
    try:
        told: Fields = Provenance.model_validate(dict(said)).model_dump(exclude_none=True)
    except (ValidationError, TypeError, ValueError):
        raise InputError(
            f"provenance is texts by name, of {', '.join(Provenance.model_fields)}; not {said!r:.80}"
        ) from None
    return told


def _blur(blur: object, stem: str) -> tuple[Fields, Sides]:
    """The section, and the files that it names."""
    match blur:
        case Wavefront() if type(blur) is Wavefront:
            return _wavefront(blur, stem)
        case OtfTable() if type(blur) is OtfTable:
            name = f"{stem}.otf.csv"
            return {"kind": "otf", "file": name, "beyond": blur.beyond}, {name: lambda path: _write_otf(blur, path)}
        case PsfTable() if type(blur) is PsfTable:
            name = f"{stem}.psf.npz"
            section = {"kind": "psf", "file": name, "normalise": bool(blur.normalise)}
            return section, {name: lambda path: _write_psf(blur, path)}
        case LensDesign() if type(blur) is LensDesign:
            name = f"{stem}.design.npz"
            said = {"symmetric": bool(blur.symmetric), "tolerance": float(blur.tolerance), "rank": blur.rank}
            said |= {"detail_um": blur.detail_um, "nodes": blur.nodes}
            section = {"kind": "lens_design", "source": name, **{k: v for k, v in said.items() if v is not None}}
            return section, {name: lambda path: write_design(blur, path)}
    raise InputError(
        f"a lens that is blurred by a {type(blur).__name__} cannot be written: an optics file knows Wavefront, "
        "OtfTable, PsfTable and LensDesign"
    )


def _wavefront(blur: Wavefront, stem: str) -> tuple[Fields, Sides]:
    plain = Wavefront()
    section: Fields = {"kind": "wavefront", "zernike": _coefficients(blur)}
    for name in ("index", "unit", "reference_nm", "norm", "defocus_um"):
        if (value := getattr(blur, name)) != getattr(plain, name):
            section[name] = value if isinstance(value, str) else float(value)
    pupil, sides = _pupil(blur.pupil, stem)
    if pupil:
        section["pupil"] = pupil
    if (focus := blur.chromatic_focus) is not None:
        section["chromatic_focus"] = {"wavelength_nm": _list(focus.wavelength_nm), "shift_um": _list(focus.values)}
    return section, sides


def _coefficients(blur: Wavefront) -> dict[int | str, float]:
    return {
        f"{key[0]},{key[1]}" if isinstance(key, tuple | list) else int(key): float(value)
        for key, value in blur.coefficients.items()
    }


def _pupil(pupil: Pupil, stem: str) -> tuple[Fields, Sides]:
    """What of a pupil is not that of an open circle."""
    section: Fields = {}
    for name in ("obscuration", "blades", "rotation_deg", "roundness", "vanes", "vane_width", "vane_rotation_deg"):
        if value := getattr(pupil, name):
            section[name] = int(value) if name in ("blades", "vanes") else float(value)
    amplitude = pupil.amplitude
    if amplitude is None:
        return section, {}
    section["amplitude"] = f"{stem}.pupil.npz"
    return section, {section["amplitude"]: lambda path: write_amplitude(amplitude, path)}


def _write_psf(table: PsfTable, path: Path) -> None:
    np.savez(path, psf=table.samples, spacing_um=float(table.spacing_um), wavelength_nm=table.wavelength_nm)


def _write_otf(table: OtfTable, path: Path) -> None:
    """CSV as `photosite.optics.io.table_files.read_otf_table` has it."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        write = csv.writer(stream).writerow
        waves, down, across = _list(table.wavelength_nm), _list(table.frequency_per_mm), table.fx_per_mm
        if across is None:
            write([RADIAL, *waves])
            for frequency, row in zip(down, np.real(table.values).T.tolist(), strict=True):
                write([frequency, *row])
            return
        write(PLANE)
        for k, i, j in np.ndindex(table.values.shape):
            value = complex(table.values[k, i, j])
            write([waves[k], down[i], float(across[j]), value.real, value.imag])
