"""A chart of slanted squares: the corners of the squares, and its detection in an image."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.lattice import lattice
from photosite.scene.placement import Homography
from photosite.values.region import Corners

Array = NDArray[np.float64]

NAME = "slanted-squares"
_LEAST_AREA = 24  # points of the reduced picture
_LONG_SIDE = 600
"""Points on the longer side of the reduced picture that is searched."""
_PARALLELOGRAM = 0.85, 1.08
"""Area over 12 times the root of the determinant of the second moments: 1 for a parallelogram."""
_ALIKE = 2.5
"""Largest ratio of the area of a square to the median."""
_MOST_ELONGATED = 2.0
_HINT = "Give the corners of the chart"


def chart_corners(shape: tuple[int, int], options: Any) -> dict[tuple[int, int], Array]:
    """Return the (4, 2) corners of the squares of a chart in its samples, by row and column of the square."""
    down, across, angle = int(options["down"]), int(options["across"]), math.radians(options["angle_deg"])
    pitch = np.array([shape[0] / down, shape[1] / across])
    half = 0.5 * options["side"] * pitch.min()
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    around = half * np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)]) @ turn.T
    return {(r, c): pitch * (r + 0.5, c + 0.5) + around for r in range(down) for c in range(across)}


def reduced_image(image: ChartImage, step: float) -> tuple[Array, int]:
    """Return the means of blocks of about `step` pixels, of whole tiles, and their side."""
    tile = 1 if image.origin == "picture" else int(np.lcm(len(image.cfa), len(image.cfa[0])))
    side = max(int(step) // tile, 1) * tile
    rows, cols = (size // side for size in image.shape)
    part = image.mean[: rows * side, : cols * side]
    return part.reshape(rows, side, cols, -1).mean(axis=(1, 3)), side


def find_squares(image: ChartImage, shape: tuple[int, int], options: Any) -> Corners:
    """Find the corners of a chart of slanted squares of (rows, cols) samples; all squares must be in the image.

    Raises
    ------
    InputError
        If as many similar squares as the chart has are not found on a grid.
    """
    light, step = reduced_image(image, max(image.shape) / _LONG_SIDE)
    centers = _blobs(light)
    wanted = int(options["down"]), int(options["across"])
    expected = f"{wanted[0]} x {wanted[1]} on a grid"
    if len(centers) < wanted[0] * wanted[1]:
        raise InputError("squares found", value=len(centers), expected=expected, hint=_HINT)
    index, points = lattice(centers, _steps(centers), light.shape)
    index -= index.min(axis=0)
    size = tuple(int(n) + 1 for n in index.max(axis=0))
    if size == wanted[::-1] and size != wanted:  # the camera was turned
        index = np.stack([size[1] - 1 - index[:, 1], index[:, 0]], axis=1)
    elif size != wanted:
        raise InputError("squares found", value=f"{size[0]} x {size[1]}", expected=expected, hint=_HINT)
    drawn = chart_corners(shape, options)
    view = Homography.between([drawn[int(r), int(c)].mean(axis=0) for r, c in index], points * step)
    rows, cols = (float(n) for n in shape)
    a, b, c, d = ((float(y), float(x)) for y, x in view([(0.0, 0.0), (0.0, cols), (rows, cols), (rows, 0.0)]))
    return a, b, c, d


def _blobs(light: Array) -> Array:
    """Return (n, 2) centers of dark parallelograms of similar size."""
    from scipy.ndimage import find_objects, label, maximum_filter, minimum_filter, uniform_filter

    reach = max(light.shape) // 8
    ends = [uniform_filter(each(light, reach), reach) for each in (minimum_filter, maximum_filter)]
    labels, count = label(light < 0.5 * (ends[0] + ends[1]))
    found = []
    for number, where in enumerate(find_objects(labels, count), start=1):
        row, col = np.nonzero(labels[where] == number)
        if row.size < _LEAST_AREA or where[0].start == 0 or where[1].start == 0:
            continue
        spread = np.cov(row, col, bias=True) + np.eye(2) / 12.0
        low, high = np.linalg.eigvalsh(spread)
        full = row.size / (12.0 * math.sqrt(low * high))
        if _PARALLELOGRAM[0] < full < _PARALLELOGRAM[1] and high < _MOST_ELONGATED**2 * low:
            found.append((where[0].start + row.mean() + 0.5, where[1].start + col.mean() + 0.5, float(row.size)))
    blobs = np.array(found).reshape(-1, 3)
    if not len(blobs):
        return blobs[:, :2]
    alike = blobs[:, 2] / np.median(blobs[:, 2])
    return np.asarray(blobs[(alike < _ALIKE) & (alike > 1 / _ALIKE), :2])


def _steps(points: Array) -> Array:
    """Return (2, 2): row and column components of the steps to the next square, down and across."""
    middle = points[np.argmin(np.hypot(*(points - points.mean(axis=0)).T))]
    away = points - middle
    near = away[np.argsort(np.hypot(*away.T))[1:9]]
    turn = np.arctan2(near[:, 0], near[:, 1])
    found = []
    for angle in (math.pi / 2, 0.0):
        off = np.abs((turn - angle + math.pi) % (2.0 * math.pi) - math.pi)
        found.append(near[np.argmin(np.hypot(*near.T) * (1.0 + 4.0 * off))])
    return np.array(found).T
