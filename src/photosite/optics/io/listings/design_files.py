"""From many files of point spreads, one for each field point and wavelength, to a `LensDesign`.

A folder is read whole where each file says its wavelength, field and distance of samples, as Zemax's listings do. An
index, a YAML file beside them, lists files and says what they do not:

photosite_lens_design: 1
program: zemax              # or codev
axes: image                 # of samples and fields: image, as computed (inverted); upright, as the frame
first_row: top              # of the samples: top (y up) or bottom
symmetric: true             # rotationally; the fields lie along one radius
files:
  - {file: axis-450.txt, wavelength_nm: 450, field_deg: [0, 0], spacing_um: 0.25}
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.yaml import check_keys, line_of, read_yaml
from photosite.optics.io.listings import codev, zemax
from photosite.optics.io.listings.text import PsfListing, read_text
from photosite.optics.lens import camera_wavelengths
from photosite.optics.lens_design import TOLERANCE, LensDesign
from photosite.optics.sampled import check_spacing, light_radius, normalised, resampled

Array = NDArray[np.float64]
Axes = Literal["image", "upright"]
FirstRow = Literal["top", "bottom"]

VERSION_KEY = "photosite_lens_design"
_PROGRAMS = {"zemax": zemax.read_psf, "codev": codev.read_psf}
_KEYS = (
    VERSION_KEY,
    "program",
    "axes",
    "first_row",
    "symmetric",
    "tolerance",
    "rank",
    "detail_um",
    "nodes",
    "files",
    "provenance",
)
_FILE_KEYS = ("file", "wavelength_nm", "field_deg", "field_mm", "spacing_um", "origin")
_OPTIONS = ("tolerance", "rank", "detail_um", "nodes", "symmetric", "first_row")
_SUFFIXES = (".txt", ".dat", ".psf")
_KEPT = 0.999
"""Of each point spread's light: the square around it is kept, the faint rest of a large grid is left out."""
_LEAST_HALF = 8
_MOST_HALF = 512
_PLACES = 6
"""Digits after the point, in deg or mm, to which fields of different files are the same."""


@dataclass(frozen=True)
class Layout:
    """How a program's grids lie; the defaults are those of Zemax's listings.

    Parameters
    ----------
    axes
        "image": as on the image surface, which is turned by 180 degrees against the frame; "upright": as the frame.
    first_row
        Where the first row of samples lies, "top" or "bottom".
    """

    axes: Axes = "image"
    first_row: FirstRow = "top"

    def upright(self, listing: PsfListing) -> tuple[Array, tuple[float, float]]:
        """Samples and origin as the frame is, rows downwards."""
        samples, (row, col) = listing.samples, listing.origin
        rows, cols = samples.shape
        if self.first_row == "bottom":
            samples, row = samples[::-1], rows - 1 - row
        if self.axes == "image":
            samples, row, col = samples[::-1, ::-1], rows - 1 - row, cols - 1 - col
        return samples, (row, col)

    def place(self, listing: PsfListing) -> tuple[float, float]:
        """(y, x) of the field point, y down, upright; on image axes a positive angle's image lies at +y."""
        x, y = _told(listing, "field")
        down, right = (y, -x) if self.axes == "image" else (-y, x)
        return round(down, _PLACES) + 0.0, round(right, _PLACES) + 0.0


