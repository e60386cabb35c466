"""Mean electrons of every pixel: a scene seen through a lens by a sensor, without noise.

`Camera` is the face of this; what stands here joins scene, optics and sensor and hands arrays to the engine.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
from numpy.typing import NDArray

from photosite.cfa import channel_sites
from photosite.engine.jit import threads_for
from photosite.engine.mosaic import Laying, mosaic_of_maps
from photosite.engine.transfer import RadialTransfer, Sampling
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.spread import Optics, RadialSpread
from photosite.scene.placement import Placement, place
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.spectra import Rule, integration_weights

_TRANSFER_NODES = 4097
_SVD_STRIDE = 16
_MAP_TOLERANCE = 5e-6
"""Of the largest transfer: what combining maps may change at any frequency, for any of the scene's spectra."""
_STRIP = 256
_OUTSIDE_LIMIT = 0.01
"""Share of a channel's response beyond the scene's wavelengths above which a warning is due."""
_ROUNDING = 1e-5
"""Of the largest value: how far below 0 the transforms' rounding may leave a dark pixel."""


def electron_rate(
    scene: Scene, optics: Optics, sensor: Sensor, *, rule: Rule, cells_per_pixel: int
) -> NDArray[np.float32]:
    """(rows, cols) mean electrons from light per second; see `Camera.mean_electrons`."""
    _warn_of_missing_light(scene, sensor)
    coupling = electrons_per_weight(scene, optics, sensor, rule)
    if scene.shape == (1, 1):
        mosaic = _even_mosaic(coupling.sum(axis=2) @ scene.weights[:, 0, 0].astype(np.float64), sensor)
    else:
        mosaic = _blurred_mosaic(scene, optics, sensor, coupling, cells_per_pixel)
    _fall_off(mosaic, optics, sensor, scene.distance_m)
    return _not_negative(mosaic)


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


def electrons_per_weight(scene: Scene, optics: Optics, sensor: Sensor, rule: Rule = "trapezoid") -> NDArray[np.float64]:
    """(channels, K, wavelengths) electrons per second in a pixel for weight 1, to be summed over wavelength."""
    grid = scene.wavelength_nm
    irradiance = scene.basis * optics.irradiance_per_radiance(grid, scene.distance_m)
    area_m2 = sensor.pixel_area_m2 * sensor.pixel.fill_factor.value
    responses = np.stack([sensor.channels[c].quantum_efficiency_at(grid) for c in sensor.channel_names])
    product: NDArray[np.float64] = responses[:, None, :] * (irradiance * integration_weights(grid, rule) * area_m2)
    return product


def _blurred_mosaic(
    scene: Scene, optics: Optics, sensor: Sensor, coupling: NDArray[np.float64], cells: int
) -> NDArray[np.float32]:
    """(rows, cols) electrons per second of a scene with structure."""
    pixel, array = sensor.pixel, sensor.array
    pitch = (pixel.height_um.value * 1e-6, pixel.width_um.value * 1e-6)
    side = math.sqrt(pixel.fill_factor.value)
    spread = optics.spread(scene.distance_m)
    transfer, mixing = _reduced_transfer(scene, spread, coupling)
    where = placement(scene, optics, sensor)
    laying = Laying(
        shape=(array.rows, array.cols),
        start=(where.row_start, where.col_start),
        step=(where.row_step, where.col_step),
        padding=_padding(scene, spread, min(pitch)),
        tile=(len(array.cfa), len(array.cfa[0])),
    )
    with threads_for(array.rows * array.cols * cells**2):
        return mosaic_of_maps(
            scene.weights,
            mixing.astype(np.float32),
            transfer,
            Sampling(pitch, (pitch[0] * side, pitch[1] * side), cells),
            laying,
            [channel_sites(array.cfa, name) for name in sensor.channel_names],
        )


def _padding(scene: Scene, spread: RadialSpread, pitch_m: float) -> int:
    """Pixels of scene kept beyond each border."""
    middle = scene.wavelength_nm[scene.wavelength_nm.size // 2]
    return math.ceil(spread.reach_m(middle) / pitch_m)


def _reduced_transfer(
    scene: Scene, spread: RadialSpread, coupling: NDArray[np.float64]
) -> tuple[RadialTransfer, NDArray[np.float64]]:
    """The lens summed over wavelength for R maps, and (R, K) how these mix from the scene's K weights.

    A chart has 24 spectra and a cube may have more, but three channels behind a lens cannot tell them all apart: the
    weights are combined to the ten or so maps that matter, by singular values.
    """
    reach = max(spread.cutoff_per_m(w) for w in scene.wavelength_nm)
    frequencies = np.linspace(0.0, reach, _TRANSFER_NODES)
    otf = np.stack([spread.otf(frequencies, w) for w in scene.wavelength_nm])
    table = coupling @ otf  # (channels, K, nodes)
    channels, count, nodes = table.shape
    tall = table.transpose(0, 2, 1).reshape(-1, count)
    # The table is smooth in frequency: every 16th node spans what all of them do.
    coarse = table[:, :, ::_SVD_STRIDE].transpose(0, 2, 1).reshape(-1, count)
    directions = np.linalg.svd(coarse, full_matrices=False)[2]
    limit = _MAP_TOLERANCE * np.abs(tall).max()
    for keep in range(1, len(directions)):
        mixing = directions[:keep]
        reduced = tall @ mixing.T
        # Of what is left out no entry may pass the limit: no scene spectrum, in any channel, at any frequency.
        if np.abs(tall - reduced @ mixing).max() <= limit:
            maps = reduced.reshape(channels, nodes, keep).transpose(0, 2, 1)
            return RadialTransfer(maps, float(frequencies[1])), mixing
    return RadialTransfer(table, float(frequencies[1])), np.eye(count)


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


def _not_negative(mosaic: NDArray[np.float32]) -> NDArray[np.float32]:
    lowest, highest = float(mosaic.min()), float(mosaic.max())
    if lowest < -_ROUNDING * max(highest, 0.0):
        raise InputError(
            f"the scene's radiance is negative somewhere: a pixel would gain {lowest:g} electrons a second; "
            "its weights and basis must make radiances of 0 or more"
        )
    # What is left below 0 is the transforms' rounding, within its stated error.
    return np.maximum(mosaic, np.float32(0), out=mosaic)


def _warn_of_missing_light(scene: Scene, sensor: Sensor) -> None:
    for name in sensor.channel_names:
        channel = sensor.channels[name]
        outside = scene.light_outside(channel.wavelength_nm, channel.quantum_efficiency)
        if outside > _OUTSIDE_LIMIT:
            grid = scene.wavelength_nm
            warnings.warn(
                f"{outside:.1%} of channel {name}'s response lies outside the scene's {grid[0]:g} to {grid[-1]:g} nm; "
                "light there, if any, is missing from the result",
                PhotositeWarning,
                stacklevel=5,
            )
            return
