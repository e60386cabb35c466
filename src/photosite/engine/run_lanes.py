"""Lanes: positions in a run of pixels modulo a multiple of the tile's columns, for statistics of single labels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled

_Ints = NDArray[Any]

LANES = 128
"""Largest number of lanes."""

BAND = 16
"""Rows of one entry of the totals of labels, which a thread processes at a time."""


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
