"""Kernels of `FrameSums`: several frames per pass over each run of pixels, at about the speed of memory.

A run is a piece of a row that fits the inner caches. The pixels of eight frames are copied there, the extremes and
totals of each frame are taken, and then all eight are added to the run's sums at once. The sums are read from memory
and written once per call, however many frames are added.

Label statistics of a run are first kept in *lanes*: position in the run modulo a multiple of the tile's columns. Lanes
are adjacent in memory, so that their loops become vector instructions for any tile.

Staging and prefetch need LLVM intrinsics (`jit`). A plain loop that adds one frame after another takes 1.6 to 2.0 times
as long; these kernels without the prefetch take 1.2 to 1.3 times as long (32 frames of 1024 x 3872 pixels, one core).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.arrays import F64
from photosite.engine.jit import carray, compiled, pointer, prange, prefetch

_Ints = NDArray[Any]
"""An array of an integer type; numba compiles for the type of the argument."""

RUN = 4096
"""Largest number of pixels in a run."""

LANES = 64
"""Largest number of lanes."""

BAND = 16
"""Rows that a thread processes at a time."""

_TOGETHER = 8
"""Frames added to the sums at once."""

_NARROW = 23_170
"""The largest number for which eight squares sum to less than 2^32."""

# Unsigned: numba tests whether a signed index counts from the end, which prevents vectorization.
_TWO, _LOW_32, _32 = np.uint64(2), np.uint64(0xFFFFFFFF), np.uint64(32)
_BLOCK, _LINE = np.uint64(64), np.uint64(16)  # pairs of pixels: per prefetch block, per cache line
_LOW_16, _16 = np.uint32(0xFFFF), np.uint32(16)
_R1, _R2, _R3, _R4, _R5, _R6, _R7 = (np.uint64(k * RUN) for k in range(1, _TOGETHER))


@compiled(parallel=True)
def add_frames(
    addresses: _Ints,
    like: _Ints,
    paired: bool,
    labels: _Ints,
    black: int,
    white: int,
    overwrite: bool,
    sums: _Ints,
    squares: _Ints,
    totals: _Ints,
    clipped: _Ints,
    highest: _Ints,
) -> None:
    """Add frames to the per-pixel sums.

    - `addresses`: (frames,) addresses of the frames' pixels, C-contiguous; numba has no arrays of arrays.
    - `like`: An array of the frames' dtype.
    - `paired`: Whether frames have 16 bits, an even number of columns, and addresses that are multiples of four.
    - `labels`: (tile rows, tile cols); at most LANES columns.
    - `overwrite`: Whether these frames are the first, so that the content of the sums is overwritten.
    - `sums`, `squares`: (rows, cols) uint32 and uint64, added to.
    - `totals`: (bands, frames, labels) uint64, zeros: becomes the total of each frame and label, by bands of rows.
    - `clipped`: (bands, labels, 2) int64, zeros: becomes the count at or below black, and at or above white.
    - `highest`: (bands, frames) uint32, zeros: becomes the largest number.
    """
    rows, cols = sums.shape
    tile_rows, tile_cols = labels.shape
    run = RUN // (2 * tile_cols) * 2 * tile_cols  # starts with the tile's first column, and with a pair
    for band in prange(totals.shape[0]):
        stage = np.zeros(_TOGETHER * RUN, np.uint16)
        words = stage.view(np.uint32)
        part = np.empty(RUN, np.uint32)
        counts = np.zeros((2, LANES), np.uint32)
        for r in range(band * BAND, min(rows, (band + 1) * BAND)):
            row_labels = labels[r % tile_rows]
            for c in range(0, cols, run):
                m = min(run, cols - c)
                if overwrite:
                    sums[r, c : c + m] = 0
                    squares[r, c : c + m] = 0
                for first in range(0, addresses.size, _TOGETHER):
                    present = min(_TOGETHER, addresses.size - first)
                    top = np.uint32(0)
                    for k in range(present):
                        place = (r * cols + c) * like.itemsize
                        here = pointer(addresses[first + k] + place)
                        if paired:
                            ahead = addresses[0] + place + 2 * m
                            if first + k + 1 < addresses.size:
                                ahead = addresses[first + k + 1] + place
                            source = carray(here, m // 2, np.uint32)
                            lowest, high, even, odd = _copy_pairs(source, words, k * RUN, ahead)
                        else:
                            _copy(carray(here, m, like.dtype), stage, k * RUN)
                            lowest, high, even, odd = _extremes_and_totals(stage, words, k * RUN, m)
                        top = max(top, high)
                        highest[band, first + k] = max(highest[band, first + k], high)
                        if tile_cols <= 2:
                            totals[band, first + k, row_labels[0]] += np.uint64(even)
                            totals[band, first + k, row_labels[tile_cols - 1]] += np.uint64(odd)
                        else:
                            _lane_totals(stage[k * RUN : k * RUN + m], row_labels, counts, totals[band, first + k])
                        if lowest <= black or high >= white:
                            _lane_clips(stage[k * RUN : k * RUN + m], row_labels, black, white, counts, clipped[band])
                    for k in range(present, _TOGETHER):
                        stage[k * RUN : k * RUN + m] = 0
                    if top <= _NARROW:
                        _add_narrow(stage, m, part, sums[r, c:], squares[r, c:])
                    else:
                        _add_wide(stage, m, sums[r, c:], squares[r, c:])


@compiled()
def _copy_pairs(
    source: _Ints, words: _Ints, place: int, ahead: int
) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """As `_copy` and `_extremes_and_totals` in one loop, for sources that can be read two pixels at a time.

    Meanwhile the data at the address `ahead` are prefetched: the processor predicts how a run continues, but not that
    the next run is in another frame.
    """
    lowest, highest = np.uint32(_LOW_16), np.uint32(0)
    even = odd = np.uint32(0)
    at, size = np.uint64(place) // _TWO, np.uint64(source.size)
    for first in range(np.uint64(0), size, _BLOCK):
        for line in range(_BLOCK // _LINE):
            prefetch(int(ahead + np.int64(first + line * _LINE) * 4))
        for j in range(min(_BLOCK, size - first)):
            word = source[first + j]
            words[at + first + j] = word
            a = np.uint32(word & _LOW_16)
            b = np.uint32(word >> _16)
            lowest = min(lowest, min(a, b))
            highest = max(highest, max(a, b))
            even = np.uint32(even + a)
            odd = np.uint32(odd + b)
    return lowest, highest, even, odd


@compiled()
def _copy(source: _Ints, stage: _Ints, place: int) -> None:
    for j in range(np.uint64(source.size)):
        stage[np.uint64(place) + j] = source[j]


@compiled()
def _extremes_and_totals(
    stage: _Ints, words: _Ints, place: int, pixels: int
) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """Return minimum and maximum of a staged run, and the totals of its pixels at even and odd positions.

    `words` views the stage as two pixels per word, so that a mask and a shift separate even from odd.
    """
    at, m = np.uint64(place), np.uint64(pixels)
    lowest = highest = np.uint32(stage[at])
    even = odd = np.uint32(0)
    for j in range(m // _TWO):
        word = words[at // _TWO + j]
        a = np.uint32(word & _LOW_16)
        b = np.uint32(word >> _16)
        lowest = min(lowest, min(a, b))
        highest = max(highest, max(a, b))
        even = np.uint32(even + a)
        odd = np.uint32(odd + b)
    if m % _TWO:
        last = np.uint32(stage[at + m - np.uint64(1)])
        lowest = min(lowest, last)
        highest = max(highest, last)
        even = np.uint32(even + last)
    return lowest, highest, even, odd


@compiled()
def _lane_totals(pixels: _Ints, row_labels: _Ints, counts: _Ints, totals: _Ints) -> None:
    """Add a frame's total over each label."""
    lanes = LANES // row_labels.size * row_labels.size
    size, step = np.uint64(pixels.size), np.uint64(lanes)
    sums = counts[0]
    sums[:] = 0
    for first in range(np.uint64(0), size, step):
        for lane in range(min(step, size - first)):
            sums[lane] += np.uint32(pixels[first + lane])
    for lane in range(lanes):
        totals[row_labels[lane % row_labels.size]] += np.uint64(sums[lane])


