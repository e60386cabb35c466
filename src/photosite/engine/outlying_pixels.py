"""Pixels of a map that lie outside limits about a smooth surface, in one pass over the map."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64, I64, compiled
from photosite.engine.threads import parallel_for

U32 = NDArray[np.uint32]


_PART = 128
"""Pixels of a row that are counted at once, before single ones are looked at."""


class Limits(NamedTuple):
    """Lowest numbers of the pixels of each color, and how much larger the largest ones are.

    Both are (tile rows, steps, cols): the rows of each row of the tile are divided evenly into steps.
    """

    lowest: U32
    width: U32


@compiled()
def fill_limits(
    knots: F64, at: F64, below: float, above: float, site: tuple[int, int], period: int, limits: Limits
) -> None:
    """Compute the limits of the pixels of a site: distances below and above a surface.

    - `knots`: (m, cols) the surface at m rows; it is linear in between.
    - `at`: (steps,) place of each step between them.
    - `site`, `period`: Row of the tile and first column of the site, and distance of its columns.
    """
    lowest, width = limits
    largest = np.float64(0xFFFFFFFF)
    for step in range(at.size):
        first = min(int(at[step]), len(knots) - 1)
        second = min(first + 1, len(knots) - 1)
        part = at[step] - first
        low, wide = lowest[site[0], step], width[site[0], step]
        for c in range(knots.shape[1]):
            center = knots[first, c] + part * (knots[second, c] - knots[first, c])
            start = min(max(math.ceil(center - below), 0.0), largest)
            stop = min(max(math.floor(center + above), start), largest)
            low[site[1] + c * period] = np.uint32(start)
            wide[site[1] + c * period] = np.uint32(stop - start)


@compiled()
def _count_outside(start: int, stop: int, values: NDArray[Any], limits: Limits, counts: U32) -> None:
    lowest, width = limits
    tile_rows, steps = lowest.shape[0], lowest.shape[1]
    for r in range(start, stop):
        site = r % tile_rows
        rows = (values.shape[0] - site + tile_rows - 1) // tile_rows
        step = r // tile_rows * steps // rows
        counts[r] = _outside(values[r], lowest[site, step], width[site, step])


@compiled()
def _outside(row: NDArray[Any], lowest: U32, width: U32) -> int:
    found = np.uint32(0)
    for c in range(np.uint64(row.size)):
        # Unsigned: what is below the lowest number becomes large.
        found += np.uint32(np.uint32(np.uint32(row[c]) - lowest[c]) > width[c])
    return int(found)


@compiled()
def _columns_outside(rows: I64, values: NDArray[Any], limits: Limits, cols: I64) -> None:
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
                    if np.uint32(np.uint32(row[c]) - low[c]) > wide[c]:
                        cols[place] = c
                        place += 1


def outside(values: NDArray[np.unsignedinteger], limits: Limits) -> tuple[I64, I64]:
    """Return rows and columns of the values outside the limits.

    Examples
    --------
    >>> values = np.array([[10, 11, 10, 30], [10, 9, 2, 10]], np.uint16)
    >>> limits = Limits(np.full((1, 1, 4), 8, np.uint32), np.full((1, 1, 4), 7, np.uint32))
    >>> [found.tolist() for found in outside(values, limits)]
    [[0, 1], [3, 2]]
    """
    counts = np.zeros(len(values), np.uint32)
    parallel_for(_count_outside, len(values), values, limits, counts)
    rows = np.flatnonzero(counts)
    cols = np.empty(int(counts.sum()), np.int64)
    _columns_outside(rows, values, limits, cols)
    return np.repeat(rows, counts[rows]), cols
