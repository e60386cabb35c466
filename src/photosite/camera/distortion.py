"""What a lens's mapping does to a frame: the warps through which its cells look, and where a scene's regions lie.

With lateral chromatic aberration every wavelength has a warp of its own. A few wavelengths stand for all: their images
are at most a quarter of a pixel apart anywhere in the frame, and the light of a wavelength between is shared among four
of them, so that a sum of shifted images stands for one (`wavelength_nodes`).
"""

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
_ALONG = 65
"""Places on each side of a region that are followed through the lens."""

Pitch = tuple[float, float]


def color_nodes(
    mapping: RadialMapping | None, wavelength_nm: NDArray[np.float64], shape: tuple[int, int], pitch_m: Pitch
) -> tuple[list[float], NDArray[np.float64]]:
    """Wavelengths that stand for all, and their shares (N, wavelengths) of the light; one of them without a mapping.

    Parameters
    ----------
    mapping
        The lens's.
    wavelength_nm
        (wavelengths,) those of the light.
    shape, pitch_m
        (rows, cols) of the frame, and the distance of its pixels.

    Warns
    -----
    PhotositeWarning
        If the frame's corner lies beyond the mapping's last height.
    """
    if mapping is None:
        return [float(wavelength_nm[wavelength_nm.size // 2])], np.ones((1, wavelength_nm.size))
    corner_m = math.hypot(shape[0] * pitch_m[0], shape[1] * pitch_m[1]) / 2
    known_m = float(mapping.real_m[:, -1].min())
    if corner_m > known_m * (1 + 1e-6):
        what = (
            f"the distortion of the lens is known up to an image height of {known_m * 1e3:.4g} mm, and the frame's "
            f"corner is at {corner_m * 1e3:.4g} mm; a straight line continues it"
        )
        warnings.warn(PhotositeWarning(what, hint="Extend the table to the corner"), stacklevel=2)
    middle = float(wavelength_nm[wavelength_nm.size // 2])
    ideal_m = corner_m * float(inverse_scale(mapping, middle, corner_m)[0][-1])
    nodes, shares = wavelength_nodes(mapping, wavelength_nm, ideal_m, _STEP_PIXELS * min(pitch_m))
    used = shares.any(axis=1)
    return [float(node) for node in nodes[used]], shares[used]


def warp(mapping: RadialMapping | None, wavelength_nm: float, reach_m: float, pitch_m: Pitch) -> Warp | None:
    """The warp of a wavelength, up to a distance from the axis; None without a mapping."""
    if mapping is None:
        return None
    scale, step_m2 = inverse_scale(mapping, wavelength_nm, reach_m)
    return Warp(scale, step_m2, pitch_m)


def warped_regions(
    mapping: RadialMapping | None, where: Placement, regions: tuple[Region, ...], pitch_m: Pitch
) -> tuple[Region, ...]:
    """A scene's regions in pixels: the largest upright rectangles inside their images, at all wavelengths.

    Raises
    ------
    InputError
        If a region holds no whole pixel of the frame.
    """
    if mapping is None:
        return where.regions(regions)
    curves = [image_height(mapping, w) for w in mapping.wavelength_nm]
    share = np.linspace(0.0, 1.0, _ALONG)

    def image(row: NDArray[np.float64], col: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(wavelengths, n) rows and columns, in pixels, of places in samples."""
        y_m = ((row - where.row_start) / where.row_step - where.shape[0] / 2) * pitch_m[0]
        x_m = ((col - where.col_start) / where.col_step - where.shape[1] / 2) * pitch_m[1]
        ideal_m = np.hypot(y_m, x_m)
        on_axis = ideal_m == 0
        factor = np.stack([curve(ideal_m) / np.where(on_axis, 1.0, ideal_m) for curve in curves])
        return (
            factor * y_m / pitch_m[0] + where.shape[0] / 2,
            factor * x_m / pitch_m[1] + where.shape[1] / 2,
        )

    found = []
    for region in regions:
        down = region.r0 + share * (region.r1 - region.r0)
        across = region.c0 + share * (region.c1 - region.c0)
        top = image(np.full(_ALONG, region.r0), across)[0].max()
        bottom = image(np.full(_ALONG, region.r1), across)[0].min()
        left = image(down, np.full(_ALONG, region.c0))[1].max()
        right = image(down, np.full(_ALONG, region.c1))[1].min()
        found.append(where.whole_pixels(region.name, (top, bottom), (left, right)))
    return tuple(found)
