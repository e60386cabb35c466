"""Statistics of maps and single frames: line sums, moments, residuals, scaled sums.

Sums are accumulated in a fixed order, in lanes that become vector instructions, so that a result does not depend on the
number of threads. A *label* is an integer that a repeating tile assigns to each pixel, such as the index of its color
channel.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, carray, compiled, pointer, read_only
from photosite.engine.lazy_maps import Map, contiguous, row_strips
from photosite.engine.threads import parallel_for

_RUN = 1024
_LABEL_LANES = 64
_SECOND, _THIRD, _FOURTH = (np.uint64(k * _LABEL_LANES) for k in (1, 2, 3))
LONGEST_LINE = 1 << 16
"""Pixels of a row or column, so that a sum of 16-bit numbers stays below 2^32."""


@compiled()
def _add_scaled(start: int, stop: int, target: F64, addresses: I64, like: NDArray[Any], factors: F64) -> None:
    cols, run = target.shape[1], factors.shape[2]
    for r in range(start, stop):
        for first in range(0, cols, run):
            row = target[r, first : min(first + run, cols)]
            for k in range(addresses.size):
                place = addresses[k] + (r * cols + first) * like.itemsize
                _add_line(row, carray(pointer(place), row.size, like.dtype), factors[k, r % factors.shape[1]])


@compiled()
def _add_line(row: F64, added: NDArray[Any], factor: F64) -> None:
    for c in range(np.uint64(row.size)):
        row[c] += np.float64(added[c]) * factor[c]


def add_scaled(target: F64, sources: Sequence[tuple[NDArray[np.unsignedinteger], F64]]) -> None:
    """Add maps of integers, each times a repeating tile of factors, to a map in place, in one pass over it.

    The tiles have the same shape.

    Examples
    --------
    >>> total, more = np.zeros((1, 3)), np.array([[1, 2, 3]], np.uint16)
    >>> add_scaled(total, [(more, np.array([[1.0, 10.0]])), (more, np.ones((1, 2)))])
    >>> total.tolist()
    [[2.0, 22.0, 6.0]]
    """
    for dtype, run in groupby(sources, key=lambda source: source[0].dtype):
        maps, tiles = zip(*run, strict=True)
        maps = [np.ascontiguousarray(values) for values in maps]  # kept alive here, because the kernel has addresses
        if any(values.shape != target.shape for values in maps):
            raise ValueError(f"maps must be {target.shape}, got {[values.shape for values in maps]}")
        # Lines of all maps are added in runs that stay in the cache, and begin with the tile's first column.
        factors = np.stack([np.tile(tile, max(_RUN // tile.shape[1], 1)) for tile in tiles])
        addresses = np.array([values.ctypes.data for values in maps])
        parallel_for(_add_scaled, len(target), target, addresses, np.empty(0, dtype), factors)


@compiled()
def _power_sums(start: int, stop: int, values: F64, labels: NDArray[Any], center: F64, out: F64) -> None:
    """Sum the first to fourth power of the deviation from `center[label]`, by row and label."""
    tile_rows, tile_cols = labels.shape
    lanes = _LABEL_LANES // tile_cols * tile_cols
    for r in range(start, stop):
        centers = np.empty(lanes)
        powers = np.zeros(4 * _LABEL_LANES)
        for lane in range(lanes):
            centers[lane] = center[labels[r % tile_rows, lane % tile_cols]]
        _lane_powers(values[r], centers, powers)
        for lane in range(lanes):
            for k in range(4):
                out[r, labels[r % tile_rows, lane % tile_cols], k] += powers[k * _LABEL_LANES + lane]


@compiled()
def _lane_powers(values: F64, centers: F64, powers: F64) -> None:
    """Add four powers to their lanes: one array, because loops that write several become no vector instructions."""
    size, lanes = np.uint64(values.size), np.uint64(centers.size)
    for first in range(np.uint64(0), size, lanes):
        for lane in range(min(lanes, size - first)):
            d = values[first + lane] - centers[lane]
            square = d * d
            powers[lane] += d
            powers[_SECOND + lane] += square
            powers[_THIRD + lane] += square * d
            powers[_FOURTH + lane] += square * square


def label_pixels(shape: tuple[int, ...], labels: NDArray[np.integer]) -> I64:
    """Return the number of pixels of each label.

    Examples
    --------
    >>> label_pixels((3, 3), np.array([[0, 1], [1, 2]])).tolist()
    [4, 4, 1]
    """
    pixels = np.zeros(int(labels.max()) + 1, np.int64)
    for (r, c), label in np.ndenumerate(labels):
        pixels[label] += len(range(r, shape[0], labels.shape[0])) * len(range(c, shape[1], labels.shape[1]))
    return pixels


@dataclass(frozen=True)
class Moments:
    """Mean, unbiased variance, and third and fourth central moments over the pixels of one label."""

    pixels: int
    mean: float
    variance: float
    third: float
    fourth: float


def label_moments(values: Map, labels: NDArray[np.integer] | None = None) -> tuple[Moments, ...]:
    """Return the moments of a map over the pixels of each label.

    `labels` is (tile rows, tile cols), a repeating tile of labels from 0, with 64 columns or fewer; None is one label
    for all pixels. Raises `ValueError` if the tile has more columns.

    Examples
    --------
    >>> label_moments(np.array([[1.0, 10.0], [3.0, 10.0]]), np.array([[0, 1]]))[0].variance
    2.0
    """
    tile = np.zeros((1, 1), np.int64) if labels is None else np.asarray(labels, np.int64)
    if tile.shape[1] > _LABEL_LANES:
        raise ValueError(f"labels must have {_LABEL_LANES} columns or fewer, got {tile.shape[1]}")
    n_labels = int(tile.max()) + 1
    center = np.array([_sampled_mean(values, tile, label) for label in range(n_labels)])
    counts = label_pixels(values.shape, tile)
    for final in (False, True):
        by_row = np.zeros((values.shape[0], n_labels, 4))
        for row, end in row_strips(values, tile.shape[0]):
            parallel_for(_power_sums, end - row, contiguous(values[row:end]), tile, center, by_row[row:end])
        first, second, third, fourth = by_row.sum(axis=0).T / counts
        # Near the mean, the moments about it follow from these without cancellation; else a second pass finds them.
        if final or (first**2 <= 0.1 * second).all():
            break
        center = center + first
    mean, variance = center + first, np.maximum(second - first**2, 0.0)
    fourth = fourth - 4.0 * first * third + 6.0 * first**2 * second - 3.0 * first**4
    third = third - 3.0 * first * second + 2.0 * first**3
    return tuple(
        Moments(int(n), float(m), float(v * n / (n - 1)) if n > 1 else 0.0, float(t), float(f))
        for n, m, v, t, f in zip(counts, mean, variance, third, fourth, strict=True)
    )


def _sampled_mean(values: Map, tile: I64, label: int) -> float:
    """Return the mean of up to 32 x 32 pixels of a label, evenly spaced."""
    (r, c), *_ = np.argwhere(tile == label).tolist()
    steps = [
        period * max(len(range(at, length, period)) // 32, 1)
        for at, length, period in zip((r, c), values.shape, tile.shape, strict=True)
    ]
    return float(values[r :: steps[0], c :: steps[1]].mean())


def remove_group_means(values: F32, groups: I64, rounds: int, tails: float) -> None:
    """Subtract means of groups from each row of values in place, and clip what is left, in several rounds.

    - `values`: (rows, n), C-contiguous.
    - `groups`: (groupings, n) index of the group of each value, from 0; the groupings follow each other.
    - `tails`: Largest deviation that is left, in medians of the sizes of a quarter of the row's deviations.
    """
    numbers = [np.maximum(np.bincount(group), 1) for group in groups]
    for row in values:
        for _ in range(rounds):
            for group, number in zip(groups, numbers, strict=True):
                row -= (np.bincount(group, row) / number).astype(np.float32)[group]
            limit = np.float32(tails * float(np.median(np.abs(row[::4]))))
            np.clip(row, -limit, limit, out=row)


# Statistics of a frame: exact line sums, and residuals about the mean of a stack.


@compiled()
def _frame_line_sums(frame: NDArray[Any], rows_out: NDArray[np.uint32], columns_out: NDArray[np.uint32]) -> None:
    rows, cols = frame.shape
    tile_cols, tile_rows = rows_out.shape[1], columns_out.shape[0]
    totals = np.empty(max(_LABEL_LANES // tile_cols, 1) * tile_cols, np.uint32)
    size, lanes = np.uint64(cols), np.uint64(totals.size)
    for r in range(rows):
        row, columns = frame[r], columns_out[r % tile_rows]
        totals[:] = 0
        for first in range(np.uint64(0), size, lanes):
            for lane in range(min(lanes, size - first)):
                value = np.uint32(row[first + lane])
                columns[first + lane] += value
                totals[lane] += value
        rows_out[r] = 0
        for lane in range(totals.size):
            rows_out[r, lane % tile_cols] += totals[lane]


def line_sums(
    frames: Iterable[NDArray[np.unsignedinteger]], tile: tuple[int, int] = (1, 1)
) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Return the exact row sums and column sums of each frame, separately for the sites of a repeating tile.

    The function is single-threaded, so that threads that read frames may call it.

    - `frames`: Frames (rows, cols) of uint8 or uint16, all of one size; consumed one at a time.
    - `tile`: (tile rows, tile cols).

    Returns `row_sums` (frames, rows, tile cols) and `column_sums` (frames, tile rows, cols), uint32. The pixels of the
    tile's site (r, c) have the row sums `row_sums[:, r::tile_rows, c]` and the column sums
    `column_sums[:, r, c::tile_cols]`.

    Raises `ValueError` if there is no frame, a frame differs in size or type, or a side is longer than 65 536.

    Examples
    --------
    >>> frame = np.array([[1, 2, 3, 4], [10, 20, 30, 40]], np.uint16)
    >>> rows, columns = line_sums([frame])
    >>> rows[0, :, 0].tolist(), columns[0, 0].tolist()
    ([10, 100], [11, 22, 33, 44])
    >>> rows, columns = line_sums([frame], tile=(2, 2))
    >>> rows[0].tolist(), columns[0].tolist()
    ([[4, 6], [40, 60]], [[1, 2, 3, 4], [10, 20, 30, 40]])
    """
    by_row, by_column = [], []
    shape: tuple[int, ...] | None = None
    for frame in frames:
        shape = shape or frame.shape
        if frame.ndim != 2 or frame.shape != shape or frame.dtype not in (np.uint8, np.uint16):
            raise ValueError(f"frames must be {shape} of uint8 or uint16, got {frame.shape} of {frame.dtype}")
        if max(shape) > LONGEST_LINE:
            raise ValueError(f"a row or column must have at most {LONGEST_LINE} pixels, got {max(shape)}")
        rows, cols = shape
        row_sums = np.empty((rows, tile[1]), np.uint32)
        column_sums = np.zeros((tile[0], cols), np.uint32)
        _frame_line_sums(read_only(frame), row_sums, column_sums)
        by_row.append(row_sums)
        by_column.append(column_sums)
    if not by_row:
        raise ValueError("line sums need at least one frame")
    return np.stack(by_row), np.stack(by_column)


