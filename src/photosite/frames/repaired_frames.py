"""Frames in which the numbers of some pixels are replaced by those of other pixels of the same frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from photosite.frames.frame_set import FrameSet, FrameSource
from photosite.frames.raw_frame import Numbers
from photosite.frames.stored_rows import StoredRows

NEAREST, FARTHEST = 8, 40
"""Distances in pixels of one color, between which the pixel is taken that replaces another.

Nearer ones would correlate the noise of neighbors; a fixed distance would show as a period."""

_LONGEST = 1 << 17
"""More than the columns of a frame."""

_LINES = 512
"""Rows of a stored frame that are read at a time."""

_Places = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PixelReplacement:
    """The pixels that are replaced, and those that replace them.

    A pixel of the same row and color replaces another, so that the noise of rows and columns stays; where most of a row
    is replaced, another row does.

    Parameters
    ----------
    bad_row, bad_col
        (n,) all bad pixels, in the order of their rows.
    row, col, source_col
        (n,) pixels that others of their row replace, in this order, and the columns that their numbers are taken from.
    lines
        Rows that are replaced as a whole, with the row that replaces each.
    """

    bad_row: _Places
    bad_col: _Places
    row: _Places
    col: _Places
    source_col: _Places
    lines: tuple[tuple[int, int], ...] = ()

    @classmethod
    def of(cls, bad: NDArray[np.bool_], tile: tuple[int, ...]) -> PixelReplacement:
        """Choose the pixels that replace the bad ones of a (rows, cols) chip with a color filter array's tile.

        Examples
        --------
        >>> bad = np.zeros((4, 40), bool)
        >>> bad[2, 30] = bad[3] = True
        >>> chosen = PixelReplacement.of(bad, (1, 1))
        >>> chosen.row.tolist(), abs(int(chosen.source_col[0]) - 30) >= NEAREST, chosen.lines[0][0]
        ([2], True, 3)
        """
        cols = bad.shape[1]
        height, width = tile
        bad_row, bad_col = np.divmod(np.flatnonzero(bad), cols)
        counts = np.zeros((len(bad), width), np.int64)
        np.add.at(counts, (bad_row, bad_col % width), 1)
        most = np.array([len(range(c, cols, width)) for c in range(width)])
        good_rows = np.logical_not((2 * counts > most).any(axis=1))
        lines = tuple((r, _nearest_line(r, good_rows, height)) for r in np.flatnonzero(~good_rows).tolist())
        in_row = good_rows[bad_row]
        row, col = bad_row[in_row], bad_col[in_row]
        source = np.full(len(col), -1)
        for distance in _distances(col // width, cols // width):
            left = source < 0
            if not left.any():
                break
            at = col + distance * width
            inside = left & (at >= 0) & (at < cols)
            inside[inside] = ~bad[row[inside], at[inside]]
            source[inside] = at[inside]
        known = source >= 0
        return cls(bad_row, bad_col, row[known], col[known], source[known], lines)

    @property
    def bad(self) -> tuple[_Places, _Places]:
        """(n,) row and column of each bad pixel."""
        return self.bad_row, self.bad_col

    @cached_property
    def sources(self) -> tuple[_Places, _Places]:
        """(n,) row and column that the number of each bad pixel is taken from."""
        line_of = np.arange(int(self.bad_row.max(initial=0)) + 1)
        for line, source in self.lines:
            line_of[line] = source
        row = line_of[self.bad_row]
        known, wanted = self.row * _LONGEST + self.col, row * _LONGEST + self.bad_col
        at = np.minimum(np.searchsorted(known, wanted), max(len(known) - 1, 0))
        found = known[at] == wanted if len(known) else np.zeros(len(wanted), np.bool_)
        col = self.bad_col.copy()
        col[found] = self.source_col[at[found]]
        return row, col

    def apply(self, dn: Numbers, first: int = 0, read_row: Callable[[int], Numbers] | None = None) -> None:
        """Replace the pixels of successive rows of a frame in place, the first of which has this number."""
        start, stop = np.searchsorted(self.row, [first, first + len(dn)])
        part = slice(int(start), int(stop))
        at = self.row[part] - first
        dn[at, self.col[part]] = dn[at, self.source_col[part]]
        for line, source in self.lines:
            if first <= line < first + len(dn):
                start, stop = np.searchsorted(self.bad_row, [line, line + 1])
                cols = self.bad_col[int(start) : int(stop)]
                if read_row is None:
                    dn[line - first, cols] = dn[source - first, cols]
                else:
                    other = read_row(source)[None].copy()
                    replace(self, lines=()).apply(other, source)
                    dn[line - first, cols] = other[0, cols]


def _nearest_line(row: int, good: NDArray[np.bool_], step: int) -> int:
    others = np.arange(row % step, len(good), step)
    others = others[good[others]]
    if not len(others):
        return row
    far = np.abs(others - row) >= NEAREST * step
    others = others[far] if far.any() else others
    return int(others[np.argmin(np.abs(others - row))])


def _distances(col: _Places, count: int) -> Iterable[_Places]:
    """Yield distances to try, in pixels of one color; they depend on the column, so that columns stay columns."""
    sign = np.where(col % 2 == 0, 1, -1)
    span = FARTHEST - NEAREST
    for turn in range(span):
        distance = NEAREST + (7 * col + turn) % span
        yield sign * distance
        yield -sign * distance
    for near in range(NEAREST - 1, 0, -1):
        yield sign * near
        yield -sign * near
    for far in range(FARTHEST, count):
        yield sign * far
        yield -sign * far


class RepairedRows(StoredRows):
    """Rows of a stored frame with replaced pixels."""

    def __init__(self, stored: StoredRows, replacement: PixelReplacement) -> None:
        self.path, self.shape = stored.path, stored.shape
        self._stored, self._replacement = stored, replacement

    @property
    def place(self) -> None:  # type: ignore[override]
        """None: the numbers in the file are not those of the frame."""
        return None

    def read_rows(self, first: int, out: NDArray[np.uint16]) -> None:
        """Read successive rows into a C-contiguous array (n, cols), or one row (cols,)."""
        self._stored.read_rows(first, out)
        lines = out if out.ndim == 2 else out[None]
        self._replacement.apply(lines, first, lambda row: self._stored.take_rows([row])[0])

    def take_rows(self, rows: Iterable[int]) -> NDArray[np.uint16]:
        """Return some rows (n, cols), which need not be adjacent."""
        wanted = np.fromiter(rows, np.int64)
        out = np.empty((len(wanted), self.shape[1]), np.uint16)
        for row, line in zip(wanted.tolist(), out, strict=True):
            self.read_rows(row, line)
        return out


@dataclass(frozen=True, eq=False)
class _RepairedRead:
    """`FrameSource.read` of a frame with replaced pixels."""

    source: FrameSource
    replacement: PixelReplacement

    def __call__(self) -> Numbers:
        dn = self.source.read().copy()
        self.replacement.apply(dn)
        return dn

    def open_rows(self) -> StoredRows | None:
        stored = self.source.open_rows()
        return None if stored is None else RepairedRows(stored, self.replacement)


def repaired(frames: FrameSet, replacement: PixelReplacement) -> FrameSet:
    """Return the frames with replaced pixels."""

    def without(source: FrameSource) -> FrameSource:
        return replace(source, read=_RepairedRead(source, replacement))

    groups = tuple(replace(group, frames=tuple(map(without, group.frames))) for group in frames.groups)
    return replace(frames, groups=groups)


def numbers_at(source: FrameSource, row: _Places, col: _Places) -> NDArray[np.uint16]:
    """Return the numbers (n,) of some pixels of a frame; of a stored frame, only they or their rows are read."""
    stored = source.open_rows()
    if stored is None:
        return source.read()[row, col].astype(np.uint16)
    if stored.place is not None:
        return stored.numbers_at(row, col)
    lines, at = np.unique(row, return_inverse=True)
    out = np.empty(len(row), np.uint16)
    for first in range(0, len(lines), _LINES):
        part = (at >= first) & (at < first + _LINES)
        out[part] = stored.take_rows(lines[first : first + _LINES])[at[part] - first, col[part]]
    return out
