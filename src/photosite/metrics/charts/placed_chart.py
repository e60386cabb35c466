"""A chart in an image: its patches and outline in pixels, and the light that comes from each patch."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import xyz
from photosite.color.spectrum import Spectrum
from photosite.errors import InputError, did_you_mean
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts import slanted_squares
from photosite.metrics.charts.color_checker import find_chart
from photosite.scene.placement import Homography, check_corners, field_corners, field_size, place, seen_patches
from photosite.scene.scene import Scene
from photosite.scene.scene_request import BUILT_IN_SCENES, OF_ANY_SIZE, SceneRequest, chart_options
from photosite.values.region import Corners, Patch, Region
from photosite.values.shown import Shown

Array = NDArray[np.float64]
Found = Literal["given corners", "fills the frame", "detected"]

INNER = 0.6
"""Part of a patch's side that is measured, around its center, so that blur and flare at borders stay outside."""
_GRAY_WITHIN = 0.01
"""Distance in CIE 1931 chromaticity from the white of the light within which a patch is gray."""


@dataclass(frozen=True, eq=False)
class PlacedChart(Shown):
    """A chart in an image.

    Parameters
    ----------
    name
        Built-in scene, such as "macbeth".
    scene
        The chart under its light, with a region for each patch.
    corners
        Of the chart in the image: top left, top right, bottom right, bottom left of its patches, or of the whole chart
        where it has none; (row, col) in pixels.
    patches
        The insides of the patches in the image.
    found
        How the corners are known.
    shape
        (rows, cols) of the image.
    known_light
        Whether the luminance of the chart was given.
    options
        Of the built-in scene.
    illuminant
        Light of the chart, as it was given.
    """

    name: str
    scene: Scene
    corners: Corners
    patches: tuple[Patch, ...]
    found: Found
    shape: tuple[int, int]
    known_light: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    illuminant: str | float | Spectrum = "D65"

    @property
    def region(self) -> Region:
        """The rectangle of whole pixels around the corners, within the image."""
        points = np.array(self.corners)
        (r0, c0), (r1, c1) = np.maximum(np.ceil(points.min(axis=0) - 1e-6), 0), np.floor(points.max(axis=0) + 1e-6)
        r1, c1 = min(r1, self.shape[0]), min(c1, self.shape[1])
        return Region(self.name, int(r0), int(r1), int(c0), int(c1))

    @cached_property
    def patch_xyz(self) -> Array:
        """(patches, 3) tristimulus values of the light of the patches, CIE 1931, Y in cd/m2."""
        basis = xyz(self.scene.basis, self.scene.wavelength_nm)
        parts = self.scene.regions
        weights = [self.scene.weights[:, p.r0 : p.r1, p.c0 : p.c1].mean(axis=(1, 2), dtype=np.float64) for p in parts]
        return np.array(weights).reshape(-1, len(basis)) @ basis

    @cached_property
    def white_xyz(self) -> Array:
        """(3,) tristimulus values of a perfect diffuser in the chart's light, from the light of the scene."""
        return np.asarray(xyz(self.scene.light(), self.scene.wavelength_nm))

    @cached_property
    def gray(self) -> NDArray[np.bool_]:
        """(patches,) whether a patch has the chromaticity of the light; black ones do."""
        xyz, white = self.patch_xyz, self.white_xyz
        chromaticity = xyz[:, :2] / np.maximum(xyz.sum(axis=1, keepdims=True), 1e-300)
        away = np.hypot(*(chromaticity - white[:2] / white.sum()).T)
        return np.asarray((xyz[:, 1] <= 0) | (away < _GRAY_WITHIN))

    def to_image(self, points: Array) -> Array:
        """Return points of the scene, (n, 2) rows and columns of samples, in the image."""
        return Homography.between(_scene_corners(self.scene), self.corners)(points)

    def to_scene(self, points: Array) -> Array:
        """Return points of the image, (n, 2) rows and columns, in samples of the scene."""
        return Homography.between(self.corners, _scene_corners(self.scene))(points)

    def to_scene_grid(self, row: Array, col: Array) -> tuple[Array, Array]:
        """Return rows and columns in samples of the scene, (n, m) each, of a grid of (n,) rows and (m,) columns."""
        matrix = Homography.between(self.corners, _scene_corners(self.scene)).matrix
        y, x, depth = (line[0] * row[:, None] + (line[1] * col + line[2]) for line in matrix)
        return y / depth, x / depth

    @property
    def samples_per_pixel(self) -> float:
        """Samples of the scene along a pixel's side, in the middle of the chart."""
        points = np.array(self.corners)
        middle = points.mean(axis=0)
        near = self.to_scene(middle + np.array([(0, 0), (1, 0), (0, 1)]))
        return float(max(np.hypot(*(near[1] - near[0])), np.hypot(*(near[2] - near[0]))))

    def gray_at(self, row: NDArray[np.floating[Any]], col: NDArray[np.floating[Any]]) -> Array:
        """Return the chart at points of the image, relative to its brightest sample; for gray charts.

        Raises
        ------
        InputError
            If the chart is in color.
        """
        y, x = np.broadcast_arrays(row, col)
        return self.gray_of(self.to_scene(np.stack([y, x], axis=-1)))

    def gray_of(self, points: Array) -> Array:
        """Return the chart at points of the scene, (..., 2) rows and columns of samples; as `gray_at`."""
        self._check_gray()
        at = np.floor(points).astype(np.intp)
        rows, cols = self.scene.shape
        found = self.scene.weights[0][np.clip(at[..., 0], 0, rows - 1), np.clip(at[..., 1], 0, cols - 1)]
        return np.asarray(found, dtype=np.float64)

    def gray_over(self, points: Array, size: tuple[float, float]) -> Array:
        """Return the mean of the chart over upright rectangles around points of the scene; as `gray_of`.

        Each sample counts by the area that a rectangle of `size` samples, rows and columns, shares with it.
        """
        from scipy.ndimage import map_coordinates

        self._check_gray()
        ends = [
            (low := np.clip(points[..., axis] - 0.5 * extent, 0.0, whole - extent), low + extent)
            for axis, (extent, whole) in enumerate(zip(size, self.scene.shape, strict=True))
        ]
        below = np.zeros(points.shape[:-1])
        for row, sign in zip(ends[0], (-1.0, 1.0), strict=True):
            for col, other in zip(ends[1], (-1.0, 1.0), strict=True):
                below += sign * other * map_coordinates(self._integral, [row, col], order=1, mode="nearest")
        return below / (size[0] * size[1])

    @cached_property
    def _integral(self) -> Array:
        """Sum of the samples above and to the left of each corner of samples; between corners it is bilinear."""
        total = np.cumsum(np.cumsum(self.scene.weights[0], axis=0, dtype=np.float64), axis=1)
        return np.pad(total, ((1, 0), (1, 0)))

    def _check_gray(self) -> None:
        if len(self.scene.weights) != 1:
            raise InputError("chart", value=self.name, expected="gray")


def _scene_corners(scene: Scene) -> Corners:
    if scene.patches:
        return field_corners(scene)
    rows, cols = (float(size) for size in scene.shape)
    return (0.0, 0.0), (0.0, cols), (rows, cols), (rows, 0.0)


def placed_chart(
    image: ChartImage,
    chart: str,
    *,
    corners: Corners | None = None,
    detect: bool = False,
    illuminant: str | float | Spectrum | None = None,
    luminance_cd_m2: float | None = None,
    options: Mapping[str, Any] | None = None,
) -> PlacedChart:
    """Return where a chart is in an image.

    Parameters
    ----------
    image, chart
        The image, and the name of a built-in scene.
    corners
        Top left, top right, bottom right and bottom left corner of the chart's patches (of the whole chart where it has
        none), (row, col) in pixels. None: the chart fills the frame, as a scene without a width does.
    detect
        Find the chart (ColorChecker in raw frames).
    illuminant, luminance_cd_m2
        Light of the chart, D65 by default, and its mean luminance, for measurements that need them.
    options
        Of the built-in scene, such as `{"cycles": 72}` of a star.

    Raises
    ------
    InputError
        If the chart is unknown, not found, or the corners are outside the image.
    """
    if chart not in BUILT_IN_SCENES:
        hint = did_you_mean(chart, BUILT_IN_SCENES, "photosite scenes list shows the charts")
        raise InputError("chart", value=chart, expected="the name of a built-in scene", hint=hint)
    if corners is not None and detect:
        raise InputError("corners", expected="given, or the chart detected, not both")
    light: dict[str, Any] = {"illuminant": "D65" if illuminant is None else illuminant}
    if luminance_cd_m2 is not None:
        light["mean_luminance_cd_m2"] = luminance_cd_m2
    own = chart_options(chart) | dict(options or {})
    drawn = dict(options or {})
    if chart in OF_ANY_SIZE and corners is None and not detect and not {"rows", "cols"} & drawn.keys():
        drawn |= _sides(image.shape, min(own["rows"], own["cols"]))
    scene = SceneRequest(chart, {**light, **drawn}).scene()
    known, illuminant = luminance_cd_m2 is not None, light["illuminant"]
    if detect:
        corners = _detected(image, chart, scene, own)
    if corners is None:
        return replace(filling_chart(chart, scene, image.shape, own, known_light=known), illuminant=illuminant)
    if not detect:  # the border of a chart that is found may be outside the image
        check_corners(corners, image.shape)
    patches: tuple[Patch, ...] = ()
    if scene.patches:
        patches = seen_patches(scene, corners, INNER)
    elif scene.regions:
        view = Homography.between(_scene_corners(scene), corners)
        patches = tuple(_rectangle(view, region) for region in scene.regions)
    found: Found = "detected" if detect else "given corners"
    return PlacedChart(chart, scene, corners, patches, found, image.shape, known, own, illuminant)


