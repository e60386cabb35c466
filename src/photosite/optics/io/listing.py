"""Text files of lens-design programs: encodings, numbers, tables, grids of numbers, and PSFs of one file each."""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, in_file
from photosite.files.small_files import read_small
from photosite.optics.checks import camera_wavelengths
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import check_spacing, encircled_radius, normalized, resampled

LARGEST_BYTES = 1 << 27
"""Largest listing that is read: 2048 x 2048 numbers in UTF-16."""

NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][-+]?\d+)?"
"""A number with a decimal point or comma; a comma and a blank separate two numbers."""

_WORD = re.compile(r"[^\W\d_]{2}|^\d+(?:[:/.-]\d+){2,}$")
"""Two letters, a date or a time."""
_NOT_A_NUMBER = re.compile(r"^[-+]?(?:nan|inf(?:inity)?)$|#", re.IGNORECASE)
"""What programs write for invalid numbers: NaN, Infinity, 1.#IND."""

_MICRO = {"µm", "μm", "um", "�m", "microns", "micrometers", "micrometer"}
_LENGTHS_UM = {
    **dict.fromkeys(_MICRO, 1.0),
    **dict.fromkeys(("mm", "millimeters", "millimeter"), 1e3),
    **dict.fromkeys(("nm", "nanometers"), 1e-3),
    **dict.fromkeys(("cm", "centimeters", "centimeter"), 1e4),
    **dict.fromkeys(("in", "inches", "inch"), 25.4e3),
    **dict.fromkeys(("m", "meters", "meter"), 1e6),
}


def read_text(path: str | PathLike[str], what: str) -> list[str]:
    """Return the lines of a text file in UTF-16, UTF-8 or Latin-1, whichever it is.

    Raises `FileError` if the file cannot be read, is too large, or is not text.
    """
    file = Path(path)
    text = _decoded(read_small(file, what, LARGEST_BYTES))
    if text is None or not text.strip() or "\0" in text:
        raise FileError(file, f"is not {what}: it is not text")
    return text.splitlines()


def _decoded(content: bytes) -> str | None:
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ["utf-16"]
    elif b"\0" in content[:200]:  # some exports omit the byte order mark
        encodings = ["utf-16-le" if content[1:2] == b"\0" else "utf-16-be"]
    else:
        encodings = ["utf-8-sig", "latin-1"]
    for encoding in encodings:
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    return None


def number(text: str) -> float:
    """Return a number with a decimal point or comma, and an exponent of E or D, such as 1,25E-003."""
    return float(text.replace(",", ".").replace("D", "E").replace("d", "e"))


def finite(text: str, path: Path, line: int) -> float:
    """Return a number; raise `FileError` if it overflows."""
    value = number(text)
    if not math.isfinite(value):
        raise FileError(path, "number", line, value=text, expected="within the range of floating-point numbers")
    return value


def micrometers(value: str, unit: str, path: Path, line: int) -> float:
    """Return a length with its unit, in um; raise `FileError` for an unknown unit or an overflow."""
    name = unit.strip(" .").lower()
    if name not in _LENGTHS_UM:
        raise FileError(path, "unit of length", line, value=unit.strip(" ."), expected="µm, mm, nm, cm, m or in")
    length = finite(value, path, line) * _LENGTHS_UM[name]
    if not math.isfinite(length):
        raise FileError(path, "length", line, value=f"{value} {unit}", expected="finite")
    return length


def table_row(line: str, columns: int | None, path: Path, number: int) -> list[float] | None:
    """Return the numbers of a table's line; None for other lines: empty ones, rules, headings, footers.

    Percent signs are ignored. A row has `columns` numbers, or at least two if that is None. `FileError` is raised for
    other text among the numbers, an overflow, or another count.

    Examples
    --------
    >>> table_row("10.0  -0.5 %", 2, Path("a.txt"), 7), table_row("Maximum distortion = 2 %", 2, Path("a.txt"), 8)
    ([10.0, -0.5], None)
    """
    parts = line.replace("%", " ").split()
    if _is_text(line, parts, columns):
        return None
    for part in parts:
        if not re.fullmatch(NUMBER, part):
            raise FileError(path, "entry", number, value=part, expected="a number", hint="Save the listing again")
    if len(parts) != columns and (columns is not None or len(parts) < 2):
        expected = "2 or more" if columns is None else str(columns)
        raise FileError(path, "numbers in this row", number, value=len(parts), expected=expected)
    return [finite(part, path, number) for part in parts]


