"""Named parts of a frame, such as the patches of a chart."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.values.shown import Shown

Corners = tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float]]
"""Four (row, col) in order around the shape, in pixels: pixel i covers i to i + 1."""

Border = tuple[int, int, int, int]
"""Lines around a frame: rows at the top and at the bottom, columns at the left and at the right."""

ROUNDING_PX = 1e-6
"""Tolerance for computed corners on the border of a frame."""


@dataclass(frozen=True, slots=True)
class Region(Shown):
    """A rectangle of rows r0 to r1 and columns c0 to c1, r1 and c1 excluded.

    Raises
    ------
    InputError
        If it is empty or begins below 0.

    Examples
    --------
    >>> Region("white", 10, 20, 0, 5).shape
    (10, 5)
    """

    name: str
    r0: int
    r1: int
    c0: int
    c1: int

    def __post_init__(self) -> None:
        if not (0 <= self.r0 < self.r1 and 0 <= self.c0 < self.c1):
            corners = (self.r0, self.r1, self.c0, self.c1)
            expected = "0 <= r0 < r1 and 0 <= c0 < c1"
            raise InputError("r0, r1, c0, c1", where=f"region '{self.name}'", value=corners, expected=expected)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.r1 - self.r0, self.c1 - self.c0

    @property
    def corners(self) -> Corners:
        """(row, column) of the corners: top left, top right, bottom right, bottom left."""
        return (self.r0, self.c0), (self.r0, self.c1), (self.r1, self.c1), (self.r1, self.c0)

    def inside(self) -> NDArray[np.bool_]:
        """Return the pixels inside: (rows, cols), all true."""
        return np.ones(self.shape, dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class Quadrilateral(Shown):
    """A quadrilateral, such as a square patch in perspective, in rows r0 to r1 and columns c0 to c1 (both excluded).

    Parameters
    ----------
    name
        Its name.
    corners
        In order around the shape, in either direction. The shape must be convex.

    Raises
    ------
    InputError
        If a corner is not finite or below 0, or the corners in this order do not form a convex shape.

    Examples
    --------
    >>> diamond = Quadrilateral("white", ((0, 4), (4, 8), (8, 4), (4, 0)))
    >>> (diamond.r0, diamond.r1, diamond.c0, diamond.c1), int(diamond.inside().sum())
    ((0, 8, 0, 8), 24)
    """

    name: str
    corners: Corners
    r0: int = field(init=False, repr=False)
    r1: int = field(init=False, repr=False)
    c0: int = field(init=False, repr=False)
    c1: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        points = np.asarray(self.corners, dtype=np.float64)
        if points.shape != (4, 2) or not np.isfinite(points).all():
            raise self._error("four (row, col) of finite numbers")
        if points.min() < -ROUNDING_PX:
            raise self._error("0 or above")
        turns = turning(self.corners)
        if not (turns.min() > 0 or turns.max() < 0):
            raise self._error("a convex shape, in order around it")
        rows, cols = zip(*self.corners, strict=True)
        for first, end, values in (("r0", "r1", rows), ("c0", "c1", cols)):
            object.__setattr__(self, first, math.floor(min(values)))
            object.__setattr__(self, end, math.ceil(max(values)))

    def _error(self, expected: str) -> InputError:
        return InputError("corners", where=f"patch '{self.name}'", value=self.corners, expected=expected)

    def inside(self) -> NDArray[np.bool_]:
        """Return the pixels that are completely inside, (r1 - r0, c1 - c0)."""
        row = np.arange(self.r0, self.r1)[:, None] + 0.5
        col = np.arange(self.c0, self.c1)[None, :] + 0.5
        direction = np.sign(turning(self.corners)[0])
        within = np.ones((row.size, col.size), dtype=np.bool_)
        for (r0, c0), (r1, c1) in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            down, along = r1 - r0, c1 - c0
            # Cross product of side and vector to the pixel's center; its corners differ by at most half the sum.
            distance = direction * (down * (col - c0) - along * (row - r0))
            within &= distance >= 0.5 * (abs(down) + abs(along)) - 1e-9
        return within


Patch = Region | Quadrilateral
"""A patch whose mean `photosite.metrics.patches` computes."""


def turning(corners: Corners) -> NDArray[np.float64]:
    """Return the cross product of the two sides at each corner, (4,): all of one sign if the shape is convex."""
    points = np.asarray(corners, dtype=np.float64)
    side = np.roll(points, -1, axis=0) - points
    after = np.roll(side, -1, axis=0)
    return np.asarray(side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0])
