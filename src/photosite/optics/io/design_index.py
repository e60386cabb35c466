"""Indices of PSF files: a YAML file that lists files and states what they do not.

photosite_lens_design: 1
program: zemax              # or grid: bare grids of numbers
axes: image                 # of samples and fields: image, as computed (inverted); upright, as the frame
first_row: top              # of the samples: top (y up) or bottom
symmetric: true             # rotationally; the fields lie along one radius
files:
  - {file: axis-450.txt, wavelength_nm: 450, field_deg: [0, 0], spacing_um: 0.25}
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from photosite.errors import FileError, InputError
from photosite.files.yaml import check_keys, line_of, read_yaml
from photosite.optics.checks import camera_wavelengths
from photosite.optics.io import zemax
from photosite.optics.io.psf_listing import Axes, FirstRow, Layout, PsfListing, lens_design_of, read_grid
from photosite.optics.lens_design import LensDesign
from photosite.optics.sampled_psf import check_spacing

VERSION_KEY = "photosite_lens_design"
_PROGRAMS = {"zemax": zemax.read_psf, "grid": read_grid}
_OPTIONS: dict[str, tuple[type, str]] = {
    "tolerance": (float, "a number between 0 and 1"),
    "rank": (int, "a whole number"),
    "detail_um": (float, "a number above 0"),
    "nodes": (int, "a whole number"),
    "symmetric": (bool, "true or false"),
}
_KEYS = (VERSION_KEY, "program", "axes", "first_row", *_OPTIONS, "files", "provenance")
_FILE_KEYS = ("file", "wavelength_nm", "field_deg", "field_mm", "spacing_um", "origin")
_SUFFIXES = (".txt", ".dat", ".psf")


def read_folder(path: Path, first_row: FirstRow = "top", **options: Any) -> LensDesign:
    """Read a folder of Zemax listings that each state wavelength, field and spacing.

    Parameters
    ----------
    path
        The folder; its files end in .txt, .dat or .psf.
    first_row
        See `Layout`.
    **options
        Options of `LensDesign`.

    Raises
    ------
    FileError
        If there is no listing of a PSF, or one is wrong.
    """
    listings = [zemax.read_psf(file) for file in sorted(path.iterdir()) if zemax.is_psf_file(file, _SUFFIXES)]
    if not listings:
        raise FileError(path, "holds no listing of a PSF (.txt, .dat or .psf)", hint="Name an index, a YAML file")
    return lens_design_of(path, listings, Layout(first_row=first_row), options)


def read_index(path: Path, first_row: FirstRow | None = None, **options: Any) -> LensDesign:
    """Read an index; the arguments override its entries.

    Raises
    ------
    FileError
        If the index or a file that it names is wrong, or a PSF is missing.
    """
    data = read_yaml(path, "an index of PSF files")
    if not isinstance(data, dict) or data.get(VERSION_KEY) != 1:
        raise FileError(path, f"is not an index of PSF files: it has no '{VERSION_KEY}: 1'")
    check_keys(path, data, _KEYS, "an index of PSF files")
    layout = Layout(
        _choice(path, data, "axes", get_args(Axes)), first_row or _choice(path, data, "first_row", get_args(FirstRow))
    )
    read = _PROGRAMS[_choice(path, data, "program", tuple(_PROGRAMS))]
    entries = data.get("files")
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        raise FileError(
            path, "files", line_of(data, "files"), expected="a list of {file: ..., wavelength_nm: ..., ...}"
        )
    listings = [_entry(path, entries, index, read) for index in range(len(entries))]
    return lens_design_of(path, listings, layout, {**_options(path, data), **options})


def _options(path: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    given = {key: data[key] for key in _OPTIONS if data.get(key) is not None}
    for key, value in given.items():
        kind, expected = _OPTIONS[key]
        fits = isinstance(value, int | float) if kind is float else isinstance(value, kind)
        if not fits or (isinstance(value, bool) and kind is not bool):
            raise FileError(path, key, line_of(data, key), value=value, expected=expected)
    return given


def _choice(path: Path, data: Mapping[str, Any], key: str, known: tuple[str, ...]) -> Any:
    value = data.get(key, known[0])
    if value not in known:
        raise FileError(path, key, line_of(data, key), value=value, expected=" or ".join(known))
    return value


def _entry(path: Path, entries: Sequence[Any], index: int, read: Callable[[Path], PsfListing]) -> PsfListing:
    entry, line = entries[index], line_of(entries, index)
    if not isinstance(entry, Mapping) or not isinstance(entry.get("file"), str):
        raise FileError(path, "an entry of files", line, expected="{file: name, ...}")
    check_keys(path, entry, _FILE_KEYS, "an entry of 'files'")
    listing = read(path.parent / str(entry["file"]))
    changes: dict[str, Any] = {}
    for key, check in (("wavelength_nm", camera_wavelengths), ("spacing_um", check_spacing)):
        if entry.get(key) is not None:
            changes[key] = _checked(path, entry[key], key, line, check)
    for key in ("field_deg", "field_mm"):
        if entry.get(key) is not None:
            changes["field"] = _pair(path, entry[key], key, line)
            changes["field_unit"] = key.removeprefix("field_")
    if entry.get("origin") is not None:
        row, col = _pair(path, entry["origin"], "origin", line)
        rows, cols = listing.samples.shape
        if not (1 <= row <= rows and 1 <= col <= cols):
            expected = f"within the {rows} x {cols} samples, from 1"
            raise FileError(path, "origin", line, value=[row, col], expected=expected)
        changes["origin"] = (row - 1, col - 1)
    return replace(listing, **changes)


def _checked(path: Path, value: Any, key: str, line: int | None, check: Callable[[Any], Any]) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise FileError(path, key, line, value=value, expected="a number above 0")
    try:
        check([value] if key == "wavelength_nm" else value)
    except InputError as error:
        raise error.in_file(path, line) from None
    return float(value)


def _pair(path: Path, value: Any, key: str, line: int | None) -> tuple[float, float]:
    numbers = isinstance(value, list) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
    if not numbers or len(value) != 2 or not all(map(math.isfinite, value)):
        order = "[row, column], from 1" if key == "origin" else "[x, y]"
        raise FileError(path, key, line, value=str(value), expected=f"two finite numbers, {order}")
    return float(value[0]), float(value[1])
