"""Patches of images, and the light that codes of pictures stand for."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, compiled
from photosite.engine.threads import COPIES_PER_THREAD, parallel_for, threads_for


def scaled_patch(
    image: F32, corner: tuple[int, int], shape: tuple[int, int], flips: tuple[bool, bool], factor: np.float32
) -> F32:
    """Return the patch of a shape at a corner of an image, (rows, cols), times a factor; flipped along its axes."""
    rows, cols = shape
    out = np.empty((rows, cols), np.float32)
    with threads_for(out.size, COPIES_PER_THREAD):
        parallel_for(_scaled_patch, rows, image, corner, shape, flips, factor, out)
    return out


@compiled()
def _scaled_patch(
    start: int,
    stop: int,
    image: F32,
    corner: tuple[int, int],
    shape: tuple[int, int],
    flips: tuple[bool, bool],
    factor: np.float32,
    out: F32,
) -> None:
    rows, cols = shape
    last = np.uint64(cols - 1)  # an unsigned index is not tested for counting from the end, which vectors cannot
    for r in range(start, stop):
        line = image[corner[0] + np.int64(r), corner[1] :]
        target = out[rows - 1 - np.int64(r)] if flips[0] else out[r]
        if flips[1]:
            for c in range(cols):
                target[c] = line[last - np.uint64(c)] * factor
        else:
            for c in range(cols):
                target[c] = line[c] * factor


def looked_up(table: F32, codes: NDArray[Any]) -> F32:
    """Return (channels, rows, cols) entries of a table for unsigned codes (rows, cols, channels)."""
    rows, cols, channels = codes.shape
    out = np.empty((channels, rows, cols), np.float32)
    parallel_for(_looked_up, rows, table, codes, out)
    return out


@compiled()
def _looked_up(start: int, stop: int, table: F32, codes: NDArray[Any], out: F32) -> None:
    cols, channels = codes.shape[1:]
    for r in range(start, stop):
        for channel in range(channels):
            line, given = out[channel, r], codes[r, :, channel]
            for c in range(cols):
                line[c] = table[given[c]]
