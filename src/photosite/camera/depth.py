"""Scenes in depth: planes at different distances, imaged separately and combined from the farthest to the nearest.

Every plane has its own magnification, defocus, distortion and relative illumination. Neighboring planes that the lens
blurs alike, for example all planes in focus, occlude each other on the frame's cells, before the blur. Planes blurred
differently are combined by their opacity alpha, imaged in the same way as the plane itself, channel by channel::

    image = image_p(alpha radiance) + (1 - image_p(alpha)) * image behind

The image of the opacity is taken in the light that it blocks: the mean spectrum of what is behind. These are linear
layers. A real lens sees each point of a plane through its whole pupil, and through each part of the pupil another part
of the plane behind. The product is exact if either plane is in focus, except for the lens's smallest blur, and if the
plane behind is uniform. It errs near edges of opacity if both planes are out of focus (docs/theory/depth.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from photosite.camera.mean_image import finish_mosaic, image_rate, low_rank_error, pitch_m, warn_of_missing_light
from photosite.optics.point_spread import FieldPsf, PointSpread, RadialPsf
from photosite.scene.planes import Plane, Planes
from photosite.scene.scene import Scene

if TYPE_CHECKING:
    from photosite.camera.camera import Camera

_ALIKE = 0.05
"""Difference of transfer functions up to which planes count as blurred alike."""
_FREQUENCIES = 33
_DIRECTIONS = 8


def planes_electron_rate(planes: Planes, camera: Camera) -> NDArray[np.float32]:
    """Return (rows, cols) mean electrons from light per second of a scene in depth; see `Camera.mean_electrons`."""
    sensor = camera.sensor
    for plane in planes.planes:
        warn_of_missing_light(plane.scene, sensor)
    mosaic = np.zeros((sensor.array.rows, sensor.array.cols), np.float32)
    behind: tuple[Plane, ...] = ()
    for group in reversed(_groups(planes.planes, camera)):
        if behind:
            _occlude(mosaic, group, behind, camera)
        covers = [plane.cover(True, *_mean_light(group)) for plane in group]
        for index, plane in enumerate(group):
            ends = bool(behind) or index < len(group) - 1
            mosaic += image_rate(plane.light(ends), camera, covers[:index])
        behind = (*group, *behind)
    scenes = [plane.scene for plane in planes.planes]
    relative_error = max(scene.relative_error + low_rank_error(camera.optics, scene.distance_m) for scene in scenes)
    return finish_mosaic(mosaic, camera, scenes, relative_error)


def _groups(planes: tuple[Plane, ...], camera: Camera) -> list[tuple[Plane, ...]]:
    """Group neighboring planes that the lens blurs alike."""
    groups: list[tuple[Plane, ...]] = []
    for plane in planes:
        if groups and _alike(camera, groups[-1][0].scene, plane.scene):
            groups[-1] = (*groups[-1], plane)
        else:
            groups.append((plane,))
    return groups


def _alike(camera: Camera, one: Scene, other: Scene) -> bool:
    """Return whether the transfer functions of two scenes differ by at most `_ALIKE` below the Nyquist frequency."""
    if one.distance_m == other.distance_m:
        return True
    spreads = [camera.optics.point_spread(scene.distance_m) for scene in (one, other)]
    frequency = np.linspace(0.0, 0.5 / min(pitch_m(camera.sensor)), _FREQUENCIES)
    wavelengths = one.wavelength_nm[[0, one.wavelength_nm.size // 2, -1]]
    a, b = (_samples(spread, frequency, wavelengths) for spread in spreads)
    return a.shape == b.shape and bool(np.abs(a - b).max() <= _ALIKE)


def _samples(
    spread: PointSpread, frequency_per_m: NDArray[np.float64], wavelength_nm: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return samples of a spread's transfer function; for a `FieldPsf`, at every field node."""
    if isinstance(spread, RadialPsf):
        return np.concatenate([spread.otf(frequency_per_m, float(w)) for w in wavelength_nm]).astype(np.complex128)
    if isinstance(spread, FieldPsf):
        modes = np.stack([_samples(mode, frequency_per_m, wavelength_nm) for mode in spread.modes])
        at_nodes: NDArray[np.complex128] = np.tensordot(spread.weights, modes, axes=(0, 0)).ravel()
        return at_nodes
    angle = np.arange(_DIRECTIONS)[:, None] * (np.pi / _DIRECTIONS)
    fy, fx = frequency_per_m * np.sin(angle), frequency_per_m * np.cos(angle)
    return np.concatenate([spread.otf(fy, fx, float(w)).ravel() for w in wavelength_nm])


def _occlude(mosaic: NDArray[np.float32], group: tuple[Plane, ...], behind: tuple[Plane, ...], camera: Camera) -> None:
    """Attenuate the image of what is behind a group of planes by the group's opacity, in place."""
    spectrum, grid = _mean_light(behind)
    covers = [plane.cover(True, spectrum, grid) for plane in group]
    hidden = np.zeros_like(mosaic)
    for index, cover in enumerate(covers):
        opaque = image_rate(cover, camera, covers[:index])
        # The image of opacity 1: the quotient cancels relative illumination and the channel's response.
        full = image_rate(Scene.uniform(spectrum, grid, cover.distance_m), camera)
        # 0 for a channel that receives none of the light behind.
        hidden += np.divide(opaque, full, out=np.zeros_like(full), where=full > 0)
    # Rounding of the transforms may make it exceed 1.
    mosaic *= np.maximum(np.float32(1) - hidden, np.float32(0))


def _mean_light(planes: tuple[Plane, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the sum of the planes' mean radiances, and its wavelengths."""
    grid = np.unique(np.concatenate([plane.scene.wavelength_nm for plane in planes]))
    total = np.zeros(grid.size)
    for plane in planes:
        total += np.interp(grid, plane.scene.wavelength_nm, plane.mean_radiance(), left=0.0, right=0.0)
    return np.maximum(total, 0.0), grid
