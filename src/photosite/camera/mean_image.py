"""Mean electrons of every pixel: a scene seen through a lens by a sensor, without noise.

`Camera` is the face of this; what stands here joins scene, optics and sensor and hands arrays to the engine.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from photosite.camera.channel_transfers import Reduced, reduced_transfers
from photosite.camera.distortion import color_nodes, warp, warped_regions
from photosite.camera.optical_stack import apply_optical_stack, low_pass_split_m
from photosite.camera.sampled_otf import field_scale
from photosite.camera.veiling_glare import add_glare
from photosite.color.spectrum import Rule, integration_weights
from photosite.engine.jit import threads_for
from photosite.engine.layers import Field, Grid, Layer, View
from photosite.engine.mosaic import mosaic_of_layers
from photosite.engine.transfer import Sampling
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.point_spread import FieldPsf
from photosite.optics.protocols import Optics
from photosite.scene.placement import Placement, place
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_sites
from photosite.values.region import Region

_STRIP = 256
_OUTSIDE_LIMIT = 0.01
"""Share of a channel's response beyond the scene's wavelengths above which a warning is due."""
_MOST_ELECTRONS = 1e30
"""A second and for weight 1, that weights, transforms and times still leave within a 32-bit float."""
_ROUNDING = 1e-5
"""Of the brightest sample's electrons: how far below 0 the transforms' rounding may leave a dark pixel."""
_REDUCTION = 3.0
"""Times the scene's own error, over all wavelengths, is what a channel that sees some of them may have of it."""


def electron_rate(
    scene: Scene, optics: Optics, sensor: Sensor, *, rule: Rule, cells_per_pixel: int
) -> NDArray[np.float32]:
    """(rows, cols) mean electrons from light per second; see `Camera.mean_electrons`."""
    warn_of_missing_light(scene, sensor)
    mosaic = image_rate(scene, optics, sensor, rule, cells_per_pixel)
    missing = scene.relative_error + low_rank_error(optics, scene.distance_m)
    return arrived(mosaic, optics, sensor, [scene], rule, missing)


def image_rate(
    scene: Scene,
    optics: Optics,
    sensor: Sensor,
    rule: Rule,
    cells_per_pixel: int,
    before: Sequence[Scene] = (),
) -> NDArray[np.float32]:
    """(rows, cols) electrons per second from a scene's image, as the transforms give it, rounding below 0 and all.

    What `before` holds hides parts of the scene before the lens blurs it: scenes whose only weights are opacities.
    """
    coupling = electrons_per_weight(scene, optics, sensor, rule)
    if not (brightest := float(np.abs(coupling.sum(axis=2)).max())) < _MOST_ELECTRONS:
        raise InputError(
            f"the scene is too bright: weight 1 of its spectra gives a pixel {brightest:g} electrons a second, and "
            f"32-bit floats are sure to hold {_MOST_ELECTRONS:g}; give it a lower luminance"
        )
    if scene.shape == (1, 1) and not before:
        mosaic = _even_mosaic(coupling.sum(axis=2) @ scene.weights[:, 0, 0].astype(np.float64), sensor)
    else:
        mosaic = _blurred_mosaic(scene, optics, sensor, coupling, cells_per_pixel, before)
    _fall_off(mosaic, optics, sensor, scene.distance_m)
    return mosaic


def arrived(
    mosaic: NDArray[np.float32],
    optics: Optics,
    sensor: Sensor,
    scenes: Sequence[Scene],
    rule: Rule,
    relative_error: float,
) -> NDArray[np.float32]:
    """What the frame's light becomes as a whole: veiling glare, then the sensor's door. The mosaic may be changed.

    `scenes`, near to far, are what it is the image of; `relative_error` is theirs and the lens's together, for what may
    lie below 0.
    """
    _not_negative(mosaic, relative_error, lambda: max(_brightest(scene, optics, sensor, rule) for scene in scenes))
    if optics.veiling_glare is not None:
        add_glare(mosaic, optics.veiling_glare, sensor.array.cfa, pitch_m(sensor))
    return apply_optical_stack(mosaic, sensor, optics, scenes[-1].distance_m)


def low_rank_error(optics: Optics, distance_m: float) -> float:
    """RMS error of a lens whose point spreads are a sum of a few modes; 0 of any other."""
    spread = optics.point_spread(distance_m)
    return spread.relative_error if isinstance(spread, FieldPsf) else 0.0


