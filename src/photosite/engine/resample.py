"""Resampling by means, which conserves light: lines to another grid, and maps as cells see them through a lens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, compiled, prange

_CHUNK = 16
"""Rows of cells that a thread processes at a time; all but the first reuse the edges of the row above."""


class Overlap(NamedTuple):
    """The samples that each output covers, and their shares: entries first[i] to first[i + 1] belong to output i."""

    first: I64
    sample: I64
    share: F32

    def span(self, start: int, end: int) -> tuple[int, int]:
        """Return the samples that outputs from start to end need: the first, and one after the last."""
        needed = self.sample[self.first[start] : self.first[end]]
        return int(needed.min()), int(needed.max()) + 1


def overlap(count: int, start: float, step: float, samples: int) -> Overlap:
    """Return the overlap of outputs with samples: output i is the mean from start + step i to start + step (i + 1).

    Sample j covers j to j + 1 in these coordinates. Beyond its ends the line repeats its end samples.

    Examples
    --------
    >>> two = overlap(2, 0.5, 1.5, 3)
    >>> two.first, two.sample, two.share.round(3)
    (array([0, 2, 3]), array([0, 1, 2]), array([0.333, 0.667, 1.   ], dtype=float32))
    """
    borders = start + step * np.arange(count + 1)
    # The borders of outputs and samples cut the line into pieces of one sample and one output each.
    inner = np.arange(1, samples, dtype=np.float64)
    cuts = np.union1d(borders, inner[(inner > borders[0]) & (inner < borders[-1])])
    middle = (cuts[:-1] + cuts[1:]) / 2
    output = np.searchsorted(borders, middle, side="right") - 1
    sample = np.clip(np.floor(middle), 0, samples - 1).astype(np.int64)
    share = np.diff(cuts) / step
    first = np.searchsorted(output, np.arange(count + 1)).astype(np.int64)
    return Overlap(first, sample, share.astype(np.float32))


@compiled()
def mean_along_rows(values: F32, across: Overlap) -> F32:
    """Return (rows, count): each row of (rows, samples) resampled. Single-threaded, because strips are short."""
    first, sample, share = across
    rows, count = values.shape[0], first.size - 1
    out = np.empty((rows, count), np.float32)
    for r in range(rows):
        for i in range(count):
            total = np.float32(0.0)
            for entry in range(first[i], first[i + 1]):
                total += values[r, sample[entry]] * share[entry]
            out[r, i] = total
    return out


@compiled()
def mean_of_rows(values: F32, down: Overlap, begin: int, offset: int, out: F32) -> None:
    """Compute outputs begin, begin + 1, ... as means of whole rows; values[0] is sample number `offset`."""
    first, sample, share = down
    for i in range(out.shape[0]):
        for entry in range(first[begin + i], first[begin + i + 1]):
            row, weight = values[sample[entry] - offset], share[entry]
            if entry == first[begin + i]:
                for c in range(out.shape[1]):
                    out[i, c] = row[c] * weight
            else:
                for c in range(out.shape[1]):
                    out[i, c] += row[c] * weight


# Distortion: resampling of maps by means over the place in the map that each cell sees through the lens.
#
# The corners of a cell are traced back through the lens to the map. The cell's value is the map's mean over the
# quadrilateral between them. With F(x, y) the integral of the map along its row from 0 to x, Green's theorem gives
#
#     mean = (1 / area) * closed integral of F dy,
#
# exact for a map that is constant within each sample. Neighboring cells share corners and edges, so that no light is
# lost or counted twice. Without distortion the mean equals that of the resampled lines.


@dataclass(frozen=True, eq=False)
class Warp:
    """The place where the light of a point on the sensor would fall without distortion."""

    # (n,) undistorted over distorted distance from the axis, at squared distorted distances 0, step, 2 step, ...; n >=
    # 2. Linear between these, constant beyond. Scale times distance must increase.
    scale: F64
    step_m2: float  # step between nodes, m^2
    pitch_m: tuple[float, float]  # (vertical, horizontal) pixel pitch; the axis passes through the center of the frame


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of a grid of cells, and the map that they see through a warp."""

    warp: Warp
    # (rows + 1,), (cols + 1,) increasing positions of the borders between cells, 0 on the axis
    y_m: F64
    x_m: F64
    axis: tuple[float, float]  # (row, col) map coordinate of the axis; sample j covers j to j + 1
    per_m: tuple[float, float]  # (row, col) map samples per m
    shape: tuple[int, int]  # (rows, cols) of the map; beyond its border it repeats its border samples

    def span(self, begin: int, end: int) -> tuple[int, int]:
        """Return the rows of the map that rows begin to end of cells see: the first, and one after the last."""
        # Scale times distance increases, so the outermost corners see the outermost rows.
        rows_seen = [self.axis[0] + self._scale(row) * self.y_m[row] * self.per_m[0] for row in (begin, end)]
        last = self.shape[0] - 1
        first, final = (int(np.clip(np.floor(limit), 0, last)) for limit in (rows_seen[0].min(), rows_seen[1].max()))
        return first, final + 1

    def _scale(self, row: int) -> F64:
        nodes = np.arange(self.warp.scale.size) * self.warp.step_m2
        return np.asarray(np.interp(self.y_m[row] ** 2 + self.x_m**2, nodes, self.warp.scale))


