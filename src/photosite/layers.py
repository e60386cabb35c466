"""Scenes in depth: planes one behind another, each imaged by itself, put together from the farthest to the nearest.

Every plane has its own magnification, defocus, distortion and fall-off. A plane p lets pass of what is behind it what
its opacity, imaged as it is itself, leaves over, channel by channel:

    image = image_p(alpha radiance) + (1 - image_p(alpha)) * image behind.

The opacity's image is taken in the light that it takes away: in the mean spectrum of what is behind. These are linear
layers; a lens sees each point of a plane through its whole pupil, and another part of the plane behind through each
part of the pupil. The product is exact where either of the two is in focus, but for the lens's finest blur, and where
the plane behind is even. It errs near edges of opacity where both are out of focus, or several opacities are
(docs/depth.md).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.mosaic import arrived, image_rate, image_regions, warn_of_missing_light
from photosite.optics.spread import Optics
from photosite.regions import Region
from photosite.scene.planes import Plane, Planes
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.spectra import Rule

_STRIP = 256


def layered_rate(
    planes: Planes, optics: Optics, sensor: Sensor, *, rule: Rule, cells_per_pixel: int
) -> NDArray[np.float32]:
    """(rows, cols) mean electrons from light per second of a scene in depth; see `Camera.mean_electrons`."""
    for plane in planes.planes:
        warn_of_missing_light(plane.scene, sensor)
    *nearer, farthest = planes.planes
    mosaic = image_rate(farthest.light(ends=False), optics, sensor, rule, cells_per_pixel)
    for index in reversed(range(len(nearer))):
        plane = nearer[index]
        _hide(mosaic, plane, planes.planes[index + 1 :], optics, sensor, rule, cells_per_pixel)
        mosaic += image_rate(plane.light(ends=True), optics, sensor, rule, cells_per_pixel)
    relative_error = max(plane.scene.relative_error for plane in planes.planes)
    return arrived(mosaic, optics, sensor, farthest.scene.distance_m, relative_error)


def layered_regions(planes: Planes, optics: Optics, sensor: Sensor) -> tuple[Region, ...]:
    """All planes' regions in pixels of the frame; see `Camera.image_regions`."""
    return tuple(region for plane in planes.planes for region in image_regions(plane.scene, optics, sensor))


def _hide(
    mosaic: NDArray[np.float32],
    plane: Plane,
    behind: tuple[Plane, ...],
    optics: Optics,
    sensor: Sensor,
    rule: Rule,
    cells_per_pixel: int,
) -> None:
    """Take from the image of what is behind a plane what the plane hides, in place."""
    spectrum, grid = _mean_light(behind)
    cover = plane.cover(True, spectrum, grid)
    opaque = image_rate(cover, optics, sensor, rule, cells_per_pixel)
    # What an opacity of 1 would give: the lens's fall-off and the channel's response are in both.
    even = Scene.uniform(spectrum, grid, cover.distance_m)
    full = image_rate(even, optics, sensor, rule, cells_per_pixel)
    for first in range(0, len(mosaic), _STRIP):
        strip = slice(first, first + _STRIP)
        # A channel that sees nothing of the light behind has nothing to lose.
        share = np.divide(opaque[strip], full[strip], out=np.zeros_like(full[strip]), where=full[strip] > 0)
        # Beyond 1 by the transforms' rounding only.
        mosaic[strip] *= np.maximum(np.float32(1) - share, np.float32(0))


def _mean_light(planes: tuple[Plane, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The planes' mean radiances, summed, at all their wavelengths."""
    grid = np.unique(np.concatenate([plane.scene.wavelength_nm for plane in planes]))
    total = np.zeros(grid.size)
    for plane in planes:
        total += np.interp(grid, plane.scene.wavelength_nm, plane.mean_radiance(), left=0.0, right=0.0)
    return np.maximum(total, 0.0), grid
