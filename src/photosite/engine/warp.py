"""Maps laid on cells that look elsewhere: distortion, as means over the places where each cell's light comes from.

A cell's corners are followed back through the lens to the map; the cell's value is the map's mean over the
quadrilateral between them. With F(x, y) the integral of the map along its row from 0 to x, Green's theorem makes that
mean an integral around the quadrilateral,

    mean = (1 / area) * closed integral of F dy,

exact for a map that is constant within each sample. Neighbouring cells share corners and edges: of the map's
light none is lost and none counted twice. Where nothing is moved, the mean is that of the plain laying.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange

_CHUNK = 16
"""Rows of cells that a thread takes at a time: all but the first find their upper edges done."""


@dataclass(frozen=True, eq=False)
class Warp:
    """Where the light of a place on the sensor would fall without distortion.

    Parameters
    ----------
    scale
        (n,) undistorted over distorted distance from the axis, at squared distorted distances 0, step, 2 step, ...;
        2 or more; linear between these, and that of the last beyond it. Scale times distance must increase.
    step_m2
        Distance of nodes, m^2.
    pitch_m
        (vertical, horizontal) distance of pixels: the axis passes through the middle of the frame.
    """

    scale: NDArray[np.float64]
    step_m2: float
    pitch_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of a grid of cells, and the map they look at through a warp.

    Parameters
    ----------
    warp
        What moves them.
    y_m, x_m
        (rows + 1,), (cols + 1,) increasing: where the borders between cells stand, 0 on the axis.
    axis
        (row, col) map coordinate of the axis; sample j covers j to j + 1.
    per_m
        (row, col) map samples per m.
    shape
        (rows, cols) of the map; beyond its border it repeats its border samples.
    """

    warp: Warp
    y_m: NDArray[np.float64]
    x_m: NDArray[np.float64]
    axis: tuple[float, float]
    per_m: tuple[float, float]
    shape: tuple[int, int]

    def span(self, begin: int, end: int) -> tuple[int, int]:
        """The rows of the map that rows begin to end of the cells look at: from the first to after the last."""
        # A warp that does not fold keeps the order of places along a column: the outer corners look farthest.
        looked = [self.axis[0] + self._scale(row) * self.y_m[row] * self.per_m[0] for row in (begin, end)]
        last = self.shape[0] - 1
        first, final = (int(np.clip(np.floor(limit), 0, last)) for limit in (looked[0].min(), looked[1].max()))
        return first, final + 1

    def _scale(self, row: int) -> NDArray[np.float64]:
        nodes = np.arange(self.warp.scale.size) * self.warp.step_m2
        scale: NDArray[np.float64] = np.interp(self.y_m[row] ** 2 + self.x_m**2, nodes, self.warp.scale)
        return scale


def warped_means(
    values: NDArray[np.float32], offset: int, corners: Corners, begin: int, end: int
) -> NDArray[np.float32]:
    """(end - begin, cols): means of a map over the places that rows begin to end of the cells look at.

    Parameters
    ----------
    values
        (n, map cols): rows `offset`, `offset + 1`, ... of the map, at least those of `corners.span(begin, end)`.
    corners
        The cells.
    """
    before = np.zeros((values.shape[0], values.shape[1] + 1))
    np.cumsum(values, axis=1, dtype=np.float64, out=before[:, 1:])
    out = np.empty((end - begin, corners.x_m.size - 1), np.float32)
    _warped_means(
        values,
        before,
        offset,
        corners.shape[0],
        corners.warp.scale,
        corners.warp.step_m2,
        corners.y_m[begin : end + 1],
        corners.x_m,
        corners.axis[0],
        corners.axis[1],
        corners.per_m[0],
        corners.per_m[1],
        out,
    )
    return out


