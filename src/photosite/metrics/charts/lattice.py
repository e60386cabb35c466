"""Points of a regular grid in an image: their rows and columns, from neighbor to neighbor."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NEAR = 0.3
"""Distance of a point from where its neighbors predict it, in steps."""


def lattice(points: Array, steps: Array, shape: tuple[int, int]) -> tuple[NDArray[np.int_], Array]:
    """Return the rows and columns of points in their grid, and the points in that order; others are left out.

    Parameters
    ----------
    points
        (n, 2) rows and columns in the image.
    steps
        (2, 2) row and column components of the steps from point to point, down and across, near the middle.
    shape
        (rows, cols) of the image; indices are counted from the point nearest to its middle.

    Examples
    --------
    >>> row, col = np.indices((3, 4)).reshape(2, -1)
    >>> index, _ = lattice(np.column_stack([10.0 * row, 10.0 * col + row]), 10.0 * np.eye(2), (20, 30))
    >>> len(index), (np.ptp(index, axis=0) + 1).tolist()
    (12, [3, 4])
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    start = int(tree.query(np.array(shape) / 2)[1])
    near = points[tree.query(points[start], min(9, len(points)))[1][1:]] - points[start]
    own = [near[np.argmin(np.hypot(*(near - steps[:, axis]).T))] for axis in (0, 1)]
    found = {start: (0, 0)}
    waiting = deque([(start, np.array(own).T)])
    while waiting:
        at, local = waiting.popleft()
        for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
            away, other = tree.query(points[at] + sign * local[:, axis])
            if other in found or away > _NEAR * np.hypot(*local[:, axis]):
                continue
            changed = local.copy()
            changed[:, axis] = sign * (points[other] - points[at])
            row, col = found[at]
            found[other] = (row + sign, col) if axis == 0 else (row, col + sign)
            waiting.append((other, changed))
    order = list(found)
    return np.array([found[k] for k in order]), points[order]