def _sides(shape: tuple[int, int], smaller: int) -> dict[str, int]:
    """Return the samples of a chart that takes the proportions of the frame, as those that are simulated do."""
    return {name: -(-smaller * side // min(shape)) for name, side in zip(("rows", "cols"), shape, strict=True)}


def _rectangle(view: Homography, region: Region) -> Region:
    """Return the largest upright rectangle of pixels inside the corners of a region in the image."""
    points = view(np.array([(r, c) for r in (region.r0, region.r1) for c in (region.c0, region.c1)], dtype=np.float64))
    rows, cols = np.sort(points[:, 0]), np.sort(points[:, 1])
    r0, r1, c0, c1 = (int(np.ceil(rows[1])), int(rows[2]), int(np.ceil(cols[1])), int(cols[2]))
    return Region(region.name, r0, r1, c0, c1)


def filling_chart(
    name: str, scene: Scene, shape: tuple[int, int], options: Mapping[str, Any], *, known_light: bool = False
) -> PlacedChart:
    """Return a chart where a camera places a scene that fills the frame; patches outside the frame are left out.

    Parameters
    ----------
    name, scene, options
        Built-in scene, and the options that differ from its defaults.
    shape
        (rows, cols) of the frame.
    known_light
        Whether the luminance of the scene is that of the chart.
    """
    where = place(scene.shape, shape, content=field_size(scene))
    a, b, c, d = (
        ((row - where.row_start) / where.row_step, (col - where.col_start) / where.col_step)
        for row, col in _scene_corners(scene)
    )
    patches = {}
    for region in scene.regions:
        with suppress(InputError):
            (patches[region],) = where.regions([region])
    seen = replace(scene, regions=tuple(patches))
    own = chart_options(name) | dict(options)
    corners, found = (a, b, c, d), tuple(patches.values())
    return PlacedChart(name, seen, corners, found, "fills the frame", shape, known_light, own)


def _detected(image: ChartImage, chart: str, scene: Scene, options: Mapping[str, Any]) -> Corners:
    if chart == slanted_squares.NAME:
        return slanted_squares.find_squares(image, scene.shape, options)
    if chart != "macbeth":
        expected = f"macbeth or {slanted_squares.NAME}; give the corners of other charts"
        raise InputError("detect", value=chart, expected=expected)
    return find_chart(image.mosaic_frame())
