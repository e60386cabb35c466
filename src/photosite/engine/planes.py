"""Passes over maps of floating-point numbers: sums of lines, powers of residuals, smoothing, linear combinations.

Sums are taken in a fixed order, in lanes that become vector instructions, so that a result does not depend on
how many threads worked on it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange

_LANES = 32
_BAND = 32
"""Rows that a thread takes at a time."""


@compiled()
def _row_sum(values: NDArray[np.float64], lanes: NDArray[np.float64]) -> float:
    lanes[:] = 0.0
    whole = np.uint64(values.size) // np.uint64(_LANES) * np.uint64(_LANES)
    for first in range(np.uint64(0), whole, np.uint64(_LANES)):
        for lane in range(np.uint64(_LANES)):
            lanes[lane] += values[first + lane]
    total = 0.0
    for lane in range(_LANES):
        total += lanes[lane]
    for j in range(whole, np.uint64(values.size)):
        total += values[j]
    return total


@compiled(parallel=True)
def _line_sums(values: NDArray[np.float64], rows_out: NDArray[np.float64], bands_out: NDArray[np.float64]) -> None:
    rows, cols = values.shape
    for band in prange(bands_out.shape[0]):
        lanes = np.empty(_LANES)
        columns = bands_out[band]
        for r in range(band * _BAND, min(rows, (band + 1) * _BAND)):
            row = values[r]
            rows_out[r] = _row_sum(row, lanes)
            for c in range(cols):
                columns[c] += row[c]


def line_means(values: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """The mean of a map, of its rows and of its columns.

    Parameters
    ----------
    values
        (rows, cols), C-contiguous.

    Returns
    -------
    float, ndarray, ndarray
        Mean; (rows,); (cols,).

    Examples
    --------
    >>> mean, rows, cols = line_means(np.array([[1.0, 2.0], [3.0, 6.0]]))
    >>> mean, rows.tolist(), cols.tolist()
    (3.0, [1.5, 4.5], [2.0, 4.0])
    """
    rows, cols = values.shape
    row_sums = np.empty(rows)
    bands = np.zeros((-(-rows // _BAND), cols))
    _line_sums(values, row_sums, bands)
    return float(row_sums.sum()) / values.size, row_sums / cols, bands.sum(axis=0) / rows


@compiled(parallel=True)
def _residual_powers(
    values: NDArray[np.float64], rows_off: NDArray[np.float64], cols_off: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    rows, cols = values.shape
    for r in prange(rows):
        squares, fourths = np.zeros(_LANES), np.zeros(_LANES)
        row = values[r]
        off = rows_off[r]
        whole = np.uint64(cols) // np.uint64(_LANES) * np.uint64(_LANES)
        for first in range(np.uint64(0), whole, np.uint64(_LANES)):
            for lane in range(np.uint64(_LANES)):
                d = row[first + lane] - off - cols_off[first + lane]
                square = d * d
                squares[lane] += square
                fourths[lane] += square * square
        for j in range(whole, np.uint64(cols)):
            d = row[j] - off - cols_off[j]
            squares[0] += d * d
            fourths[0] += d * d * d * d
        out[r, 0] = squares.sum()
        out[r, 1] = fourths.sum()


def residual_moments(
    values: NDArray[np.float64], rows_off: NDArray[np.float64], cols_off: NDArray[np.float64]
) -> tuple[float, float]:
    """Mean second and fourth power of what is left of a map when a number is taken off each row and each column.

    Parameters
    ----------
    values
        (rows, cols), C-contiguous.
    rows_off, cols_off
        (rows,), (cols,).

    Examples
    --------
    >>> residual_moments(np.array([[1.0, 5.0]]), np.array([3.0]), np.zeros(2))
    (4.0, 16.0)
    """
    sums = np.empty((values.shape[0], 2))
    _residual_powers(values, rows_off, cols_off, sums)
    second, fourth = sums.sum(axis=0) / values.size
    return float(second), float(fourth)


@compiled(parallel=True)
def smooth_separable(plane: NDArray[np.float64], kernel: NDArray[np.float64]) -> NDArray[np.float64]:
    """A map smoothed along columns and rows by one kernel, without the border that the kernel does not reach.

    Parameters
    ----------
    plane
        (rows, cols), C-contiguous.
    kernel
        (n,), odd and symmetric.

    Returns
    -------
    ndarray
        (rows - n + 1, cols - n + 1).
    """
    rows, cols = plane.shape
    taps = kernel.size
    n_rows, n_cols = rows - taps + 1, cols - taps + 1
    out = np.empty((n_rows, n_cols))
    for r in prange(n_rows):
        down = np.zeros(cols)
        for k in range(taps):
            weight = kernel[k]
            row = plane[r + k]
            for c in range(cols):
                down[c] += weight * row[c]
        target = out[r]
        target[:] = 0.0
        for k in range(taps):
            weight = kernel[k]
            shifted = down[k:]
            for c in range(n_cols):
                target[c] += weight * shifted[c]
    return out


@compiled(parallel=True)
def _add_scaled(target: NDArray[np.float64], source: NDArray[Any], factors: NDArray[np.float64]) -> None:
    rows, cols = target.shape
    for r in prange(rows):
        row, given, factor = target[r], source[r], factors[r % factors.shape[0]]
        for c in range(cols):
            row[c] += np.float64(given[c]) * factor[c]


def add_scaled(target: NDArray[np.float64], source: NDArray[Any], factors: NDArray[np.float64]) -> None:
    """Add to a map another one times factors that repeat.

    Parameters
    ----------
    target, source
        (rows, cols); the source's numbers may be integers.
    factors
        (tile rows, tile cols).

    Examples
    --------
    >>> total = np.zeros((1, 3))
    >>> add_scaled(total, np.array([[1, 2, 3]], np.uint32), np.array([[1.0, 10.0]]))
    >>> total.tolist()
    [[1.0, 20.0, 3.0]]
    """
    cols = target.shape[1]
    _add_scaled(target, source, np.tile(factors, -(-cols // factors.shape[1]))[:, :cols].copy())
