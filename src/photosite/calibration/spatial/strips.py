"""Maps looked at a strip at a time, so that what is worked out from them does not need their memory again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spatial.spatial import MARGIN, high_pass

VALUES_AT_A_TIME = 1 << 19
"""Values of a strip: 4 MB."""


class Plane(Protocol):
    """A map that gives any rectangle of itself: an array, or a `Difference`."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(rows, cols)."""

    def __getitem__(self, part: tuple[slice, slice], /) -> NDArray[np.floating]:
        """The rectangle's values."""


@dataclass(frozen=True, eq=False)
class Difference:
    """One map less another, worked out where it is looked at.

    Examples
    --------
    >>> Difference(np.full((2, 2), 5.0), np.eye(2))[0:1, :]
    array([[4., 5.]])
    """

    bright: NDArray[np.float64]
    dark: NDArray[np.float64]

    @property
    def shape(self) -> tuple[int, ...]:
        """(rows, cols)."""
        return self.bright.shape

    def __getitem__(self, part: tuple[slice, slice], /) -> NDArray[np.float64]:
        return np.asarray(self.bright[part] - self.dark[part])


def strips(plane: Plane, axis: int = 1) -> Iterator[tuple[slice, NDArray[np.floating]]]:
    """Whole lines of a map, some at a time: rows where `axis` is 1, columns, as rows, where it is 0.

    Examples
    --------
    >>> [(part.start, lines.tolist()) for part, lines in strips(np.array([[1.0, 2.0], [3.0, 4.0]]), axis=0)]
    [(0, [[1.0, 3.0], [2.0, 4.0]])]
    """
    across = plane.shape[1 - axis]
    step = max(1, VALUES_AT_A_TIME // plane.shape[axis])
    for first in range(0, across, step):
        part = slice(first, min(first + step, across))
        lines = plane[part, :] if axis == 1 else plane[:, part].T
        yield part, np.ascontiguousarray(lines)


def plane_mean(plane: Plane) -> float:
    """The mean of a map."""
    rows, cols = plane.shape
    return sum(float(lines.sum(dtype=np.float64)) for _, lines in strips(plane)) / (rows * cols)


def high_passed(plane: Plane, scale: float = 1.0) -> NDArray[np.float32]:
    """The map after EMVA 1288's high-pass, without the border, times a factor.

    In single precision: of numbers about zero, which the high-pass leaves, that is as good as exact.
    """
    rows, cols = plane.shape
    out = np.empty((rows - 2 * MARGIN, cols - 2 * MARGIN), np.float32)
    step = max(1, VALUES_AT_A_TIME // cols)
    for first in range(0, out.shape[0], step):
        last = min(first + step, out.shape[0])
        lines = np.ascontiguousarray(plane[first : last + 2 * MARGIN, :], dtype=np.float64)
        np.multiply(high_pass(lines), scale, out=out[first:last], casting="same_kind")
    return out


def spread_sample(plane: Plane, most: int = 1 << 18) -> NDArray[np.floating]:
    """(n,) values of rows spread over the map: all of them where there are not more than `most`."""
    rows, cols = plane.shape
    step = -(-rows * cols // most)
    return np.asarray(plane[slice(None, None, step), slice(None)]).ravel()
