"""Text files of lens-design programs: encodings, numbers, tables, and grids of numbers."""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.small import read_small

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
