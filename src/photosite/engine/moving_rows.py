"""Rows of a moving image, each integrated over its own exposure.

The image is that of a scene at rest: `images[k, i, j]` is what a pixel of channel k collects per second at cell (i, j).
A cell is a part of a pixel. While a pixel of the frame is exposed, it sees a path of places on the cells. Between cells
the image is interpolated by cubic convolution, phi(y) phi(x) (Keys, IEEE Trans. ASSP 29 (1981) 1153).

An exposure is split into steps with known light. All pixels of a row have the path of a translation, up to their own
position. Its integral is then a short kernel for each row::

    kernel(i, j) = sum over steps of light * mean over the step of phi(i - y(t)) phi(j - x(t))

The mean is exact: between crossings of cells the product is a polynomial of degree 6, and Gauss's rule of four nodes
integrates degree 7. Other affine motions give every pixel its own path, which is sampled at nodes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from photosite.engine.jit import F32, F64, I64, compiled
from photosite.engine.threads import parallel_for

_NODE = np.polynomial.legendre.leggauss(4)[0] * 0.5 + 0.5
_WEIGHT = np.polynomial.legendre.leggauss(4)[1] * 0.5


class Cells(NamedTuple):
    """Images of the channels on the cells of a larger field, and the place of the frame's pixels on it."""

    # (channels, R, phases, C / phases) electrons per second. Column j is at [..., j % phases, j // phases]. The cells
    # of one kind of pixel follow one another if the phases are the cells per pixel times the columns of the tile.
    images: F32
    per_pixel: int  # cells per pixel on each axis
    # Cell at the center of the frame's first pixel
    first_row: int
    first_col: int
    tile: I64  # (tile rows, tile cols) channel of each site of the color filter array


def in_phases(images: F32, phases: int) -> F32:
    """Return (channels, R, phases, C / phases) of images (channels, R, C), whose last column is repeated to fill up.

    Examples
    --------
    >>> in_phases(np.arange(5, dtype=np.float32)[None, None], 2)[0, 0]
    array([[0., 2., 4.],
           [1., 3., 4.]], dtype=float32)
    """
    missing = -images.shape[2] % phases
    padded = np.pad(images, ((0, 0), (0, 0), (0, missing)), mode="edge") if missing else images
    return np.ascontiguousarray(padded.reshape(*images.shape[:2], -1, phases).swapaxes(2, 3))


def translated_rows(cells: Cells, y: F64, x: F64, light_s: F64, out: F32) -> None:
    """Compute `out`, (rows, cols) electrons of an image that is translated.

    The phases of the cells are those of one kind of pixel. `y` and `x` are (rows, steps + 1) displacements of the
    places that the pixels of a row see, in cells, at the ends of the steps, and straight between them. `light_s` is
    (rows, steps) seconds of mean light. All places must lie on the images, and so must the two cells to each side. What
    cubic convolution leaves below 0 becomes 0.
    """
    parallel_for(_translated_rows, len(out), cells, y, x, light_s, out)


@compiled()
def _translated_rows(start: int, stop: int, cells: Cells, y: F64, x: F64, light_s: F64, out: F32) -> None:
    for r in range(start, stop):
        _translated_row(cells, r, y[r], x[r], light_s[r], out[r])


