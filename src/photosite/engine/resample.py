"""Means over rectangles: a map of square samples brought to another grid, light neither lost nor made."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numpy.typing import NDArray


def overlap_matrix(count: int, start: float, step: float, samples: int) -> scipy.sparse.csr_array:
    """(count, samples): row i holds each sample's share of the interval start + step i to start + step (i + 1).

    Beyond its ends the line of samples repeats its last ones.

    Examples
    --------
    >>> overlap_matrix(2, 0.5, 1.5, 3).toarray().round(3)
    array([[0.333, 0.667, 0.   ],
           [0.   , 0.   , 1.   ]])
    """
    borders = start + step * np.arange(count + 1)
    # Borders between outputs and borders between samples cut the line into pieces of one sample and one output each.
    inner = np.arange(1, samples, dtype=np.float64)
    cuts = np.union1d(borders, inner[(inner > borders[0]) & (inner < borders[-1])])
    middle = (cuts[:-1] + cuts[1:]) / 2
    row = np.searchsorted(borders, middle, side="right") - 1
    col = np.clip(np.floor(middle), 0, samples - 1)
    share = np.diff(cuts) / step
    return scipy.sparse.csr_array((share, (row, col.astype(np.intp))), shape=(count, samples))


def area_mean(
    maps: NDArray[np.float32],
    shape: tuple[int, int],
    start: tuple[float, float],
    step: tuple[float, float],
) -> NDArray[np.float32]:
    """Each output cell's mean over the samples it covers.

    Parameters
    ----------
    maps
        (maps, rows, cols).
    shape
        (rows, cols) of the output.
    start, step
        (row, col) sample coordinate of the output's corner, and samples per output cell.

    Returns
    -------
    ndarray
        (maps, *shape) float32.
    """
    down = overlap_matrix(shape[0], start[0], step[0], maps.shape[1]).astype(np.float32)
    across = overlap_matrix(shape[1], start[1], step[1], maps.shape[2]).astype(np.float32).T.tocsr()
    out = np.empty((maps.shape[0], *shape), np.float32)
    for k, values in enumerate(maps):
        narrow = (across.T @ values.T).T  # (rows, shape[1])
        out[k] = down @ np.ascontiguousarray(narrow)
    return out
