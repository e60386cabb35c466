"""Tables of numbers as people write them in text: comments, an optional heading, and lines of cells.

Separators are tabs, semicolons, commas or blanks. Numbers have a decimal point, or a decimal comma where the comma does
not separate cells. Lines that begin with `#`, `%`, `//` or `!` are comments; `# name: value` states something.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from photosite.errors import FileError
from photosite.files.small_files import read_small
from photosite.values.shown import Shown

_COMMENT = re.compile(r"\s*(?:#|%|//|!)+\s*(.*)")
_STATEMENT = re.compile(r"([A-Za-z][A-Za-z _-]*?)\s*[:=]\s*(.*\S)\s*")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")


@dataclass(frozen=True)
class TextTable(Shown):
    """Cells of a table of text, each line with its number in the file.

    Parameters
    ----------
    path, what
        The file, and what it should be, such as "a spectrum".
    stated
        Values of comments of the form `# name: value`, by name in lower case.
    heading, heading_line
        The names of the columns; None without them.
    rows, lines
        Cells of the other lines, stripped, and their line numbers.
    decimal_comma
        Whether numbers may have a decimal comma, because another sign separates cells.
    """

    path: Path
    what: str
    stated: Mapping[str, str]
    heading: tuple[str, ...] | None
    heading_line: int | None
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    decimal_comma: bool = False

    def error(self, what: str, line: int | None = None, hint: str | None = None) -> FileError:
        """Return the error that the file is not what it should be, with the reason and its line."""
        return FileError(self.path, f"the file is not {self.what}: {what}", line, hint=hint)

    def numbers(self, columns: int | Sequence[int]) -> list[list[float]]:
        """Return the numbers of all lines, each of as many cells as one of `columns`, the same everywhere.

        Raises
        ------
        FileError
            With the line and what is wrong with it.
        """
        wanted = {columns} if isinstance(columns, int) else set(columns)
        found = []
        for row, line in zip(self.rows, self.lines, strict=True):
            if len(row) not in wanted:
                expected = " or ".join(map(str, sorted(wanted)))
                raise self.error(f"the row has {len(row)} {'cell' if len(row) == 1 else 'cells'}, not {expected}", line)
            wanted = {len(row)}
            found.append([self.number(cell, line) for cell in row])
        return found

    def number(self, cell: str, line: int) -> float:
        """Return a finite number, or raise `FileError` with the line."""
        value = parse_number(cell, decimal_comma=self.decimal_comma)
        if value is None:
            raise self.error(f"a cell is not a finite number: {cell[:40]!r}", line)
        return value


def parse_number(cell: str, *, decimal_comma: bool = False) -> float | None:
    """Return a finite number of a cell; None if it is not one.

    Examples
    --------
    >>> parse_number("0,25", decimal_comma=True), parse_number("0,25"), parse_number("nan")
    (0.25, None, None)
    """
    text = cell.replace(",", ".") if decimal_comma and _DECIMAL_COMMA.fullmatch(cell) else cell
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


_PERCENT = re.compile(r"(.*[^\s_,/(\[-])[\s_,/-]*[(\[]?\s*(?:in )?(?:%|percent)\s*[)\]]?", re.IGNORECASE)


def split_percent(heading: str) -> tuple[str, bool]:
    """Return a heading without the unit percent, and whether it states it.

    Examples
    --------
    >>> split_percent("R (%)"), split_percent("qe_percent"), split_percent("red"), split_percent("%")
    (('R', True), ('qe', True), ('red', False), ('%', False))
    """
    found = _PERCENT.fullmatch(heading.strip())
    return (heading, False) if found is None else (found[1], True)


def read_table(path: str | PathLike[str], what: str, largest: int) -> TextTable:
    """Read a table; `what` names it in errors, such as "a spectrum".

    Raises
    ------
    FileError
        If the file cannot be read or is not text.
    """
    content = read_small(path, what, largest)
    marked = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = content.decode(marked)
    except UnicodeDecodeError:
        raise FileError(path, f"is not {what}: it is not text in UTF-8") from None
    return parse_table(text, path, what)


def parse_table(text: str, path: str | PathLike[str], what: str = "a table") -> TextTable:
    """Return the table of a text.

    A first line that begins with no number is the heading; without one, the last comment before the numbers that
    has as many cells as they have.

    Examples
    --------
    >>> table = parse_table("# camera: X-1\\n# nm; red\\n400; 0,5\\n410; 0,75\\n", "a.csv")
    >>> table.heading, table.numbers(2), table.stated["camera"]
    (('nm', 'red'), [[400.0, 0.5], [410.0, 0.75]], 'X-1')
    """
    stated: dict[str, str] = {}
    comments: list[tuple[int, str]] = []
    kept: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if match := _COMMENT.fullmatch(line):
            if statement := _STATEMENT.fullmatch(match[1]):
                stated[" ".join(statement[1].lower().split())] = statement[2]
            elif not kept:
                comments.append((number, match[1]))
        elif line.strip(" ,;\t"):
            kept.append((number, re.split(r"\s#", line, maxsplit=1)[0]))
    mark = _separator([line for _, line in kept[:2]])
    comma = mark != ","
    rows = [tuple(_cells(line, mark)) for _, line in kept]
    lines = [number for number, _ in kept]
    heading: tuple[str, ...] | None = None
    at: int | None = None
    if rows and parse_number(rows[0][0], decimal_comma=comma) is None:
        heading, at = rows.pop(0), lines.pop(0)
    elif rows:
        for number, comment in reversed(comments):
            cells = tuple(_cells(comment, _separator([comment]) if mark == " " else mark))
            if len(cells) == len(rows[0]) and len(cells) > 1:
                heading, at = cells, number
                break
    return TextTable(Path(path), what, stated, heading, at, tuple(rows), tuple(lines), comma)


def _separator(lines: Sequence[str]) -> str:
    """Return the sign between cells, by the last of the first lines, which has numbers: tab, ;, comma or blank."""
    line = lines[-1].strip() if lines else ""
    for mark in "\t;":
        if mark in line:
            return mark
    words = line.split()
    numbers = len(words) > 1 and all(parse_number(word, decimal_comma=True) is not None for word in words)
    return "," if "," in line and not numbers else " " if len(words) > 1 else ","


def _cells(line: str, mark: str) -> list[str]:
    """Return the cells of a line, without quotes and empty ones at its end."""
    reader = csv.reader([" ".join(line.split()) if mark == " " else line], delimiter=mark, skipinitialspace=True)
    cells = [cell.strip() for row in reader for cell in row]
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells
