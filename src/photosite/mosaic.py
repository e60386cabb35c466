"""Mean electrons of every pixel: a scene seen through a lens by a sensor, without noise.

`Camera` is the face of this; what stands here joins scene, optics and sensor and hands arrays to the engine.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
from numpy.typing import NDArray

from photosite.cfa import channel_sites
from photosite.engine.resample import area_mean
from photosite.engine.transfer import RadialTransfer, Sampling, channel_images
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.lens import Optics
from photosite.scene.placement import Placement, place
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.spectra import Rule, integration_weights

_TRANSFER_NODES = 8193
_MAP_TOLERANCE = 1e-6
"""Relative size below which a combination of basis spectra, as the sensor sees it, is left out."""
_PADDING = 32
"""Pixels of scene kept beyond each border of the frame."""
_OUTSIDE_LIMIT = 0.01
"""Share of a channel's response beyond the scene's wavelengths above which a warning is due."""
_ROUNDING = 1e-5
"""Of the largest value: how far below 0 the transforms' rounding may leave a dark pixel."""


def mean_mosaic(
    scene: Scene, optics: Optics, sensor: Sensor, exposure_s: float, *, rule: Rule, cells_per_pixel: int
) -> NDArray[np.float32]:
    """(rows, cols) mean electrons from light; see `Camera.mean_electrons`."""
    _warn_of_missing_light(scene, sensor)
    coupling = exposure_s * electrons_per_weight(scene, optics, sensor, rule)
    if scene.shape == (1, 1):
        even = coupling.sum(axis=2) @ scene.weights[:, 0, 0].astype(np.float64)
        mosaic = _interleaved(np.asarray(even, np.float32)[:, None, None], sensor)
    else:
        mosaic = _interleaved(_channel_images(scene, optics, sensor, coupling, cells_per_pixel), sensor)
    falloff = _relative_illumination(optics, sensor, scene.distance_m)
    if falloff is not None:
        mosaic *= falloff
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


def _channel_images(
    scene: Scene, optics: Optics, sensor: Sensor, coupling: NDArray[np.float64], cells: int
) -> NDArray[np.float32]:
    """(channels, rows, cols) electrons, every channel at every pixel."""
    pixel, array = sensor.pixel, sensor.array
    pitch = (pixel.height_um.value * 1e-6, pixel.width_um.value * 1e-6)
    side = math.sqrt(pixel.fill_factor.value)
    sampling = Sampling(pitch, (pitch[0] * side, pitch[1] * side), cells)
    transfer, mixing = _reduced_transfer(scene, optics, coupling)
    maps = np.tensordot(mixing.astype(np.float32), scene.weights, axes=1)
    where = placement(scene, optics, sensor)
    laid = area_mean(
        maps,
        ((array.rows + 2 * _PADDING) * cells, (array.cols + 2 * _PADDING) * cells),
        (where.row_start - _PADDING * where.row_step, where.col_start - _PADDING * where.col_step),
        (where.row_step / cells, where.col_step / cells),
    )
    first = _PADDING * cells + cells // 2
    rows = slice(first, first + array.rows * cells, cells)
    cols = slice(first, first + array.cols * cells, cells)
    return channel_images(laid, transfer, sampling)[:, rows, cols]


def _reduced_transfer(
    scene: Scene, optics: Optics, coupling: NDArray[np.float64]
) -> tuple[RadialTransfer, NDArray[np.float64]]:
    """The lens summed over wavelength for R maps, and (R, K) how these mix from the scene's K weights.

    A chart has 24 spectra and a cube may have more, but a few channels behind a lens cannot tell them all apart: the
    weights are combined to the maps that matter, by singular values.
    """
    reach = max(optics.cutoff_per_m(w, scene.distance_m) for w in scene.wavelength_nm)
    frequencies = np.linspace(0.0, reach, _TRANSFER_NODES)
    otf = np.stack([optics.otf(frequencies, w, scene.distance_m) for w in scene.wavelength_nm])
    table = coupling @ otf  # (channels, K, nodes)
    channels, count, nodes = table.shape
    _, size, mixing = np.linalg.svd(table.transpose(0, 2, 1).reshape(-1, count), full_matrices=False)
    mixing = mixing[: max(1, int((size > size[0] * _MAP_TOLERANCE).sum()))]
    reduced = np.einsum("ckn,rk->crn", table, mixing, optimize=True)
    return RadialTransfer(reduced.reshape(channels, len(mixing), nodes), float(frequencies[1])), mixing


def _interleaved(images: NDArray[np.float32], sensor: Sensor) -> NDArray[np.float32]:
    """(rows, cols): each pixel from its own channel's image; an image of one pixel stands for all."""
    array = sensor.array
    mosaic = np.empty((array.rows, array.cols), np.float32)
    for image, name in zip(images, sensor.channel_names, strict=True):
        for r, c in channel_sites(array.cfa, name):
            sites = np.s_[r :: len(array.cfa), c :: len(array.cfa[0])]
            mosaic[sites] = image[sites] if image.shape != (1, 1) else image
    return mosaic


def _relative_illumination(optics: Optics, sensor: Sensor, distance_m: float) -> NDArray[np.float32] | None:
    pixel, array = sensor.pixel, sensor.array
    y_m = (np.arange(array.rows) + 0.5 - array.rows / 2) * pixel.height_um.value * 1e-6
    x_m = (np.arange(array.cols) + 0.5 - array.cols / 2) * pixel.width_um.value * 1e-6
    falloff = optics.relative_illumination(np.hypot(y_m[:, None], x_m[None, :]), distance_m)
    return None if falloff is None else falloff.astype(np.float32)


def _not_negative(mosaic: NDArray[np.float32]) -> NDArray[np.float32]:
    lowest, highest = float(mosaic.min()), float(mosaic.max())
    if lowest < -_ROUNDING * max(highest, 0.0):
        raise InputError(
            f"the scene's radiance is negative somewhere: a pixel would hold {lowest:g} electrons; "
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
                stacklevel=4,
            )
            return
