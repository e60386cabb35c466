"""The kernels of `FrameSums`: several frames to a pass over each run of pixels, at about the speed of memory.

A run is a piece of a row short enough for the inner caches. The pixels of eight frames are copied there, each frame's
extremes and totals are taken, and then the eight are folded into the run's sums at once. The sums themselves travel
from memory and back once a call, however many frames it brings.

What a run tells of labels is first kept in *lanes*: position in the run modulo a multiple of the tile's columns. Lanes
are neighbours in memory, so that their loops become vector instructions whatever the tile.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import carray, compiled, pointer, prange, prefetch

_Ints = NDArray[Any]
"""An array of the integer type that its caller allocates; numba compiles for the one that comes."""

RUN = 4096
"""Pixels of a run, at most."""

LANES = 64
"""Lanes, at most."""

BAND = 16
"""Rows that a thread takes at a time."""

_TOGETHER = 8
"""Frames folded into the sums at once."""

_NARROW = 23_170
"""The highest number of which eight squares add up to less than 2^32."""

# Unsigned, because numba asks of a signed index whether it counts from the end, and then nothing vectorises.
_TWO, _LOW_32, _32 = np.uint64(2), np.uint64(0xFFFFFFFF), np.uint64(32)
_BLOCK, _LINE = np.uint64(64), np.uint64(16)  # in pairs of pixels: fetched at a time; in a line of the caches
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
    anew: bool,
    sums: _Ints,
    squares: _Ints,
    totals: _Ints,
    clipped: _Ints,
    highest: _Ints,
) -> None:
    """Add frames to the per-pixel sums.

    Parameters
    ----------
    addresses
        (frames,) where each frame's pixels lie, C-contiguous; an array of arrays is nothing numba can take.
    like
        An array of the frames' type.
    paired
        Whether the frames are of 16 bits, their columns are even and their addresses multiples of four.
    labels
        (tile rows, tile cols); at most LANES columns.
    black, white
        The clips.
    anew
        Whether these frames are the first, so that what the sums hold is overwritten.
    sums, squares
        (rows, cols) uint32 and uint64, added to.
    totals
        (bands, frames, labels) uint64, zeros: becomes each frame's total over each label, by bands of rows.
    clipped
        (bands, labels, 2) int64, zeros: numbers at or below black, at or above white.
    highest
        (bands, frames) uint32, zeros: highest number.
    """
    rows, cols = sums.shape
    tile_rows, tile_cols = labels.shape
    run = RUN // (2 * tile_cols) * 2 * tile_cols  # each begins with the tile's first column, and with a pair
    for band in prange(totals.shape[0]):
        stage = np.zeros(_TOGETHER * RUN, np.uint16)
        words = stage.view(np.uint32)
        part = np.empty(RUN, np.uint32)
        counts = np.zeros((2, LANES), np.uint32)
        for r in range(band * BAND, min(rows, (band + 1) * BAND)):
            row_labels = labels[r % tile_rows]
            for c in range(0, cols, run):
                m = min(run, cols - c)
                if anew:
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
                            lowest, high, even, odd = _take_words(source, words, k * RUN, ahead)
                        else:
                            _copy(carray(here, m, like.dtype), stage, k * RUN)
                            lowest, high, even, odd = _look(stage, words, k * RUN, m)
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
                        _fold_narrow(stage, m, part, sums[r, c:], squares[r, c:])
                    else:
                        _fold_wide(stage, m, sums[r, c:], squares[r, c:])


@compiled()
def _take_words(
    source: _Ints, words: _Ints, place: int, ahead: int
) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """What `_copy` and `_look` do, in one go, where the source can be taken two pixels at a time.

    Meanwhile what lies at the address `ahead` is fetched: the processor foresees how one run goes on, not that the next
    one lies in another frame.
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
def _look(stage: _Ints, words: _Ints, place: int, pixels: int) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """Lowest and highest of a staged run, and the totals of the pixels at even and at odd places.

    `words` are the stage's bytes, two pixels to each: to part even from odd is then a mask and a shift.
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
    """A frame's total over each label."""
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
    """Numbers at or below black and at or above white, of each label."""
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
def _fold_narrow(stage: _Ints, m: int, part: _Ints, sums: _Ints, squares: _Ints) -> None:
    """Eight staged runs into the sums, where eight squares fit into 32 bits.

    Two loops, because a loop's vectors hold as many numbers as there is room for of its widest type.
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
def _fold_wide(stage: _Ints, m: int, sums: _Ints, squares: _Ints) -> None:
    """Eight staged runs into the sums, whatever the numbers."""
    for j in range(np.uint64(m)):
        y0, y1 = np.uint64(stage[j]), np.uint64(stage[_R1 + j])
        y2, y3 = np.uint64(stage[_R2 + j]), np.uint64(stage[_R3 + j])
        y4, y5 = np.uint64(stage[_R4 + j]), np.uint64(stage[_R5 + j])
        y6, y7 = np.uint64(stage[_R6 + j]), np.uint64(stage[_R7 + j])
        sums[j] += np.uint32(y0 + y1 + y2 + y3 + y4 + y5 + y6 + y7)
        squares[j] += y0 * y0 + y1 * y1 + y2 * y2 + y3 * y3 + y4 * y4 + y5 * y5 + y6 * y6 + y7 * y7


@compiled(parallel=True)
def label_squares(
    sums: _Ints, squares: _Ints, labels: _Ints, n: int, exact: _Ints, spread: NDArray[np.float64]
) -> None:
    """By band of rows and label, what `LabelTotals` needs of the squares.

    Parameters
    ----------
    sums, squares
        (rows, cols), S and Q of a pixel: its sum and sum of squares over n frames.
    labels
        (tile rows, tile cols).
    n
        Frames.
    exact
        (bands, labels, 3) uint64, zeros: sum of Q, and of S^2 the low and the high halves of 32 bits, which cannot
        overflow.
    spread
        (bands, labels), zeros: sum of (n Q - S^2)^2, rounded.
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
    sums: _Ints,
    squares: _Ints,
    lanes: int,
    n: np.uint64,
    q_total: _Ints,
    s_low: _Ints,
    s_high: _Ints,
    rounded: NDArray[np.float64],
) -> None:
    for first in range(np.uint64(0), np.uint64(sums.size), np.uint64(lanes)):
        for lane in range(min(np.uint64(lanes), np.uint64(sums.size) - first)):
            s = np.uint64(sums[first + lane])
            q = squares[first + lane]
            square = s * s
            q_total[lane] += q
            s_low[lane] += square & _LOW_32
            s_high[lane] += square >> _32
            v = np.float64(np.int64(n * q - square))  # below 2^62: signed converts faster
            rounded[lane] += v * v


@compiled(parallel=True)
def mean_map(sums: _Ints, n: int, out: NDArray[np.float64]) -> None:
    """(rows, cols) S / n, into `out`."""
    rows, cols = sums.shape
    for r in prange(rows):
        for c in range(np.uint64(cols)):
            out[r, c] = np.float64(sums[r, c]) / np.float64(n)


@compiled(parallel=True)
def variance_map(sums: _Ints, squares: _Ints, n: int, out: NDArray[np.float64]) -> None:
    """(rows, cols) (n Q - S^2) / (n (n - 1)), the numerator exact, into `out`."""
    rows, cols = sums.shape
    divisor = np.float64(n) * np.float64(n - 1)
    for r in prange(rows):
        for c in range(np.uint64(cols)):
            s = np.uint64(sums[r, c])
            out[r, c] = np.float64(np.int64(np.uint64(n) * squares[r, c] - s * s)) / divisor