@compiled()
def _lane_clips(pixels: _Ints, row_labels: _Ints, black: int, white: int, counts: _Ints, clipped: _Ints) -> None:
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
def _add_narrow(stage: _Ints, m: int, part: _Ints, sums: _Ints, squares: _Ints) -> None:
    """Add eight staged runs to the sums, if eight squares fit 32 bits.

    Two loops, because the widest type in a loop determines how many numbers a vector holds.
    """
    for j in range(np.uint64(m)):
        y0, y1 = np.uint32(stage[j]), np.uint32(stage[_R1 + j])
        y2, y3 = np.uint32(stage[_R2 + j]), np.uint32(stage[_R3 + j])
        y4, y5 = np.uint32(stage[_R4 + j]), np.uint32(stage[_R5 + j])
        y6, y7 = np.uint32(stage[_R6 + j]), np.uint32(stage[_R7 + j])
        sums[j] += np.uint32(y0 + y1 + y2 + y3 + y4 + y5 + y6 + y7)
        part[j] = np.uint32(y0 * y0 + y1 * y1 + y2 * y2 + y3 * y3 + y4 * y4 + y5 * y5 + y6 * y6 + y7 * y7)
    for j in range(np.uint64(m)):
        squares[j] += np.uint64(part[j])


@compiled()
def _add_wide(stage: _Ints, m: int, sums: _Ints, squares: _Ints) -> None:
    """Add eight staged runs to the sums, for any numbers."""
    for j in range(np.uint64(m)):
        y0, y1 = np.uint64(stage[j]), np.uint64(stage[_R1 + j])
        y2, y3 = np.uint64(stage[_R2 + j]), np.uint64(stage[_R3 + j])
        y4, y5 = np.uint64(stage[_R4 + j]), np.uint64(stage[_R5 + j])
        y6, y7 = np.uint64(stage[_R6 + j]), np.uint64(stage[_R7 + j])
        sums[j] += np.uint32(y0 + y1 + y2 + y3 + y4 + y5 + y6 + y7)
        squares[j] += y0 * y0 + y1 * y1 + y2 * y2 + y3 * y3 + y4 * y4 + y5 * y5 + y6 * y6 + y7 * y7


