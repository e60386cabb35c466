"""Distortion and lateral color on a frame: wavelength nodes, warps, and the regions of a distorted image."""

from __future__ import annotations

import math
import warnings

import numpy as np
from numpy.typing import NDArray

from photosite.engine.warp import Warp
from photosite.errors import PhotositeWarning
from photosite.optics.mapping import RadialMapping, image_height, inverse_scale, wavelength_nodes
from photosite.scene.placement import Placement
from photosite.values.region import Region

_STEP_PIXELS = 0.1
_POINTS_PER_SIDE = 65
"""Points on each side of a region whose images are computed."""

Pitch = tuple[float, float]
Array = NDArray[np.float64]


def frame_wavelength_nodes(
    mapping: RadialMapping | None, wavelength_nm: Array, shape: tuple[int, int], pitch_m: Pitch
) -> tuple[list[float], Array]:
    """Return a few wavelengths whose images stand for all, and the share of each wavelength's light at each of them.

    The images of neighboring nodes are at most a quarter of a pixel apart anywhere in the frame.

    - `mapping`: Distortion of the lens; None is no distortion, and one node.
    - `wavelength_nm`: (wavelengths,) of the light.
    - `shape`, `pitch_m`: (rows, cols) of the frame, and its pixel pitch.

    Returns N wavelengths in nm, and the shares, (N, wavelengths).
    """
    middle = float(wavelength_nm[wavelength_nm.size // 2])
    if mapping is None:
        return [middle], np.ones((1, wavelength_nm.size))
    corner_m = math.hypot(shape[0] * pitch_m[0], shape[1] * pitch_m[1]) / 2
    known_m = float(mapping.real_m[:, -1].min())
    if corner_m > known_m * (1 + 1e-6):
        what = (
            f"the distortion of the lens is known up to an image height of {known_m * 1e3:.4g} mm, but the frame's "
            f"corner is at {corner_m * 1e3:.4g} mm; a straight line continues it"
        )
        warnings.warn(PhotositeWarning(what, hint="Extend the table to the corner"), stacklevel=2)
    ideal_m = corner_m * float(inverse_scale(mapping, middle, corner_m)[0][-1])
    nodes, shares = wavelength_nodes(mapping, wavelength_nm, ideal_m, _STEP_PIXELS * min(pitch_m))
    used = shares.any(axis=1)
    return [float(node) for node in nodes[used]], shares[used]


def frame_warp(mapping: RadialMapping | None, wavelength_nm: float, reach_m: float, pitch_m: Pitch) -> Warp | None:
    """Return the warp of a wavelength, up to a distance from the axis; None without a mapping."""
    if mapping is None:
        return None
    scale, step_m2 = inverse_scale(mapping, wavelength_nm, reach_m)
    return Warp(scale, step_m2, pitch_m)


def warped_regions(
    mapping: RadialMapping | None, where: Placement, regions: tuple[Region, ...], pitch_m: Pitch
) -> tuple[Region, ...]:
    """Return a scene's regions in pixels: the largest upright rectangles inside their images at all wavelengths."""
    if mapping is None:
        return where.regions(regions)
    curves = [image_height(mapping, w) for w in mapping.wavelength_nm]
    share = np.linspace(0.0, 1.0, _POINTS_PER_SIDE)

    def image(row: Array, col: Array) -> tuple[Array, Array]:
        """Return (wavelengths, n) rows and columns in pixels of points in scene samples."""
        y_m = ((row - where.row_start) / where.row_step - where.shape[0] / 2) * pitch_m[0]
        x_m = ((col - where.col_start) / where.col_step - where.shape[1] / 2) * pitch_m[1]
        ideal_m = np.hypot(y_m, x_m)
        on_axis = ideal_m == 0
        factor = np.stack([curve(ideal_m) / np.where(on_axis, 1.0, ideal_m) for curve in curves])
        return (factor * y_m / pitch_m[0] + where.shape[0] / 2, factor * x_m / pitch_m[1] + where.shape[1] / 2)

    found = []
    for region in regions:
        down = region.r0 + share * (region.r1 - region.r0)
        across = region.c0 + share * (region.c1 - region.c0)
        top = image(np.full(_POINTS_PER_SIDE, region.r0), across)[0].max()
        bottom = image(np.full(_POINTS_PER_SIDE, region.r1), across)[0].min()
        left = image(down, np.full(_POINTS_PER_SIDE, region.c0))[1].max()
        right = image(down, np.full(_POINTS_PER_SIDE, region.c1))[1].min()
        found.append(where.whole_pixels(region.name, (top, bottom), (left, right)))
    return tuple(found)
