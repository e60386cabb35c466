"""Matrices put together along a diagonal."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def block_diagonal(*blocks: NDArray[Any]) -> NDArray[Any]:
    """Return a matrix with the given matrices along its diagonal, and zeros elsewhere.

    Examples
    --------
    >>> block_diagonal(np.eye(1), np.full((1, 2), 3.0))
    array([[1., 0., 0.],
           [0., 3., 3.]])
    """
    ends = np.cumsum([(0, 0), *(block.shape for block in blocks)], axis=0)
    whole = np.zeros(ends[-1], np.result_type(*blocks))
    for (row, col), block in zip(ends, blocks, strict=False):
        whole[row : row + block.shape[0], col : col + block.shape[1]] = block
    return whole
