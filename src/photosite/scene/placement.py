"""The place of a scene in a frame: its samples on a grid of pixels, and a flat chart in perspective."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.scene.scene import Scene
from photosite.values.region import ROUNDING_PX, Corners, Patch, Quadrilateral, Region, turning


@dataclass(frozen=True, slots=True)
class Placement:
    """An upright scene on a grid of pixels: sample coordinate = start + step * pixel coordinate, on each axis.

    Coordinates are from border to border: pixel i covers i to i + 1. Outside its border the scene repeats its border
    samples.

    Parameters
    ----------
    row_start, col_start
        Sample coordinate of the grid's top left corner.
    row_step, col_step
        Samples per pixel.
    shape
        (rows, cols) of the grid, in pixels.
    """

    row_start: float
    col_start: float
    row_step: float
    col_step: float
    shape: tuple[int, int]

    def regions(self, sample_regions: Iterable[Region]) -> tuple[Region, ...]:
        """Return regions in pixels: the whole pixels inside them, within the frame; see `whole_pixels`."""
        found = []
        for region in sample_regions:
            r0, r1 = ((row - self.row_start) / self.row_step for row in (region.r0, region.r1))
            c0, c1 = ((col - self.col_start) / self.col_step for col in (region.c0, region.c1))
            found.append(self.whole_pixels(region.name, (r0, r1), (c0, c1)))
        return tuple(found)

    def whole_pixels(self, name: str, rows: tuple[float, float], cols: tuple[float, float]) -> Region:
        """Return the whole pixels between two rows and two columns in pixels, within the frame."""
        r0, r1 = self._inside(*rows, self.shape[0])
        c0, c1 = self._inside(*cols, self.shape[1])
        if r0 >= r1 or c0 >= c1:
            what = f"region '{name}' holds no whole pixel of a {self.shape[0]} x {self.shape[1]} frame"
            raise InputError(what, hint="Use a larger frame or a scene that fills it")
        return Region(name, r0, r1, c0, c1)

    @staticmethod
    def _inside(low: float, high: float, size: int) -> tuple[int, int]:
        # 1e-9 absorbs rounding where a border is on a pixel's border.
        first, end = math.ceil(low - 1e-9), math.floor(high + 1e-9)
        return max(first, 0), min(end, size)


def place(
    scene_shape: tuple[int, int],
    frame_shape: tuple[int, int],
    *,
    pixel_aspect: float = 1.0,
    cols_per_pixel: float | None = None,
    content: tuple[float, float] | None = None,
) -> Placement:
    """Center a scene of square samples on a frame; shapes are (rows, cols).

    Parameters
    ----------
    scene_shape, frame_shape
        In samples and in pixels.
    pixel_aspect
        A pixel's height over its width.
    cols_per_pixel
        Samples per pixel along a row; None scales the scene evenly until it covers the frame.
    content
        Rows and columns of the centered part that the frame must hold, in samples, such as a chart without its border.
        If a scene that covers the frame loses some of it, the scene is scaled until all of it fits.

    Examples
    --------
    >>> place((100, 100), (20, 50)).row_step
    2.0
    >>> place((100, 100), (20, 50), content=(90, 90)).row_step
    5.0
    """
    (scene_rows, scene_cols), (rows, cols) = scene_shape, frame_shape
    col_step = cols_per_pixel
    if col_step is None:
        steps = scene_cols / cols, scene_rows / (rows * pixel_aspect)
        col_step = min(steps)
        if content is not None and (content[0] > rows * pixel_aspect * col_step or content[1] > cols * col_step):
            col_step = max(steps)
    row_step = col_step * pixel_aspect
    start = (scene_rows - rows * row_step) / 2, (scene_cols - cols * col_step) / 2
    return Placement(*start, row_step, col_step, frame_shape)


SAMPLES_PER_PATCH = 32
"""Samples on the shorter side of the smallest patch in perspective; a border is blurred by one sample."""

_MOST_SAMPLES = 1e6
"""Limits the memory of the weights; a chart that is small in the frame gets more blurred borders."""

_CELLS = 4
"""Points per axis that a sample is the mean of."""


@dataclass(frozen=True, eq=False)
class Homography:
    """A projective map of a plane to another, such as of a flat chart to the frame of a camera without distortion.

    Parameters
    ----------
    matrix
        (3, 3): maps (a, b, 1) of one plane to a multiple of (a', b', 1) of the other.

    Notes
    -----
    R. Hartley and A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd edition 2004, chapter 4.
    """

    matrix: NDArray[np.float64]

    @classmethod
    def between(cls, source: ArrayLike, target: ArrayLike) -> Homography:
        """Return the map of four points to four others; for more points, the one of least algebraic error.

        Parameters
        ----------
        source, target
            (points, 2) each, four or more; no three of four on a line.

        Examples
        --------
        >>> square = [(0, 0), (0, 1), (1, 1), (1, 0)]
        >>> view = Homography.between(square, [(0, 0), (0, 10), (10, 8), (10, 2)])   # far side at the bottom
        >>> view([(0.0, 0.5), (0.5, 0.5)]).round(3) + 0.0
        array([[0.   , 5.   ],
               [6.25, 5.  ]])
        """
        one, other = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
        if one.ndim != 2 or one.shape != other.shape or one.shape[1] != 2 or len(one) < 4:
            raise InputError("target", value=other.shape, expected=f"four or more points, as source {one.shape}")
        scale_one, scale_other = _centring(one), _centring(other)
        (a, b), (c, d) = _apply(scale_one, one).T, _apply(scale_other, other).T
        nil, unit = np.zeros_like(a), np.ones_like(a)
        rows = np.concatenate(
            [
                np.stack([a, b, unit, nil, nil, nil, -c * a, -c * b, -c], axis=1),
                np.stack([nil, nil, nil, a, b, unit, -d * a, -d * b, -d], axis=1),
            ]
        )
        _, size, directions = np.linalg.svd(rows)
        if size[7] < 1e-9 * size[0]:
            raise InputError("source", expected="points that span an area, not on one line")
        return cls(np.asarray(np.linalg.inv(scale_other) @ directions[-1].reshape(3, 3) @ scale_one))

    @property
    def inverse(self) -> Homography:
        """The inverse map."""
        return Homography(np.asarray(np.linalg.inv(self.matrix)))

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return mapped points (..., 2)."""
        return _apply(self.matrix, np.asarray(points, dtype=np.float64))


