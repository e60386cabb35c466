"""Pixels that are chosen by chance, and the states of those that blink."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64, I64, compiled
from photosite.engine.random_numbers import BLINKING, normal, philox4x32, uniform


@compiled()
def chosen_pixels(
    pixels: int, fraction: float, use: np.uint32, series: int, k0: np.uint32, k1: np.uint32
) -> tuple[I64, F64]:
    """Return the numbers (n,) of the pixels that a fraction of all leaves, and three uniform numbers (3, n) of each.

    Word 0 of the block of a pixel chooses it: a pixel of one fraction is in every larger one, too. `series`, the second
    word of the counter, distinguishes several choices of one use.
    """
    count = 0
    for i in range(pixels):
        w0, _, _, _ = philox4x32(np.uint32(i), np.uint32(series), use, np.uint32(0), k0, k1)
        count += int(uniform(w0) < fraction)
    numbers, values = np.empty(count, np.int64), np.empty((3, count))
    n = 0
    for i in range(pixels):
        w0, w1, w2, w3 = philox4x32(np.uint32(i), np.uint32(series), use, np.uint32(0), k0, k1)
        if uniform(w0) < fraction:
            numbers[n] = i
            values[0, n], values[1, n], values[2, n] = uniform(w1), uniform(w2), uniform(w3)
            n += 1
    return numbers, values


@compiled()
def fractions_of(number: int, count: int, use: np.uint32, k0: np.uint32, k1: np.uint32) -> F64:
    """Return (count,) numbers from 0 to below 1 of a 64-bit number, which is the first two words of the counter."""
    low, high = np.uint32(number & 0xFFFFFFFF), np.uint32(number >> 32)
    out = np.empty((count + 3) // 4 * 4)
    for block in range(out.size // 4):
        w0, w1, w2, w3 = philox4x32(low, high, use, np.uint32(block), k0, k1)
        out[4 * block], out[4 * block + 1] = float(w0), float(w1)
        out[4 * block + 2], out[4 * block + 3] = float(w2), float(w3)
    return out[:count] / 4294967296.0


@compiled()
def single_deviate(number: int, frame: int, use: np.uint32, k0: np.uint32, k1: np.uint32) -> float:
    """Return a standard normal deviate of a counter."""
    w0, _, _, _ = philox4x32(np.uint32(number), np.uint32(frame), use, np.uint32(0), k0, k1)
    return normal(w0)


@compiled()
def telegraph_states(
    numbers: I64, high_fraction: F64, keep: float, frame: np.uint32, k0: np.uint32, k1: np.uint32
) -> NDArray[np.bool_]:
    """Return (n,) whether each blinking pixel is in its upper state in a frame.

    In each frame a pixel keeps its state with probability `keep`, or else draws a new one: a Markov chain of two states
    whose autocorrelation over n frames is keep^n. Its state is that of the last draw, which is found backward from the
    frame; frame 0 always draws. Word 0 of a block is the state that is drawn, word 1 whether it is drawn.
    """
    out = np.empty(len(numbers), np.bool_)
    for j in range(len(numbers)):
        n = np.int64(frame)
        w0, w1, _, _ = philox4x32(np.uint32(numbers[j]), np.uint32(n), BLINKING, np.uint32(0), k0, k1)
        while n > 0 and uniform(w1) < keep:
            n -= 1
            w0, w1, _, _ = philox4x32(np.uint32(numbers[j]), np.uint32(n), BLINKING, np.uint32(0), k0, k1)
        out[j] = uniform(w0) < high_fraction[j]
    return out