def pitch_m(sensor: Sensor) -> tuple[float, float]:
    """(vertical, horizontal) distance of pixels, m."""
    return sensor.pixel.height_um.value * 1e-6, sensor.pixel.width_um.value * 1e-6


def placement(scene: Scene, optics: Optics, sensor: Sensor) -> Placement:
    """Where the scene's samples fall on the sensor's pixels."""
    pixel, array = sensor.pixel, sensor.array
    samples = None
    if scene.width_m is not None:
        image_width_m = scene.width_m * optics.magnification(scene.distance_m)
        samples = scene.shape[1] * pixel.width_um.value * 1e-6 / image_width_m
    return place(
        scene.shape,
        (array.rows, array.cols),
        pixel_aspect=pixel.height_um.value / pixel.width_um.value,
        cols_per_pixel=samples,
    )


def image_regions(scene: Scene, optics: Optics, sensor: Sensor) -> tuple[Region, ...]:
    """The scene's regions in pixels of the frame; see `Camera.image_regions`."""
    where = placement(scene, optics, sensor)
    return warped_regions(optics.mapping(scene.distance_m), where, scene.regions, pitch_m(sensor))


def electrons_per_weight(scene: Scene, optics: Optics, sensor: Sensor, rule: Rule = "trapezoid") -> NDArray[np.float64]:
    """(channels, K, wavelengths) electrons per second in a pixel for weight 1, to be summed over wavelength."""
    grid = scene.wavelength_nm
    irradiance = scene.basis * optics.irradiance_per_radiance(grid, scene.distance_m)
    area_m2 = sensor.pixel_area_m2 * sensor.pixel.fill_factor.value
    responses = np.stack([sensor.response_at(name, grid) for name in sensor.channel_names])
    product: NDArray[np.float64] = responses[:, None, :] * (irradiance * integration_weights(grid, rule) * area_m2)
    return product


def _blurred_mosaic(
    scene: Scene,
    optics: Optics,
    sensor: Sensor,
    coupling: NDArray[np.float64],
    cells: int,
    before: Sequence[Scene],
) -> NDArray[np.float32]:
    """(rows, cols) electrons per second of a scene with structure."""
    array, pitch = sensor.array, pitch_m(sensor)
    side = math.sqrt(sensor.pixel.fill_factor.value)
    sampling = Sampling(pitch, (pitch[0] * side, pitch[1] * side), cells, low_pass_split_m(sensor))
    spread, mapping = optics.point_spread(scene.distance_m), optics.mapping(scene.distance_m)
    where = placement(scene, optics, sensor)
    colors_nm, shares = color_nodes(mapping, scene.wavelength_nm, (array.rows, array.cols), pitch)
    parts = reduced_transfers(spread, coupling, scene.wavelength_nm, sampling, shares)
    if not parts:  # no channel sees any light
        return np.zeros((array.rows, array.cols), np.float32)
    grid = Grid(
        shape=(array.rows, array.cols),
        padding=math.ceil(max(reduced.padding_m for reduced in parts) / min(pitch)),
        tile=(len(array.cfa), len(array.cfa[0])),
        cells_per_pixel=cells,
    )
    reach_m = math.hypot(*(grid.farthest(axis) * pitch[axis] for axis in (0, 1)))
    views = tuple(
        View(
            weights=scene.weights,
            start=(where.row_start, where.col_start),
            step=(where.row_step, where.col_step),
            warp=warp(mapping, color_nm, reach_m, pitch),
            before=tuple(_sheet(cover, optics, sensor, color_nm, reach_m) for cover in before),
        )
        for color_nm in colors_nm
    )
    field = _field(spread, sensor) if isinstance(spread, FieldPsf) else None
    layers = [_layer(reduced, views, field) for reduced in parts]
    with threads_for(array.rows * array.cols * cells**2):
        return mosaic_of_layers(
            layers, sampling, grid, [channel_sites(array.cfa, name) for name in sensor.channel_names]
        )


def _layer(reduced: Reduced, views: tuple[View, ...], field: Field | None) -> Layer:
    """In the engine's single precision."""
    pictures = None if reduced.pictures is None else tuple(few.astype(np.float32) for few in reduced.pictures)
    return Layer(views, reduced.mixing.astype(np.float32), reduced.transfer, pictures, field, reduced.channel)


