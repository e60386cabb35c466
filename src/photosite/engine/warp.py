"""Distortion: resampling of maps by means over the place in the map that each cell sees through the lens.

The corners of a cell are traced back through the lens to the map. The cell's value is the map's mean over the
quadrilateral between them. With F(x, y) the integral of the map along its row from 0 to x, Green's theorem gives

    mean = (1 / area) * closed integral of F dy,

exact for a map that is constant within each sample. Neighbouring cells share corners and edges, so that no light is
lost or counted twice. Without distortion the mean equals that of `resample`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange

_CHUNK = 16
"""Rows of cells that a thread processes at a time; all but the first reuse the edges of the row above."""


@dataclass(frozen=True, eq=False)
class Warp:
    """The place where the light of a point on the sensor would fall without distortion.

    Parameters
    ----------
    scale
        (n,) undistorted over distorted distance from the axis, at squared distorted distances 0, step, 2 step, ...;
        n >= 2. Linear between these, constant beyond. Scale times distance must increase.
    step_m2
        Step between nodes, m^2.
    pitch_m
        (vertical, horizontal) pixel pitch; the axis passes through the centre of the frame.
    """

    scale: NDArray[np.float64]
    step_m2: float
    pitch_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of a grid of cells, and the map that they see through a warp.

    Parameters
    ----------
    warp
        The distortion.
    y_m, x_m
        (rows + 1,), (cols + 1,) increasing positions of the borders between cells, 0 on the axis.
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
        """Return the rows of the map that rows begin to end of cells see: the first, and one after the last."""
        # Scale times distance increases, so the outermost corners see the outermost rows.
        rows_seen = [self.axis[0] + self._scale(row) * self.y_m[row] * self.per_m[0] for row in (begin, end)]
        last = self.shape[0] - 1
        first, final = (int(np.clip(np.floor(limit), 0, last)) for limit in (rows_seen[0].min(), rows_seen[1].max()))
        return first, final + 1

    def _scale(self, row: int) -> NDArray[np.float64]:
        nodes = np.arange(self.warp.scale.size) * self.warp.step_m2
        scale: NDArray[np.float64] = np.interp(self.y_m[row] ** 2 + self.x_m**2, nodes, self.warp.scale)
        return scale


def warped_means(
    values: NDArray[np.float32], offset: int, corners: Corners, begin: int, end: int
) -> NDArray[np.float32]:
    """Return (R, end - begin, cols): means of maps over the places that rows begin to end of cells see.

    Parameters
    ----------
    values
        (R, n, map cols): rows `offset`, `offset + 1`, ... of the maps, at least those of `corners.span(begin, end)`.
    corners
        The cells.
    """
    # Interleave the maps: they share the computation of the place.
    maps = np.ascontiguousarray(np.moveaxis(values, 0, 2))
    before = np.zeros((maps.shape[0], maps.shape[1] + 1, maps.shape[2]))
    np.cumsum(maps, axis=1, dtype=np.float64, out=before[:, 1:])
    out = np.empty((len(values), end - begin, corners.x_m.size - 1), np.float32)
    _warped_means(
        maps,
        before,
        offset,
        corners.shape[0],
        corners.warp.scale,
        corners.warp.step_m2,
        corners.y_m[begin : end + 1],
        corners.x_m,
        corners.axis,
        corners.per_m,
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
    axis: tuple[float, float],
    per_m: tuple[float, float],
    out: NDArray[np.float32],
) -> None:
    rows = out.shape[1]
    for chunk in prange((rows + _CHUNK - 1) // _CHUNK):
        first, last = chunk * _CHUNK, min((chunk + 1) * _CHUNK, rows)
        # For the corners above and below a row of cells: their place in the map, and the sample there.
        above, below = np.empty((2, x_m.size)), np.empty((2, x_m.size))
        in_above, in_below = np.empty(x_m.size, np.int64), np.empty(x_m.size, np.int64)
        # The integrals from each corner to the next, and whether they are computed.
        along_above, along_below = np.empty((x_m.size, out.shape[0])), np.empty((x_m.size, out.shape[0]))
        known_above, known_below = np.zeros(x_m.size, np.bool_), np.zeros(x_m.size, np.bool_)
        sizes = map_rows, values.shape[1]
        _corner_places(scale, step_m2, y_m[first], x_m, axis, per_m, sizes, above, in_above)
        for r in range(first, last):
            _corner_places(scale, step_m2, y_m[r + 1], x_m, axis, per_m, sizes, below, in_below)
            known_below[:] = False
            _row_of_means(
                values,
                before,
                offset,
                map_rows,
                above,
                below,
                in_above,
                in_below,
                along_above,
                along_below,
                known_above,
                known_below,
                r,
                out,
            )
            above, below = below, above
            in_above, in_below = in_below, in_above
            along_above, along_below = along_below, along_above
            known_above, known_below = known_below, known_above


@compiled()
def _row_of_means(
    values: NDArray[np.float32],
    before: NDArray[np.float64],
    offset: int,
    map_rows: int,
    above: NDArray[np.float64],
    below: NDArray[np.float64],
    in_above: NDArray[np.int64],
    in_below: NDArray[np.int64],
    along_above: NDArray[np.float64],
    along_below: NDArray[np.float64],
    known_above: NDArray[np.bool_],
    known_below: NDArray[np.bool_],
    r: int,
    out: NDArray[np.float32],
) -> None:
    """Compute the means of the cells between two rows of corners, into out[:, r]."""
    maps = out.shape[0]
    samples = values.reshape(-1, maps)
    sides = np.empty((2, maps))  # of a cell's left and right side, alternating
    left, known_left = 0, False
    for c in range(out.shape[2]):
        d = c + 1
        if in_above[c] == in_above[d] == in_below[c] == in_below[d]:
            sample = in_above[c] - offset * values.shape[1]
            for k in range(maps):
                out[k, r, c] = samples[sample, k]
            known_left = False
            continue
        upper_left, upper_right = (above[0, c], above[1, c]), (above[0, d], above[1, d])
        lower_left, lower_right = (below[0, c], below[1, c]), (below[0, d], below[1, d])
        right = 1 - left
        if not known_left:
            _integral(values, before, offset, map_rows, upper_left, lower_left, sides, left)
        if not known_above[c]:
            _integral(values, before, offset, map_rows, upper_left, upper_right, along_above, c)
        _integral(values, before, offset, map_rows, upper_right, lower_right, sides, right)
        _integral(values, before, offset, map_rows, lower_left, lower_right, along_below, c)
        known_left = known_below[c] = True
        # Twice the area: the product of the diagonals.
        area = (lower_right[0] - upper_left[0]) * (lower_left[1] - upper_right[1]) - (
            lower_right[1] - upper_left[1]
        ) * (lower_left[0] - upper_right[0])
        for k in range(maps):
            around = along_above[c, k] + sides[right, k] - along_below[c, k] - sides[left, k]
            out[k, r, c] = 2.0 * around / area
        left = right


@compiled()
def _corner_places(
    scale: NDArray[np.float64],
    step_m2: float,
    y_m: float,
    x_m: NDArray[np.float64],
    axis: tuple[float, float],
    per_m: tuple[float, float],
    sizes: tuple[int, int],
    place: NDArray[np.float64],
    sample: NDArray[np.int64],
) -> None:
    """Compute the places (x, y) in the map of a row of corners, and the number of the sample there."""
    x, y = place[0], place[1]
    last, per_m2 = scale.size - 2, 1.0 / step_m2
    for c in range(x_m.size):
        position = (y_m * y_m + x_m[c] * x_m[c]) * per_m2
        node = min(int(position), last)
        share = min(position - node, 1.0)
        factor = scale[node] + share * (scale[node + 1] - scale[node])
        x[c] = axis[1] + factor * (x_m[c] * per_m[1])
        y[c] = axis[0] + factor * (y_m * per_m[0])
    for c in range(x_m.size):
        # Beyond its border the map repeats its border samples.
        row, col = min(max(y[c], 0.0), sizes[0] - 1.0), min(max(x[c], 0.0), sizes[1] - 1.0)
        sample[c] = int(row) * sizes[1] + int(col)


@compiled()
def _integral(
    values: NDArray[np.float32],
    before: NDArray[np.float64],
    offset: int,
    map_rows: int,
    begin: tuple[float, float],
    end: tuple[float, float],
    out: NDArray[np.float64],
    place: int,
) -> None:
    """Compute out[place], each map's integral of F dy along a straight line, row by row of the map."""
    for k in range(out.shape[1]):
        out[place, k] = 0.0
    sign = 1.0
    if begin[1] > end[1]:
        begin, end, sign = end, begin, -1.0
    (x0, y0), (x1, y1) = begin, end
    if y0 == y1:
        return
    slope = (x1 - x0) / (y1 - y0)
    row = int(np.floor(y0))
    x, y = x0, y0
    while y1 > row + 1:
        inside = min(max(row, 0), map_rows - 1) - offset
        border = row + 1.0
        at = x0 + slope * (border - y0)
        _add_mean_before(values, before, inside, x, at, sign * (border - y), out, place)
        x, y, row = at, border, row + 1
    inside = min(max(row, 0), map_rows - 1) - offset
    _add_mean_before(values, before, inside, x, x1, sign * (y1 - y), out, place)


@compiled()
def _add_mean_before(
    values: NDArray[np.float32],
    before: NDArray[np.float64],
    row: int,
    x0: float,
    x1: float,
    height: float,
    out: NDArray[np.float64],
    place: int,
) -> None:
    """Add `height` times the mean of F between two places of a row, which repeats its end samples beyond its ends."""
    last = values.shape[1] - 1
    low, high = min(x0, x1), max(x0, x1)
    first, final = min(max(int(np.floor(low)), 0), last), min(max(int(np.floor(high)), 0), last)
    if first == final:  # F is linear within a sample
        into = (low + high) * 0.5 - first
        for k in range(out.shape[1]):
            out[place, k] += height * (before[row, first, k] + into * values[row, first, k])
        return
    x = low
    for sample in range(first, final + 1):
        end = min(high, sample + 1.0) if sample < final else high
        share, into = height * (end - x) / (high - low), (x + end) * 0.5 - sample
        for k in range(out.shape[1]):
            out[place, k] += share * (before[row, sample, k] + into * values[row, sample, k])
        x = end
