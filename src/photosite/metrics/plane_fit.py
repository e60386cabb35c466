"""Planes through values at places of a frame: uneven light over a patch is one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def without_plane(values: Array, row: NDArray[Any], col: NDArray[Any], weight: Array | None = None) -> Array:
    """Return values less the plane that fits them best, by least squares.

    Parameters
    ----------
    values
        (..., n), each row of which has its own plane.
    row, col
        (n,) places.
    weight
        (n,) of the squared deviations; None: all alike.

    Examples
    --------
    >>> row, col = np.indices((2, 3)).reshape(2, -1)
    >>> np.abs(without_plane(5.0 + 2.0 * row - col, row, col)).max() < 1e-12
    np.True_
    """
    one = np.ones(len(row))
    root = one if weight is None else np.sqrt(weight)
    middle = [np.average(place, weights=weight) for place in (row, col)]
    model = np.stack([one, row - middle[0], col - middle[1]]) * root
    # Places relative to their middle make the normal matrix well conditioned.
    basis = np.linalg.solve(np.linalg.cholesky(model @ model.T), model)
    return np.asarray(values - ((values * root) @ basis.T) @ basis / root)
