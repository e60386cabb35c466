"""Linearization: a table that undoes a known tone curve or companding, applied to the frames of a set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.files.small_files import read_small
from photosite.frames.frame_set import FrameSet, FrameSource
from photosite.frames.raw_frame import Numbers
from photosite.values.diagnostic import DiagnosticKind

MOST_BYTES = 8 << 20
"""Largest file of a table."""

_TOP = 65_535


@dataclass(frozen=True, eq=False)
class LinearizationTable:
    """Linear digital number of each code, as integers, so that sums over frames stay exact.

    Values that are not whole numbers, or exceed 16 bits, are scaled so that the largest is 65535, and rounded.

    Parameters
    ----------
    values
        (codes,) value of each code from 0 on; finite, not negative, and never falling.
    source
        Name of the table in messages.

    Raises
    ------
    InputError
        If the values are invalid.

    Examples
    --------
    >>> LinearizationTable(np.array([0.0, 1.0, 4.0, 9.0])).numbers.tolist()
    [0, 1, 4, 9]
    >>> LinearizationTable(np.array([0.0, 0.25, 1.0])).numbers.tolist()
    [0, 16384, 65535]
    """

    values: NDArray[np.float64]
    source: str = "table"

    def __post_init__(self) -> None:
        values = np.asarray(self.values, np.float64)
        object.__setattr__(self, "values", values)
        if values.ndim != 1 or not 2 <= len(values) <= _TOP + 1:
            raise InputError(
                "values", where=self.source, value=values.shape, expected="2 to 65536 values, one per code"
            )
        if not np.isfinite(values).all() or values.min() < 0.0 or values.max() == values.min():
            raise InputError("values", where=self.source, expected="finite, 0 or above, and different")
        if (falling := np.flatnonzero(np.diff(values) < 0.0)).size:
            code = int(falling[0]) + 1
            raise InputError(f"values[{code}]", where=self.source, value=values[code], expected="never falling")

    @property
    def scale(self) -> float:
        """Factor by which the values were multiplied: 1 for whole numbers of 16 bits."""
        whole = self.values.max() <= _TOP and np.array_equal(self.values, np.rint(self.values))
        return 1.0 if whole else _TOP / float(self.values.max())

    @property
    def numbers(self) -> NDArray[np.uint16]:
        """(codes,) digital number of each code."""
        return np.rint(self.values * self.scale).astype(np.uint16)

    @property
    def bits(self) -> int:
        """Bits of the largest number."""
        return int(self.numbers[-1]).bit_length()

    def at(self, code: float) -> float:
        """Return the digital number of a code, interpolated between two."""
        return float(np.interp(code, np.arange(len(self.values)), self.numbers))


def read_linearization(path: str | PathLike[str]) -> LinearizationTable:
    """Read a table from a text file: a value per line, or code and value, separated by commas or blanks.

    A first line without numbers is a header; lines that start with # are comments. Codes must be 0, 1, 2, ... in order.

    Raises
    ------
    FileError
        If the file cannot be read, or holds no such table.
    """
    path = Path(path)
    try:
        text = read_small(path, "a linearization table", MOST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(path, f"the table cannot be read: {error}") from None
    rows: list[tuple[int, list[float]]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.replace(",", " ").replace(";", " ").split()
        if not fields or line.lstrip().startswith("#"):
            continue
        try:
            rows.append((number, [float(field) for field in fields]))
        except ValueError:
            if rows:
                raise FileError(path, f"line {number}: expected numbers, got {line.strip()[:40]!r}") from None
    widths = {len(row) for _, row in rows}
    if widths not in ({1}, {2}):
        raise FileError(path, "each line must hold a value, or a code and a value", hint="Write one code per line")
    if widths == {2}:
        for expected, (number, (code, _)) in enumerate(rows):
            if code != expected:
                what = f"line {number}: code must be {expected}, got {code:g}"
                raise FileError(path, what, hint="List every code from 0 on, in order")
    try:
        return LinearizationTable(np.array([row[-1] for _, row in rows]), path.name)
    except InputError as error:
        raise FileError(path, str(error)) from None


LINEARIZED = DiagnosticKind(
    "linearized",
    "note",
    "The numbers of the frames were replaced by those of a table.",
    "All results are those of the replaced numbers.",
    "Check that the table undoes the tone curve of these frames.",
)


def linearize(frames: FrameSet, table: LinearizationTable) -> FrameSet:
    """Return the frame set with each code replaced by its linear digital number.

    The bit depth becomes that of the largest number. Black and white level are replaced too.

    Raises
    ------
    InputError
        If the table has fewer codes than the frames' bit depth.

    Examples
    --------
    >>> from photosite.frames.frame_set import FrameSet
    >>> frames = FrameSet.from_arrays([("dark", 0.1, np.array([[0, 3]], np.uint16))], bits=2)
    >>> linear = linearize(frames, LinearizationTable(np.array([0, 1, 4, 9])))
    >>> linear.bits, next(iter(linear.groups[0])).tolist()
    (4, [[0, 9]])
    """
    if len(table.values) < 1 << frames.bits:
        raise InputError(
            "values",
            where=table.source,
            value=len(table.values),
            expected=f"{1 << frames.bits} or more, one per code of {frames.bits} bits",
        )
    numbers = table.numbers[: 1 << frames.bits]
    groups = tuple(
        replace(group, frames=tuple(_linearized(source, numbers) for source in group.frames)) for group in frames.groups
    )
    black, white = (None if dn is None else table.at(dn) for dn in (frames.black_level_dn, frames.white_level_dn))
    note = f"the numbers were replaced by those of {table.source}"
    if table.scale != 1.0:
        note += f", multiplied by {table.scale:.6g} and rounded to 16 bits"
    return replace(
        frames,
        groups=groups,
        bits=max(int(numbers[-1]).bit_length(), 1),
        black_level_dn=black,
        white_level_dn=white,
        diagnostics=(*frames.diagnostics, LINEARIZED(note)),
    )


def _linearized(source: FrameSource, numbers: NDArray[np.uint16]) -> FrameSource:
    whole = None if source.whole is None else partial(_read, source.name, source.whole, numbers)
    return replace(source, read=partial(_read, source.name, source.read, numbers), whole=whole)


def _read(name: str, read: Callable[[], Numbers], numbers: NDArray[np.uint16]) -> NDArray[np.uint16]:
    dn = read()
    if dn.size and (highest := int(dn.max())) >= len(numbers):
        raise FileError(name, f"the frame holds {highest} DN, but the table ends at {len(numbers) - 1}")
    return numbers[dn]
