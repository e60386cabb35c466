"""Sums of products of the temporal noise of frames: of pixels with their neighbors, and between successive frames.

The functions are single-threaded, so that threads may call them for several pairs of frames or sites of a mosaic.
A *site* is a row and column in the repeating tile of a mosaic; the pixels of a site are its plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64, I64, compiled
from photosite.engine.site_planes import plane_shape

_LANES = 32

_Frames = NDArray[np.uint16]
_Site = tuple[int, int]


@compiled()
def _dot(first: F64, second: F64, lanes: F64) -> None:
    """Add the products of two lines to lanes, of which each takes every n-th."""
    size, n = np.uint64(first.size), np.uint64(lanes.size)
    for start in range(np.uint64(0), size, n):
        for lane in range(min(n, size - start)):
            lanes[lane] += first[start + lane] * second[start + lane]


class DifferenceProducts(NamedTuple):
    """Sums of the difference of two frames, less its part in proportion to the mean of the two at each site."""

    near: F64  # (tile rows, tile cols, 2 reach + 1, 2 reach + 1) products with the neighbors, by the lag to them
    rows: F64  # (rows, tile cols) sums of the pixels of a row, for each column of the tile
    columns: F64  # (tile rows, cols) the same for columns


@compiled()
def _pair_sums(first: _Frames, second: _Frames, shape: _Site, out: I64) -> None:
    """Sum a, b, a^2, a b and b^2 at each site."""
    tile_rows, tile_cols = out.shape[:2]
    for r in range(shape[0]):
        for k in range(tile_cols):
            a_sum = b_sum = a_squares = products = b_squares = np.int64(0)
            start, step = np.uint64(k), np.uint64(tile_cols)
            for c in range(np.uint64(shape[1] // tile_cols)):
                a, b = np.int64(first[r, start + step * c]), np.int64(second[r, start + step * c])
                a_sum += a
                b_sum += b
                a_squares += a * a
                products += a * b
                b_squares += b * b
            sums = out[r % tile_rows, k]
            sums[0] += a_sum
            sums[1] += b_sum
            sums[2] += a_squares
            sums[3] += products
            sums[4] += b_squares


@compiled()
def _difference_lines(
    first: _Frames, second: _Frames, fraction: F64, offset: F64, reach: int, out: F64, rows_out: F64, columns_out: F64
) -> None:
    """Compute a - b - fraction (a + b) - offset in the middle of `out`, and sum its lines."""
    tile_rows, tile_cols = fraction.shape
    rows, cols = rows_out.shape[0], columns_out.shape[1]
    for r in range(rows):
        line, columns = out[r, reach:], columns_out[r % tile_rows]
        for k in range(tile_cols):
            of_sum, less = fraction[r % tile_rows, k], offset[r % tile_rows, k]
            start, step = np.uint64(k), np.uint64(tile_cols)
            lanes = np.zeros(_LANES)
            n = np.uint64(cols // tile_cols)
            for j in range(np.uint64(0), n, np.uint64(_LANES)):
                for lane in range(min(np.uint64(_LANES), n - j)):
                    place = start + step * (j + lane)
                    a, b = np.float64(first[r, place]), np.float64(second[r, place])
                    d = a - b - of_sum * (a + b) - less
                    line[place] = d
                    columns[place] += d
                    lanes[lane] += d
            rows_out[r, k] = lanes.sum()


@compiled()
def _lag_products(difference: F64, reach: int, out: F64) -> None:
    """Sum the products with the neighbors in the same and the next rows; the border of `difference` is 0."""
    tile_rows, tile_cols = out.shape[:2]
    cols = difference.shape[1] - 2 * reach
    lanes = np.empty(max(_LANES // tile_cols, 1) * tile_cols)
    for r in range(difference.shape[0] - reach):
        line = difference[r, reach : reach + cols]
        for dy in range(reach + 1):
            for dx in range(-reach, reach + 1):
                if dy == 0 and dx < 0:
                    continue
                lanes[:] = 0.0
                _dot(line, difference[r + dy, reach + dx : reach + dx + cols], lanes)
                for lane in range(lanes.size):
                    out[r % tile_rows, lane % tile_cols, reach + dy, reach + dx] += lanes[lane]


def difference_products(first: _Frames, second: _Frames, tile: tuple[int, ...], reach: int) -> DifferenceProducts:
    """Return the sums of the difference of two frames; lines beyond the last whole tile are left out.

    At each site, the mean of the difference and its part in proportion to the mean of the two frames are subtracted.

    - `first`, `second`: (rows, cols).
    - `tile`: (tile rows, tile cols).
    - `reach`: Rows and columns to the farthest neighbor.

    Examples
    --------
    >>> first, second = np.array([[5, 5, 9, 9]], np.uint16), np.array([[5, 7, 7, 9]], np.uint16)
    >>> difference_products(first, second, (1, 1), 1).near[0, 0]
    array([[ 0.  ,  0.  ,  0.  ],
           [-5.12,  6.4 , -5.12],
           [ 0.  ,  0.  ,  0.  ]])
    """
    rows, cols = (length // of_tile * of_tile for length, of_tile in zip(first.shape, tile, strict=True))
    pixels = rows * cols // (tile[0] * tile[1])
    sums = np.zeros((tile[0], tile[1], 5), np.int64)
    _pair_sums(first, second, (rows, cols), sums)
    fraction, offset = np.zeros((2, tile[0], tile[1]))
    for site in np.ndindex(*fraction.shape):
        a, b, aa, ab, bb = map(int, sums[site])
        spread = pixels * (aa + 2 * ab + bb) - (a + b) ** 2  # integers: exact
        fraction[site] = (pixels * (aa - bb) - (a - b) * (a + b)) / spread if spread else 0.0
        offset[site] = ((a - b) - fraction[site] * (a + b)) / pixels
    difference = np.zeros((rows + reach, cols + 2 * reach))
    of_rows, of_columns = np.empty((rows, tile[1])), np.zeros((tile[0], cols))
    _difference_lines(first, second, fraction, offset, reach, difference, of_rows, of_columns)
    near = np.zeros((tile[0], tile[1], 2 * reach + 1, 2 * reach + 1))
    _lag_products(difference, reach, near)
    for r, c in np.ndindex(*fraction.shape):
        for dy, dx in np.ndindex(reach + 1, 2 * reach + 1):
            if (other := dx - reach) > 0 or dy > 0:
                near[(r + dy) % tile[0], (c + other) % tile[1], reach - dy, reach - other] = near[r, c, reach + dy, dx]
    return DifferenceProducts(near, of_rows, of_columns)


@compiled()
def _plane_line(source: _Frames, start: int, step: int, out: F64) -> np.int64:
    """Copy every n-th pixel of a row, and return their sum."""
    total = np.uint64(0)
    for c in range(np.uint64(out.size)):
        value = source[np.uint64(start) + np.uint64(step) * c]
        out[c] = np.float64(value)
        total += np.uint64(value)
    return np.int64(total)


@compiled()
def _smooth_part(frame: _Frames, site: _Site, tile: _Site, row_means: F64, smooth: F64) -> None:
    """Compute the means of rows, and what else is smooth: the means of columns, and those of blocks beyond these.

    - `row_means`: (block rows, block), `smooth`: (block rows, cols); overwritten.
    """
    bands, block = row_means.shape
    cols, rows = smooth.shape[1], bands * block
    line, column = np.empty(cols), np.zeros(cols)
    for band in range(bands):
        sums = smooth[band]
        sums[:] = 0.0
        for r in range(block):
            source = frame[site[0] + tile[0] * (band * block + r)]
            row_means[band, r] = _plane_line(source, site[1], tile[1], line) / cols
            for c in range(np.uint64(cols)):
                sums[c] += line[c]
        for c in range(np.uint64(cols)):
            column[c] += sums[c]
    for band in range(bands):
        sums, of_rows = smooth[band], row_means[band].mean()
        for start in range(0, cols, block):
            beyond = 0.0
            for c in range(start, start + block):
                beyond += sums[c] / block - column[c] / rows
            for c in range(start, start + block):
                sums[c] = column[c] / rows + beyond / block - of_rows


@compiled()
def _residual_products(stack: _Frames, site: _Site, tile: _Site, row_means: F64, smooth: F64, out: F64) -> None:
    """Add the products of the frames, less what is smooth in each; one of two equal products only."""
    frames, bands, block = row_means.shape
    lines, lanes = np.empty((frames, smooth.shape[2])), np.empty(_LANES)
    for r in range(bands * block):
        for k in range(frames):
            line, less, mean = lines[k], smooth[k, r // block], row_means[k, r // block, r % block]
            _plane_line(stack[k, site[0] + tile[0] * r], site[1], tile[1], line)
            for c in range(np.uint64(line.size)):
                line[c] -= mean + less[c]
            for other in range(k + 1):
                lanes[:] = 0.0
                _dot(line, lines[other], lanes)
                out[k, other] += lanes.sum()


def frame_products(
    stack: _Frames, site: tuple[int, ...], tile: tuple[int, ...], block: int, part: int
) -> Iterator[tuple[F64, int]]:
    """Yield for each part of a plane the (frames, frames) products of its frames, and the number of its pixels.

    In each part, the means of rows, columns and blocks of each frame are subtracted. Lines beyond the last whole block
    are left out.

    - `stack`: (frames, rows, cols).
    - `block`: Rows and columns of a block.
    - `part`: Largest number of pixels of a part, but at least a row of blocks.

    Examples
    --------
    >>> stack = np.array([[[9, 5], [5, 9]], [[8, 6], [6, 8]]], np.uint16)
    >>> [(products.tolist(), pixels) for products, pixels in frame_products(stack, (0, 0), (1, 1), 2, 4)]
    [([[16.0, 8.0], [8.0, 4.0]], 4)]
    """
    at, step = (site[0], site[1]), (tile[0], tile[1])
    rows, cols = (length // block * block for length in plane_shape(stack.shape[1:], at, step))
    height = max(part // max(cols, 1) // block, 1) * block
    for start in range(0, rows if cols else 0, height):
        bands = min(height, rows - start) // block
        row_means, smooth = np.empty((len(stack), bands, block)), np.empty((len(stack), bands, cols))
        below = stack[:, start * step[0] :]
        for frame, of_rows, of_frame in zip(below, row_means, smooth, strict=True):
            _smooth_part(frame, at, step, of_rows, of_frame)
        lower = np.zeros((len(stack), len(stack)))
        _residual_products(below, at, step, row_means, smooth, lower)
        yield np.tril(lower) + np.tril(lower, -1).T, bands * block * cols
