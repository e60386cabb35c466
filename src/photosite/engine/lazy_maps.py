"""Maps whose values are computed for the part that is read, and maps in strips of rows, so that few are ever whole.

A *map* has a shape (rows, cols), and `values[part]` returns the values of a slice of rows, or of slices of rows and
columns. Arrays are maps.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64
from photosite.engine.threads import thread_count

STRIP_VALUES = 1 << 19
"""Values in a strip, 4 MB, so that it stays in the cache."""

_MOST_STRIP_VALUES = 1 << 23
"""Largest number of values in a strip that has a part for each thread."""


class Map(Protocol):
    """A map (rows, cols): an array, or a `LazyMap`."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of rows and columns."""

    def __getitem__(self, part: Any, /) -> NDArray[Any]:
        """Return the values of a slice of rows, or of slices of rows and columns."""


class LazyMap(ABC):
    """A map whose values are computed for the part that is read."""

    shape: tuple[int, ...]

    @abstractmethod
    def __getitem__(self, part: Any, /) -> F64:
        """Return the values of a slice of rows, or of slices of rows and columns."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[:], dtype)


@dataclass(frozen=True, eq=False)
class ConstantMap(LazyMap):
    """A map of one value.

    Examples
    --------
    >>> ConstantMap((3, 2), 1.5)[1:].tolist()
    [[1.5, 1.5], [1.5, 1.5]]
    """

    shape: tuple[int, ...]
    value: float = 0.0

    def __getitem__(self, part: Any, /) -> F64:
        return np.array(np.broadcast_to(self.value, self.shape)[part])


@dataclass(frozen=True, eq=False)
class MovedMap(LazyMap):
    """A map moved along the slopes of its pixels: values + distance slopes.

    Examples
    --------
    >>> MovedMap(np.array([[1.0, 2.0]]), np.array([[0.5, 0.0]]), 2.0)[:].tolist()
    [[2.0, 2.0]]
    """

    values: Map
    slopes: F64
    distance: float

    @property
    def shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """Number of rows and columns."""
        return self.values.shape

    def __getitem__(self, part: Any, /) -> F64:
        moved: F64 = self.distance * self.slopes[part]
        moved += self.values[part]
        return moved


@dataclass(frozen=True, eq=False)
class PatchedMap(LazyMap):
    """A map with other values of some pixels.

    Examples
    --------
    >>> PatchedMap(np.zeros((2, 3)), np.array([1]), np.array([2]), np.array([5.0]))[1:, 1:].tolist()
    [[0.0, 5.0]]
    """

    values: Map
    row: NDArray[np.int64]
    col: NDArray[np.int64]
    own: F64

    @property
    def shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """Number of rows and columns."""
        return self.values.shape

    def __getitem__(self, part: Any, /) -> F64:
        found = np.array(self.values[part], np.float64)
        slices = part if isinstance(part, tuple) else (part, slice(None))
        at, inside = [], np.ones(len(self.row), np.bool_)
        for each, place, length in zip(slices, (self.row, self.col), self.shape, strict=True):
            first, last, stride = each.indices(length)
            inside &= (place >= first) & (place < last) & ((place - first) % stride == 0)
            at.append((place - first) // stride)
        found[at[0][inside], at[1][inside]] = self.own[inside]
        return found


@dataclass(frozen=True, eq=False)
class SitePlane(LazyMap):
    """The plane of a site of a mosaic: every n-th row and column of a map.

    Parameters
    ----------
    values
        The mosaic.
    site, tile
        Row and column of the first value; rows and columns between neighboring values.
    shape
        Number of rows and columns of the plane.

    Examples
    --------
    >>> SitePlane(np.arange(16.0).reshape(4, 4), (1, 0), (2, 2), (2, 2))[1:, :].tolist()
    [[12.0, 14.0]]
    """

    values: Map
    site: tuple[int, int]
    tile: tuple[int, int]
    shape: tuple[int, ...]

    def __getitem__(self, part: Any, /) -> F64:
        slices = part if isinstance(part, tuple) else (part, slice(None))
        found = []
        for each, at, step, length in zip(slices, self.site, self.tile, self.shape, strict=True):
            first, last, stride = each.indices(length)
            found.append(slice(at + step * first, at + step * last, step * stride))
        return self.values[tuple(found)]


def contiguous(values: NDArray[Any]) -> F64:
    """Return values as a C-contiguous array of doubles, a copy only where they are not."""
    return np.ascontiguousarray(values, dtype=np.float64)


HELD_PIXELS = 1 << 24
"""Pixels of the largest map that is computed once and held."""


def held(values: Map) -> Map:
    """Return the values of a small map, which is faster than to compute them each time; a large one as it is.

    Examples
    --------
    >>> held(ConstantMap((1, 2), 1.5))
    array([[1.5, 1.5]])
    """
    return values if is_large(values.shape) else values[:]


def is_large(shape: tuple[int, ...]) -> bool:
    """Return whether maps of a shape are computed in strips."""
    return shape[0] * shape[1] > HELD_PIXELS


def row_strips(values: Map, unit: int = 1, rows: slice = slice(None)) -> Iterator[tuple[int, int]]:
    """Yield first and last row of strips of a map, of a multiple of `unit` rows that keep all threads busy.

    A small array is one strip. `rows` are those of the map, all by default.

    Examples
    --------
    >>> list(row_strips(ConstantMap((5, 1 << 23)), 2))
    [(0, 2), (2, 4), (4, 5)]
    """
    first, last, _ = rows.indices(values.shape[0])
    of_unit = unit * max(values.shape[1], 1)
    step = unit * max(STRIP_VALUES // of_unit, min(thread_count(), _MOST_STRIP_VALUES // of_unit), 1)
    if isinstance(values, np.ndarray) and not is_large(values.shape):
        step = max(last - first, 1)
    for start in range(first, last, step):
        yield start, min(start + step, last)


def row_means(values: Map) -> F64:
    """Return (rows,) the means of the rows of a map.

    Examples
    --------
    >>> row_means(np.array([[1.0, 2.0], [3.0, 5.0]])).tolist()
    [1.5, 4.0]
    """
    return np.concatenate([contiguous(values[r:end]).mean(axis=1) for r, end in row_strips(values)])