def _is_text(line: str, parts: list[str], columns: int | None) -> bool:
    """Return whether a line is not a row: words outnumber its other entries, or lead a line of another length."""
    words = [bool(_WORD.search(part)) and not _NOT_A_NUMBER.search(part) for part in parts]
    others = sum(not word and re.search(r"[\w*?#]", part) is not None for word, part in zip(words, parts, strict=True))
    if not others or "=" in line or ":" in line:
        return not others or any(words)
    return sum(words) > others or (words[0] and sum(words) == others and len(parts) != columns)


@dataclass
class TableRows:
    """Rows of a table, line by line; text after the rows and an empty line is a footer.

    If rows have empty lines between them, an empty line does not end the table. Then invalid lines raise an error, as
    does a footer that rows follow. `columns` is as for `table_row`; None becomes the number of the first row. With
    `ends_after`, a footer begins after that many rows only; 0: no footer.
    """

    path: Path
    columns: int | None = None
    ends_after: int | None = None
    parse: Callable[[str, int | None, Path, int], list[float] | None] = table_row
    rows: list[list[float]] = field(default_factory=list)
    _gap: bool = False
    _spaced: bool = False
    _footer: FileError | None = None

    def take(self, line: str, number: int) -> None:
        """Read the next line; raise `FileError` as `parse` does, unless the line is a footer."""
        if not line.strip():
            self._gap = bool(self.rows) and self.ends_after in (None, len(self.rows))
            return
        try:
            row = self.parse(line, self.columns, self.path, number)
        except FileError as error:
            if self._spaced or not self._gap:
                raise
            self._footer = self._footer or error
            return
        if row is None:
            return
        if self._footer is not None:
            raise self._footer
        self._spaced, self._gap, self.columns = self._spaced or self._gap, False, len(row)
        self.rows.append(row)


def rows_of_numbers(lines: list[str], first: int, path: Path, count: int | None = None) -> NDArray[np.float64]:
    """Return (rows, cols) from lines of numbers separated by blanks, tabs, semicolons or commas; skip empty lines.

    `count` is the number of rows, if known: after these and an empty line, other text is a footer unless rows follow
    it. A line of other text, a number that is not finite, or a row of another length raises `FileError` with the line.
    """
    commas = _separates_by_comma(lines, first)
    table = TableRows(path, ends_after=count or 0, parse=_grid_row)
    for index in range(first, len(lines)):
        text = lines[index].replace(";", " ")
        table.take(text.replace(",", " ") if commas else text, index + 1)
    return np.array(table.rows).reshape(len(table.rows), -1 if table.rows else 0)


def _grid_row(text: str, columns: int | None, path: Path, line: int) -> list[float]:
    parts = [part.rstrip(",") for part in text.split()]
    try:
        row = [number(part) for part in parts]
    except ValueError:
        bad = next(part for part in parts if not re.fullmatch(NUMBER, part))
        raise FileError(path, "entry", line, value=bad, expected="a number") from None
    if not all(map(math.isfinite, row)):
        raise FileError(path, "entry", line, expected="a finite number")
    if columns not in (None, len(row)):
        raise FileError(path, "numbers in this row", line, value=len(row), expected=f"{columns}, as in the rows before")
    return row


def grid_of_numbers(lines: list[str], first: int, path: Path, count: int | None = None) -> NDArray[np.float64]:
    """Return the grid of a PSF by `rows_of_numbers`; raise `FileError` also for less than 3 x 3 numbers."""
    grid = rows_of_numbers(lines, first, path, count)
    if min(grid.shape) < 3:
        raise FileError(path, "the grid of a PSF", value=grid.shape, expected="3 x 3 numbers or more")
    return grid


