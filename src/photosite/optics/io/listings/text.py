"""Text that lens-design programs write: its encoding, its numbers, and what a listing of a point spread says.

The programs' own layouts are read in `zemax` and `codev`; from listings to a `LensDesign` goes `design_files`, and
from the files that ISET's macros write with either program to a whole lens `ray_trace`.
"""

from __future__ import annotations

import codecs
import math
import re
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.small import read_small

LARGEST_BYTES = 1 << 27
"""Of a listing that is read at all: 2048 x 2048 numbers in UTF-16 take that."""

NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][-+]?\d+)?"
"""With a decimal point or comma; a comma and a blank separate two numbers."""

_WORD = re.compile(r"[^\W\d_]{2}|^\d+(?:[:/.-]\d+){2,}$")
"""Two letters, a date or a time."""
_NO_NUMBER = re.compile(r"^[-+]?(?:nan|inf(?:inity)?)$|#", re.IGNORECASE)
"""What programs write for a number that is none: NaN, Infinity, 1.#IND."""

_MICRO = {"µm", "μm", "um", "�m", "microns", "micrometers", "micrometer"}
_LENGTHS_UM = {
    **dict.fromkeys(_MICRO, 1.0),
    **dict.fromkeys(("mm", "millimeters", "millimeter"), 1e3),
    **dict.fromkeys(("nm", "nanometers"), 1e-3),
    **dict.fromkeys(("cm", "centimeters", "centimeter"), 1e4),
    **dict.fromkeys(("in", "inches", "inch"), 25.4e3),
    **dict.fromkeys(("m", "meters", "meter"), 1e6),
}


@dataclass(frozen=True, eq=False)
class PsfListing:
    """One point spread as a file has it; what the file does not say is None.

    Parameters
    ----------
    path
        The file.
    samples
        (rows, cols) in the file's order.
    origin
        (row, col), from 0, of the sample at the field point's reference.
    spacing_um
        Between samples.
    wavelength_nm
        Of the light.
    field
        (x, y) of the field point.
    field_unit
        "deg" or "mm" as the file says.
    center_mm
        (x, y) on the image surface where the origin lies; the lens's unit is taken for mm where the file names none.
    """

    path: Path
    samples: NDArray[np.float64]
    origin: tuple[float, float]
    spacing_um: float | None = None
    wavelength_nm: float | None = None
    field: tuple[float, float] | None = None
    field_unit: str | None = None
    center_mm: tuple[float, float] | None = None


def read_text(path: str | PathLike[str], what: str) -> list[str]:
    """The lines of a text in UTF-16, UTF-8 or Latin-1, whichever it is.

    Raises
    ------
    FileError
        If the file cannot be read, is too large, or is no text.
    """
    file = Path(path)
    text = _decoded(read_small(file, what, LARGEST_BYTES))
    if text is None or not text.strip() or "\0" in text:
        raise FileError(file, f"is not {what}: it is not text")
    return text.splitlines()


def _decoded(content: bytes) -> str | None:
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ["utf-16"]
    elif b"\0" in content[:200]:  # some exports leave the byte order mark out
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
    """A number with a decimal point or comma, and an exponent of E or D.

    Examples
    --------
    >>> number("1,25E-003"), number("0.5")
    (0.00125, 0.5)
    """
    return float(text.replace(",", ".").replace("D", "E").replace("d", "e"))


def finite(text: str, path: Path, line: int) -> float:
    """A finite number.

    Raises
    ------
    FileError
        If it is beyond what a number can be.
    """
    value = number(text)
    if not math.isfinite(value):
        raise FileError(path, f"'{text[:40]}' is too large a number", line)
    return value


def micrometers(value: str, unit: str, path: Path, line: int) -> float:
    """A length with its unit, in um.

    Raises
    ------
    FileError
        If the unit is not one of length, or the number not finite.
    """
    name = unit.strip(" .").lower()
    if name not in _LENGTHS_UM:
        raise FileError(
            path, f"'{unit.strip(' .')}' is no unit of length that is known here: µm, mm, nm, cm, m or in", line
        )
    length = finite(value, path, line) * _LENGTHS_UM[name]
    if not math.isfinite(length):
        raise FileError(path, f"'{value[:40]} {unit[:40]}' is too large a length", line)
    return length


