"""Veiling glare: light that lens surfaces and barrel scatter over the sensor, added to a mosaic of mean electrons.

A fraction g of all light is scattered: out = (1 - g) x + g G x, for each color channel separately. G spreads light
uniformly over the frame, or with the kernel exp(-distance / s) / (2 pi s^2), whose integral over the plane is 1. Beyond
the frame's border the light is the frame's mirror image, so that a uniform field stays uniform and no light is lost.
Light sources outside the frame are not in the scene, and do not contribute.

The kernel is much wider than a pixel. It acts on means over blocks of s / 8, by cosine transforms, which imply mirror
images. ISO 9358 measures g as the light inside a small black spot on a large bright field.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from photosite.engine.resample import overlap
from photosite.errors import InputError
from photosite.optics.illumination import VeilingGlare
from photosite.values.cfa import Cfa, channel_names, channel_sites

_BLOCKS_PER_SPREAD = 8
_LEAST_BLOCKS = 8
"""Per axis of the frame, if it is large enough."""
_LEAST_BLOCK_TILES = 2
"""So that each block contains pixels of every channel."""


def add_glare(mosaic: NDArray[np.float32], glare: VeilingGlare, cfa: Cfa, pitch_m: tuple[float, float]) -> None:
    """Scatter a fraction of a mosaic's light over it, in place.

    - `mosaic`: (rows, cols) mean electrons.
    - `glare`, `cfa`: Fraction and spread of the scattered light; tile of the color filter array.
    - `pitch_m`: (vertical, horizontal) pixel pitch.

    Raises `InputError` if the glare's spread is less than 16 pixels (for a 2 x 2 tile): that is a point spread.

    Notes
    -----
    The glare differs from the sum over all pixels by less than 0.5 % of itself (tests/camera/test_veiling_glare.py).

    Examples
    --------
    >>> frame = np.ones((40, 60), np.float32)
    >>> frame[20, 30] = 0
    >>> add_glare(frame, VeilingGlare(0.03), (("M",),), (6e-6, 6e-6))
    >>> round(float(frame[20, 30]), 4)
    0.03
    """
    if glare.fraction == 0:
        return
    kept, scattered = np.float32(1 - glare.fraction), np.float32(glare.fraction)
    axes = None if glare.spread_m is None else _axes(mosaic.shape, glare.spread_m, cfa, pitch_m)
    for name in channel_names(cfa):
        sites = channel_sites(cfa, name)
        planes = [mosaic[r :: len(cfa), c :: len(cfa[0])] for r, c in sites]
        light = sum(float(plane.sum(dtype=np.float64)) for plane in planes)
        pixels = sum(plane.size for plane in planes)
        if pixels == 0 or light == 0:
            continue
        if axes is None or glare.spread_m is None:
            veils = [np.full((1, 1), light / pixels)] * len(planes)
        else:
            veils = _veils(planes, sites, axes, glare.spread_m)
            # Interpolation between blocks changes the total light by about 1e-4: correct it.
            factor = light / sum(float(veil.sum()) for veil in veils)
            veils = [veil * factor for veil in veils]
        for plane, veil in zip(planes, veils, strict=True):
            plane *= kept
            plane += veil.astype(np.float32) * scattered


class _Axis:
    """One axis of the frame: means over blocks, and interpolation between them.

    `to_blocks` is (blocks, pixels) fractions, `to_pixels` (pixels, blocks).
    """

    def __init__(self, pixels: int, tile: int, pitch_m: float, spread_m: float) -> None:
        least = _LEAST_BLOCK_TILES * tile
        if spread_m < 4 * least * pitch_m:
            expected = f"at least {4 * least} pixels of {pitch_m * 1e6:g} um"
            hint = "Make a smaller spread part of the lens's point spread"
            raise InputError("spread_m", where="veiling_glare", value=spread_m, expected=expected, hint=hint)
        wanted = max(math.ceil(pixels * pitch_m / spread_m * _BLOCKS_PER_SPREAD), _LEAST_BLOCKS)
        count = max(1, min(wanted, pixels // least))
        width = pixels / count
        cover = overlap(count, 0.0, width, pixels)
        output = np.repeat(np.arange(count), np.diff(cover.first))
        self.tile = tile
        self.to_blocks = np.zeros((count, pixels))
        self.to_blocks[output, cover.sample] = cover.fraction
        # Linear between block centers; constant beyond the first and last, as in the mirror image.
        position = np.clip((np.arange(pixels) + 0.5) / width - 0.5, 0, count - 1)
        self.to_pixels = np.maximum(0.0, 1 - np.abs(position[:, None] - np.arange(count)))
        self.frequency_per_m = np.arange(count) / (2 * pixels * pitch_m)


def _axes(shape: tuple[int, ...], spread_m: float, cfa: Cfa, pitch_m: tuple[float, float]) -> tuple[_Axis, _Axis]:
    tile = len(cfa), len(cfa[0])
    down, across = (_Axis(shape[axis], tile[axis], pitch_m[axis], spread_m) for axis in (0, 1))
    return down, across


def _veils(
    planes: list[NDArray[np.float32]], sites: Sequence[tuple[int, int]], axes: tuple[_Axis, _Axis], spread_m: float
) -> list[NDArray[np.float64]]:
    """Return the scattered light at each of a channel's sites."""
    from scipy.fft import dctn, idctn

    down, across = axes
    light: NDArray[np.float64] = np.zeros((down.frequency_per_m.size, across.frequency_per_m.size))
    fraction = np.zeros_like(light)
    for plane, (r, c) in zip(planes, sites, strict=True):
        means, along = down.to_blocks[:, r :: down.tile], across.to_blocks[:, c :: across.tile]
        light += means @ plane @ along.T
        fraction += means.sum(axis=1)[:, None] * along.sum(axis=1)
    squared = down.frequency_per_m[:, None] ** 2 + across.frequency_per_m**2
    # Fourier transform of exp(-r / s) / (2 pi s^2) in the plane.
    transfer = (1 + (2 * math.pi * spread_m) ** 2 * squared) ** -1.5
    veil = idctn(dctn(light / fraction, type=2) * transfer, type=2)
    return [down.to_pixels[r :: down.tile] @ veil @ across.to_pixels[c :: across.tile].T for r, c in sites]