def is_grid_row(line: str) -> bool:
    """Return whether a line holds three numbers or more, and nothing else."""
    parts = re.split(r"[\s;]+|,\s+|,(?=[-+]?\d*\.)", line.strip().strip(",;"))
    return len(parts) >= 3 and all(re.fullmatch(NUMBER, part.strip(",")) for part in parts)


def _separates_by_comma(lines: list[str], first: int) -> bool:
    """Return whether commas separate numbers, rather than mark decimals: there are points too, or no blanks."""
    for text in lines[first:]:
        if text.strip():
            return "," in text and ("." in text or len(text.split()) == 1)
    return False


Array = NDArray[np.float64]
Axes = Literal["image", "upright"]
FirstRow = Literal["top", "bottom"]

_ENCLOSED = 0.999
"""Energy of each PSF within the square that is kept; the faint rest of a large grid is dropped."""
_LEAST_HALF = 8
_MOST_HALF = 512
_FIELD_DIGITS = 6
"""Decimals, in deg or mm, to which the fields of different files are compared."""


@dataclass(frozen=True, eq=False)
class PsfListing:
    """One PSF as a file states it; None for what the file does not state.

    Parameters
    ----------
    path
        The file.
    samples
        (rows, cols) in the order of the file.
    origin
        (row, col), from 0, of the sample at the reference of the field point.
    spacing_um, wavelength_nm
        Distance between samples, and wavelength of the light.
    field, field_unit
        (x, y) of the field point, in "deg" or "mm".
    center_mm
        (x, y) of the origin on the image surface.
    """

    path: Path
    samples: Array
    origin: tuple[float, float]
    spacing_um: float | None = None
    wavelength_nm: float | None = None
    field: tuple[float, float] | None = None
    field_unit: str | None = None
    center_mm: tuple[float, float] | None = None

    def known(self, name: Literal["wavelength_nm", "spacing_um", "field"]) -> Any:
        """Return a value that the listing, or the index for it, must state."""
        if (value := getattr(self, name)) is None:
            key = "field_deg or field_mm" if name == "field" else name
            raise FileError(self.path, f"does not state its {key}", hint="Give it in an index, a YAML file")
        return value


