"""Exact sums of the rows and columns of frames: what noise that a whole line shares is seen in."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled

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
    """Row sums and column sums of each frame, exact, kept apart by the sites of a repeating tile.

    One thread works on a frame, so that threads which read frames may call it.

    The plane of the tile's site (r, c), which holds rows r, r + tile rows ... and columns c, c + tile cols ..., has the
    row sums `row_sums[:, r::tile_rows, c]` and the column sums `column_sums[:, r, c::tile_cols]`.

    Parameters
    ----------
    frames
        Frames (rows, cols) of uint8 or uint16, all of one size; taken one at a time.
    tile
        (tile rows, tile cols).

    Returns
    -------
    row_sums, column_sums
        (frames, rows, tile cols) and (frames, tile rows, cols) uint32.

    Raises
    ------
    ValueError
        If there is no frame, one has another size or type, or a side is longer than 65 536.

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
            raise ValueError(f"a frame here is {shape} of uint8 or uint16, not {frame.shape} of {frame.dtype}")
        if max(shape) > LONGEST_LINE:
            raise ValueError(f"a row or column has at most {LONGEST_LINE} pixels, not {max(shape)}")
        rows, cols = shape
        row_sums = np.empty((rows, tile[1]), np.uint32)
        column_sums = np.zeros((tile[0], cols), np.uint32)
        _line_sums(np.ascontiguousarray(frame), row_sums, column_sums)
        by_row.append(row_sums)
        by_column.append(column_sums)
    if not by_row:
        raise ValueError("line sums need a frame")
    return np.stack(by_row), np.stack(by_column)
