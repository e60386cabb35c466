"""Lens prescriptions: Zemax (.zmx), CODE V (.seq) and plain tables, read by rayoptics (extra `lenses`).

A plain table has a line for each surface from the front to the last one before the sensor, and comments that state the
rest::

    # f_number: 4
    # fields_deg: 0, 14, 20
    # wavelengths_nm: 486, 588, 656
    radius_mm, thickness_mm, glass, semi_diameter_mm, conic, stop
    22.014, 3.259, N-SK16 SCHOTT, 9.5, 0, 0

Radius 0 or inf is a plane. The glass is empty for air, a name with its catalogue, or `1.6204/60.3`: index and Abbe
number at the d line; an index alone is the same at all wavelengths.
"""

from __future__ import annotations

import contextlib
import io
import logging
import math
import shutil
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from photosite.errors import FileError, PhotositeWarning, message_of, printable
from photosite.files.small_files import read_small
from photosite.files.text_table import TextTable, parse_number, read_table
from photosite.values.shown import Shown

_LARGEST_BYTES = 1 << 22
_COLUMNS = ("radius_mm", "thickness_mm", "glass", "semi_diameter_mm", "conic", "stop")
_REQUIRED = ("radius_mm", "thickness_mm", "glass")
SUFFIXES = (".zmx", ".seq", ".csv", ".txt")


@dataclass(frozen=True, eq=False)
class Prescription(Shown):
    """A lens that can be traced.

    Parameters
    ----------
    path
        The file.
    model
        The `OpticalModel` of rayoptics.
    """

    path: Path
    model: Any