def _apply(matrix: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    mapped = points @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(mapped[..., :2] / mapped[..., 2:])


def _centring(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3): centers the points and scales them to unit size, against rounding errors (Hartley)."""
    middle = points.mean(axis=0)
    size = float(np.abs(points - middle).max())
    scale = 1.0 / size if size > 0 else 1.0
    return np.array([[scale, 0.0, -scale * middle[0]], [0.0, scale, -scale * middle[1]], [0.0, 0.0, 1.0]])


def check_corners(corners: Corners, shape: tuple[int, int]) -> None:
    """Check the four corners of a chart in a frame of (rows, cols) pixels."""
    points = np.asarray(corners, dtype=np.float64)
    if points.shape != (4, 2) or not np.isfinite(points).all():
        raise InputError("corners", value=corners, expected="four of (row, col) in pixels")
    outside = (points < -ROUNDING_PX) | (points > np.asarray(shape) + ROUNDING_PX)
    if outside.any():
        worst = points[outside.any(axis=1)][0]
        expected, hint = f"within the frame of {shape[0]} x {shape[1]} pixels", "Give row,col with rows from the top"
        raise InputError("corners", value=(float(worst[0]), float(worst[1])), expected=expected, hint=hint)
    turns = turning(corners)
    if not (turns.min() > 0 or turns.max() < 0):
        hint = "Give top left, top right, bottom right, bottom left"
        raise InputError("corners", value=corners, expected="the corners of a convex shape in order", hint=hint)


def field_corners(chart: Scene) -> Corners:
    """Return the corners of a chart's patches in samples: top left, top right, bottom right, bottom left.

    The patches are bright and the border is black, as in `photosite.scene.charts.macbeth`.

    Examples
    --------
    >>> from photosite.scene.charts import macbeth
    >>> field_corners(macbeth())
    ((4.0, 4.0), (4.0, 192.0), (128.0, 192.0), (128.0, 4.0))
    """
    lit = np.any(chart.weights != 0, axis=0)
    rows, cols = np.flatnonzero(lit.any(axis=1)), np.flatnonzero(lit.any(axis=0))
    if not rows.size:
        raise InputError("a dark chart has no corners")
    top, bottom, left, right = float(rows[0]), float(rows[-1] + 1), float(cols[0]), float(cols[-1] + 1)
    return (top, left), (top, right), (bottom, right), (bottom, left)


def field_size(chart: Scene) -> tuple[float, float] | None:
    """Return the rows and columns of samples between the borders of a chart of patches; None for any other scene.

    Examples
    --------
    >>> from photosite.scene.charts import macbeth
    >>> field_size(macbeth())
    (124.0, 188.0)
    """
    if not chart.patches or not np.any(chart.weights):
        return None
    (top, left), _, (bottom, right), _ = field_corners(chart)
    return bottom - top, right - left


def seen_patches(chart: Scene, corners: Corners, inner: float) -> tuple[Quadrilateral, ...]:
    """Return the inner parts of a chart's patches in a frame.

    Parameters
    ----------
    chart
        A chart with regions, facing the camera.
    corners
        Of its patches in the frame, in the order of `field_corners`.
    inner
        Part of each patch's side to keep, around its center; above 0, at most 1.

    Examples
    --------
    >>> from photosite.scene.charts import macbeth
    >>> seen = seen_patches(macbeth(), ((10, 20), (12, 220), (140, 210), (150, 15)), inner=0.6)
    >>> len(seen), seen[0].name
    (24, 'dark skin')
    """
    if not 0 < inner <= 1:
        raise InputError("inner", value=inner, expected="above 0 and at most 1")
    view = Homography.between(field_corners(chart), corners)
    found = []
    for region in chart.regions:
        r0, r1, c0, c1 = _whole_patch(chart, region)
        middle, half = np.array([(r0 + r1) / 2, (c0 + c1) / 2]), inner / 2 * np.array([r1 - r0, c1 - c0])
        square = middle + half * np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)])
        a, b, c, d = ((float(row), float(col)) for row, col in view(square))
        found.append(Quadrilateral(region.name, (a, b, c, d)))
    return tuple(found)


def _whole_patch(chart: Scene, region: Patch) -> tuple[int, int, int, int]:
    """First and last row and column of the patch around a region, the last excluded."""
    row, col = (region.r0 + region.r1) // 2, (region.c0 + region.c1) // 2
    color = chart.weights[:, row, col]
    alike = (chart.weights == color[:, None, None]).all(axis=0)
    rows, cols = alike[:, col], alike[row]
    return (*_run(rows, row), *_run(cols, col))


def _run(alike: NDArray[np.bool_], at: int) -> tuple[int, int]:
    """The run of true entries around one of them."""
    changes = np.flatnonzero(~alike)
    before, after = changes[changes < at], changes[changes > at]
    return int(before[-1]) + 1 if before.size else 0, int(after[0]) if after.size else alike.size


def in_perspective(chart: Scene, corners: Corners, frame_shape: tuple[int, int], *, pixel_aspect: float = 1.0) -> Scene:
    """Return the scene of a chart whose patches have given corners in the frame, with black around it.

    Its samples are pixels or squares of pixels, each the mean of the chart over its area, small enough that the inner
    part of a patch has one color.

    Parameters
    ----------
    chart
        The chart, facing the camera.
    corners
        Of its patches in the frame, in the order of `field_corners`.
    frame_shape
        (rows, cols) of the frame, in pixels.
    pixel_aspect
        A pixel's height over its width.

    Returns
    -------
    Scene
        It fills the sensor; its spectra and distance are the chart's, and its patches are matte: their radiance does
        not depend on the viewing angle.

    Examples
    --------
    >>> from photosite.scene.charts import macbeth
    >>> seen = in_perspective(macbeth(), ((10, 20), (12, 220), (140, 210), (150, 15)), (160, 240))
    >>> len(seen.weights), round(float(seen.weights.sum(axis=0).max()), 3)
    (24, 1.0)
    """
    check_corners(corners, frame_shape)
    patches = seen_patches(chart, corners, inner=1.0)
    points = np.array([patch.corners for patch in patches])
    side = float(np.hypot(*np.moveaxis(points - np.roll(points, 1, axis=1), 2, 0)).min())
    pixels = max(1.0, side / SAMPLES_PER_PATCH, math.sqrt(frame_shape[0] * frame_shape[1] / _MOST_SAMPLES))
    shape = (math.ceil(frame_shape[0] * pixel_aspect / pixels), math.ceil(frame_shape[1] / pixels))
    where = place(shape, frame_shape, pixel_aspect=pixel_aspect)
    back = Homography.between(field_corners(chart), corners).inverse
    labels = _labels(chart)
    seen = np.zeros((len(chart.weights) + 1, *shape), np.float32)
    part = (np.arange(_CELLS) + 0.5) / _CELLS
    for row in range(shape[0]):
        rows = (row + part - where.row_start) / where.row_step
        cols = ((np.arange(shape[1])[:, None] + part).ravel() - where.col_start) / where.col_step
        at = back(np.stack(np.meshgrid(rows, cols, indexing="ij"), axis=-1))
        found = _looked_up(labels, at).reshape(_CELLS, shape[1], _CELLS)
        for label in np.unique(found):
            seen[label, row] = (found == label).mean(axis=(0, 2))
    return replace(chart, weights=seen[1:], width_m=None, regions=(), name=f"{chart.name}, in perspective")


def _labels(chart: Scene) -> NDArray[np.intp]:
    """(rows, cols): 1 + the index of a sample's spectrum, 0 for black."""
    if not np.isin(chart.weights, (0.0, 1.0)).all() or (chart.weights.sum(axis=0) > 1).any():
        raise InputError("chart", expected="evenly lit, with one spectrum in each sample")
    return np.where(chart.weights.any(axis=0), chart.weights.argmax(axis=0) + 1, 0)


def _looked_up(labels: NDArray[np.intp], at: NDArray[np.float64]) -> NDArray[np.intp]:
    """The labels at (..., 2) points of the chart; 0 outside it."""
    row, col = np.floor(at[..., 0]), np.floor(at[..., 1])
    on = (row >= 0) & (row < labels.shape[0]) & (col >= 0) & (col < labels.shape[1])
    found = np.zeros(row.shape, dtype=np.intp)
    found[on] = labels[row[on].astype(np.intp), col[on].astype(np.intp)]
    return found