@compiled(parallel=True)
def _warped_means(
    values: NDArray[np.float32],
    before: NDArray[np.float64],
    offset: int,
    map_rows: int,
    scale: NDArray[np.float64],
    step_m2: float,
    y_m: NDArray[np.float64],
    x_m: NDArray[np.float64],
    axis_row: float,
    axis_col: float,
    rows_per_m: float,
    cols_per_m: float,
    out: NDArray[np.float32],
) -> None:
    rows, cols = out.shape
    for chunk in prange((rows + _CHUNK - 1) // _CHUNK):
        first, last = chunk * _CHUNK, min((chunk + 1) * _CHUNK, rows)
        # Of the corners above and below a row of cells: where they look, in which sample that is, and the integral from
        # each to the next, NaN where nobody asked for it yet.
        x_above, y_above, along_above = np.empty(cols + 1), np.empty(cols + 1), np.empty(cols + 1)
        x_below, y_below, along_below = np.empty(cols + 1), np.empty(cols + 1), np.empty(cols + 1)
        in_above, in_below = np.empty(cols + 1, np.int64), np.empty(cols + 1, np.int64)
        sizes = map_rows, values.shape[1]
        _look(
            scale,
            step_m2,
            y_m[first],
            x_m,
            axis_row,
            axis_col,
            rows_per_m,
            cols_per_m,
            sizes,
            x_above,
            y_above,
            in_above,
        )
        along_above[:] = np.nan
        for r in range(first, last):
            _look(
                scale,
                step_m2,
                y_m[r + 1],
                x_m,
                axis_row,
                axis_col,
                rows_per_m,
                cols_per_m,
                sizes,
                x_below,
                y_below,
                in_below,
            )
            along_below[:] = np.nan
            left = np.nan
            for c in range(cols):
                d = c + 1
                if in_above[c] == in_above[d] == in_below[c] == in_below[d]:
                    out[r, c] = values[in_above[c] // sizes[1] - offset, in_above[c] % sizes[1]]
                    left = np.nan
                    continue
                if np.isnan(left):
                    left = _integral(values, before, offset, map_rows, x_above[c], y_above[c], x_below[c], y_below[c])
                if np.isnan(along_above[c]):
                    along_above[c] = _integral(
                        values, before, offset, map_rows, x_above[c], y_above[c], x_above[d], y_above[d]
                    )
                right = _integral(values, before, offset, map_rows, x_above[d], y_above[d], x_below[d], y_below[d])
                along_below[c] = _integral(
                    values, before, offset, map_rows, x_below[c], y_below[c], x_below[d], y_below[d]
                )
                # Twice the area: the product of the diagonals.
                area = (x_below[d] - x_above[c]) * (y_below[c] - y_above[d]) - (y_below[d] - y_above[c]) * (
                    x_below[c] - x_above[d]
                )
                out[r, c] = 2.0 * (along_above[c] + right - along_below[c] - left) / area
                left = right
            x_above, x_below = x_below, x_above
            y_above, y_below = y_below, y_above
            in_above, in_below = in_below, in_above
            along_above, along_below = along_below, along_above


@compiled()
def _look(
    scale: NDArray[np.float64],
    step_m2: float,
    y_m: float,
    x_m: NDArray[np.float64],
    axis_row: float,
    axis_col: float,
    rows_per_m: float,
    cols_per_m: float,
    sizes: tuple[int, int],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    sample: NDArray[np.int64],
) -> None:
    """Where in the map a row of corners looks, and the number of the sample there."""
    last, per_m2 = scale.size - 2, 1.0 / step_m2
    for c in range(x_m.size):
        position = (y_m * y_m + x_m[c] * x_m[c]) * per_m2
        node = min(int(position), last)
        share = min(position - node, 1.0)
        factor = scale[node] + share * (scale[node + 1] - scale[node])
        x[c] = axis_col + factor * (x_m[c] * cols_per_m)
        y[c] = axis_row + factor * (y_m * rows_per_m)
    for c in range(x_m.size):
        # Beyond its border the map repeats its border samples: cells there are within these.
        row, col = min(max(y[c], 0.0), sizes[0] - 1.0), min(max(x[c], 0.0), sizes[1] - 1.0)
        sample[c] = int(row) * sizes[1] + int(col)


@compiled()
def _integral(
    values: NDArray[np.float32],
    before: NDArray[np.float64],
    offset: int,
    map_rows: int,
    x0: float,
    y0: float,
    x1: float,
    y1: float,
) -> float:
    """The integral of F dy along a straight line, piece by piece between the map's rows."""
    if y0 == y1:
        return 0.0
    if y0 > y1:
        return -_integral_down(values, before, offset, map_rows, x1, y1, x0, y0)
    return _integral_down(values, before, offset, map_rows, x0, y0, x1, y1)


@compiled()
def _integral_down(
    values: NDArray[np.float32],
    before: NDArray[np.float64],
    offset: int,
    map_rows: int,
    x0: float,
    y0: float,
    x1: float,
    y1: float,
) -> float:
    slope = (x1 - x0) / (y1 - y0)
    row = int(np.floor(y0))
    x, y, total = x0, y0, 0.0
    while True:
        inside = min(max(row, 0), map_rows - 1) - offset
        if y1 <= row + 1:
            return total + (y1 - y) * _mean_before(values[inside], before[inside], x, x1)
        border = row + 1.0
        at = x0 + slope * (border - y0)
        total += (border - y) * _mean_before(values[inside], before[inside], x, at)
        x, y, row = at, border, row + 1


@compiled()
def _mean_before(values: NDArray[np.float32], before: NDArray[np.float64], x0: float, x1: float) -> float:
    """The mean of F between two places of a row; beyond its ends the row repeats its last samples."""
    last = values.size - 1
    low, high = min(x0, x1), max(x0, x1)
    first, final = min(max(int(np.floor(low)), 0), last), min(max(int(np.floor(high)), 0), last)
    if first == final:  # F is straight here
        return float(before[first]) + ((low + high) * 0.5 - first) * float(values[first])
    total, x = 0.0, low
    for sample in range(first, final + 1):
        end = min(high, sample + 1.0) if sample < final else high
        total += (end - x) * (float(before[sample]) + ((x + end) * 0.5 - sample) * float(values[sample]))
        x = end
    return total / (high - low)