def read_grid(path: str | PathLike[str]) -> PsfListing:
    """Read a bare grid of numbers, with any lines of text above it.

    Raises `FileError` if there is no grid of 3 x 3 numbers or more, or text within it; with the line.
    """
    file = Path(path)
    lines = read_text(file, "a grid of a PSF")
    start = next((i for i, line in enumerate(lines) if is_grid_row(line)), None)
    if start is None:
        raise FileError(file, "holds no rows of numbers")
    samples = grid_of_numbers(lines, start, file)
    return PsfListing(file, samples, (samples.shape[0] // 2, samples.shape[1] // 2))


@dataclass(frozen=True)
class Layout:
    """Orientation of a program's grids; the defaults are those of Zemax.

    Parameters
    ----------
    axes
        "image": as on the image surface, which is rotated by 180 degrees from the frame. "upright": as the frame.
    first_row
        Position of the first row of samples, "top" or "bottom".
    """

    axes: Axes = "image"
    first_row: FirstRow = "top"

    def upright(self, listing: PsfListing) -> tuple[Array, tuple[float, float]]:
        """Return samples and origin in the orientation of the frame, rows downwards."""
        samples, (row, col) = listing.samples, listing.origin
        rows, cols = samples.shape
        if self.first_row == "bottom":
            samples, row = samples[::-1], rows - 1 - row
        if self.axes == "image":
            samples, row, col = samples[::-1, ::-1], rows - 1 - row, cols - 1 - col
        return samples, (row, col)

    def field_point(self, listing: PsfListing) -> tuple[float, float]:
        """Return (y, x) of the field point, y down in the frame; on image axes a positive angle is imaged at +y."""
        x, y = listing.known("field")
        down, right = (y, -x) if self.axes == "image" else (-y, x)
        return round(down, _FIELD_DIGITS) + 0.0, round(right, _FIELD_DIGITS) + 0.0


def lens_design_of(
    source: Path, listings: Sequence[PsfListing], layout: Layout, options: Mapping[str, Any]
) -> LensDesign:
    """Return the lens design of many listings, one PSF for every field point and wavelength, in any order.

    Parameters
    ----------
    source
        The folder or file that names them, for messages.
    listings, layout
        The PSFs, and the orientation of their grids.
    options
        Options of `LensDesign`.

    Raises
    ------
    FileError
        If a listing lacks a value, or the listings do not form a complete design.
    """
    table: dict[tuple[tuple[float, float], float], PsfListing] = {}
    for listing in listings:
        with in_file(listing.path):
            camera_wavelengths([listing.known("wavelength_nm")])
            check_spacing(listing.known("spacing_um"))
        key = layout.field_point(listing), round(listing.known("wavelength_nm"), 3)
        if key in table:
            raise FileError(listing.path, f"has the same field and wavelength as {table[key].path.name}")
        table[key] = listing
    unit: Literal["deg", "mm"] = "deg" if listings[0].field_unit == "deg" else "mm"
    if any(listing.field_unit != unit for listing in listings):
        raise FileError(source, "mixes fields in degrees and in mm", hint="Give all in the same unit, in an index")
    points = sorted({point for point, _ in table}, key=lambda p: (np.hypot(*p), p))
    waves = sorted({wave for _, wave in table})
    for point, wave in product(points, waves):
        if (point, wave) not in table:
            x, y = next(known.field or (0, 0) for (at, _), known in table.items() if at == point)
            raise FileError(source, f"has no PSF at {wave:g} nm for the field ({x:g}, {y:g}) {unit}")
    psf, spacing = _on_one_grid([[table[point, wave] for wave in waves] for point in points], layout)
    y, x = np.array(points).T
    with in_file(source):
        return LensDesign(np.array(waves), psf, spacing, y, x, unit=unit, **options)


def _on_one_grid(table: list[list[PsfListing]], layout: Layout) -> tuple[Array, float]:
    """Return (F, L, n, n) samples of the finest spacing, large enough for each PSF, and that spacing in um."""
    spacing = min(listing.known("spacing_um") for row in table for listing in row)
    upright = [[_upright(listing, layout) for listing in row] for row in table]
    half = max(np.ceil(max(reach for row in upright for *_, reach in row) / spacing), _LEAST_HALF)
    if half > _MOST_HALF:
        path, across = table[0][0].path, f"{2 * half + 1:.4g}"
        raise FileError(path, f"needs {across} samples across with the others", hint="Save fewer or coarser samples")
    count = 2 * int(half) + 1
    psf = np.empty((len(table), len(table[0]), count, count))
    for f, row in enumerate(upright):
        for w, (samples, origin, own, _) in enumerate(row):
            psf[f, w] = resampled(samples, origin, own, count, spacing)
    return psf, spacing


def _upright(listing: PsfListing, layout: Layout) -> tuple[Array, tuple[float, float], float, float]:
    """Return samples, origin, spacing in um, and the radius about the origin that encloses the energy, in um."""
    samples, origin = layout.upright(listing)
    spacing = listing.known("spacing_um")
    with in_file(listing.path):
        samples = normalized(samples, "samples")
    return samples, origin, spacing, _reach(samples, origin) * spacing


def _reach(samples: Array, origin: tuple[float, float]) -> float:
    """Return the radius about the origin that encloses nearly all energy, in samples."""
    rows, cols = samples.shape
    middle = round(origin[0]), round(origin[1])
    margin = max(middle[0], rows - 1 - middle[0], middle[1], cols - 1 - middle[1])
    framed = np.zeros((2 * margin + 1, 2 * margin + 1))
    first = margin - middle[0], margin - middle[1]
    framed[first[0] : first[0] + rows, first[1] : first[1] + cols] = samples
    return encircled_radius(framed, 1.0, _ENCLOSED)