def read_lens_design(path: str | PathLike[str], **options: Any) -> LensDesign:
    """Lens-design point spreads from a folder of listings, or from an index.

    Parameters
    ----------
    path
        A folder of Zemax listings (.txt, .dat, .psf), a YAML file as this module's text shows, or the ISETPARMS.txt of
        a set that ISET's macros wrote (`photosite.optics.io.listings.ray_trace`).
    options
        `tolerance`, `rank`, `detail_um`, `nodes` and `symmetric` of `LensDesign`, and `first_row` of `Layout`; before
        those of an index.

    Raises
    ------
    FileError
        If a file is missing or wrong, says too little, or some wavelength of some field point is missing.
    InputError
        If there is no such option.
    """
    from photosite.optics.io.listings.ray_trace import read_ray_trace, set_of

    if unknown := [name for name in options if name not in _OPTIONS]:
        raise InputError(f"read_lens_design has no option '{unknown[0]}'; {did_you_mean(unknown[0], _OPTIONS)}")
    source = Path(path)
    if (parameters := set_of(source)) is not None:
        return read_ray_trace(parameters).point_spreads(**options)
    if source.is_dir():
        files = sorted(f for f in source.iterdir() if f.suffix.lower() in _SUFFIXES)
        listings = [zemax.read_psf(f) for f in files if zemax.is_psf_listing(read_text(f, "a listing")[:12])]
        if not listings:
            raise FileError(
                source, "holds no listing of a PSF (.txt, .dat or .psf); name an index, a YAML file, instead"
            )
        layout = Layout(first_row=options.pop("first_row", "top"))
        return design_of(source, listings, layout, options)
    data = read_yaml(source, "an index of lens-design files")
    if not isinstance(data, dict) or data.get(VERSION_KEY) != 1:
        raise FileError(source, f"is no index of lens-design files: expected '{VERSION_KEY}: 1' and 'files'")
    check_keys(source, data, _KEYS, "an index of lens-design files")
    first_row = options.pop("first_row", _word(source, data, "first_row", get_args(FirstRow)))
    layout = Layout(_word(source, data, "axes", get_args(Axes)), first_row)
    program = _word(source, data, "program", tuple(_PROGRAMS))
    entries = data.get("files")
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        raise FileError(source, "'files' is a list of {file: ..., wavelength_nm: ..., ...}", line_of(data, "files"))
    listings = [_entry(source, entries, index, program) for index in range(len(entries))]
    return design_of(source, listings, layout, {**_said(source, data), **options})


