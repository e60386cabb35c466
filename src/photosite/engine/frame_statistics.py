"""Statistics of single frames: exact line sums, and residuals about the mean of a stack."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.arrays import F32, F64, I64
from photosite.engine.jit import compiled, prange

LONGEST_LINE = 1 << 16
"""Pixels of a row or column, so that a sum of 16-bit numbers stays below 2^32."""


@compiled()
def _line_sums(frame: NDArray[Any], rows_out: NDArray[np.uint32], columns_out: NDArray[np.uint32]) -> None:
    rows, cols = frame.shape
    tile_cols, tile_rows = rows_out.shape[1], columns_out.shape[0]
    for r in range(rows):
        row, columns = frame[r], columns_out[r % tile_rows]
        for c in range(cols):
            columns[c] += row[c]
        for phase in range(tile_cols):
            total = np.uint32(0)
            for c in range(phase, cols, tile_cols):
                total += row[c]
            rows_out[r, phase] = total


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
        _line_sums(np.ascontiguousarray(frame), row_sums, column_sums)
        by_row.append(row_sums)
        by_column.append(column_sums)
    if not by_row:
        raise ValueError("line sums need at least one frame")
    return np.stack(by_row), np.stack(by_column)


@compiled(parallel=True)
def add_residuals(
    frame: NDArray[Any],
    total: NDArray[Any],
    count: int,
    row_shift: F64,
    column_shift: F64,
    bins_per_dn: float,
    fourth: F32,
    histogram: I64,
) -> None:
    """Add the residuals of one frame, its digital numbers minus the mean of each pixel over the stack.

    - `frame`: (rows, cols) uint8 or uint16.
    - `total`, `count`: (rows, cols) sum over the stack that the frame belongs to, and the number of frames in it.
    - `row_shift`, `column_shift`: (rows,), (cols,) offset of each line in this frame, for the histogram only.
    - `bins_per_dn`: Bins of the histogram per digital number.
    - `fourth`: (rows, cols) sum of the fourth powers of the residuals; updated in place.
    - `histogram`: (blocks, bins) residuals by block of rows: the rows are divided evenly into as many blocks as it has
      rows. Updated in place. The center of the bins is 0; the first and the last bin also count what lies beyond them.
    """
    rows, cols = frame.shape
    blocks, bins = histogram.shape
    inverse = 1.0 / count
    middle = 0.5 * bins
    for block in prange(blocks):
        counts = histogram[block]
        for r in range(block * rows // blocks, (block + 1) * rows // blocks):
            for c in range(cols):
                d = float(frame[r, c]) - float(total[r, c]) * inverse
                square = d * d
                fourth[r, c] += np.float32(square * square)
                place = (d - row_shift[r] - column_shift[c]) * bins_per_dn + middle
                counts[int(min(max(place, 0.0), bins - 1.0))] += 1
