"""Resampling by means, which conserves light: lines to another grid, and maps as cells see them through a lens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, compiled, read_only
from photosite.engine.threads import parallel_for, threads_for

_CHUNK = 16
"""Rows of cells that a thread processes at a time; all but the first reuse the edges of the row above."""
_FEW_SAMPLES = 4
"""Samples per output up to which all outputs of a line are computed as if they covered as many."""
_BLOCK = 256
"""Cells whose fractions in samples are computed together, unless each of them sees one sample."""


class Overlap(NamedTuple):
    """The samples that each output covers, and their fractions: entries first[i] to first[i + 1] belong to output i."""

    first: I64
    sample: I64
    fraction: F32

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
    >>> two.first, two.sample, two.fraction.round(3)
    (array([0, 2, 3]), array([0, 1, 2]), array([0.333, 0.667, 1.   ], dtype=float32))
    """
    borders = start + step * np.arange(count + 1)
    # The borders of outputs and samples cut the line into pieces of one sample and one output each.
    inner = np.arange(1, samples, dtype=np.float64)
    cuts = np.union1d(borders, inner[(inner > borders[0]) & (inner < borders[-1])])
    middle = (cuts[:-1] + cuts[1:]) / 2
    output = np.searchsorted(borders, middle, side="right") - 1
    sample = np.clip(np.floor(middle), 0, samples - 1).astype(np.int64)
    fraction = np.diff(cuts) / step
    first = np.searchsorted(output, np.arange(count + 1)).astype(np.int64)
    return Overlap(first, sample, fraction.astype(np.float32))


def mean_along_rows(values: F32, across: Overlap, out: F32) -> None:
    """Compute (rows, count): each row of (rows, samples) resampled."""
    with threads_for(out.size):
        if np.diff(across.first).max() > _FEW_SAMPLES:
            parallel_for(_mean_along_rows, len(out), values, across, out)
        else:
            parallel_for(_mean_of_few, len(out), values, *_equal_entries(across), out)


def mean_of_rows(values: F32, down: Overlap, outputs: I64, offset: int, out: F32) -> None:
    """Compute some outputs, given by number, as means of whole rows; values[0] is sample number `offset`."""
    with threads_for(out.size):
        parallel_for(_mean_of_rows, len(out), values, down, outputs, offset, out)


def _equal_entries(across: Overlap) -> tuple[NDArray[np.uint32], F32]:
    """Return (covered, count) samples and fractions, equally many for each output; the last ones may be 0."""
    covered = np.arange(np.diff(across.first).max())[:, None]
    entry = across.first[:-1] + covered
    inside = np.minimum(entry, across.first[1:] - 1)
    fraction = np.where(entry == inside, across.fraction[inside], np.float32(0.0))
    return across.sample[inside].astype(np.uint32), fraction


@compiled()
def _mean_along_rows(start: int, stop: int, values: F32, across: Overlap, out: F32) -> None:
    first, sample, fraction = across
    for r in range(start, stop):
        for i in range(out.shape[1]):
            total = np.float32(0.0)
            for entry in range(first[i], first[i + 1]):
                total += values[r, sample[entry]] * fraction[entry]
            out[r, i] = total


@compiled()
def _mean_of_few(start: int, stop: int, values: F32, samples: NDArray[np.uint32], fractions: F32, out: F32) -> None:
    """Compute means as `_mean_along_rows`, of equally many samples, for vector instructions."""
    for r in range(start, stop):
        line, given = out[r], values[r]
        line[:] = 0.0
        for k in range(len(samples)):
            number, weight = samples[k], fractions[k]
            for i in range(line.size):
                line[i] += given[number[i]] * weight[i]