class FrameShift(NamedTuple):
    """Offset of a frame, and of each row and column beyond that, for the histogram only."""

    whole: float
    rows: F64
    columns: F64


class ResidualSums(NamedTuple):
    """Sums of the residuals of the frames of a stack, which `add_residuals` adds to."""

    # (rows, cols) sums of the second and fourth powers
    second: F32
    fourth: F32
    # (blocks, bins) residuals by block of rows: the rows are divided evenly. The center of the bins is 0; the first and
    # the last bin also count what lies beyond them.
    histogram: I64


def add_residuals(
    frame: NDArray[Any], total: NDArray[Any], count: int, shift: FrameShift, bins_per_dn: float, into: ResidualSums
) -> None:
    """Add the residuals of one frame: its digital numbers less its shift and the mean of each pixel over the stack.

    - `frame`: (rows, cols) uint8 or uint16.
    - `total`, `count`: (rows, cols) sum over the stack that the frame belongs to, and the number of frames in it.
    - `bins_per_dn`: Bins of the histogram per digital number.
    """
    parallel_for(_add_residuals, len(into.histogram), frame, total, count, shift, bins_per_dn, into)


@compiled()
def _add_residuals(
    start: int,
    stop: int,
    frame: NDArray[Any],
    total: NDArray[Any],
    count: int,
    shift: FrameShift,
    bins_per_dn: float,
    into: ResidualSums,
) -> None:
    second, fourth, histogram = into
    whole, row_shift, column_shift = shift
    rows, cols = frame.shape
    blocks, bins = histogram.shape
    inverse = 1.0 / count
    middle = 0.5 * bins
    for block in range(start, stop):
        counts = histogram[block]
        for r in range(block * rows // blocks, (block + 1) * rows // blocks):
            for c in range(cols):
                d = float(frame[r, c]) - float(total[r, c]) * inverse - whole
                square = d * d
                second[r, c] += np.float32(square)
                fourth[r, c] += np.float32(square * square)
                place = (d - row_shift[r] - column_shift[c]) * bins_per_dn + middle
                counts[int(min(max(place, 0.0), bins - 1.0))] += 1
