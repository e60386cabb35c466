"""Patches of images, and the light that codes of pictures stand for."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, compiled, prange


@compiled(parallel=True)
def scaled_patch(
    image: F32, corner: tuple[int, int], shape: tuple[int, int], flips: tuple[bool, bool], factor: np.float32
) -> F32:
    """Return the patch of a shape at a corner of an image, (rows, cols), times a factor; flipped along its axes."""
    rows, cols = shape
    last = np.uint64(cols - 1)  # an unsigned index is not tested for counting from the end, which vectors cannot
    out = np.empty((rows, cols), np.float32)
    for r in prange(rows):
        line = image[corner[0] + np.int64(r), corner[1] :]
        target = out[rows - 1 - np.int64(r)] if flips[0] else out[r]
        if flips[1]:
            for c in range(cols):
                target[c] = line[last - np.uint64(c)] * factor
        else:
            for c in range(cols):
                target[c] = line[c] * factor
    return out


@compiled(parallel=True)
def looked_up(table: F32, codes: NDArray[Any]) -> F32:
    """Return (channels, rows, cols) entries of a table for unsigned codes (rows, cols, channels)."""
    rows, cols, channels = codes.shape
    out = np.empty((channels, rows, cols), np.float32)
    for r in prange(rows):
        for channel in range(channels):
            line, given = out[channel, r], codes[r, :, channel]
            for c in range(cols):
                line[c] = table[given[c]]
    return out
