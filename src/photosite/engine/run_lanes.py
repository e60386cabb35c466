"""Lanes: positions in a run of pixels modulo a multiple of the tile's columns, for statistics of single labels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64, compiled

_Ints = NDArray[Any]
_LOW_32, _32 = np.uint64(0xFFFFFFFF), np.uint64(32)

LANES = 128
"""Largest number of lanes."""

BAND = 16
"""Rows of one entry of the totals of labels, which a thread processes at a time."""


@compiled(inline=True)
def copy_run(values: NDArray[Any], out: NDArray[Any]) -> None:
    """Copy values to the beginning of `out`; numba compiles assignments between arrays with all their errors."""
    for i in range(np.uint64(values.size)):
        out[i] = values[i]


@compiled()
def lane_clips(pixels: _Ints, row_labels: _Ints, black: int, white: int, counts: _Ints, clipped: _Ints) -> None:
    """Count the numbers at or below black, and at or above white, for each label."""
    lanes = LANES // row_labels.size * row_labels.size
    size, step = np.uint64(pixels.size), np.uint64(lanes)
    low, high = counts[0], counts[1]
    counts[:] = 0
    floor, ceiling = np.int32(black), np.int32(white)
    for first in range(np.uint64(0), size, step):
        for lane in range(min(step, size - first)):
            y = np.int32(pixels[first + lane])
            low[lane] += np.uint32(y <= floor)
            high[lane] += np.uint32(y >= ceiling)
    for lane in range(lanes):
        for end in range(2):
            clipped[row_labels[lane % row_labels.size], end] += counts[end, lane]


@compiled()
def lane_squares(sums: _Ints, squares: _Ints, lanes: int, n: np.uint64, whole: _Ints, rounded: F64) -> None:
    """Add Q, the low and the high 32 bits of S^2, and (n Q - S^2)^2 of each pixel to its lane."""
    q_total, s_low, s_high = whole[0], whole[1], whole[2]
    for first in range(np.uint64(0), np.uint64(sums.size), np.uint64(lanes)):
        for lane in range(min(np.uint64(lanes), np.uint64(sums.size) - first)):
            s = np.uint64(sums[first + lane])
            q = squares[first + lane]
            square = s * s
            q_total[lane] += q
            s_low[lane] += square & _LOW_32
            s_high[lane] += square >> _32
            v = np.float64(np.int64(n * q - square))  # below 2^62: signed integers convert faster
            rounded[lane] += v * v


@compiled()
def add_lanes(whole: _Ints, rounded: F64, row_labels: _Ints, lanes: int, exact: _Ints, spread: F64) -> None:
    """Add the lanes of a row to the totals of its labels, and set them to zero."""
    for lane in range(lanes):
        label = row_labels[lane % row_labels.size]
        for part in range(3):
            exact[label, part] += whole[part, lane]
        spread[label] += rounded[lane]
    whole[:] = 0
    rounded[:] = 0.0
