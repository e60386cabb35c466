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


@dataclass(frozen=True, eq=False)
class CellWeights:
    """What maps are weighted by in each cell: linear between two of the field's rows.

    Parameters
    ----------
    across
        (P, cols, R) in the field's rows.
    index, share
        (rows,) of each row of cells the field's row above it, and the share of that below.
    """

    across: NDArray[np.float32]
    index: NDArray[np.int64]
    share: NDArray[np.float32]


def warped_means(
    values: NDArray[np.float32],
    offset: int,
    corners: Corners,
    begin: int,
    end: int,
    weights: CellWeights | None = None,
) -> NDArray[np.float32]:
    """(end - begin, cols): means of maps over the places that rows begin to end of the cells look at, summed.

    Parameters
    ----------
    values
        (R, n, map cols): rows `offset`, `offset + 1`, ... of the maps, at least those of `corners.span(begin, end)`.
    corners
        The cells.
    weights
        Of each map in each of these rows' cells; None: 1.
    """
    # The maps of a place lie together: they share the way there.
    maps = np.ascontiguousarray(np.moveaxis(values, 0, 2))
    before = np.zeros((maps.shape[0], maps.shape[1] + 1, maps.shape[2]))
    np.cumsum(maps, axis=1, dtype=np.float64, out=before[:, 1:])
    rows, cols = end - begin, corners.x_m.size - 1
    if weights is None:
        ones = np.ones((1, cols, maps.shape[2]), np.float32)
        weights = CellWeights(ones, np.zeros(rows, np.int64), np.zeros(rows, np.float32))
    out = np.empty((rows, cols), np.float32)
    _warped_means(
        maps,
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
        weights.across,
        weights.index,
        weights.share,
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
    across: NDArray[np.float32],
    index: NDArray[np.int64],
    share: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    rows, cols = out.shape
    maps = values.shape[2]
    for chunk in prange((rows + _CHUNK - 1) // _CHUNK):
        first, last = chunk * _CHUNK, min((chunk + 1) * _CHUNK, rows)
        # Of the corners above and below a row of cells: where they look, in which sample that is, and the integrals
        # from each to the next, if somebody asked for them yet.
        x_above, y_above, along_above = np.empty(cols + 1), np.empty(cols + 1), np.empty((cols + 1, maps))
        x_below, y_below, along_below = np.empty(cols + 1), np.empty(cols + 1), np.empty((cols + 1, maps))
        in_above, in_below = np.empty(cols + 1, np.int64), np.empty(cols + 1, np.int64)
        known_above, known_below = np.zeros(cols + 1, np.bool_), np.zeros(cols + 1, np.bool_)
        left, right = np.empty(maps), np.empty(maps)
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
            known_below[:] = False
            known_left = False
            part = share[r]
            upper, lower = across[index[r]], across[min(index[r] + 1, across.shape[0] - 1)]
            for c in range(cols):
                d = c + 1
                total = 0.0
                if in_above[c] == in_above[d] == in_below[c] == in_below[d]:
                    row, col = in_above[c] // sizes[1] - offset, in_above[c] % sizes[1]
                    for k in range(maps):
                        weight = upper[c, k] + part * (lower[c, k] - upper[c, k])
                        total += values[row, col, k] * weight
                    out[r, c] = total
                    known_left = False
                    continue
                if not known_left:
                    _integral(values, before, offset, map_rows, x_above[c], y_above[c], x_below[c], y_below[c], left)
                if not known_above[c]:
                    _integral(
                        values, before, offset, map_rows, x_above[c], y_above[c], x_above[d], y_above[d], along_above[c]
                    )
                _integral(values, before, offset, map_rows, x_above[d], y_above[d], x_below[d], y_below[d], right)
                _integral(
                    values, before, offset, map_rows, x_below[c], y_below[c], x_below[d], y_below[d], along_below[c]
                )
                known_left = known_below[c] = True
                # Twice the area: the product of the diagonals.
                area = (x_below[d] - x_above[c]) * (y_below[c] - y_above[d]) - (y_below[d] - y_above[c]) * (
                    x_below[c] - x_above[d]
                )
                for k in range(maps):
                    weight = upper[c, k] + part * (lower[c, k] - upper[c, k])
                    total += weight * (2.0 * (along_above[c, k] + right[k] - along_below[c, k] - left[k]) / area)
                    left[k] = right[k]
                out[r, c] = total
            x_above, x_below = x_below, x_above
            y_above, y_below = y_below, y_above
            in_above, in_below = in_below, in_above
            along_above, along_below = along_below, along_above
            known_above, known_below = known_below, known_above


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
    out: NDArray[np.float64],
) -> None:
    """Each map's integral of F dy along a straight line, piece by piece between the map's rows."""
    out[:] = 0.0
    if y0 < y1:
        _integral_down(values, before, offset, map_rows, x0, y0, x1, y1, 1.0, out)
    elif y0 > y1:
        _integral_down(values, before, offset, map_rows, x1, y1, x0, y0, -1.0, out)


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
    sign: float,
    out: NDArray[np.float64],
) -> None:
    slope = (x1 - x0) / (y1 - y0)
    row = int(np.floor(y0))
    x, y = x0, y0
    while y1 > row + 1:
        inside = min(max(row, 0), map_rows - 1) - offset
        border = row + 1.0
        at = x0 + slope * (border - y0)
        _add_mean_before(values[inside], before[inside], x, at, sign * (border - y), out)
        x, y, row = at, border, row + 1
    inside = min(max(row, 0), map_rows - 1) - offset
    _add_mean_before(values[inside], before[inside], x, x1, sign * (y1 - y), out)


@compiled()
def _add_mean_before(
    values: NDArray[np.float32],
    before: NDArray[np.float64],
    x0: float,
    x1: float,
    height: float,
    out: NDArray[np.float64],
) -> None:
    """`height` times the mean of F between two places of a row; beyond its ends the row repeats its last samples."""
    last = values.shape[0] - 1
    low, high = min(x0, x1), max(x0, x1)
    first, final = min(max(int(np.floor(low)), 0), last), min(max(int(np.floor(high)), 0), last)
    if first == final:  # F is straight here
        into = (low + high) * 0.5 - first
        for k in range(out.size):
            out[k] += height * (before[first, k] + into * values[first, k])
        return
    x = low
    for sample in range(first, final + 1):
        end = min(high, sample + 1.0) if sample < final else high
        share, into = height * (end - x) / (high - low), (x + end) * 0.5 - sample
        for k in range(out.size):
            out[k] += share * (before[sample, k] + into * values[sample, k])
        x = end
