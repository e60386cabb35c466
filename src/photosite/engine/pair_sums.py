"""Exact sums of frames in files, two pixels at a time, read and added by compiled code.

`add_pairs_of_files` does the work of `frame_sums.add_rows` for whole stacks. One number of 32 bits holds the sums of
two pixels over so many frames that none overflows into its neighbor. Nothing is stored between reading and adding but a
few rows of each frame, which stay in the cache.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.file_rows import CAN_READ, read_at
from photosite.engine.jit import F64, I64, compiled, counted
from photosite.engine.run_lanes import BAND, LANES, add_lanes, copy_run, lane_clips, lane_squares
from photosite.engine.threads import thread_count

_Ints = NDArray[Any]

_STRIP_BYTES = 1 << 21
"""Bytes of rows of all frames that a thread reads at a time, so that they stay in its cache."""

_READ_BYTES = 1 << 14
"""Bytes of a frame that are read at a time, at least."""

_LEAST_TOGETHER = 4
"""Frames that one number for two pixels must hold."""

_PARTS = 8
"""Parts of a frame for each thread."""

_RUN = 1024
"""Largest number of pairs in a run."""

_LANES = LANES // 2
"""Lanes of pairs: rounded sums are added in the same order as in lanes of pixels, with the same bits."""

# Lines of a run a multiple of 4096 bytes apart would be taken for the same one by the processor's store buffer.
_STEP, _TWO_STEPS = np.uint64(_RUN + 48), np.uint64(2 * (_RUN + 48))
_LOW_16, _16 = np.uint32(0xFFFF), np.uint32(16)
_ONE, _TWO = np.uint64(1), np.uint64(2)


class LabelClips(NamedTuple):
    """Labels, and numbers at which pixels are clipped."""

    labels: I64  # (tile rows, 1 or 2)
    black: int
    white: int


class PairSums(NamedTuple):
    """The sums over frames; all but `sums` and `highest` are as in `frame_sums.StackSums`, and zeros before."""

    sums: _Ints  # (rows, cols) uint32, or (rows, cols / 2) of two pixels each
    totals: _Ints
    clipped: _Ints
    highest: _Ints
    exact: _Ints
    spread: F64
    numerators: _Ints  # (rows, cols) uint32: becomes n Q - S^2 of each pixel; (0, 0) if it is not wanted


class WatchedPixels(NamedTuple):
    """Some pixels, in the order of the rows, whose numbers are copied while frames are added."""

    # (rows + 1,) place of the first pixel of each row; (n,) their columns
    first: I64
    cols: I64
    numbers: _Ints  # (frames, n) uint16, becomes their numbers

    @classmethod
    def of(cls, at: I64, shape: tuple[int, int], frames: int) -> WatchedPixels:
        """Return the pixels, given as ascending numbers in the order of the rows, of so many frames."""
        first = np.searchsorted(at, np.arange(shape[0] + 1) * shape[1])
        return cls(first, at % max(shape[1], 1), np.zeros((frames, len(at)), np.uint16))


@compiled()
def copy_watched(lines: _Ints, rows: int, start: int, watched: WatchedPixels) -> None:
    """Copy the watched pixels from lines (frames, height, cols) of all frames, whose first row has this number."""
    first, cols, numbers = watched
    for k in range(lines.shape[0]):
        for r in range(rows):
            for i in range(first[start + r], first[start + r + 1]):
                numbers[k, i] = lines[k, r, cols[i]]


class _Files(NamedTuple):
    """What threads read."""

    # (frames,) descriptors, and positions of the first pixels
    files: I64
    places: I64
    turn: I64  # (1,) next part, for all threads, which take it without waiting for the interpreter
    step: int  # rows of a part, whole bands
    height: int  # rows that are read at a time


def add_pairs_of_files(
    places: Sequence[tuple[int, int] | None],
    clips: LabelClips,
    full_scale: int,
    into: PairSums,
    watched: WatchedPixels,
) -> bool:
    """Compute the sums of all frames of a stack; return whether it was done, which is else left to the caller.

    It is not where a file cannot be read, or numbers have so many bits that pairs are no gain; nor if numerators are
    wanted of so many frames that sums have 32 bits. Where a number is above full scale, all results but `highest` are
    wrong.

    - `places`: File descriptor and position of the first pixel of each frame; None if it is not in a file.
    - `into`: `sums` is (rows, cols) uint32, or uint16 if the sums have 16 bits; becomes the sums.
    - `watched`: Pixels whose numbers are copied.
    """
    known = [place for place in places if place is not None]
    together = 0xFFFF // full_scale
    if not CAN_READ or len(known) < len(places) or together < min(_LEAST_TOGETHER, len(known)):
        return False
    rows, cols = into.sums.shape
    files, offsets = np.array(known, np.int64).T.copy()
    step = BAND * -(-rows // (_PARTS * thread_count() * BAND))
    row_bytes = max(2 * cols, 1)
    height = min(max(_STRIP_BYTES // (row_bytes * len(known)), -(-_READ_BYTES // row_bytes)), step)
    source = _Files(files, offsets, np.zeros(1, np.int64), step, height)
    narrow = into.sums.dtype == np.uint16
    if into.numerators.size and not narrow:
        return False
    kernel, sums = (_read_and_add, into.sums.view(np.uint32)) if narrow else (_read_and_add_many, into.sums)
    of_pairs = into._replace(sums=sums)

    def add(_thread: int) -> bool:
        return kernel(source, together, clips, of_pairs, watched)

    if thread_count() == 1:
        return add(0)
    with ThreadPoolExecutor(thread_count() - 1) as others:
        left = [others.submit(add, k) for k in range(1, thread_count())]
        return all([add(0), *(thread.result() for thread in left)])


@compiled()
def _read_and_add(source: _Files, _together: int, clips: LabelClips, into: PairSums, watched: WatchedPixels) -> bool:
    """Read some rows of all frames, a few at a time, and add them, part by part until all parts are taken.

    `into.sums` has two pixels in each number. Return whether all rows of the parts could be read.
    """
    files, places, turn, step, height = source
    sums = into.sums
    row_bytes = 4 * sums.shape[1]
    lines = np.empty((files.size, height, sums.shape[1]), np.uint32)
    first = step * counted(turn.ctypes.data)
    while first < sums.shape[0]:
        last = min(first + step, sums.shape[0])
        for start in range(first, last, height):
            rows = min(height, last - start)
            for k in range(files.size):
                if not read_at(files[k], lines[k].ctypes.data, rows * row_bytes, places[k] + start * row_bytes):
                    return False
            copy_watched(lines.view(np.uint16), rows, start, watched)
            _add_lines(lines, rows, start, clips, into)
        first = step * counted(turn.ctypes.data)
    return True


@compiled()
def _add_lines(lines: _Ints, rows: int, start: int, clips: LabelClips, into: PairSums) -> None:
    """Add the first rows of lines (frames, height, pairs) to those of the sums from `start` on."""
    labels, black, white = clips
    sums, totals, clipped, highest, exact, spread, numerators = into
    tile_rows, tile_cols = labels.shape
    pairs = sums.shape[1]
    # The sums of pairs, and of the squares of even and odd pixels.
    run = np.empty(3 * _STEP, np.uint32)
    counts, rounded = np.zeros((2, LANES), np.uint32), np.zeros((2, _LANES))
    for r in range(rows):
        row_labels, band = labels[(start + r) % tile_rows], (start + r) // BAND
        even, odd = row_labels[0], row_labels[tile_cols - 1]
        for c in range(0, pairs, _RUN):
            m = min(_RUN, pairs - c)
            for k in range(lines.shape[0]):
                here = lines[k, r, c : c + m]
                lowest, high, of_even, of_odd = _add_pairs(here, run, k == 0)
                highest[band, k] = max(highest[band, k], high)
                totals[band, k, even] += np.uint64(of_even)
                totals[band, k, odd] += np.uint64(of_odd)
                if lowest <= black or high >= white:
                    lane_clips(here.view(np.uint16), row_labels, black, white, counts, clipped[band])
            squares = _square_pairs(run, lines.shape[0], sums[start + r, c : c + m])
            for label, part in ((even, squares[0]), (odd, squares[1])):
                exact[band, label, 0] += part[0]
                exact[band, label, 1] += part[1]
            if numerators.size:
                _interleave(run, m, numerators[start + r, 2 * c :])
            _add_squares(run[_STEP : _STEP + m], rounded[0])
            _add_squares(run[2 * _STEP : 2 * _STEP + m], rounded[1])
        for lane in range(_LANES):
            spread[band, even] += rounded[0, lane]
            spread[band, odd] += rounded[1, lane]
        rounded[:] = 0.0


@compiled()
def _read_and_add_many(
    source: _Files, together: int, clips: LabelClips, into: PairSums, watched: WatchedPixels
) -> bool:
    """As `_read_and_add` for any number of frames, `together` of which are added in pairs."""
    files, places, turn, step, height = source
    sums = into.sums
    pairs = sums.shape[1] // 2
    lines = np.empty((files.size, height, pairs), np.uint32)
    first = step * counted(turn.ctypes.data)
    while first < sums.shape[0]:
        last = min(first + step, sums.shape[0])
        for start in range(first, last, height):
            rows = min(height, last - start)
            for k in range(files.size):
                if not read_at(files[k], lines[k].ctypes.data, rows * 4 * pairs, places[k] + start * 4 * pairs):
                    return False
            copy_watched(lines.view(np.uint16), rows, start, watched)
            _add_many_lines(lines, rows, start, together, clips, into)
        first = step * counted(turn.ctypes.data)
    return True


@compiled()
def _add_many_lines(lines: _Ints, rows: int, start: int, together: int, clips: LabelClips, into: PairSums) -> None:
    labels, black, white = clips
    sums, totals, clipped, highest, exact, spread, _ = into
    tile_rows, tile_cols = labels.shape
    frames, pairs = lines.shape[0], lines.shape[2]
    run = np.empty(3 * _STEP, np.uint32)
    run_sums, run_squares = np.empty(2 * _RUN, np.uint32), np.empty(2 * _RUN, np.uint64)
    counts = np.zeros((2, LANES), np.uint32)
    whole, rounded = np.zeros((3, LANES), np.uint64), np.zeros(LANES)
    for r in range(rows):
        row_labels, band = labels[(start + r) % tile_rows], (start + r) // BAND
        even, odd = row_labels[0], row_labels[tile_cols - 1]
        for c in range(0, pairs, _RUN):
            m = min(_RUN, pairs - c)
            for k in range(frames):
                here = lines[k, r, c : c + m]
                lowest, high, of_even, of_odd = _add_pairs(here, run, k % together == 0)
                highest[band, k] = max(highest[band, k], high)
                totals[band, k, even] += np.uint64(of_even)
                totals[band, k, odd] += np.uint64(of_odd)
                if lowest <= black or high >= white:
                    lane_clips(here.view(np.uint16), row_labels, black, white, counts, clipped[band])
                if (k + 1) % together == 0 or k + 1 == frames:
                    _unpack_pairs(run, m, k < together, run_sums, run_squares)
            copy_run(run_sums[: 2 * m], sums[start + r, 2 * c :])
            lane_squares(run_sums[: 2 * m], run_squares[: 2 * m], LANES, np.uint64(frames), whole, rounded)
        add_lanes(whole, rounded, row_labels, LANES, exact[band], spread[band])


@compiled()
def _unpack_pairs(run: _Ints, m: int, first: bool, sums: _Ints, squares: _Ints) -> None:
    """Add the sums of pairs, and of squares of even and odd pixels, to those of pixels."""
    if first:
        sums[:] = 0
        squares[:] = 0
    for j in range(np.uint64(m)):
        sums[_TWO * j] += run[j] & _LOW_16
        sums[_TWO * j + _ONE] += run[j] >> _16
    for j in range(np.uint64(m)):
        squares[_TWO * j] += np.uint64(run[_STEP + j])
        squares[_TWO * j + _ONE] += np.uint64(run[_TWO_STEPS + j])


@compiled()
def _add_pairs(source: _Ints, run: _Ints, first: bool) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """Add pairs of pixels and the squares of both to a run, and return extremes and totals as `_copy_pairs` does."""
    lowest, highest = np.uint32(_LOW_16), np.uint32(0)
    even = odd = np.uint32(0)
    if first:
        run[:] = 0
    for j in range(np.uint64(source.size)):
        pair = source[j]
        a = np.uint32(pair & _LOW_16)
        b = np.uint32(pair >> _16)
        run[j] += pair
        run[_STEP + j] += np.uint32(a * a)
        run[_TWO_STEPS + j] += np.uint32(b * b)
        lowest = min(lowest, min(a, b))
        highest = max(highest, max(a, b))
        even = np.uint32(even + a)
        odd = np.uint32(odd + b)
    return lowest, highest, even, odd


@compiled()
def _square_pairs(run: _Ints, n: int, sums: _Ints) -> tuple[tuple[np.uint64, np.uint64], tuple[np.uint64, np.uint64]]:
    """Store a run's sums, replace Q by n Q - S^2, and return the totals of Q and S^2 of even and of odd pixels."""
    frames = np.uint32(n)
    # The low and the high 16 bits separately, in 32 bits, because 64 bits would halve the pixels in a vector.
    q_even = q_odd = s_even = s_odd = np.uint32(0)
    q_even_high = q_odd_high = s_even_high = s_odd_high = np.uint32(0)
    for j in range(np.uint64(sums.size)):
        pair, p, q = run[j], run[_STEP + j], run[_TWO_STEPS + j]
        a = np.uint32(pair & _LOW_16)
        b = np.uint32(pair >> _16)
        a, b = np.uint32(a * a), np.uint32(b * b)
        sums[j] = pair
        run[_STEP + j] = np.uint32(frames * p - a)
        run[_TWO_STEPS + j] = np.uint32(frames * q - b)
        q_even = np.uint32(q_even + (p & _LOW_16))
        q_even_high = np.uint32(q_even_high + (p >> _16))
        q_odd = np.uint32(q_odd + (q & _LOW_16))
        q_odd_high = np.uint32(q_odd_high + (q >> _16))
        s_even = np.uint32(s_even + (a & _LOW_16))
        s_even_high = np.uint32(s_even_high + (a >> _16))
        s_odd = np.uint32(s_odd + (b & _LOW_16))
        s_odd_high = np.uint32(s_odd_high + (b >> _16))
    return (
        (_joined(q_even, q_even_high), _joined(s_even, s_even_high)),
        (_joined(q_odd, q_odd_high), _joined(s_odd, s_odd_high)),
    )


@compiled()
def _interleave(run: _Ints, m: int, out: _Ints) -> None:
    for j in range(np.uint64(m)):
        out[_TWO * j] = run[_STEP + j]
        out[_TWO * j + _ONE] = run[_TWO_STEPS + j]


@compiled(inline=True)
def _joined(low: np.uint32, high: np.uint32) -> np.uint64:
    return np.uint64(low) + (np.uint64(high) << np.uint64(16))


@compiled()
def _add_squares(values: _Ints, lanes: F64) -> None:
    """Add the squares of numbers to their lanes in floating point."""
    whole = np.uint64(values.size) // np.uint64(_LANES) * np.uint64(_LANES)
    for first in range(np.uint64(0), whole, np.uint64(_LANES)):
        for lane in range(np.uint64(_LANES)):
            value = np.float64(values[first + lane])
            lanes[lane] += value * value
    for j in range(whole, np.uint64(values.size)):
        value = np.float64(values[j])
        lanes[j - whole] += value * value
