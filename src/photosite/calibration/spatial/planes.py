"""Operations on one color plane of a mean frame: strips, differences and EMVA 1288's high-pass filter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.engine.map_statistics import smooth_separable

Array = NDArray[np.float64]

MARGIN = 9
"""Width in pixels of the border that the 19 x 19 kernel of the filter cannot process."""

SMALLEST_SIDE = 2 * MARGIN + 16
"""Smallest number of rows and columns of a color plane that can be high-pass filtered."""


@cache
def high_pass_kernel() -> Array:
    """Return the one-dimensional smoothing kernel (19,): a box of 7, a box of 11 and the binomial 1 2 1, convolved."""
    kernel = np.convolve(np.full(7, 1 / 7), np.full(11, 1 / 11))
    return np.convolve(kernel, np.array([0.25, 0.5, 0.25]))


def high_pass(plane: Array) -> Array:
    """Return the plane less the low-pass filtered plane, (rows - 18, cols - 18), without the border.

    The filter removes slow variation such as uneven illumination and vignetting. It is that of EMVA 1288 R4.0: 7 x 7
    box, 11 x 11 box, 3 x 3 binomial.

    Examples
    --------
    >>> ramp = np.add.outer(np.arange(40.0), np.arange(50.0))
    >>> bool(abs(high_pass(ramp)).max() < 1e-12)
    True
    """
    smooth = smooth_separable(np.ascontiguousarray(plane), high_pass_kernel())
    return plane[MARGIN:-MARGIN, MARGIN:-MARGIN] - smooth


def line_gain() -> float:
    """Return the factor by which the filter scales the variance of independent columns or rows: 1 - 2 h(0) + sum h^2.

    Examples
    --------
    >>> round(line_gain(), 4)
    0.8891
    """
    kernel = high_pass_kernel()
    return float(1.0 - 2.0 * kernel[MARGIN] + kernel @ kernel)


def pixel_gain() -> float:
    """Return the factor by which the filter scales the variance of independent pixels: 1 - 2 h(0)^2 + (sum h^2)^2.

    Examples
    --------
    >>> round(pixel_gain(), 4)
    0.9885
    """
    kernel = high_pass_kernel()
    return float(1.0 - 2.0 * kernel[MARGIN] ** 2 + (kernel @ kernel) ** 2)


VALUES_AT_A_TIME = 1 << 19
"""Values in a strip: 4 MB."""


class Plane(Protocol):
    """A map that can be sliced by rows and columns: an array or a `Difference`."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of rows and columns."""

    def __getitem__(self, part: tuple[slice, slice], /) -> NDArray[np.floating]:
        """Return the values of a rectangle."""


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference of two maps, computed only for the part that is sliced.

    Examples
    --------
    >>> Difference(np.full((2, 2), 5.0), np.eye(2))[0:1, :]
    array([[4., 5.]])
    """

    bright: Array
    dark: Array

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of rows and columns."""
        return self.bright.shape

    def __getitem__(self, part: tuple[slice, slice], /) -> Array:
        return np.asarray(self.bright[part] - self.dark[part])


def strips(plane: Plane, axis: int = 1) -> Iterator[tuple[slice, NDArray[np.floating]]]:
    """Yield a map in strips of whole lines, so that derived values do not need memory for a second map.

    Each is the slice of its lines and their values (lines, values): rows for axis 1, columns for axis 0.

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
    """Return the mean of a map."""
    rows, cols = plane.shape
    return sum(float(lines.sum(dtype=np.float64)) for _, lines in strips(plane)) / (rows * cols)


def high_passed(plane: Plane, scale: float = 1.0) -> NDArray[np.float32]:
    """Return the high-pass filtered map, without the border, multiplied by `scale`.

    Single precision is enough: the filtered values are close to zero.
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
    """Return values (n,) of evenly spaced rows, or all values if there are at most `most`."""
    rows, cols = plane.shape
    step = -(-rows * cols // most)
    return np.asarray(plane[slice(None, None, step), slice(None)]).ravel()
