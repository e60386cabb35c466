"""Means over blocks of pixels of one color of a mosaic, for pictures that are smaller than a frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, compiled
from photosite.engine.threads import parallel_for


def mosaic_means(
    mosaic: NDArray[Any], first: tuple[int, int], shape: tuple[int, int], tile: tuple[int, int], step: int
) -> F32:
    """Return a mosaic `step` times smaller, each value the mean of `step` x `step` pixels of its color.

    The pixels of a value are centered on its place in the smaller mosaic, so that the colors are not displaced.

    Parameters
    ----------
    mosaic
        (rows, cols).
    first
        Row and column of the first pixel, at the beginning of a tile.
    shape
        (h, w) of the result.
    tile
        Rows and columns of a tile of the color filter array.
    step
        Pixels between values along both axes.

    Returns
    -------
    ndarray
        (h, w) float32. Pixels outside the mosaic are left out of a mean.

    Examples
    --------
    >>> mosaic_means(np.add.outer(10.0 * np.arange(8), np.arange(8.0)), (0, 0), (2, 2), (1, 1), 4)
    array([[16.5, 20.5],
           [56.5, 60.5]], dtype=float32)
    """
    out = np.empty(shape, np.float32)
    parallel_for(_mosaic_means, shape[0], mosaic, first, shape, tile, step, out)
    return out


@compiled()
def _mosaic_means(
    start: int,
    stop: int,
    mosaic: NDArray[Any],
    first: tuple[int, int],
    shape: tuple[int, int],
    tile: tuple[int, int],
    step: int,
    out: F32,
) -> None:
    rows, cols = mosaic.shape
    for i in range(start, stop):
        r0 = block_start(i, step, tile[0])
        for j in range(shape[1]):
            c0 = block_start(j, step, tile[1])
            total, count = 0.0, 0
            for r in range(first[0] + r0, first[0] + r0 + step * tile[0], tile[0]):
                if 0 <= r < rows:
                    for c in range(first[1] + c0, first[1] + c0 + step * tile[1], tile[1]):
                        if 0 <= c < cols:
                            total += mosaic[r, c]
                            count += 1
            out[i, j] = total / count


@compiled()
def block_start(index: Any, step: int, tile: int) -> Any:
    """Return the first pixel of one block or several, of the color of the value, in the window about its center."""
    low = (2 * index + 1) * step - tile * step  # twice the position of the window's edge
    start = -((1 - low) // 2)  # the first pixel whose center is inside
    return start + (index - start) % tile
