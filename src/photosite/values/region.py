"""Parts of a frame with a name: where a chart's patches lie."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

Corners = tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float]]
"""Four (row, col) in pixels, one after the other round the shape; they run over borders: pixel i covers i to i + 1."""

ROUNDING_PX = 1e-6
"""Corners may lie this far outside a frame: computed ones that were meant to lie on its border."""


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle, rows r0 to r1 and columns c0 to c1, the second of each excluded.

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
            raise InputError(
                f"region '{self.name}' is empty or begins below 0: rows {self.r0} to {self.r1}, "
                f"columns {self.c0} to {self.c1}"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.r1 - self.r0, self.c1 - self.c0

    def inside(self) -> NDArray[np.bool_]:
        """(rows, cols) of the rectangle: all of it."""
        return np.ones(self.shape, dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class Quadrilateral:
    """Four corners and what lies between them: a square patch seen from the side, say.

    Parameters
    ----------
    name
        What it is called.
    corners
        One after the other round the shape, either way; it must be convex.

    Raises
    ------
    InputError
        If a corner is not finite or lies below 0, or the corners are not those of a convex quadrilateral in order.

    Examples
    --------
    >>> diamond = Quadrilateral("white", ((0, 4), (4, 8), (8, 4), (4, 0)))
    >>> (diamond.r0, diamond.r1, diamond.c0, diamond.c1), int(diamond.inside().sum())
    ((0, 8, 0, 8), 24)
    """

    name: str
    corners: Corners

    def __post_init__(self) -> None:
        points = np.asarray(self.corners, dtype=np.float64)
        if points.shape != (4, 2) or not np.isfinite(points).all():
            raise InputError(f"patch '{self.name}' needs four corners (row, col) of finite numbers")
        if points.min() < -ROUNDING_PX:
            raise InputError(f"patch '{self.name}' begins outside the frame, at {_listed(self.corners)}")
        turns = turning(self.corners)
        if not (turns.min() > 0 or turns.max() < 0):
            raise InputError(
                f"the corners of patch '{self.name}', {_listed(self.corners)}, do not go round a convex shape; "
                "give them one after the other round it"
            )

    @property
    def r0(self) -> int:
        """First row."""
        return math.floor(min(row for row, _ in self.corners))

    @property
    def r1(self) -> int:
        """Last row, excluded."""
        return math.ceil(max(row for row, _ in self.corners))

    @property
    def c0(self) -> int:
        """First column."""
        return math.floor(min(col for _, col in self.corners))

    @property
    def c1(self) -> int:
        """Last column, excluded."""
        return math.ceil(max(col for _, col in self.corners))

    def inside(self) -> NDArray[np.bool_]:
        """(r1 - r0, c1 - c0): the pixels that lie wholly within the four sides."""
        row = np.arange(self.r0, self.r1)[:, None] + 0.5
        col = np.arange(self.c0, self.c1)[None, :] + 0.5
        way = np.sign(turning(self.corners)[0])
        within = np.ones((row.size, col.size), dtype=np.bool_)
        for (r0, c0), (r1, c1) in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            down, along = r1 - r0, c1 - c0
            # Cross product of the side and the way to the pixel's middle; its corners differ by at most the rest.
            away = way * (down * (col - c0) - along * (row - r0))
            within &= away >= 0.5 * (abs(down) + abs(along)) - 1e-9
        return within


Patch = Region | Quadrilateral
"""What `photosite.metrics.patches` reads."""


def turning(corners: Corners) -> NDArray[np.float64]:
    """(4,): cross product of the two sides at each corner; all of one sign where the shape is convex."""
    points = np.asarray(corners, dtype=np.float64)
    side = np.roll(points, -1, axis=0) - points
    after = np.roll(side, -1, axis=0)
    return np.asarray(side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0])


def _listed(corners: Corners) -> str:
    return " ".join(f"{row:g},{col:g}" for row, col in corners)
