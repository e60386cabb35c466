"""Slanted squares as they are seen in an image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.charts.slanted_squares import chart_corners, reduced_image
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_POINTS_ACROSS = 24
"""Points of the reduced image across a square."""
_LEAST_SIDE_PX = 40.0
_ROUNDS = 8
_FOUND_POINTS = 0.02
_AREA = 0.6, 1.5
"""Area of a square in the image over that of the chart."""


@dataclass(frozen=True, eq=False)
class SeenSquare(Shown):
    """A square in an image.

    Parameters
    ----------
    place
        Row and column among the squares of the chart.
    corners
        (4, 2) corners in order around it, in pixels.
    """

    place: tuple[int, int]
    corners: Array

    @property
    def center(self) -> Array:
        """Row and column of the center, in pixels."""
        return np.asarray(self.corners.mean(axis=0))


def seen_squares(image: ChartImage, chart: PlacedChart) -> list[SeenSquare]:
    """Return the squares that are whole in the image, each moved to where it is seen: distortion displaces them.

    Raises
    ------
    InputError
        If the squares are too small, or none is where the chart has it.
    """
    drawn = {place: chart.to_image(each) for place, each in chart_corners(chart.scene.shape, chart.options).items()}
    side = math.sqrt(float(np.median([_area(each) for each in drawn.values()])))
    if side < _LEAST_SIDE_PX:
        raise InputError("side of the squares in the image", value=side, expected=f"{_LEAST_SIDE_PX:g} pixels or more")
    light, step = reduced_image(image, side / _POINTS_ACROSS)
    reach = 0.5 * side / float(chart.options["side"]) / step
    found = []
    for place, corners in drawn.items():
        moved = _moved(light, corners / step, reach)
        if moved is not None and (moved >= 0).all() and (moved <= light.shape).all():
            found.append(SeenSquare(place, moved * step))
    if not found:
        raise InputError(
            "squares of the chart",
            value=0,
            expected="seen where the chart has them",
            hint="Give the corners of the chart",
        )
    return found


def _area(corners: Array) -> float:
    one, other = corners[2] - corners[0], corners[3] - corners[1]
    return abs(float(one[0] * other[1] - one[1] * other[0])) / 2


def _moved(light: Array, corners: Array, reach: float) -> Array | None:
    """Return corners moved so that their center is the centroid of the dark around it; None without a square."""
    center = corners.mean(axis=0)
    for _ in range(_ROUNDS):
        (r0, c0), (r1, c1) = (np.rint(center + sign * reach).astype(int) for sign in (-1, 1))
        part = light[max(r0, 0) : max(r1, 0), max(c0, 0) : max(c1, 0)]
        if part.size < _POINTS_ACROSS**2:
            return None
        dark, bright = np.percentile(part, (10, 90))
        inside = part < 0.5 * (dark + bright)
        row, col = np.nonzero(inside)
        seen = np.array([row.mean() + max(r0, 0), col.mean() + max(c0, 0)]) + 0.5
        step = seen - center
        center = seen
        if np.abs(step).max() < _FOUND_POINTS:
            break
    alike = float(inside.sum()) / _area(corners)
    return corners + (center - corners.mean(axis=0)) if _AREA[0] < alike < _AREA[1] else None