def _sheet(cover: Scene, optics: Optics, sensor: Sensor, wavelength_nm: float, reach_m: float) -> View:
    """A scene of opacities where the light of a wavelength meets it."""
    where = placement(cover, optics, sensor)
    return View(
        weights=cover.weights[:1],
        start=(where.row_start, where.col_start),
        step=(where.row_step, where.col_step),
        warp=warp(optics.mapping(cover.distance_m), wavelength_nm, reach_m, pitch_m(sensor)),
    )


def _field(spread: FieldPsf, sensor: Sensor) -> Field:
    """The spread's weights over the frame's pixels, their largest magnitudes left to the transfer."""
    pixel, array = sensor.pixel, sensor.array
    return Field(
        row=spread.y_m / (pixel.height_um.value * 1e-6) + array.rows / 2,
        col=spread.x_m / (pixel.width_um.value * 1e-6) + array.cols / 2,
        weights=spread.weights / field_scale(spread)[:, None, None],
    )


def _even_mosaic(electrons: NDArray[np.float64], sensor: Sensor) -> NDArray[np.float32]:
    """(rows, cols): each pixel holds its channel's electrons."""
    array = sensor.array
    mosaic = np.empty((array.rows, array.cols), np.float32)
    for value, name in zip(electrons, sensor.channel_names, strict=True):
        for r, c in channel_sites(array.cfa, name):
            mosaic[r :: len(array.cfa), c :: len(array.cfa[0])] = value
    return mosaic


def _fall_off(mosaic: NDArray[np.float32], optics: Optics, sensor: Sensor, distance_m: float) -> None:
    """Multiply by the lens's relative illumination, in strips: the map in double precision would be large."""
    pixel, array = sensor.pixel, sensor.array
    y_m = (np.arange(array.rows) + 0.5 - array.rows / 2) * pixel.height_um.value * 1e-6
    x_m = (np.arange(array.cols) + 0.5 - array.cols / 2) * pixel.width_um.value * 1e-6
    for first in range(0, array.rows, _STRIP):
        strip = slice(first, first + _STRIP)
        falloff = optics.relative_illumination(np.hypot(y_m[strip, None], x_m), distance_m)
        if falloff is None:
            return
        mosaic[strip] *= falloff.astype(np.float32)


def _not_negative(
    mosaic: NDArray[np.float32], relative_error: float, full_scale: Callable[[], float]
) -> NDArray[np.float32]:
    lowest, highest = float(mosaic.min()), float(mosaic.max())
    if (
        lowest < -_ROUNDING * max(highest, 0.0)
        and lowest < -_ROUNDING * full_scale()
        and not _within_reduction(mosaic, relative_error)
    ):
        raise InputError(
            f"the scene's radiance is negative somewhere: a pixel would gain {lowest:g} electrons a second; "
            "its weights and basis must make radiances of 0 or more"
        )
    # What is left below 0 is the transforms' rounding, or what few spectra or few modes left out, as far as is stated.
    return np.maximum(mosaic, np.float32(0), out=mosaic)


def _brightest(scene: Scene, optics: Optics, sensor: Sensor, rule: Rule) -> float:
    """Electrons per second that the brightest sample would give a pixel that saw nothing else.

    The transforms err in proportion to this, not to the image's brightest pixel: the image of a point is far darker.
    """
    coupling = electrons_per_weight(scene, optics, sensor, rule).sum(axis=2).astype(np.float32)
    return max(
        float(np.tensordot(coupling, scene.weights[:, first : first + _STRIP], axes=1).max())
        for first in range(0, scene.shape[0], _STRIP)
    )


def _within_reduction(mosaic: NDArray[np.float32], relative_error: float) -> bool:
    """Whether what lies below 0 is no more, as RMS, than few spectra, or a lens's few modes, may be wrong."""
    below = np.minimum(mosaic, np.float32(0)).ravel()
    whole = mosaic.ravel()
    return float(below @ below) <= (_REDUCTION * relative_error) ** 2 * float(whole @ whole)


def warn_of_missing_light(scene: Scene, sensor: Sensor) -> None:
    """Say that a channel responds to light beyond the scene's wavelengths, where it does."""
    for name in sensor.channel_names:
        outside = scene.light_outside(*sensor.response(name))
        if outside > _OUTSIDE_LIMIT:
            grid = scene.wavelength_nm
            warnings.warn(
                f"{outside:.1%} of channel {name}'s response lies outside the scene's {grid[0]:g} to {grid[-1]:g} nm; "
                "light there, if any, is missing from the result",
                PhotositeWarning,
                stacklevel=5,
            )
            return