def warped_means(values: F32, offset: int, corners: Corners, begin: int, end: int) -> F32:
    """Return (R, end - begin, cols): means of maps over the places that rows begin to end of cells see.

    `values` is (R, n, map cols): rows `offset`, `offset + 1`, ... of the maps, at least those of `corners.span`.
    """
    # Interleave the maps: they share the computation of the place.
    maps = np.ascontiguousarray(np.moveaxis(values, 0, 2))
    before = np.zeros((maps.shape[0], maps.shape[1] + 1, maps.shape[2]))
    np.cumsum(maps, axis=1, dtype=np.float64, out=before[:, 1:])
    out = np.empty((len(values), end - begin, corners.x_m.size - 1), np.float32)
    source = _Source(maps, before, offset, corners.shape[0])
    trace = _Trace(corners.warp.scale, corners.warp.step_m2, corners.x_m, *corners.axis, *corners.per_m)
    _warped_means(source, trace, corners.y_m[begin : end + 1], out)
    return out


class _Source(NamedTuple):
    """Maps, interleaved: values (n, cols, R), integrals along the rows, number of the first row, rows of the map."""

    values: F32
    before: F64
    offset: int
    map_rows: int


class _Trace(NamedTuple):
    """What traces corners back to the map; see `Warp` and `Corners`. numba needs numbers and arrays here, not pairs."""

    scale: F64
    step_m2: float
    x_m: F64
    axis_y: float
    axis_x: float
    per_m_y: float
    per_m_x: float


class _CornerRow(NamedTuple):
    """A row of corners."""

    place: F64  # (2, n) x and y in the map
    sample: I64  # (n,) number of the sample there
    # (n, R) integrals from each corner to the next, and (n,) whether they are computed
    along: F64
    known: NDArray[np.bool_]


@compiled()
def _corner_row(corners: int, maps: int) -> _CornerRow:
    known = np.zeros(corners, np.bool_)
    return _CornerRow(np.empty((2, corners)), np.empty(corners, np.int64), np.empty((corners, maps)), known)


