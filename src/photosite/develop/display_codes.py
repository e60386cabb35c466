"""Linear values as the 8-bit codes of sRGB for a display, in one pass over a picture."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import encode_srgb
from photosite.engine.jit import compiled
from photosite.engine.threads import parallel_for, threads_for


def encoded_rgba(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return (rows, cols, 4) codes, opaque, of (rows, cols, 3) linear sRGB values from 0 to 1."""
    out = np.empty((*linear.shape[:2], 4), np.uint8)
    with threads_for(out.size):
        parallel_for(_encode_rgba, len(out), linear, *_srgb_codes(), out)
    return out


_BINS = 4096
"""Equal parts of 0 to 1, each with two codes of sRGB at most."""


@lru_cache(maxsize=1)
def _srgb_codes() -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the 8-bit code at the beginning of each bin, and the least linear value of each code."""
    low, high = np.zeros(256, np.float32), np.ones(256, np.float32)
    wanted = np.arange(256)
    for _ in range(60):  # bisection, down to neighboring numbers
        middle = (low + high) / np.float32(2)
        reached = encode_srgb(middle) * np.float32(255) + np.float32(0.5) >= wanted
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    high[0] = 0.0
    starts = np.arange(_BINS + 1, dtype=np.float32) / np.float32(_BINS)
    return (np.searchsorted(high, starts, side="right") - 1).astype(np.uint8), high


@compiled()
def _encode_rgba(
    start: int,
    stop: int,
    linear: NDArray[np.float32],
    codes: NDArray[np.uint8],
    least: NDArray[np.float32],
    out: NDArray[np.uint8],
) -> None:
    for r in range(start, stop):
        for c in range(linear.shape[1]):
            for k in range(3):
                value = min(max(linear[r, c, k], np.float32(0)), np.float32(1))
                code = codes[int(value * _BINS)]
                while code < 255 and value >= least[code + 1]:
                    code += 1
                out[r, c, k] = code
            out[r, c, 3] = 255