@compiled()
def _mean_of_rows(start: int, stop: int, values: F32, down: Overlap, outputs: I64, offset: int, out: F32) -> None:
    first, sample, fraction = down
    for i in range(start, stop):
        begin = first[outputs[i]]
        for entry in range(begin, first[outputs[i] + 1]):
            row, weight = values[sample[entry] - offset], fraction[entry]
            if entry == begin:
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
#
# A cell no larger than a sample usually sees the samples of its four corners only. Their fractions of its area are
# exact as well, and take a fifth of the time: most cells need no integrals.


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


def warped_means(values: F32, mixes: F32, offset: int, corners: Corners, begin: int, out: F32) -> None:
    """Compute (R, rows, cols): means of maps over the places that rows of cells from `begin` on see.

    The maps are the combinations `mixes` (R, K) of `values`, (K, n, map cols): rows `offset`, `offset + 1`, ..., at
    least those of `corners.span`.
    """
    count, (rows, cols) = len(mixes), values.shape[1:]
    maps, before = np.empty((count, rows, cols), np.float32), np.empty((count, rows, cols))
    parallel_for(_mix_and_integrate, values.shape[1], read_only(values), read_only(mixes), maps, before)
    source = _Source(maps, before, offset)
    trace = _Trace(corners.warp.scale, corners.warp.step_m2, corners.x_m, *corners.axis, *corners.per_m)
    y_m = corners.y_m[begin : begin + out.shape[1] + 1]
    parallel_for(_warped_means, -(-out.shape[1] // _CHUNK), source, trace, y_m, out)


class _Source(NamedTuple):
    """Rows of maps, (R, n, cols), their integrals along the rows, and the number of the first row.

    Beyond its border a map repeats its border samples. These rows are all that the cells see, so they repeat as well.
    """

    values: F32
    before: F64
    offset: int


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
    """A row of n corners: their places in the map, the samples there, and the values of these in each map."""

    x: F64
    y: F64
    col: NDArray[np.int32]
    row: NDArray[np.int32]
    values: F32  # (R, n)


class _Fractions(NamedTuple):
    """Fractions of a block of cells in the samples of their corners; that of the upper left corner is the rest of 1."""

    upper_right: F32
    lower_left: F32
    lower_right: F32


class _Pieces(NamedTuple):
    """Edges, cut where they pass from sample to sample: entries first[c] to first[c + 1] belong to edge c.

    An edge's integral of F dy is the sum of `height * before[sample] + moment * values[sample]`.
    """

    first: I64
    sample: I64
    height: F64
    moment: F64


@compiled()
def _mix_and_integrate(start: int, stop: int, values: F32, mixes: F32, maps: F32, before: F64) -> None:
    """Compute the maps, and the integral of each along its row up to each sample."""
    for r in range(start, stop):
        for k in range(mixes.shape[0]):
            line, sums = maps[k, r], before[k, r]
            line[:] = 0.0
            for own in range(mixes.shape[1]):
                weight, given = mixes[k, own], values[own, r]
                for c in range(line.size):
                    line[c] += weight * given[c]
            total = 0.0
            for c in range(line.size):
                sums[c] = total
                total += line[c]


@compiled()
def _warped_means(start: int, stop: int, source: _Source, trace: _Trace, y_m: F64, out: F32) -> None:
    rows = out.shape[1]
    for chunk in range(start, stop):
        _chunk_of_means(source, trace, y_m, chunk * _CHUNK, min((chunk + 1) * _CHUNK, rows), out)


@compiled()
def _chunk_of_means(source: _Source, trace: _Trace, y_m: F64, begin: int, end: int, out: F32) -> None:
    maps, cells = out.shape[0], out.shape[2]
    # Of two rows of corners, alternating: the row itself,
    corners = _corner_row(maps, cells + 1), _corner_row(maps, cells + 1)
    along = np.empty((2, maps, cells + 1))  # the integrals from each corner to the next,
    known = np.zeros((2, cells), np.bool_)  # and whether they are computed
    side = np.empty((maps, cells + 1))  # integrals from corners to those below
    fractions = _Fractions(np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32))
    complete = np.empty(cells, np.bool_)
    rest, sides, unknown = (np.empty(cells + 1, np.int64), np.empty(cells + 1, np.int64), np.empty(cells, np.int64))
    pieces = _room(cells + 1, 4 * cells)
    _find_places(trace, y_m[begin], source, corners[0])
    for r in range(begin, end):
        above, below = (r - begin) % 2, 1 - (r - begin) % 2
        upper, lower = corners[above], corners[below]
        _find_places(trace, y_m[r + 1], source, lower)
        for first in range(0, cells, _BLOCK):
            _means_of_corners(upper, lower, first, fractions, complete, out[:, r])
        others = rest[: _find_others(complete, rest)]
        count_sides, count_unknown = _find_edges(others, known[above], known[below], sides, unknown)
        pieces = _integrals(source, upper, lower, 0, sides[:count_sides], pieces, side)
        pieces = _integrals(source, upper, upper, 1, unknown[:count_unknown], pieces, along[above])
        pieces = _integrals(source, lower, lower, 1, others, pieces, along[below])
        _divide_by_areas(upper, lower, along[above], along[below], side, others, out[:, r])


@compiled()
def _corner_row(maps: int, size: int) -> _CornerRow:
    col, row = np.empty(size, np.int32), np.empty(size, np.int32)
    return _CornerRow(np.empty(size), np.empty(size), col, row, np.empty((maps, size), np.float32))


@compiled()
def _room(edges: int, pieces: int) -> _Pieces:
    return _Pieces(np.empty(edges + 1, np.int64), np.empty(pieces, np.int64), np.empty(pieces), np.empty(pieces))


@compiled()
def _find_places(trace: _Trace, y_m: float, source: _Source, corners: _CornerRow) -> None:
    """Compute a row of corners."""
    scale, step_m2, x_m, axis_y, axis_x, per_m_y, per_m_x = trace
    x, y, col, row, _ = corners
    rows, cols = source.values.shape[1:]
    last, per_m2, first_row = scale.size - 2, 1.0 / step_m2, float(source.offset)
    for c in range(x_m.size):
        position = (y_m * y_m + x_m[c] * x_m[c]) * per_m2
        node = min(int(position), last)
        fraction = min(position - node, 1.0)
        factor = scale[node] + fraction * (scale[node + 1] - scale[node])
        x[c] = axis_x + factor * (x_m[c] * per_m_x)
        y[c] = axis_y + factor * (y_m * per_m_y)
    for c in range(x_m.size):
        col[c] = np.int32(min(max(x[c], 0.0), cols - 1.0))
        row[c] = np.int32(min(max(y[c], first_row), first_row + (rows - 1.0)))
    for k in range(source.values.shape[0]):
        values, line = source.values[k], corners.values[k]
        for c in range(x_m.size):
            line[c] = values[np.uint32(row[c] - source.offset), np.uint32(col[c])]  # unsigned: see `frame_sums`


@compiled()
def _means_of_corners(
    upper: _CornerRow, lower: _CornerRow, first: int, fractions: _Fractions, complete: NDArray[np.bool_], out: F32
) -> None:
    """Compute the means of a block of cells as if they saw the samples of their corners only; note whether they do."""
    end = min(first + _BLOCK, out.shape[1])
    mixed = _find_fractions(upper, lower, first, end, fractions, complete[first:end])
    for k in range(out.shape[0]):
        line, above, below = out[k, first:end], upper.values[k, first : end + 1], lower.values[k, first : end + 1]
        if not mixed:
            line[:] = above[:-1]
            continue
        value0, value1, value2, value3 = above[:-1], above[1:], below[:-1], below[1:]
        fraction1, fraction2, fraction3 = fractions
        for c in range(line.size):
            more = fraction1[c] * (value1[c] - value0[c]) + fraction2[c] * (value2[c] - value0[c])
            line[c] = value0[c] + (more + fraction3[c] * (value3[c] - value0[c]))


@compiled()
def _find_fractions(
    upper: _CornerRow, lower: _CornerRow, first: int, end: int, fractions: _Fractions, complete: NDArray[np.bool_]
) -> bool:
    """Compute the fractions of cells first to end, and whether these are all; return False if each sees one sample.

    A vertical and a horizontal line between the samples cut a cell into four quadrilaterals, one for each corner, whose
    areas are half of the products of their diagonals. All lengths are from these lines, so that none is negative.
    """
    left, right = slice(first, end), slice(first + 1, end + 1)
    x0, x1, x2, x3 = upper.x[left], upper.x[right], lower.x[left], lower.x[right]
    y0, y1, y2, y3 = upper.y[left], upper.y[right], lower.y[left], lower.y[right]
    col0, col1, col2, col3 = upper.col[left], upper.col[right], lower.col[left], lower.col[right]
    row0, row1, row2, row3 = upper.row[left], upper.row[right], lower.row[left], lower.row[right]
    fraction1, fraction2, fraction3 = fractions
    differ = 0
    for c in range(end - first):
        differ |= (col0[c] ^ col1[c]) | (col0[c] ^ col2[c]) | (col0[c] ^ col3[c])
        differ |= (row0[c] ^ row1[c]) | (row0[c] ^ row2[c]) | (row0[c] ^ row3[c])
    if differ == 0:
        complete[:] = True
        return False
    for c in range(end - first):
        # Within one column or row of samples, any line serves that cuts the cell.
        x_cut, y_cut = max(x0[c], x2[c]), max(y0[c], y1[c])
        x_next, y_next = float(col1[c]), float(row2[c])
        x_cut = x_next if col1[c] > col0[c] else x_cut
        y_cut = y_next if row2[c] > row0[c] else y_cut
        left0, right1 = np.float32(x_cut - x0[c]), np.float32(x1[c] - x_cut)
        left2, right3 = np.float32(x_cut - x2[c]), np.float32(x3[c] - x_cut)
        above0, above1 = np.float32(y_cut - y0[c]), np.float32(y_cut - y1[c])
        below2, below3 = np.float32(y2[c] - y_cut), np.float32(y3[c] - y_cut)
        # Where the edges cross the lines.
        top = (above0 * right1 + above1 * left0) / (left0 + right1)
        bottom = (below2 * right3 + below3 * left2) / (left2 + right3)
        near = (left0 * below2 + left2 * above0) / (above0 + below2)
        far = (right1 * below3 + right3 * above1) / (above1 + below3)
        area0, area1 = left0 * top + above0 * near, right1 * top + above1 * far
        area2, area3 = left2 * bottom + below2 * near, right3 * bottom + below3 * far
        per_area = np.float32(1.0) / ((area0 + area1) + (area2 + area3))
        fraction1[c], fraction2[c], fraction3[c] = area1 * per_area, area2 * per_area, area3 * per_area
        # The samples are two by two neighbors, or fewer, and the lines cut the cell.
        neighbors = (col0[c] == col2[c]) & (col1[c] == col3[c]) & (col1[c] - col0[c] <= 1)
        neighbors &= (row0[c] == row1[c]) & (row2[c] == row3[c]) & (row2[c] - row0[c] <= 1)
        least = min(min(min(left0, left2), min(right1, right3)), min(min(above0, above1), min(below2, below3)))
        complete[c] = neighbors & (least >= np.float32(0.0))
    return True


@compiled()
def _find_others(complete: NDArray[np.bool_], others: I64) -> int:
    """Find the cells that see other samples than those of their corners; return their number."""
    count = 0
    for c in range(complete.size):
        others[count] = c
        count += 1 - int(complete[c])
    return count


@compiled()
def _find_edges(
    others: I64, known_above: NDArray[np.bool_], known_below: NDArray[np.bool_], sides: I64, unknown: I64
) -> tuple[int, int]:
    """Find the sides of some cells and their upper edges that are not known; mark the lower ones as known."""
    known_below[:] = False
    count_sides, count_unknown = 0, 0
    for c in others:
        if count_sides == 0 or sides[count_sides - 1] != c:
            sides[count_sides] = c
            count_sides += 1
        sides[count_sides] = c + 1
        count_sides += 1
        if not known_above[c]:
            unknown[count_unknown] = c
            count_unknown += 1
        known_below[c] = True
    return count_sides, count_unknown


@compiled()
def _divide_by_areas(
    upper: _CornerRow, lower: _CornerRow, above: F64, below: F64, side: F64, others: I64, out: F32
) -> None:
    """Compute the means of some cells of a row from the integrals along their edges."""
    xu, yu, xl, yl = upper.x, upper.y, lower.x, lower.y
    for k in range(out.shape[0]):
        above_k, below_k, side_k, line = above[k], below[k], side[k], out[k]
        for c in others:
            # Twice the area: the product of the diagonals.
            area = (xl[c + 1] - xu[c]) * (yl[c] - yu[c + 1]) - (yl[c + 1] - yu[c]) * (xl[c] - xu[c + 1])
            line[c] = 2.0 * (above_k[c] + side_k[c + 1] - below_k[c] - side_k[c]) / area


@compiled()
def _integrals(
    source: _Source, begin: _CornerRow, end: _CornerRow, step: int, edges: I64, pieces: _Pieces, out: F64
) -> _Pieces:
    """Compute each map's integrals of F dy along edges, from corner c of `begin` to corner c + step of `end`.

    `edges` are the numbers c. Return the memory for pieces, which may have become larger.
    """
    xb, yb, xe, ye = begin.x, begin.y, end.x, end.y
    most = 0.0
    for c in edges:
        most += 4.0 + abs(xb[c] - xe[c + step]) + abs(yb[c] - ye[c + step])
    if most > pieces.sample.size:
        pieces = _room(pieces.first.size - 1, 2 * int(most))
    first, sample, height, moment = pieces
    last_row, last = source.values.shape[1] - 1, source.values.shape[2] - 1
    count = 0
    for edge in range(edges.size):
        c = edges[edge]
        first[edge] = count
        x0, y0, x1, y1, sign = xb[c], yb[c], xe[c + step], ye[c + step], 1.0
        if y0 > y1:
            x0, y0, x1, y1, sign = x1, y1, x0, y0, -1.0
        row = int(np.floor(y0))
        slope = (x1 - x0) / (y1 - y0) if y1 > row + 1 else 0.0
        x, y, more = x0, y0, True
        while more:  # row by row of the map
            more = y1 > row + 1
            next_y = row + 1.0 if more else y1
            next_x = x0 + slope * (next_y - y0) if more else x1
            low, high, whole = min(x, next_x), max(x, next_x), sign * (next_y - y)
            start = min(max(row - source.offset, 0), last_row) * (last + 1)
            near, far = int(min(max(low, 0.0), float(last))), int(min(max(high, 0.0), float(last)))
            if near == far:
                sample[count], height[count] = start + near, whole
                moment[count] = whole * ((low + high) * 0.5 - near)
                count += 1
            else:
                at, per_length = low, whole / (high - low)
                for number in range(near, far + 1):  # F is linear within a sample
                    until = min(high, number + 1.0) if number < far else high
                    part = per_length * (until - at)
                    sample[count], height[count] = start + number, part
                    moment[count] = part * ((at + until) * 0.5 - number)
                    count += 1
                    at = until
            x, y, row = next_x, next_y, row + 1
    first[edges.size] = count
    for k in range(out.shape[0]):
        values, before, line = source.values[k].reshape(-1), source.before[k].reshape(-1), out[k]
        for edge in range(edges.size):
            total = 0.0
            for piece in range(first[edge], first[edge + 1]):
                at_sample = sample[piece]
                total += height[piece] * before[at_sample] + moment[piece] * values[at_sample]
            line[edges[edge]] = total
    return pieces