@compiled(parallel=True)
def _warped_means(source: _Source, trace: _Trace, y_m: F64, out: F32) -> None:
    rows = out.shape[1]
    for chunk in prange((rows + _CHUNK - 1) // _CHUNK):
        _chunk_of_means(source, trace, y_m, chunk * _CHUNK, min((chunk + 1) * _CHUNK, rows), out)


@compiled()
def _chunk_of_means(source: _Source, trace: _Trace, y_m: F64, first: int, last: int, out: F32) -> None:
    # A function of its own: numba may compute allocations in a prange loop once for all its iterations.
    above, below = (_corner_row(out.shape[2] + 1, out.shape[0]), _corner_row(out.shape[2] + 1, out.shape[0]))
    _find_places(trace, y_m[first], source, above)
    for r in range(first, last):
        _find_places(trace, y_m[r + 1], source, below)
        below.known[:] = False
        _row_of_means(source, above, below, r, out)
        above, below = below, above


@compiled()
def _row_of_means(source: _Source, upper: _CornerRow, lower: _CornerRow, r: int, out: F32) -> None:
    """Compute the means of the cells between two rows of corners, into out[:, r]."""
    maps = out.shape[0]
    (above, in_above, along_above, known_above), (below, in_below, along_below, known_below) = upper, lower
    samples = source.values.reshape(-1, maps)
    sides = np.empty((2, maps))  # of a cell's left and right side, alternating
    left, known_left = 0, False
    for c in range(out.shape[2]):
        d = c + 1
        if in_above[c] == in_above[d] == in_below[c] == in_below[d]:
            sample = in_above[c] - source.offset * source.values.shape[1]
            for k in range(maps):
                out[k, r, c] = samples[sample, k]
            known_left = False
            continue
        upper_left, upper_right = (above[0, c], above[1, c]), (above[0, d], above[1, d])
        lower_left, lower_right = (below[0, c], below[1, c]), (below[0, d], below[1, d])
        right = 1 - left
        if not known_left:
            _integral(source, upper_left, lower_left, sides, left)
        if not known_above[c]:
            _integral(source, upper_left, upper_right, along_above, c)
        _integral(source, upper_right, lower_right, sides, right)
        _integral(source, lower_left, lower_right, along_below, c)
        known_left = known_below[c] = True
        # Twice the area: the product of the diagonals.
        x_down, y_down = lower_right[0] - upper_left[0], lower_right[1] - upper_left[1]
        area = x_down * (lower_left[1] - upper_right[1]) - y_down * (lower_left[0] - upper_right[0])
        for k in range(maps):
            around = along_above[c, k] + sides[right, k] - along_below[c, k] - sides[left, k]
            out[k, r, c] = 2.0 * around / area
        left = right


@compiled()
def _find_places(trace: _Trace, y_m: float, source: _Source, row: _CornerRow) -> None:
    """Compute the places in the map of a row of corners, and the samples there."""
    scale, step_m2, x_m, axis_y, axis_x, per_m_y, per_m_x = trace
    x, y = row.place[0], row.place[1]
    rows, cols = source.map_rows, source.values.shape[1]
    last, per_m2 = scale.size - 2, 1.0 / step_m2
    for c in range(x_m.size):
        position = (y_m * y_m + x_m[c] * x_m[c]) * per_m2
        node = min(int(position), last)
        share = min(position - node, 1.0)
        factor = scale[node] + share * (scale[node + 1] - scale[node])
        x[c] = axis_x + factor * (x_m[c] * per_m_x)
        y[c] = axis_y + factor * (y_m * per_m_y)
    for c in range(x_m.size):
        # Beyond its border the map repeats its border samples.
        inside_y, inside_x = min(max(y[c], 0.0), rows - 1.0), min(max(x[c], 0.0), cols - 1.0)
        row.sample[c] = int(inside_y) * cols + int(inside_x)


@compiled()
def _integral(source: _Source, begin: tuple[float, float], end: tuple[float, float], out: F64, place: int) -> None:
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
        inside = min(max(row, 0), source.map_rows - 1) - source.offset
        border = row + 1.0
        at = x0 + slope * (border - y0)
        _add_mean_before(source, inside, x, at, sign * (border - y), out, place)
        x, y, row = at, border, row + 1
    inside = min(max(row, 0), source.map_rows - 1) - source.offset
    _add_mean_before(source, inside, x, x1, sign * (y1 - y), out, place)


@compiled()
def _add_mean_before(source: _Source, row: int, x0: float, x1: float, height: float, out: F64, place: int) -> None:
    """Add `height` times the mean of F between two places of a row, which repeats its end samples beyond its ends."""
    values, before = source.values, source.before
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
