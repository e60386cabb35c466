"""Pixels of a map that lie outside limits about a smooth surface, in one pass over the map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64, I64, compiled
from photosite.engine.threads import parallel_for

Whole = NDArray[np.unsignedinteger]


_PART = 128
"""Pixels of a row that are counted at once, before single ones are looked at."""

_RUN = 1 << 15
"""Pixels that are counted in a number of 16 bits."""


class Limits(NamedTuple):
    """Lowest numbers of the pixels of each color, and how much larger the largest ones are.

    Both are (tile rows, steps, cols), of the type of the pixels, so that as many are compared at once as are read. The
    rows of each row of the tile are divided evenly into steps.
    """

    lowest: Whole
    width: Whole


class Surface(NamedTuple):
    """A surface over the pixels of a site: linear between its knots, and constant beyond them.

    `knots` is (m, n); `rows` the place between them, in knots, of each step of `Limits`; `cols` (n,) their columns.
    """

    knots: F64
    rows: F64
    cols: F64


@compiled()
def fill_limits(
    surface: Surface, below: float, above: float, site: tuple[int, int], period: int, limits: Limits
) -> None:
    """Compute the limits of the pixels of a site: distances below and above a surface.

    `site` is the row of the tile and the first column of the site, `period` the distance of its columns.
    """
    knots, rows, cols = surface
    lowest, width = limits
    largest = np.float64(np.iinfo(lowest.dtype).max)
    line = np.empty((lowest.shape[2] - site[1] + period - 1) // period)
    for step in range(rows.size):
        first = min(int(rows[step]), len(knots) - 1)
        second = min(first + 1, len(knots) - 1)
        part = rows[step] - first
        for k in range(cols.size + 1):
            left, right = max(k - 1, 0), min(k, cols.size - 1)
            start = np.uint64(math.ceil(cols[left])) if k > 0 else np.uint64(0)
            stop = np.uint64(math.ceil(cols[right])) if k < cols.size else np.uint64(line.size)
            value = knots[first, left] + part * (knots[second, left] - knots[first, left])
            last = knots[first, right] + part * (knots[second, right] - knots[first, right])
            slope = (last - value) / max(cols[right] - cols[left], 1.0)
            for c in range(start, stop):
                line[c] = value + slope * (c - cols[left])
        low, wide = lowest[site[0], step], width[site[0], step]
        for c in range(np.uint64(line.size)):
            start_dn = min(max(np.ceil(line[c] - below), 0.0), largest)
            low[site[1] + c * period] = start_dn
            wide[site[1] + c * period] = min(max(np.floor(line[c] + above), start_dn), largest) - start_dn


@compiled()
def _count_outside(start: int, stop: int, values: Whole, limits: Limits, counts: NDArray[np.uint32]) -> None:
    lowest, width = limits
    tile_rows, steps = lowest.shape[0], lowest.shape[1]
    for r in range(start, stop):
        site = r % tile_rows
        rows = (values.shape[0] - site + tile_rows - 1) // tile_rows
        step = r // tile_rows * steps // rows
        counts[r] = _outside(values[r], lowest[site, step], width[site, step])


@compiled()
def _outside(row: Whole, lowest: Whole, width: Whole) -> int:
    whole, total = row.dtype.type, 0
    for first in range(0, row.size, _RUN):
        part, low, wide = row[first : first + _RUN], lowest[first : first + _RUN], width[first : first + _RUN]
        found = whole(0)  # of the type of the pixels, for vector instructions
        for c in range(np.uint64(part.size)):
            # Unsigned: what is below the lowest number becomes large.
            found = whole(found + whole(whole(part[c] - low[c]) > wide[c]))
        total += int(found)
    return total


@compiled()
def _columns_outside(rows: I64, values: Whole, limits: Limits, cols: I64) -> None:
    lowest, width = limits
    tile_rows, steps = lowest.shape[0], lowest.shape[1]
    place = 0
    for r in rows:
        site = r % tile_rows
        step = r // tile_rows * steps // ((values.shape[0] - site + tile_rows - 1) // tile_rows)
        row, low, wide = values[r], lowest[site, step], width[site, step]
        for first in range(0, row.size, _PART):
            last = min(first + _PART, row.size)
            if _outside(row[first:last], low[first:last], wide[first:last]):
                for c in range(first, last):
                    if row.dtype.type(row[c] - low[c]) > wide[c]:
                        cols[place] = c
                        place += 1


_TOGETHER = 64
"""Windows that are sorted at once."""


@lru_cache(maxsize=8)
def _comparators(n: int) -> I64:
    """Return (m, 2) places that are compared in turn to sort n values (Knuth, The Art of Computer Programming, 5.2.2M).

    Examples
    --------
    >>> len(_comparators(8))
    19
    """
    found, p = [], 1
    while p < n:
        k = p
        while k >= 1:
            for j in range(k % p, n - k, 2 * k):
                found += [(i, i + k) for i in range(j, min(j + k, n - k)) if i // (2 * p) == (i + k) // (2 * p)]
            k //= 2
        p *= 2
    return np.array(found, np.int64).reshape(-1, 2)


@compiled()
def _compare(low: Whole, high: Whole) -> None:
    for lane in range(np.uint64(low.size)):
        a, b = low[lane], high[lane]
        low[lane] = a if a < b else b
        high[lane] = b if a < b else a


@compiled()
def _fill_ranked(
    start: int, stop: int, values: Whole, first: I64, offsets: I64, comparators: I64, ranks: I64, out: Whole
) -> None:
    held = np.empty((offsets.size, _TOGETHER), values.dtype)
    for window in range(start, stop, _TOGETHER):
        present = min(_TOGETHER, stop - window)
        for lane in range(_TOGETHER):
            place = first[window + min(lane, present - 1)]
            for k in range(np.uint64(offsets.size)):
                held[k, lane] = values[np.uint64(place + offsets[k])]
        for m in range(np.uint64(len(comparators))):
            _compare(held[np.uint64(comparators[m, 0])], held[np.uint64(comparators[m, 1])])
        for k in range(ranks.size):
            for lane in range(present):
                out[k, window + lane] = held[ranks[k], lane]


def ranked(values: NDArray[Any], first: I64, offsets: I64, ranks: Sequence[int]) -> NDArray[Any]:
    """Return (ranks, n) the values of some ranks, from 0 for the least, among those at offsets from each of n places.

    `first` are places in the order of the rows. Sorting them row by row takes ten times as long.

    Examples
    --------
    >>> ranked(np.array([5, 1, 4, 2, 3], np.uint16), np.array([0, 2]), np.array([0, 1, 2]), [0, 1]).tolist()
    [[1, 2], [4, 3]]
    """
    out = np.empty((len(ranks), len(first)), values.dtype)
    parallel_for(
        _fill_ranked, len(first), values.reshape(-1), first, offsets, _comparators(len(offsets)), np.array(ranks), out
    )
    return out


def distinct(numbers: I64) -> I64:
    """Return the distinct numbers in order; for tens of thousands, NumPy's `unique` takes ten times as long.

    Examples
    --------
    >>> distinct(np.array([5, 2, 5, 7])).tolist()
    [2, 5, 7]
    """
    ordered = np.sort(numbers)
    first = np.ones(len(ordered), np.bool_)
    np.not_equal(ordered[1:], ordered[:-1], out=first[1:])
    return ordered[first]


def outside(values: NDArray[np.unsignedinteger], limits: Limits) -> tuple[I64, I64]:
    """Return rows and columns of the values outside the limits.

    Examples
    --------
    >>> values = np.array([[10, 11, 10, 30], [10, 9, 2, 10]], np.uint16)
    >>> limits = Limits(np.full((1, 1, 4), 8, np.uint16), np.full((1, 1, 4), 7, np.uint16))
    >>> [found.tolist() for found in outside(values, limits)]
    [[0, 1], [3, 2]]
    """
    counts = np.zeros(len(values), np.uint32)
    parallel_for(_count_outside, len(values), values, limits, counts)
    rows = np.flatnonzero(counts)
    cols = np.empty(int(counts.sum()), np.int64)
    _columns_outside(rows, values, limits, cols)
    return np.repeat(rows, counts[rows]), cols