def read_prescription(path: Path) -> Prescription:
    """Read a prescription.

    Raises
    ------
    FileError
        If rayoptics is missing, the file is missing or invalid, a glass is in no catalogue, or the lens has what cannot
        be traced: mirrors, tilts, diffractive surfaces, or an object at a finite distance.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileError(path, "suffix", value=suffix, expected=f"of a prescription: {', '.join(SUFFIXES)}")
    read_small(path, "a lens prescription", _LARGEST_BYTES)
    # Beside a file, the library writes templates for unknown glasses, and evaluates a .smx file as Python.
    with _quiet(path), _local_catalogues(), TemporaryDirectory() as folder:
        copy = Path(folder, path.name)
        shutil.copyfile(path, copy)
        if suffix == ".zmx":
            from rayoptics.zemax import zmxread

            model, info = zmxread.read_lens_file(copy)
        elif suffix == ".seq":
            from rayoptics.codev import cmdproc

            model, info = cmdproc.read_lens(copy)
        else:
            model, info = _from_table(read_table(path, "a lens prescription", _LARGEST_BYTES)), None
    _check(path, model, info)
    return Prescription(path, model)


@contextmanager
def _quiet(path: Path) -> Iterator[None]:
    """Turn what the library prints, logs and raises into one error."""
    level = logging.root.manager.disable
    try:
        logging.disable(logging.CRITICAL)
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except FileError:
        raise
    except ImportError as error:
        if not (error.name or "").startswith(("rayoptics", "opticalglass")):
            raise
        hint = "Run pip install '.[lenses]' in the clone"
        raise FileError(path, "tracing a lens needs rayoptics, which is missing", hint=hint) from None
    except Exception as error:  # the library's readers raise many types for a damaged file
        raise FileError(path, f"cannot be read as a lens prescription: {message_of(error)}") from None
    finally:
        logging.disable(level)


@contextmanager
def _local_catalogues() -> Iterator[None]:
    """Look glasses up in the catalogues on disk only: the library asks refractiveindex.info for `rindexinfo`."""
    from opticalglass import glassfactory
    from opticalglass.glasserror import GlassError, GlassNotFoundError

    original = glassfactory.create_glass

    def create_glass(*names: Any) -> Any:
        name, catalogue = names if len(names) == 2 else names[0].split(",")
        online = catalogue.strip() == _ONLINE if isinstance(catalogue, str) else _ONLINE in catalogue
        try:
            if online:
                raise GlassNotFoundError(catalogue, name)
            return original(name, catalogue)
        except GlassError:  # for an unknown catalogue, the library's readers expect no error
            raise GlassNotFoundError(catalogue, name) from None

    glassfactory.create_glass = create_glass
    try:
        yield
    finally:
        glassfactory.create_glass = original


_ONLINE = "rindexinfo"


def _check(path: Path, model: Any, info: Any) -> None:
    """Raise `FileError` for what was not understood, or is not traced; warn of glasses that were replaced."""
    if model is None or len(model["seq_model"].ifcs) < 3:
        raise FileError(path, "is not a lens prescription: it has no surfaces")
    _, glasses = info if isinstance(info, tuple) and len(info) == 2 else ({}, {})
    # The reader of .seq files keeps glasses of the file itself as not found.
    used = {str(gap.medium.name()) for gap in model["seq_model"].gaps}
    unknown = [name for name, found in glasses.items() if not isinstance(found, tuple) and f"not {name}" in used]
    if unknown:
        named = ", ".join(printable(name) for name in sorted(unknown))
        raise FileError(path, f"has a glass that is in no catalogue: {named[:80]}", hint=_OTHER_GLASS)
    for name, found in glasses.items():
        if isinstance(found, tuple) and found[0].casefold() != name.casefold():
            problem = f"{path}: the glass {name} is in no catalogue; {' of '.join(found)} is traced in its place"
            warnings.warn(PhotositeWarning(problem), stacklevel=4)
    sequence = model["seq_model"]
    for number, surface in enumerate(sequence.ifcs):
        place = f"surface {number}"
        if surface.interact_mode == "reflect":
            raise FileError(path, "has a mirror; lenses are traced only", where=place)
        if getattr(surface, "decenter", None) is not None:
            raise FileError(path, "is tilted or decentered; rotationally symmetric lenses are traced", where=place)
        if getattr(surface, "phase_element", None) is not None:
            raise FileError(path, "has a diffractive surface, which is not supported", where=place)
    if not sequence.gaps[0].thi > _FAR_MM:
        hint = "Set the object distance to infinity, and refocus"
        raise FileError(
            path, f"has an object at {sequence.gaps[0].thi:g} mm; lenses are traced for far objects", hint=hint
        )


_FAR_MM = 1e7
_OTHER_GLASS = "Replace it by one of a catalogue, or by index and Abbe number"


def _from_table(table: TextTable) -> Any:
    """Return the model of a plain table."""
    from rayoptics.optical.opticalmodel import OpticalModel
    from rayoptics.raytr.opticalspec import FieldSpec, PupilSpec, WvlSpec

    names = tuple("_".join(cell.lower().split()) for cell in table.heading or ())
    if unknown := next((name for name in names if name not in _COLUMNS), None):
        raise table.error(f"unknown column '{unknown}'; columns are {', '.join(_COLUMNS)}", table.heading_line)
    if lacking := next((name for name in _REQUIRED if name not in names), None):
        raise table.error(f"it needs the column '{lacking}'", table.heading_line)
    fields = _stated(table, "fields_deg", (0.0,))
    (f_number,) = _stated(table, "f_number", None)
    wavelengths = _stated(table, "wavelengths_nm", (587.5618,))
    model = OpticalModel()
    sequence, spec = model["seq_model"], model["optical_spec"]
    spec["pupil"] = PupilSpec(spec, key=["image", "f/#"], value=f_number)
    spec["fov"] = FieldSpec(spec, key=["object", "angle"], value=max(fields), flds=list(fields), is_relative=False)
    middle = len(wavelengths) // 2
    spec["wvls"] = WvlSpec([(wavelength, 1.0) for wavelength in wavelengths], ref_wl=middle)
    model.radius_mode = True
    sequence.gaps[0].thi = 1e10
    sequence.do_apertures = False
    stop: int | None = None
    for row, line in zip(table.rows, table.lines, strict=True):
        cells = dict(zip(names, row, strict=False))
        value = {name: _cell(table, cells, name, line) for name in _COLUMNS if name != "glass"}
        radius = 0.0 if not math.isfinite(value["radius_mm"]) else value["radius_mm"]
        medium = _medium(table, cells.get("glass", ""), line)
        semi = value["semi_diameter_mm"]
        sequence.add_surface([radius, value["thickness_mm"], *medium])
        if semi > 0:
            from rayoptics.elem.surface import Circular

            sequence.ifcs[sequence.cur_surface].clear_apertures.append(Circular(radius=semi))
        if value["conic"]:
            from rayoptics.elem.profiles import Conic

            surface = sequence.ifcs[sequence.cur_surface]
            surface.profile = Conic(c=surface.profile.cv, cc=value["conic"])
        if value["stop"]:
            stop = sequence.cur_surface
            sequence.set_stop()
    if stop is None:
        raise table.error("no surface is the stop", hint="Write 1 in the column stop of one surface")
    model.update_model()
    return model


def _cell(table: TextTable, cells: Mapping[str, str], name: str, line: int) -> float:
    text = cells.get(name, "").strip()
    if text.lower() in ("", "inf", "infinity"):
        return 0.0
    value = parse_number(text, decimal_comma=table.decimal_comma)
    if value is None:
        raise table.error(f"'{name}' is not a number: {text[:40]!r}", line)
    return value


def _medium(table: TextTable, text: str, line: int) -> tuple[Any, ...]:
    """Return what rayoptics takes for a glass."""
    name = text.strip()
    if name.lower() in ("", "air"):
        return ()
    index, _, abbe = name.partition("/")
    if not abbe and (n := parse_number(index)) is not None:
        return (n,)
    if abbe and (n := parse_number(index)) is not None and (v := parse_number(abbe)) is not None:
        return n, v
    from opticalglass.glassfactory import create_glass

    words = name.replace(",", " ").split()
    try:
        create_glass(words[0], words[1] if len(words) > 1 else "Schott")
    except Exception:  # opticalglass raises its own errors and those of its catalogues
        hint = "Write name and catalogue, such as N-BK7 Schott, or index and Abbe number, 1.5168/64.17"
        raise table.error(f"the glass '{name[:40]}' is in no catalogue", line, hint=hint) from None
    return words[0], words[1] if len(words) > 1 else "Schott"


def _stated(table: TextTable, name: str, default: tuple[float, ...] | None) -> tuple[float, ...]:
    text = table.stated.get(name)
    if text is None and default is not None:
        return default
    values = [parse_number(word) for word in (text or "").replace(",", " ").split()]
    numbers = tuple(value for value in values if value is not None)
    if not numbers or len(numbers) < len(values):
        raise table.error(f"it needs numbers in the comment '# {name}: ...'")
    return numbers
