"""Planes of a mosaic: statistics of every n-th pixel of a map, without copies of the planes.

A plane is given by its *site*: row and column in the repeating tile. Sums are accumulated in a fixed order, so that a
result does not depend on the number of threads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64, I64, compiled
from photosite.engine.lazy_maps import LazyMap, Map, contiguous, is_large, row_strips
from photosite.engine.threads import parallel_for

Site = tuple[int, int]

_BAND = 48
"""Rows of a plane that a thread processes at a time."""

_LANES = 32


def plane_shape(shape: tuple[int, ...], site: Site, tile: tuple[int, ...]) -> tuple[int, int]:
    """Return the rows and columns of a site's plane.

    Examples
    --------
    >>> plane_shape((5, 8), (1, 0), (2, 2))
    (2, 4)
    """
    rows, cols = (len(range(at, length, step)) for at, length, step in zip(site, shape, tile, strict=True))
    return rows, cols


class PlaneMoments(NamedTuple):
    """Statistics of a plane.

    - `shape`: Rows and columns.
    - `rows`, `columns`: Deviations of the means of rows and columns from the plane's mean.
    - `second`, `fourth`: Mean second and fourth power of what is left without the means of rows and columns.
    """

    shape: tuple[int, int]
    rows: F64
    columns: F64
    second: float
    fourth: float


@compiled()
def _line_sums(start: int, stop: int, values: F64, tile: Site, lanes: int, rows_out: F64, columns_out: F64) -> None:
    """Sum the rows of a mosaic by column of the tile, and its columns by band and row of the tile."""
    for band in range(start, stop):
        parts = np.empty(lanes)
        for r in range(band * _BAND, min(values.shape[0], (band + 1) * _BAND)):
            row, columns = values[r], columns_out[band, r % tile[0]]
            for c in range(np.uint64(row.size)):
                columns[c] += row[c]
            _add_line(row, parts, rows_out[r])


@compiled()
def _add_line(row: F64, lanes: F64, sums: F64) -> None:
    """Add a line to the sums of its sites, whose number divides that of the lanes."""
    lanes[:] = 0.0
    step = np.uint64(lanes.size)
    whole = np.uint64(row.size) // step * step
    for first in range(np.uint64(0), whole, step):
        for lane in range(step):
            lanes[lane] += row[first + lane]
    for c in range(whole, np.uint64(row.size)):
        lanes[c - whole] += row[c]
    for lane in range(lanes.size):
        sums[lane % sums.size] += lanes[lane]


@compiled()
def _powers_left(start: int, stop: int, values: F64, row_mean: F64, column_offset: F64, lanes: int, out: F64) -> None:
    """Sum the second and fourth power of a mosaic less the means of its lines, by row and column of the tile.

    - `row_mean`: (rows, tile columns).
    - `column_offset`: (tile rows, columns).
    - `lanes`: A multiple of the tile's columns.
    - `out`: (2, rows, tile columns).
    """
    tile_rows, tile_cols = column_offset.shape[0], row_mean.shape[1]
    for r in range(start, stop):
        means, squares, fourths = np.empty(lanes), np.zeros(lanes), np.zeros(lanes)
        for lane in range(lanes):
            means[lane] = row_mean[r, lane % tile_cols]
        row, offset = values[r], column_offset[r % tile_rows]
        step = np.uint64(lanes)
        whole = np.uint64(row.size) // step * step
        for first in range(np.uint64(0), whole, step):
            for lane in range(step):
                d = row[first + lane] - means[lane] - offset[first + lane]
                square = d * d
                squares[lane] += square
                fourths[lane] += square * square
        for c in range(whole, np.uint64(row.size)):
            d = row[c] - means[c - whole] - offset[c]
            squares[c - whole] += d * d
            fourths[c - whole] += (d * d) * (d * d)
        for lane in range(lanes):
            out[0, r, lane % tile_cols] += squares[lane]
            out[1, r, lane % tile_cols] += fourths[lane]


class _LineSums(NamedTuple):
    """Sums of the rows of a map by column of the tile, and of its columns by band and row of the tile."""

    rows: F64  # (rows, tile columns)
    bands: F64  # (bands, tile rows, columns)


_Strips = Iterator[tuple[int, F64]]
"""First row and values of successive rows of a map."""


def plane_moments(values: Map, tile: tuple[int, ...], *, high_passed: bool = False) -> dict[Site, PlaneMoments]:
    """Return the statistics of the plane of each site.

    - `values`: (rows, cols) map of the whole mosaic.
    - `tile`: Rows and columns of the tile.
    - `high_passed`: Whether the planes are filtered first (`high_passed_planes`).

    Examples
    --------
    >>> mosaic = np.add.outer([1.0, 0.0, 3.0, 0.0], [0.0, 9.0, 2.0, 9.0])
    >>> found = plane_moments(mosaic, (2, 2))[0, 0]
    >>> found.shape, found.rows.tolist(), found.columns.tolist(), found.second
    ((2, 2), [-1.0, 1.0], [-1.0, 1.0], 0.0)
    """
    tile_rows, tile_cols = tile
    strips, shape = _plain_strips, values.shape
    if high_passed:
        strips, shape = _filtered_strips, _filtered_shape(values.shape, (tile_rows, tile_cols))
    rows, cols = shape
    band = _FILTERED_BAND * tile_rows if high_passed else _BAND
    row_sums, bands = _LineSums(np.zeros((rows, tile_cols)), np.zeros((-(-rows // band), tile_rows, cols)))
    kept = not is_large(shape)  # else the strips are computed again
    first_pass = strips(values, (tile_rows, tile_cols), _LineSums(row_sums, bands))
    parts = [strip for strip in first_pass if kept]
    column_sums = bands.sum(axis=0)
    row_mean, column_offset = np.empty((rows, tile_cols)), np.empty((tile_rows, cols))
    means = np.empty((tile_rows, tile_cols))
    sites = list(np.ndindex(tile_rows, tile_cols))
    for r, c in sites:
        height, width = plane_shape(shape, (r, c), tile)
        row_mean[r::tile_rows, c] = row_sums[r::tile_rows, c] / width
        means[r, c] = row_sums[r::tile_rows, c].sum() / (height * width)
        column_offset[r, c::tile_cols] = column_sums[r, c::tile_cols] / height - means[r, c]
    powers = np.zeros((2, rows, tile_cols))
    for first, part in parts or strips(values, (tile_rows, tile_cols), None):
        here = np.zeros((2, len(part), tile_cols))
        rows_here = slice(first, first + len(part))
        parallel_for(_powers_left, len(part), part, row_mean[rows_here], column_offset, _lanes(tile_cols), here)
        powers[:, rows_here] = here
    found = {}
    for r, c in sites:
        height, width = plane_shape(shape, (r, c), tile)
        second, fourth = powers[:, r::tile_rows, c].sum(axis=1) / (height * width)
        of_rows, of_columns = row_mean[r::tile_rows, c] - means[r, c], column_offset[r, c::tile_cols].copy()
        found[r, c] = PlaneMoments((height, width), of_rows, of_columns, float(second), float(fourth))
    return found


def _plain_strips(values: Map, tile: Site, sums: _LineSums | None) -> _Strips:
    """Yield the strips of a map, after their lines are summed."""
    for first, last in row_strips(values, math.lcm(_BAND, tile[0])):
        part = contiguous(values[first:last])
        if sums is not None:
            bands = sums.bands[first // _BAND : -(-last // _BAND)]
            parallel_for(_line_sums, len(bands), part, tile, _lanes(tile[1]), sums.rows[first:last], bands)
        yield first, part


def _lanes(tile_cols: int) -> int:
    """Return the number of lanes of partial sums: a multiple of the tile's columns."""
    return max(_LANES // tile_cols, 1) * tile_cols


MARGIN = 9
"""Pixels of a plane on each side of one that its high-pass filter sees."""

_BOX, _LONG_BOX = 7, 11
_SLOTS = _LONG_BOX + 1

_FILTERED_BAND, _FILTERED_COLS = 96, 1024
"""Rows of a plane and columns of the mosaic that are filtered together, so that their sums stay in the cache."""


@compiled()
def _high_passed(
    start: int, stop: int, values: F64, tile: Site, lanes: int, out: F64, rows_out: F64, columns_out: F64
) -> None:
    """Filter the planes, and sum their lines as `_line_sums` does."""
    tile_rows, tile_cols = tile
    cols, together = out.shape[1], _FILTERED_COLS // tile_cols * tile_cols
    band_rows = _FILTERED_BAND * tile_rows
    for band in range(start, stop):
        wide = together + 2 * MARGIN * tile_cols
        nothing, down, parts = np.zeros(wide), np.empty(wide), np.empty(lanes)
        boxes, long_boxes = np.empty((_SLOTS, wide)), np.empty((3, wide))
        for first_col in range(0, cols, together):
            n = min(together, cols - first_col)
            m = n + 2 * MARGIN * tile_cols
            for site_row in range(tile_rows):
                boxes[:] = 0.0
                long_boxes[:] = 0.0
                top = band * band_rows + site_row
                end = min(top + band_rows + 2 * MARGIN * tile_rows, values.shape[0])
                for count, r in enumerate(range(top, end, tile_rows)):
                    row = values[r, first_col : first_col + m]
                    before = r - _BOX * tile_rows
                    gone = values[before, first_col : first_col + m] if count >= _BOX else nothing
                    box, last = boxes[count % _SLOTS], boxes[(count + _SLOTS - 1) % _SLOTS]
                    _moved_sum(last, row, gone, m, box)
                    long_box, last_long = long_boxes[count % 3], long_boxes[(count + 2) % 3]
                    _moved_sum(last_long, box, boxes[(count + 1) % _SLOTS], m, long_box)
                    if count >= 2 * MARGIN:
                        _binomial(long_boxes[(count + 1) % 3], last_long, long_box, m, down)
                        above = r - 2 * MARGIN * tile_rows
                        target = out[above, first_col : first_col + n]
                        middle = values[r - MARGIN * tile_rows, first_col + MARGIN * tile_cols :]
                        _less_smooth(middle, down, tile_cols, n, target)
                        columns = columns_out[band, site_row, first_col:]
                        for c in range(np.uint64(n)):
                            columns[c] += target[c]
                        _add_line(target, parts, rows_out[above])


@compiled(inline=True)
def _moved_sum(last: F64, added: F64, gone: F64, n: int, out: F64) -> None:
    for c in range(np.uint64(n)):
        out[c] = last[c] + (added[c] - gone[c])


@compiled(inline=True)
def _binomial(above: F64, middle: F64, below: F64, n: int, out: F64) -> None:
    for c in range(np.uint64(n)):
        out[c] = (above[c] + 2.0 * middle[c] + below[c]) * (1.0 / (4 * _BOX * _LONG_BOX))


_W = np.convolve(np.convolve(np.ones(_BOX), np.ones(_LONG_BOX)), [0.25, 0.5, 0.25]) / (_BOX * _LONG_BOX)
_W0, _W1, _W2, _W3, _W4, _W5, _W6, _W7, _W8, _W9 = (float(weight) for weight in _W[: MARGIN + 1])


@compiled(inline=True)
def _less_smooth(pixels: F64, values: F64, step: int, n: int, out: F64) -> None:
    """Compute n pixels less the sums of 19 values, `step` apart, times the weights of the boxes and the binomial."""
    a0, a1, a2, a3, a4 = values, values[step:], values[2 * step :], values[3 * step :], values[4 * step :]
    a5, a6, a7, a8 = values[5 * step :], values[6 * step :], values[7 * step :], values[8 * step :]
    middle = values[9 * step :]
    b8, b7, b6, b5 = values[10 * step :], values[11 * step :], values[12 * step :], values[13 * step :]
    b4, b3, b2 = values[14 * step :], values[15 * step :], values[16 * step :]
    b1, b0 = values[17 * step :], values[18 * step :]
    for c in range(np.uint64(n)):
        far = _W0 * (a0[c] + b0[c]) + _W1 * (a1[c] + b1[c]) + _W2 * (a2[c] + b2[c])
        between = _W3 * (a3[c] + b3[c]) + _W4 * (a4[c] + b4[c]) + _W5 * (a5[c] + b5[c])
        near = _W6 * (a6[c] + b6[c]) + _W7 * (a7[c] + b7[c]) + _W8 * (a8[c] + b8[c])
        out[c] = pixels[c] - (far + between + (near + _W9 * middle[c]))


def high_passed_planes(values: Map, tile: tuple[int, ...]) -> F64:
    """Return a map whose planes are high-pass filtered, without a border of 9 pixels of each plane.

    The plane smoothed by a box of 7 x 7 pixels, a box of 11 x 11 and the binomial 1 2 1 along both axes is subtracted,
    the filter of EMVA 1288 R4.0. The result has the tile of the map. There is none, (0, 0), of maps that are too small.

    - `values`: (rows, cols) map of the whole mosaic.
    - `tile`: Rows and columns of the tile.

    Examples
    --------
    >>> ramps = np.add.outer(np.arange(40.0), np.arange(60.0)) + 1000.0 * (np.arange(60) % 2)
    >>> filtered = high_passed_planes(ramps, (1, 2))
    >>> filtered.shape, bool(abs(filtered).max() < 1e-10)
    ((22, 24), True)
    """
    out = np.empty(_filtered_shape(values.shape, (tile[0], tile[1])))
    for first, part in _filtered_strips(values, (tile[0], tile[1]), None):
        out[first : first + len(part)] = part
    return out


def _filtered_shape(shape: tuple[int, ...], tile: Site) -> tuple[int, int]:
    """Return the rows and columns that are left of a map that is filtered."""
    rows, cols = (max(length - 2 * MARGIN * step, 0) for length, step in zip(shape, tile, strict=True))
    return (rows, cols) if rows and cols else (0, 0)


def _filtered_strips(values: Map, tile: Site, sums: _LineSums | None) -> _Strips:
    """Yield the strips of a filtered map, after their lines are summed."""
    shape, band = _filtered_shape(values.shape, tile), _FILTERED_BAND * tile[0]
    for first, last in row_strips(values, band, slice(shape[0])):
        part, out = contiguous(values[first : last + 2 * MARGIN * tile[0]]), np.empty((last - first, shape[1]))
        if sums is None:
            rows, bands = np.zeros((last - first, tile[1])), np.zeros((-(-(last - first) // band), tile[0], shape[1]))
        else:
            rows, bands = sums.rows[first:last], sums.bands[first // band : -(-last // band)]
        parallel_for(_high_passed, len(bands), part, tile, _lanes(tile[1]), out, rows, bands)
        yield first, out


@compiled()
def _far_sums(start: int, stop: int, values: F64, cols: int, middle: F64, limit: F64, out: F64) -> None:
    tile_rows, tile_cols = middle.shape
    for r in range(start, stop):
        row, centers, limits = values[r], middle[r % tile_rows], limit[r % tile_rows]
        count = far = whole = 0.0
        for first in range(tile_cols):
            center, most = centers[first], limits[first]
            lanes = np.zeros(_LANES)
            n = np.uint64((cols - first + tile_cols - 1) // tile_cols)
            at, step = np.uint64(first), np.uint64(tile_cols)
            for j in range(np.uint64(0), n, np.uint64(_LANES)):
                beyond = False
                for lane in range(min(np.uint64(_LANES), n - j)):
                    d = row[at + step * (j + lane)] - center
                    lanes[lane] += d * d
                    beyond |= d * d > most
                if beyond:
                    for lane in range(min(np.uint64(_LANES), n - j)):
                        d = row[at + step * (j + lane)] - center
                        if d * d > most:
                            count += 1.0
                            far += d * d
            whole += lanes.sum()
        out[r, 0], out[r, 1], out[r, 2] = count, far, whole


def far_sums(values: Map, middle: F64, limit: F64) -> tuple[int, float, float]:
    """Return how many pixels have a squared deviation beyond a limit, the sum of these squares, and that of all.

    - `values`: (rows, cols) map; lines beyond the last whole tile are left out.
    - `middle`, `limit`: (tile rows, tile cols) center of the deviations, and largest square, of each site.

    Examples
    --------
    >>> far_sums(np.array([[1.0, 5.0, 3.0, 9.0]]), np.array([[2.0, 5.0]]), np.array([[4.0, 4.0]]))
    (1, 16.0, 18.0)
    """
    rows, cols = (length // step * step for length, step in zip(values.shape, middle.shape, strict=True))
    sums = np.zeros((rows, 3))
    for first, last in row_strips(values, len(middle), slice(rows)):
        part = contiguous(values[first:last])
        parallel_for(_far_sums, last - first, part, cols, middle, limit, sums[first:last])
    count, far, whole = sums.sum(axis=0).tolist()
    return int(count), far, whole


def spaced_values(values: Map, site: Site, tile: tuple[int, ...], step: int) -> F64:
    """Return (n,) every `step`-th value of a plane in the order of its rows; lines beyond the last tile are left out.

    Examples
    --------
    >>> spaced_values(np.arange(16.0).reshape(4, 4), (0, 1), (2, 2), 3).tolist()
    [1.0, 11.0]
    """
    rows, cols = (length // of_tile for length, of_tile in zip(values.shape, tile, strict=True))
    places = np.arange(0, rows * cols, step)
    return np.asarray(values[site[0] + tile[0] * (places // cols), site[1] + tile[1] * (places % cols)])


@compiled()
def _site_sums(
    start: int, stop: int, values: F64, dark: F64, subtract: bool, cols: int, tile_cols: int, out: F64
) -> None:
    for r in range(start, stop):
        row, black = values[r], dark[r] if subtract else values[r]
        for first in range(tile_cols):
            lanes = np.zeros(_LANES)
            n = np.uint64((cols - first + tile_cols - 1) // tile_cols)
            at, step = np.uint64(first), np.uint64(tile_cols)
            for j in range(np.uint64(0), n, np.uint64(_LANES)):
                for lane in range(min(np.uint64(_LANES), n - j)):
                    place = at + step * (j + lane)
                    lanes[lane] += row[place] - black[place] if subtract else row[place]
            out[r, first] = lanes.sum()


@compiled()
def _sum_of_sites(start: int, stop: int, values: F64, dark: F64, subtract: bool, factors: F64, out: F64) -> None:
    tile_rows, tile_cols = factors.shape
    for r in range(start, stop):
        target = out[r]
        target[:] = 0.0
        for i in range(tile_rows):
            row = values[r * tile_rows + i]
            black = dark[r * tile_rows + i] if subtract else row
            for k in range(tile_cols):
                factor, at, step = factors[i, k], np.uint64(k), np.uint64(tile_cols)
                for c in range(np.uint64(target.size)):
                    place = at + step * c
                    target[c] += factor * (row[place] - black[place] if subtract else row[place])


@dataclass(frozen=True, eq=False)
class SiteMean(LazyMap):
    """The sum over the sites of a map less a dark map, each times a factor: one value for each whole tile.

    Parameters
    ----------
    values, dark
        (rows, cols) maps; None if nothing is subtracted.
    factors
        (tile rows, tile cols).
    """

    values: Map
    dark: Map | None
    factors: F64

    @property
    def shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """Number of tiles in a column, and in a row."""
        return tuple(length // of_tile for length, of_tile in zip(self.values.shape, self.factors.shape, strict=True))

    def __getitem__(self, part: Any, /) -> F64:
        first, last, step = (part[0] if isinstance(part, tuple) else part).indices(self.shape[0])
        rows = slice(first * len(self.factors), last * len(self.factors))
        some = contiguous(self.values[rows])
        dark = some if self.dark is None else contiguous(self.dark[rows])
        out = np.empty((max(last - first, 0), self.shape[1]))
        parallel_for(_sum_of_sites, len(out), some, dark, self.dark is not None, self.factors, out)
        return out[::step, part[1]] if isinstance(part, tuple) else out[::step]


def mean_of_sites(values: Map, dark: Map | None, tile: tuple[int, ...], *, relative: bool = False) -> Map | None:
    """Return the mean over the sites of a map less a dark map, one value for each whole tile.

    `relative` divides each site by its mean; None where a site has a mean of 0 or less.

    Examples
    --------
    >>> mean_of_sites(np.array([[1.0, 4.0, 3.0, 4.0]]), None, (1, 2))[:].tolist()
    [[2.5, 3.5]]
    >>> mean_of_sites(np.array([[1.0, 4.0, 3.0, 4.0]]), None, (1, 2), relative=True)[:].tolist()
    [[0.75, 1.25]]
    """
    rows, cols = (length // of_tile for length, of_tile in zip(values.shape, tile, strict=True))
    factors = np.full((tile[0], tile[1]), 1.0 / (tile[0] * tile[1]))
    if relative:
        sums = np.empty((rows * tile[0], tile[1]))
        for first, last in row_strips(values, tile[0], slice(len(sums))):
            part = contiguous(values[first:last])
            black = part if dark is None else contiguous(dark[first:last])
            parallel_for(
                _site_sums, last - first, part, black, dark is not None, cols * tile[1], tile[1], sums[first:last]
            )
        means = sums.reshape(rows, tile[0], tile[1]).sum(axis=0) / (rows * cols)
        if means.min() <= 0.0:
            return None
        factors /= means
    return SiteMean(values, dark, factors)


@compiled()
def _count_numbers(frame: NDArray[np.unsignedinteger], counts: I64) -> None:
    parts = np.zeros((4, counts.size), np.uint32)
    first, second, third, fourth = parts[0], parts[1], parts[2], parts[3]
    for row in frame:
        whole = np.uint64(row.size) // np.uint64(4) * np.uint64(4)
        for c in range(np.uint64(0), whole, np.uint64(4)):
            # Four tables: a number often follows itself, and an addition would wait for the one before.
            first[row[c]] += np.uint32(1)
            second[row[c + np.uint64(1)]] += np.uint32(1)
            third[row[c + np.uint64(2)]] += np.uint32(1)
            fourth[row[c + np.uint64(3)]] += np.uint32(1)
        for c in range(whole, np.uint64(row.size)):
            first[row[c]] += np.uint32(1)
    for k in range(counts.size):
        counts[k] += np.int64(first[k]) + np.int64(second[k]) + np.int64(third[k]) + np.int64(fourth[k])


def count_numbers(frame: NDArray[np.unsignedinteger]) -> I64:
    """Return (65536,) how often each digital number occurs in a frame of uint8 or uint16; single-threaded.

    Examples
    --------
    >>> count_numbers(np.array([[1, 1, 3]], np.uint16))[:4].tolist()
    [0, 2, 0, 1]
    """
    counts = np.zeros(1 << 16, np.int64)
    _count_numbers(frame, counts)
    return counts
