"""Text of CODE V: point spreads as grids of numbers, and its listing of field curves.

A point spread is a grid of numbers, as the program exports its worksheet buffers, with any lines of text above and
between. Of such text the lines with an equals sign or colon are looked at for the wavelength, the distance of samples
and the field; what they do not say must come from the index (`photosite.optics.io.listings.design_files`).
docs/optics.md
says what these layouts were written after.
"""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path

import numpy as np

from photosite.errors import FileError
from photosite.optics.distortion import Distortion
from photosite.optics.io.listings.text import (
    NUMBER,
    PsfListing,
    TableRows,
    finite,
    grid_of_numbers,
    micrometers,
    read_text,
)
from photosite.optics.radial_table import FieldPoints

_N = f"({NUMBER})"
_WAVELENGTH = re.compile(rf"\bwavelength\b[^=:]*[=:]\s*{_N}\s*([A-Za-zµμ]*m\w*)\b", re.IGNORECASE)
_SPACING = re.compile(rf"\b(?:grid|sample|pixel)\s+spacing\b[^=:]*[=:]\s*{_N}\s*([A-Za-zµμ]*m\w*)\b", re.IGNORECASE)
_FIELD = re.compile(rf"\bfield\b[^=:]*[=:]\s*\(?\s*{_N}\s*,?\s+{_N}\s*\)?\s*(deg|mm)", re.IGNORECASE)
_FIELD_ROW = 5
"""Numbers in a row of field curves: relative field, angle or height, two foci, distortion."""


def read_psf(path: str | PathLike[str]) -> PsfListing:
    """A grid of numbers, and what the text above it says.

    Raises
    ------
    FileError
        If there is no grid of 3 x 3 numbers or more, or text stands in it; with the line.
    """
    file = Path(path)
    lines = read_text(file, "a grid of a point spread")
    start = next((i for i, line in enumerate(lines) if _is_row(line)), None)
    if start is None:
        raise FileError(file, "holds no rows of numbers: a point spread is a grid of them")
    wavelength = spacing = unit = None
    field: tuple[float, float] | None = None
    for index, line in enumerate(lines[:start]):
        if (match := _WAVELENGTH.search(line)) is not None:
            wavelength = micrometers(match[1], match[2], file, index + 1) * 1e3
        if (match := _SPACING.search(line)) is not None:
            spacing = micrometers(match[1], match[2], file, index + 1)
        if (match := _FIELD.search(line)) is not None:
            field = finite(match[1], file, index + 1), finite(match[2], file, index + 1)
            unit = match[3].lower()
    samples = grid_of_numbers(lines, start, file)
    return PsfListing(file, samples, (samples.shape[0] // 2, samples.shape[1] // 2), spacing, wavelength, field, unit)


def _is_row(line: str) -> bool:
    parts = re.split(r"[\s;]+|,\s+|,(?=[-+]?\d*\.)", line.strip().strip(",;"))
    return len(parts) >= 3 and all(re.fullmatch(NUMBER, part.strip(",")) for part in parts)


def read_distortion(path: str | PathLike[str]) -> Distortion:
    """The listing of field curves (FIE): relative field, field angle or height, two foci, distortion in percent.

    Raises
    ------
    FileError
        If it is no such listing, or does not say that fields are in degrees or mm and distortion in percent.
    """
    file = Path(path)
    lines = read_text(file, "a listing of field curves")
    head = " ".join(line for line in lines if not _is_row(line)).lower()
    if "field" not in head or "distortion" not in head:
        raise FileError(file, "is not a listing of field curves: no heading names field and distortion")
    if "per cent" not in head and "percent" not in head and "(%)" not in head:
        raise FileError(file, "does not say that its distortion is in percent; give the table in the YAML file")
    in_degrees, in_mm = "(deg" in head or "degrees" in head, re.search(r"field\s+height\s*\(mm|height\s*\(mm", head)
    if in_degrees == bool(in_mm):
        raise FileError(file, "does not say whether its fields are in degrees or mm; give the table in the YAML file")
    start = next((i for i, line in enumerate(lines) if "distortion" in line.lower()), 0)
    table = TableRows(file, _FIELD_ROW)
    for index in range(start + 1, len(lines)):
        table.take(lines[index], index + 1)
    if len(table.rows) < 2:
        raise FileError(file, f"has no rows of {_FIELD_ROW} numbers: relative field, field, two foci, distortion")
    values = np.array(table.rows)
    values = values[np.argsort(values[:, 1], kind="stable")]
    try:
        points = FieldPoints(angle_deg=values[:, 1]) if in_degrees else FieldPoints(height_mm=values[:, 1])
        return Distortion.from_percent(points, values[:, 4])
    except ValueError as error:
        raise FileError(file, str(error)) from None