def rows_of_numbers(lines: list[str], first: int, path: Path, count: int | None = None) -> NDArray[np.float64]:
    """(rows, cols) from lines of numbers with blanks, tabs, semicolons or commas and blanks between; empty lines skip.

    Parameters
    ----------
    lines
        Of the file.
    first
        Index of the first that is looked at.
    path
        The file, for messages.
    count
        Of rows, where the file says it: after these and an empty line what is no row is a footer, if no rows follow.

    Raises
    ------
    FileError
        If a line holds something else or what is not finite, or rows differ in length; with the line.
    """
    rows: list[list[float]] = []
    commas = _separates_by_comma(lines, first)
    footer: FileError | None = None
    ended = False
    for index in range(first, len(lines)):
        text = lines[index].replace(";", " ")
        parts = (text.replace(",", " ") if commas else text).split()
        if not parts:
            ended = len(rows) == count
            continue
        try:
            row = _numbers(parts, len(rows[0]) if rows else None, path, index + 1)
        except FileError as error:
            if not ended:
                raise
            footer = footer or error
            continue
        if footer is not None:
            raise footer
        rows.append(row)
    return np.array(rows).reshape(len(rows), -1 if rows else 0)


def _numbers(parts: list[str], columns: int | None, path: Path, at: int) -> list[float]:
    try:
        row = [number(part.rstrip(",")) for part in parts]
    except ValueError:
        bad = next(part for part in parts if not re.fullmatch(NUMBER, part.rstrip(",")))
        raise FileError(path, f"'{bad[:40]}' stands among its numbers", at) from None
    if not all(map(math.isfinite, row)):
        raise FileError(path, "holds a number that is not finite", at)
    if columns is not None and len(row) != columns:
        raise FileError(path, f"this row has {len(row)} numbers, those before it {columns}", at)
    return row


@dataclass
class TableRows:
    """The rows of a table, line by line: after its rows and an empty line what is no row is a footer.

    A table whose rows have empty lines between them is not ended by one: what cannot be read is refused there, and so
    is a footer that rows follow.

    Parameters
    ----------
    path
        The file, for messages.
    columns
        How many numbers a row has; None: as many as the first, two or more.
    """

    path: Path
    columns: int | None = None
    rows: list[list[float]] = field(default_factory=list)
    _gap: bool = False
    _spaced: bool = False
    _footer: FileError | None = None

    def take(self, line: str, at: int) -> None:
        """Look at the next line, whose number is `at`.

        Raises
        ------
        FileError
            As `table_row`, for what is no footer.
        """
        if not line.strip():
            self._gap = bool(self.rows)
            return
        try:
            row = table_row(line, self.columns, self.path, at)
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


def table_row(line: str, columns: int | None, path: Path, at: int) -> list[float] | None:
    """The numbers of a table's line; None for what stands between its rows: nothing, a rule, a heading, a footer.

    Parameters
    ----------
    line
        The line; signs of percent do not matter.
    columns
        How many numbers a row has; None: not known yet, two or more.
    path, at
        The file and the line's number, for messages.

    Raises
    ------
    FileError
        If it is a row that cannot be read: other text among its numbers, one that is not finite, too few or too many.

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
            raise FileError(path, f"'{part[:40]}' stands where a table has a number; save the listing again", at)
    expected = "2 or more" if columns is None else columns
    if len(parts) != columns and (columns is not None or len(parts) < 2):
        raise FileError(path, f"this row has {len(parts)} numbers where {expected} are expected", at)
    return [finite(part, path, at) for part in parts]


def _is_text(line: str, parts: list[str], columns: int | None) -> bool:
    """Whether a line is none of a table's: words outweigh what else it holds, or lead it where a row is longer."""
    words = [bool(_WORD.search(part)) and not _NO_NUMBER.search(part) for part in parts]
    others = sum(not word and re.search(r"[\w*?#]", part) is not None for word, part in zip(words, parts, strict=True))
    if not others or "=" in line or ":" in line:
        return not others or any(words)
    return sum(words) > others or (words[0] and sum(words) == others and len(parts) != columns)


def grid_of_numbers(lines: list[str], first: int, path: Path, count: int | None = None) -> NDArray[np.float64]:
    """`rows_of_numbers` of a point spread.

    Raises
    ------
    FileError
        As there, and if there are fewer than 3 x 3 numbers.
    """
    grid = rows_of_numbers(lines, first, path, count)
    if min(grid.shape) < 3:
        raise FileError(path, "holds no point spread: 3 x 3 numbers at least are expected")
    return grid


def _separates_by_comma(lines: list[str], first: int) -> bool:
    """Whether commas stand between numbers rather than in them: then there are points too, or no blanks."""
    for text in lines[first:]:
        if text.strip():
            return "," in text and ("." in text or len(text.split()) == 1)
    return False
