"""Pixels of a map that lie outside limits about a smooth surface, in one pass over the map."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, compiled
from photosite.engine.threads import parallel_for


class Surface(NamedTuple):
    """A smooth surface over each color of a mosaic, and the limits about it.

    - `nodes`: (tile rows, node rows, cols) values at some rows, of the color of each column.
    - `place`: (tile rows, node rows) these rows, in rows of the color.
    - `below`, `above`: (tile rows, cols) largest distances.
    """

    nodes: F32
    place: F64
    below: F32
    above: F32


@compiled()
def _count_outside(start: int, stop: int, values: NDArray[Any], surface: Surface, counts: I64) -> None:
    nodes, place, below, above = surface
    tile_rows, last = place.shape[0], place.shape[1] - 1
    for r in range(start, stop):
        site, at = r % tile_rows, r // tile_rows
        k = 0
        while k < last - 1 and at >= place[site, k + 1]:
            k += 1
        weight = np.float32(0.0)
        if last > 0:
            span = place[site, k + 1] - place[site, k]
            weight = np.float32(min(max((at - place[site, k]) / span, 0.0), 1.0))
        first, second = nodes[site, k], nodes[site, min(k + 1, last)]
        counts[r] = _outside(values[r], first, second, weight, below[site], above[site])


@compiled()
def _outside(row: NDArray[Any], first: F32, second: F32, weight: np.float32, below: F32, above: F32) -> int:
    found = np.int32(0)
    for c in range(np.uint64(row.size)):
        off = np.float32(row[c]) - (first[c] + weight * (second[c] - first[c]))
        found += np.int32((off > above[c]) | (off < -below[c]))
    return int(found)


@compiled()
def _place_outside(start: int, stop: int, values: NDArray[Any], surface: Surface, firsts: I64, out: I64) -> None:
    nodes, place, below, above = surface
    tile_rows, last = place.shape[0], place.shape[1] - 1
    for r in range(start, stop):
        found = firsts[r]
        if found == firsts[r + 1]:
            continue
        site, at = r % tile_rows, r // tile_rows
        k = 0
        while k < last - 1 and at >= place[site, k + 1]:
            k += 1
        weight = np.float32(0.0)
        if last > 0:
            span = place[site, k + 1] - place[site, k]
            weight = np.float32(min(max((at - place[site, k]) / span, 0.0), 1.0))
        first, second = nodes[site, k], nodes[site, min(k + 1, last)]
        for c in range(values.shape[1]):
            off = np.float32(values[r, c]) - (first[c] + weight * (second[c] - first[c]))
            if (off > above[site, c]) | (off < -below[site, c]):
                if found < firsts[r + 1]:
                    out[found] = c
                found += 1


def outside(values: NDArray[np.unsignedinteger], surface: Surface) -> tuple[I64, I64]:
    """Return rows and columns of the values outside the limits.

    Examples
    --------
    >>> values = np.array([[10, 11, 10, 30], [10, 9, 2, 10]], np.uint16)
    >>> level = Surface(*(np.full(shape, 10.0, np.float32) for shape in ((1, 1, 4),)), np.zeros((1, 1)),
    ...                 np.full((1, 4), 3.0, np.float32), np.full((1, 4), 5.0, np.float32))
    >>> [found.tolist() for found in outside(values, level)]
    [[0, 1], [3, 2]]
    """
    counts = np.zeros(len(values), np.int64)
    parallel_for(_count_outside, len(values), values, surface, counts)
    firsts = np.concatenate([[0], np.cumsum(counts)])
    cols = np.zeros(int(firsts[-1]), np.int64)
    if len(cols):
        parallel_for(_place_outside, len(values), values, surface, firsts, cols)
    return np.repeat(np.arange(len(values)), counts), cols
