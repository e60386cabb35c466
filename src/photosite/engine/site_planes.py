"""Planes of a mosaic: statistics of every n-th pixel of a map, without copies of the planes.

A plane is given by its *site*: row and column in the repeating tile. Sums are accumulated in a fixed order, so that a
result does not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64, I64, compiled, prange
from photosite.engine.map_statistics import residual_moments, row_sum

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


@compiled(parallel=True)
def _plane_lines(values: F64, site: Site, tile: Site, kernel: F64, out: F64, rows_out: F64, bands_out: F64) -> None:
    """Copy a plane, less the smoothed plane where there is a kernel, and sum its lines."""
    rows, cols = out.shape
    margin = kernel.size // 2
    for band in prange(bands_out.shape[0]):
        first, last = band * _BAND, min(rows, (band + 1) * _BAND)
        width = cols + 2 * margin
        dense, down = np.empty((last - first + 2 * margin) * width), np.empty(width)
        lanes = np.empty(_LANES)
        for r in range(last - first + 2 * margin):
            source, target = values[site[0] + tile[0] * (first + r)], dense[r * width : (r + 1) * width]
            start, step = np.uint64(site[1]), np.uint64(tile[1])
            for c in range(np.uint64(width)):
                target[c] = source[start + step * c]
        columns = bands_out[band]
        for r in range(first, last):
            line, middle = out[r], dense[(r - first + margin) * width + margin :]
            if kernel.size:
                _smooth(dense, (r - first) * width, width, kernel, down)
                _smooth(down, 0, 1, kernel, line)
                for c in range(np.uint64(cols)):
                    line[c] = middle[c] - line[c]
            else:
                line[:] = middle[:cols]
            rows_out[r] = row_sum(line, lanes)
            for c in range(np.uint64(cols)):
                columns[c] += line[c]


@compiled()
def _smooth(values: F64, start: int, step: int, kernel: F64, out: F64) -> None:
    """Compute the sum of lines that begin `step` values apart, each times its weight of a symmetric kernel."""
    half, n = kernel.size // 2, out.size
    middle = values[start + half * step :]
    for c in range(np.uint64(n)):
        out[c] = kernel[half] * middle[c]
    for k in range(0, half, 3):  # six lines for each time that the output is read and written
        w0, w1, w2 = kernel[k], kernel[k + 1], kernel[k + 2]
        a0, b0 = values[start + k * step :], values[start + (2 * half - k) * step :]
        a1, b1 = values[start + (k + 1) * step :], values[start + (2 * half - k - 1) * step :]
        a2, b2 = values[start + (k + 2) * step :], values[start + (2 * half - k - 2) * step :]
        for c in range(np.uint64(n)):
            out[c] += w0 * (a0[c] + b0[c]) + w1 * (a1[c] + b1[c]) + w2 * (a2[c] + b2[c])


def plane_moments(
    values: F64, site: Site, tile: tuple[int, ...], kernel: F64 | None = None
) -> tuple[tuple[int, int], F64, F64, float, float]:
    """Return rows and columns of a plane, deviations of its row and column means, and moments of what is left.

    The moments are the mean second and fourth power after subtraction of the means of rows and columns.

    - `values`: (rows, cols) map of the whole mosaic, C-contiguous.
    - `kernel`: (n,), n - 1 a multiple of 6, symmetric. The plane is then high-pass filtered: the plane smoothed by this
      kernel along both axes is subtracted, and a border of (n - 1) / 2 pixels is left out.

    Examples
    --------
    >>> mosaic = np.add.outer([1.0, 0.0, 3.0, 0.0], [0.0, 9.0, 2.0, 9.0])
    >>> shape, rows, columns, second, fourth = plane_moments(mosaic, (0, 0), (2, 2))
    >>> shape, rows.tolist(), columns.tolist(), second
    ((2, 2), [-1.0, 1.0], [-1.0, 1.0], 0.0)
    """
    smoothing = np.empty(0) if kernel is None else kernel
    rows, cols = plane_shape(values.shape, site, tile)
    if kernel is not None:
        rows, cols = rows - len(kernel) + 1, cols - len(kernel) + 1
    plane, row_sums = np.empty((rows, cols)), np.empty(rows)
    bands = np.zeros((-(-rows // _BAND), cols))
    _plane_lines(values, site, (tile[0], tile[1]), smoothing, plane, row_sums, bands)
    mean = float(row_sums.sum()) / plane.size
    row_mean, columns = row_sums / cols, bands.sum(axis=0) / rows - mean
    second, fourth = residual_moments(plane, row_mean, columns)
    return (rows, cols), row_mean - mean, columns, second, fourth


@compiled(parallel=True)
def _far_sums(values: F64, shape: Site, middle: F64, limit: F64, out: F64) -> None:
    tile_rows, tile_cols = middle.shape
    rows, cols = shape
    for r in prange(rows):
        row, centers, limits = values[r], middle[r % tile_rows], limit[r % tile_rows]
        count = far = whole = 0.0
        for first in range(tile_cols):
            center, most = centers[first], limits[first]
            lanes = np.zeros(_LANES)
            n = np.uint64((cols - first + tile_cols - 1) // tile_cols)
            start, step = np.uint64(first), np.uint64(tile_cols)
            for j in range(np.uint64(0), n, np.uint64(_LANES)):
                beyond = False
                for lane in range(min(np.uint64(_LANES), n - j)):
                    d = row[start + step * (j + lane)] - center
                    lanes[lane] += d * d
                    beyond |= d * d > most
                if beyond:
                    for lane in range(min(np.uint64(_LANES), n - j)):
                        d = row[start + step * (j + lane)] - center
                        if d * d > most:
                            count += 1.0
                            far += d * d
            whole += lanes.sum()
        out[r, 0], out[r, 1], out[r, 2] = count, far, whole


def far_sums(values: F64, middle: F64, limit: F64) -> tuple[int, float, float]:
    """Return how many pixels have a squared deviation beyond a limit, the sum of these squares, and that of all.

    - `values`: (rows, cols) map, C-contiguous; lines beyond the last whole tile are left out.
    - `middle`, `limit`: (tile rows, tile cols) center of the deviations, and largest square, of each site.

    Examples
    --------
    >>> far_sums(np.array([[1.0, 5.0, 3.0, 9.0]]), np.array([[2.0, 5.0]]), np.array([[4.0, 4.0]]))
    (1, 16.0, 18.0)
    """
    rows, cols = (length // step * step for length, step in zip(values.shape, middle.shape, strict=True))
    sums = np.zeros((rows, 3))
    _far_sums(values, (rows, cols), middle, limit, sums)
    count, far, whole = sums.sum(axis=0).tolist()
    return int(count), far, whole


@compiled(parallel=True)
def _spaced(values: F64, site: Site, tile: Site, cols: int, step: int, out: F64) -> None:
    for j in prange(out.size):
        place = j * step
        out[j] = values[site[0] + tile[0] * (place // cols), site[1] + tile[1] * (place % cols)]


def spaced_values(values: F64, site: Site, tile: tuple[int, ...], step: int) -> F64:
    """Return (n,) every `step`-th value of a plane in the order of its rows; lines beyond the last tile are left out.

    Examples
    --------
    >>> spaced_values(np.arange(16.0).reshape(4, 4), (0, 1), (2, 2), 3).tolist()
    [1.0, 11.0]
    """
    rows, cols = (length // of_tile for length, of_tile in zip(values.shape, tile, strict=True))
    out = np.empty(-(-rows * cols // step))
    _spaced(values, site, (tile[0], tile[1]), cols, step, out)
    return out


@compiled(parallel=True)
def _site_sums(values: F64, dark: F64, subtract: bool, shape: Site, tile: Site, out: F64) -> None:
    rows, cols = shape
    for r in prange(rows):
        row, black = values[r], dark[r] if subtract else values[r]
        for first in range(tile[1]):
            lanes = np.zeros(_LANES)
            n = np.uint64((cols - first + tile[1] - 1) // tile[1])
            start, step = np.uint64(first), np.uint64(tile[1])
            for j in range(np.uint64(0), n, np.uint64(_LANES)):
                for lane in range(min(np.uint64(_LANES), n - j)):
                    place = start + step * (j + lane)
                    lanes[lane] += row[place] - black[place] if subtract else row[place]
            out[r, first] = lanes.sum()


@compiled(parallel=True)
def _sum_of_sites(values: F64, dark: F64, subtract: bool, factors: F64, out: F64) -> None:
    tile_rows, tile_cols = factors.shape
    for r in prange(out.shape[0]):
        target = out[r]
        target[:] = 0.0
        for i in range(tile_rows):
            row = values[r * tile_rows + i]
            black = dark[r * tile_rows + i] if subtract else row
            for k in range(tile_cols):
                factor, start, step = factors[i, k], np.uint64(k), np.uint64(tile_cols)
                for c in range(np.uint64(target.size)):
                    place = start + step * c
                    target[c] += factor * (row[place] - black[place] if subtract else row[place])


def mean_of_sites(values: F64, dark: F64 | None, tile: tuple[int, ...], *, relative: bool = False) -> F64 | None:
    """Return the (rows, cols) mean over the sites of a map less a dark map, one value for each whole tile.

    `relative` divides each site by its mean; None where a site has a mean of 0 or less.

    Examples
    --------
    >>> mean_of_sites(np.array([[1.0, 4.0, 3.0, 4.0]]), None, (1, 2)).tolist()
    [[2.5, 3.5]]
    >>> mean_of_sites(np.array([[1.0, 4.0, 3.0, 4.0]]), None, (1, 2), relative=True).tolist()
    [[0.75, 1.25]]
    """
    rows, cols = (length // of_tile for length, of_tile in zip(values.shape, tile, strict=True))
    factors = np.full((tile[0], tile[1]), 1.0 / (tile[0] * tile[1]))
    black, subtract = (values, False) if dark is None else (dark, True)
    if relative:
        sums = np.empty((rows * tile[0], tile[1]))
        _site_sums(values, black, subtract, (rows * tile[0], cols * tile[1]), (tile[0], tile[1]), sums)
        means = sums.reshape(rows, tile[0], tile[1]).sum(axis=0) / (rows * cols)
        if means.min() <= 0.0:
            return None
        factors /= means
    out = np.empty((rows, cols))
    _sum_of_sites(values, black, subtract, factors, out)
    return out


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
