"""Orientation of a stored image, as in TIFF and Exif (TIFF 6.0, tag 274)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TURNED: dict[Any, Callable[[NDArray[Any]], NDArray[Any]]] = {
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a[::-1, ::-1].swapaxes(0, 1),
    8: lambda a: np.rot90(a),
}


def turned_upright(image: NDArray[Any], orientation: Any) -> NDArray[Any]:
    """Return a (rows, cols, ...) image upright; unchanged for orientation 1 and for what is no orientation.

    Examples
    --------
    >>> turned_upright(np.array([[1, 2, 3]]), 6).tolist()
    [[1], [2], [3]]
    """
    turn = _TURNED.get(orientation)
    return image if turn is None else turn(image)