def _said(path: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    """What an index says of the sum."""
    kinds: dict[str, tuple[type, str]] = {
        "tolerance": (float, "a number between 0 and 1"),
        "rank": (int, "a whole number"),
        "detail_um": (float, "a number above 0"),
        "nodes": (int, "a whole number"),
        "symmetric": (bool, "true or false"),
    }
    said = {key: data[key] for key in kinds if data.get(key) is not None}
    for key, value in said.items():
        kind, what = kinds[key]
        fits = isinstance(value, int | float) if kind is float else isinstance(value, kind)
        if not fits or (isinstance(value, bool) and kind is not bool):
            raise FileError(path, f"{key} is {what}, not {value!r:.40}", line_of(data, key))
    return said


def _word(path: Path, data: Mapping[str, Any], key: str, known: tuple[str, ...]) -> Any:
    value = data.get(key, known[0])
    if value not in known:
        raise FileError(path, f"{key} is {' or '.join(known)}, not {value!r:.40}", line_of(data, key))
    return value


def _entry(path: Path, entries: Sequence[Any], index: int, program: str) -> PsfListing:
    entry, line = entries[index], line_of(entries, index)
    if not isinstance(entry, Mapping) or not isinstance(entry.get("file"), str):
        raise FileError(path, "an entry of 'files' is {file: name, ...}", line)
    check_keys(path, entry, _FILE_KEYS, "an entry of 'files'")
    listing = _PROGRAMS[program](path.parent / str(entry["file"]))
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
            raise FileError(path, f"origin [{row:g}, {col:g}] lies outside the {rows} x {cols} samples, from 1", line)
        changes["origin"] = (row - 1, col - 1)
    return replace(listing, **changes)


def _checked(path: Path, value: Any, key: str, line: int | None, check: Callable[[Any], Any]) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise FileError(path, f"{key} is a number above 0, not {value!r:.40}", line)
    try:
        check([value] if key == "wavelength_nm" else value)
    except InputError as error:
        raise FileError(path, str(error), line) from None
    return float(value)


def _pair(path: Path, value: Any, key: str, line: int | None) -> tuple[float, float]:
    numbers = isinstance(value, list) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
    if not numbers or len(value) != 2 or not all(map(math.isfinite, value)):
        order = "[row, column], from 1" if key == "origin" else "[x, y]"
        raise FileError(path, f"{key} is two finite numbers, {order}, not {value!s:.40}", line)
    return float(value[0]), float(value[1])


def _told(listing: PsfListing, name: Literal["wavelength_nm", "spacing_um", "field"]) -> Any:
    """What the listing, or the index for it, says."""
    if (value := getattr(listing, name)) is None:
        key = "field_deg or field_mm" if name == "field" else name
        raise FileError(listing.path, f"does not say its {key}; give it in an index, a YAML file")
    return value


def design_of(source: Path, listings: Sequence[PsfListing], layout: Layout, options: Mapping[str, Any]) -> LensDesign:
    """The design of many listings.

    Parameters
    ----------
    source
        The folder or file that names them, for messages.
    listings
        Of every field point and wavelength, in any order.
    layout
        How their grids lie.
    options
        Of `LensDesign`.

    Raises
    ------
    FileError
        As `read_lens_design`.
    """
    for listing in listings:
        try:
            camera_wavelengths([_told(listing, "wavelength_nm")])
            check_spacing(_told(listing, "spacing_um"))
        except InputError as error:
            raise FileError(listing.path, str(error)) from None
        _told(listing, "field")
    unit: Literal["deg", "mm"] = "deg" if listings[0].field_unit == "deg" else "mm"
    if any(listing.field_unit != unit for listing in listings):
        raise FileError(source, "has fields in degrees and in mm; give all in the same unit, in an index")
    places = sorted({layout.place(listing) for listing in listings}, key=lambda p: (np.hypot(*p), p))
    waves = sorted({round(_told(listing, "wavelength_nm"), 3) for listing in listings})
    table: dict[tuple[tuple[float, float], float], PsfListing] = {}
    for listing in listings:
        key = layout.place(listing), round(_told(listing, "wavelength_nm"), 3)
        if key in table:
            raise FileError(listing.path, f"has the same field and wavelength as {table[key].path.name}")
        table[key] = listing
    for place in places:
        for wave in waves:
            if (place, wave) not in table:
                x, y = next(known.field or (0, 0) for (at, _), known in table.items() if at == place)
                raise FileError(source, f"has no point spread at {wave:g} nm for the field ({x:g}, {y:g}) {unit}")
    psf, spacing = _on_one_grid([[table[place, wave] for wave in waves] for place in places], layout)
    try:
        return LensDesign(
            np.array(waves),
            psf,
            spacing,
            np.array([y for y, _ in places]),
            np.array([x for _, x in places]),
            unit=unit,
            **{"tolerance": TOLERANCE, **options},
        )
    except (InputError, TypeError) as error:
        raise FileError(source, str(error)) from None


def _on_one_grid(table: list[list[PsfListing]], layout: Layout) -> tuple[Array, float]:
    """(F, L, n, n) of the finest spacing, with room for each one's light, and that spacing in um."""
    spacing = min(_told(listing, "spacing_um") for row in table for listing in row)
    upright = [[_upright(listing, layout) for listing in row] for row in table]
    half = max(np.ceil(max(reach for row in upright for *_, reach in row) / spacing), _LEAST_HALF)
    if half > _MOST_HALF:
        across = f"{2 * half + 1:.4g}"
        raise FileError(table[0][0].path, f"with the others needs {across} samples across; save fewer, or coarser")
    count = 2 * int(half) + 1
    psf = np.empty((len(table), len(table[0]), count, count))
    for f, row in enumerate(upright):
        for w, (samples, origin, own, _) in enumerate(row):
            psf[f, w] = resampled(samples, origin, own, count, spacing)
    return psf, spacing


def _upright(listing: PsfListing, layout: Layout) -> tuple[Array, tuple[float, float], float, float]:
    """Samples, origin, spacing in um, and how far from the origin the light reaches in um."""
    samples, origin = layout.upright(listing)
    spacing = _told(listing, "spacing_um")
    try:
        samples = normalised(samples, "the point spread")
    except InputError as error:
        raise FileError(listing.path, str(error)) from None
    return samples, origin, spacing, _reach(samples, origin) * spacing


def _reach(samples: Array, origin: tuple[float, float]) -> float:
    """Samples from the origin to where nearly all light lies."""
    rows, cols = samples.shape
    middle = round(origin[0]), round(origin[1])
    room = max(middle[0], rows - 1 - middle[0], middle[1], cols - 1 - middle[1])
    framed = np.zeros((2 * room + 1, 2 * room + 1))
    first = room - middle[0], room - middle[1]
    framed[first[0] : first[0] + rows, first[1] : first[1] + cols] = samples
    return light_radius(framed, 1.0, _KEPT)