@compiled()
def _translated_row(cells: Cells, r: int, y: F64, x: F64, light_s: F64, out: F32) -> None:
    top, left = int(np.floor(y.min())) - 1, int(np.floor(x.min())) - 1
    kernel = np.zeros((int(np.floor(y.max())) + 3 - top, int(np.floor(x.max())) + 3 - left))
    for s in range(light_s.size):
        _add_step(kernel, y[s] - top, x[s] - left, y[s + 1] - top, x[s + 1] - left, light_s[s])
    n = cells.per_pixel
    tile_rows, tile_cols = cells.tile.shape
    first_row, phases = cells.first_row + n * r + top, n * tile_cols
    for c in range(min(tile_cols, out.size)):
        image = cells.images[cells.tile[r % tile_rows, c]]
        count = (out.size - c + tile_cols - 1) // tile_cols
        total = np.zeros(count, np.float32)
        for i in range(kernel.shape[0]):
            for j in range(kernel.shape[1]):
                weight = np.float32(kernel[i, j])
                if weight != 0.0:
                    first = cells.first_col + n * c + left + j
                    source = image[first_row + i, first % phases, first // phases :]
                    for k in range(count):
                        total[k] += weight * source[k]
        for k in range(count):
            out[c + k * tile_cols] = max(total[k], np.float32(0.0))


@compiled()
def _add_step(kernel: F64, y0: float, x0: float, y1: float, x1: float, light_s: float) -> None:
    """Add the kernel of a straight path, cell by cell."""
    along_y, along_x = y1 - y0, x1 - x0
    at = 0.0
    while at < 1.0:
        end = min(_next_crossing(y0, along_y, at), _next_crossing(x0, along_x, at), 1.0)
        length = end - at
        middle = at + 0.5 * length
        row, col = int(np.floor(y0 + middle * along_y)), int(np.floor(x0 + middle * along_x))
        for g in range(4):
            place = at + length * _NODE[g]
            part = light_s * length * _WEIGHT[g]
            into_y, into_x = y0 + place * along_y - row, x0 + place * along_x - col
            down, across = _keys(into_y), _keys(into_x)
            for i in range(4):
                for j in range(4):
                    kernel[row - 1 + i, col - 1 + j] += part * down[i] * across[j]
        at = end


@compiled()
def _next_crossing(start: float, along: float, at: float) -> float:
    """Return the fraction of a path at which it next reaches a whole number after a fraction `at`; 2 for never."""
    if along == 0.0:
        return 2.0
    here = start + at * along
    whole = np.floor(here) + 1.0 if along > 0.0 else np.ceil(here) - 1.0
    fraction = (whole - start) / along
    # Rounding may leave the crossing that was just passed.
    return float(fraction if fraction > at + 1e-12 else (whole + np.sign(along) - start) / along)


@compiled(inline=True)
def _keys(t: float) -> tuple[float, float, float, float]:
    """Return the weights of the cells -1, 0, 1, 2 at a place between cells 0 and 1."""
    return (
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )


def sampled_rows(cells: Cells, places: F64, light_s: F64, out: F32) -> None:
    """Compute `out`, (rows, cols) electrons of an image in affine motion.

    The cells have one phase. `places` is (rows, nodes, 4): row and column of the cell that the first pixel of the row
    sees at each node of its exposure, and what each further pixel adds to them. `light_s` is (rows, nodes) seconds of
    mean light. Beyond their border the images repeat their border cells.
    """
    parallel_for(_sampled_rows, len(out), cells, places, light_s, out)


@compiled()
def _sampled_rows(start: int, stop: int, cells: Cells, places: F64, light_s: F64, out: F32) -> None:
    for r in range(start, stop):
        _sampled_row(cells, r, places[r], light_s[r], out[r])


@compiled()
def _sampled_row(cells: Cells, r: int, places: F64, light_s: F64, out: F32) -> None:
    tile_rows, tile_cols = cells.tile.shape
    rows, cols = cells.images.shape[1], cells.images.shape[3]
    most = (out.size + tile_cols - 1) // tile_cols
    down, across, corner = np.empty((most, 4), np.float32), np.empty((most, 4), np.float32), np.empty(most, np.int32)
    for first in range(min(tile_cols, out.size)):
        image = cells.images[cells.tile[r % tile_rows, first]].reshape(-1)
        count = (out.size - first + tile_cols - 1) // tile_cols
        total = np.zeros(count, np.float32)
        for s in range(light_s.size):
            y0, x0, along_y, along_x = places[s]
            weight = np.float32(light_s[s])
            for k in range(count):
                c = first + k * tile_cols
                y = min(max(y0 + c * along_y, 1.0), rows - 3.0)
                x = min(max(x0 + c * along_x, 1.0), cols - 3.0)
                row, col = np.int32(y), np.int32(x)
                corner[k] = (row - np.int32(1)) * np.int32(cols) + col - np.int32(1)
                down[k, 0], down[k, 1], down[k, 2], down[k, 3] = _keys32(np.float32(y - row))
                across[k, 0], across[k, 1], across[k, 2], across[k, 3] = _keys32(np.float32(x - col))
            for k in range(count):
                total[k] += weight * _cubic(image, corner[k], cols, down[k], across[k])
        for k in range(count):
            out[first + k * tile_cols] = max(total[k], np.float32(0.0))


@compiled(inline=True)
def _keys32(t: np.float32) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Return `_keys` in single precision; the four add up to 1."""
    half, one, two = np.float32(0.5), np.float32(1.0), np.float32(2.0)
    before = t - one
    a, d = -half * t * before * before, half * t * t * before
    c = t * (half + t * (two - (one + half) * t))
    return a, one - a - c - d, c, d


@compiled(inline=True)
def _cubic(image: F32, corner: np.int32, cols: int, down: F32, across: F32) -> np.float32:
    """Return the sum of 4 x 4 cells from a corner on, with their weights on each axis."""
    # Unsigned numbers need no check for indices from the end.
    upper, one, two, three = np.uint64(corner), np.uint64(1), np.uint64(2), np.uint64(3)
    row2 = upper + np.uint64(cols)
    row3 = row2 + np.uint64(cols)
    row4 = row3 + np.uint64(cols)
    a, b, c, d = down[0], down[1], down[2], down[3]
    col1 = (a * image[upper] + b * image[row2]) + (c * image[row3] + d * image[row4])
    col2 = (a * image[upper + one] + b * image[row2 + one]) + (c * image[row3 + one] + d * image[row4 + one])
    col3 = (a * image[upper + two] + b * image[row2 + two]) + (c * image[row3 + two] + d * image[row4 + two])
    col4 = (a * image[upper + three] + b * image[row2 + three]) + (c * image[row3 + three] + d * image[row4 + three])
    return np.float32((across[0] * col1 + across[1] * col2) + (across[2] * col3 + across[3] * col4))
