"""Statistics of many values in double precision, with the bits of NumPy's, without a copy of all values in doubles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.engine.jit import F64

Part = Callable[[slice], NDArray[np.floating]]
"""Returns the values of a slice of a sequence."""

_PIECE = 1 << 19
"""Largest number of values that are computed at once."""


def order_statistics(values: NDArray[np.floating], ranks: ArrayLike) -> F64:
    """Return the values with given ranks, from 0, in doubles.

    Examples
    --------
    >>> order_statistics(np.array([3.0, 1.0, 2.0], np.float32), [0, 2]).tolist()
    [1.0, 3.0]
    """
    index = np.asarray(ranks)
    ordered = np.partition(values.ravel(), np.unique(index))
    return np.asarray(ordered[index], np.float64)


def quantiles(values: NDArray[np.floating], fractions: ArrayLike) -> F64:
    """Return the quantiles of values as `numpy.quantile` does of the values in doubles.

    Examples
    --------
    >>> quantiles(np.array([1.0, 2.0, 4.0], np.float32), [0.5, 0.75]).tolist()
    [2.0, 3.0]
    """
    place = np.asarray(fractions) * (values.size - 1)
    first = np.floor(place).astype(np.int64)
    low, high = order_statistics(values, [first, np.minimum(first + 1, values.size - 1)])
    part = place - first
    found: F64 = np.where(part >= 0.5, high - (high - low) * (1.0 - part), low + (high - low) * part)
    return found


def median(values: NDArray[np.floating]) -> float:
    """Return the median of values as `numpy.median` does of the values in doubles.

    Examples
    --------
    >>> median(np.array([1.0, 2.0, 4.0, 5.0], np.float32))
    3.0
    """
    middle = values.size // 2
    return float(order_statistics(values, [middle - 1 + values.size % 2, middle]).mean())


def pieces(size: int) -> Iterator[slice]:
    """Yield the slices of a long sequence that are computed one at a time."""
    for start in range(0, size, _PIECE):
        yield slice(start, min(start + _PIECE, size))


def mean(part: Part, size: int) -> float:
    """Return the mean of a sequence in doubles, of which a slice is computed at a time, as `numpy.mean` does.

    Examples
    --------
    >>> values = np.arange(5, dtype=np.float32)
    >>> mean(lambda piece: values[piece] ** 2, values.size)
    6.0
    """
    return _sum(part, slice(0, size)) / size


def mean_and_deviation(part: Part, size: int) -> tuple[float, float]:
    """Return mean and standard deviation of such a sequence, as `numpy.mean` and `numpy.std` do.

    Examples
    --------
    >>> mean_and_deviation(lambda piece: np.array([1.0, 3.0])[piece], 2)
    (2.0, 1.0)
    """
    center = mean(part, size)
    return center, math.sqrt(mean(lambda piece: (np.asarray(part(piece), np.float64) - center) ** 2, size))


def _sum(part: Part, piece: slice) -> float:
    """Sum as NumPy does: halves of a multiple of eight values, down to few."""
    size = piece.stop - piece.start
    if size <= _PIECE:
        return float(np.asarray(part(piece), np.float64).sum())
    middle = piece.start + size // 2 // 8 * 8
    return _sum(part, slice(piece.start, middle)) + _sum(part, slice(middle, piece.stop))
