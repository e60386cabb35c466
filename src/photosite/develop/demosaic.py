"""Bilinear demosaicing: from a mosaic to one plane per channel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.values.cfa import Cfa, plane_names, tile_text


def demosaic_bilinear(mosaic: ArrayLike, cfa: Cfa) -> NDArray[np.float32]:
    """Interpolate every channel of a mosaic to every pixel.

    A pixel keeps its channel's value. For another channel it gets the weighted mean of that channel's pixels at most r
    rows and columns away, with r half the tile's larger side (1 for a Bayer tile), or more where none is that near. The
    weight is (r + 1 - rows away) (r + 1 - columns away): in a Bayer mosaic 2 for direct neighbors and 1 for diagonal
    ones. At the borders the mean is over the neighbors that exist. A constant channel stays constant; in a Bayer mosaic
    one that is linear in row and column stays linear except in the outermost rows and columns.

    Parameters
    ----------
    mosaic
        (rows, cols), any real numbers.
    cfa
        Tile of the color filter array.

    Returns
    -------
    numpy.ndarray
        (rows, cols, channels) float32, planes in the order of `plane_names(cfa)`.

    Raises
    ------
    InputError
        If the mosaic is not two-dimensional, or too small to have a pixel of every channel.

    References
    ----------
    B. K. Gunturk et al., "Demosaicking: color filter array interpolation", IEEE Signal Processing Magazine 22(1), 2005;
    the bilinear kernel of a Bayer mosaic, generalised to any tile.

    Examples
    --------
    >>> planes = demosaic_bilinear([[1, 2, 1], [4, 8, 4], [1, 2, 1]], (("R", "G"), ("G", "B")))
    >>> planes[1, 1], planes[0, 1]
    (array([1., 3., 8.], dtype=float32), array([1., 2., 8.], dtype=float32))
    """
    values = np.asarray(mosaic, dtype=np.float32)
    if values.ndim != 2:
        raise InputError("mosaic", value=values.shape, expected="of shape (rows, cols)")
    names = plane_names(cfa)
    planes = np.empty((*values.shape, len(names)), dtype=np.float32)
    height, width = len(cfa), len(cfa[0])
    radius = max(height, width) // 2
    for r in range(min(height, values.shape[0])):
        for c in range(min(width, values.shape[1])):
            for k, name in enumerate(names):
                if cfa[r][c] == name:
                    planes[r::height, c::width, k] = values[r::height, c::width]
                else:
                    planes[r::height, c::width, k] = _from_neighbours(values, cfa, (r, c), name, radius)
    return planes


def _from_neighbours(
    values: NDArray[np.float32], cfa: Cfa, site: tuple[int, int], name: str, radius: int
) -> NDArray[np.float32]:
    """Return the channel's weighted mean over the neighbors of all pixels at one site of the tile."""
    height, width = len(cfa), len(cfa[0])
    if radius > 2 * max(height, width):
        expected = f"one whose channel {name} has pixels in a {values.shape[0]} x {values.shape[1]} mosaic"
        raise InputError("cfa", where="bilinear demosaic", value=tile_text(cfa), expected=expected)
    (rows, cols), (first_row, first_col) = values.shape, site
    shape = len(range(first_row, rows, height)), len(range(first_col, cols, width))
    total, weight = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    steps = range(-radius, radius + 1)
    for dr, dc in ((dr, dc) for dr in steps for dc in steps):
        if cfa[(first_row + dr) % height][(first_col + dc) % width] != name:
            continue
        w = np.float32((radius + 1 - abs(dr)) * (radius + 1 - abs(dc)))
        target_rows, source_rows = _overlap(first_row, dr, height, rows)
        target_cols, source_cols = _overlap(first_col, dc, width, cols)
        total[target_rows, target_cols] += w * values[source_rows, source_cols]
        weight[target_rows, target_cols] += w
    if not (seen := weight > 0).all():
        wider = _from_neighbours(values, cfa, site, name, radius + 1)
        return np.divide(total, weight, out=wider, where=seen)
    return total / weight


def _overlap(first: int, step: int, period: int, size: int) -> tuple[slice, slice]:
    """Return the pixels of a site, counted along an axis, that have a neighbor at a step, and these neighbors."""
    skipped = -(min(first + step, 0) // period)
    start = first + skipped * period + step
    count = min(len(range(start, size, period)), len(range(first + skipped * period, size, period)))
    return slice(skipped, skipped + count), slice(start, start + count * period, period)