@compiled(parallel=True)
def label_squares(sums: _Ints, squares: _Ints, labels: _Ints, n: int, exact: _Ints, spread: F64) -> None:
    """Compute the squares that `LabelTotals` needs, by band of rows and label.

    - `sums`, `squares`: (rows, cols) S and Q, the sum and the sum of squares of each pixel over n frames.
    - `exact`: (bands, labels, 3) uint64, zeros: becomes the sum of Q, and those of the low and high 32 bits of S^2,
      which cannot overflow.
    - `spread`: (bands, labels), zeros: becomes the sum of (n Q - S^2)^2 in floating point.
    """
    rows = sums.shape[0]
    tile_rows, tile_cols = labels.shape
    lanes = LANES // tile_cols * tile_cols
    for band in prange(exact.shape[0]):
        whole = np.zeros((3, LANES), np.uint64)
        rounded = np.zeros(LANES, np.float64)
        for r in range(band * BAND, min(rows, (band + 1) * BAND)):
            whole[:] = 0
            rounded[:] = 0.0
            _lane_squares(sums[r], squares[r], lanes, np.uint64(n), whole[0], whole[1], whole[2], rounded)
            for lane in range(lanes):
                label = labels[r % tile_rows, lane % tile_cols]
                for part in range(3):
                    exact[band, label, part] += whole[part, lane]
                spread[band, label] += rounded[lane]


@compiled()
def _lane_squares(
    sums: _Ints, squares: _Ints, lanes: int, n: np.uint64, q_total: _Ints, s_low: _Ints, s_high: _Ints, rounded: F64
) -> None:
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


@compiled(parallel=True)
def mean_map(sums: _Ints, n: int, out: F64) -> None:
    """Compute (rows, cols) S / n in `out`."""
    rows, cols = sums.shape
    for r in prange(rows):
        for c in range(np.uint64(cols)):
            out[r, c] = np.float64(sums[r, c]) / np.float64(n)


@compiled(parallel=True)
def variance_map(sums: _Ints, squares: _Ints, n: int, out: F64) -> None:
    """Compute (rows, cols) (n Q - S^2) / (n (n - 1)) in `out`, with an exact numerator."""
    rows, cols = sums.shape
    divisor = np.float64(n) * np.float64(n - 1)
    for r in prange(rows):
        for c in range(np.uint64(cols)):
            s = np.uint64(sums[r, c])
            out[r, c] = np.float64(np.int64(np.uint64(n) * squares[r, c] - s * s)) / divisor
