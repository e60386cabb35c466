"""The pixel kernels: fixed pattern maps, and mean electrons to digital numbers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange
from photosite.engine.philox import philox4x32
from photosite.engine.variates import normal, poisson, uniform

# Noise sources: the third counter word. A number once given never changes: seeds keep their meaning.
PHOTON = np.uint32(0)
READ = np.uint32(1)
PRNU = np.uint32(2)
DSNU = np.uint32(3)
DARK_CURRENT = np.uint32(4)


@compiled(parallel=True)
def normal_map(rows: int, cols: int, source: np.uint32, k0: np.uint32, k1: np.uint32) -> NDArray[np.float32]:
    """(rows, cols) standard normal deviates, one a pixel: a chip's fixed pattern before scaling."""
    out = np.empty((rows, cols), np.float32)
    zero = np.uint32(0)
    for r in prange(rows):
        for c in range(cols):
            w0, _, _, _ = philox4x32(np.uint32(r * cols + c), zero, source, zero, k0, k1)
            out[r, c] = normal(uniform(w0))
    return out


@compiled(parallel=True)
def expose(
    photo_e: NDArray[np.float32],
    response: NDArray[np.float32],
    offset_e: NDArray[np.float32],
    dark_rate_e_per_s: NDArray[np.float32],
    exposure_s: float,
    well_capacity_e: float,
    read_noise_e: float,
    gain_dn_per_e: float,
    black_level_dn: float,
    white_level_dn: float,
    frame: np.uint32,
    k0: np.uint32,
    k1: np.uint32,
) -> NDArray[np.uint16]:
    """(rows, cols) digital numbers of one frame.

    Parameters
    ----------
    photo_e
        (rows, cols) mean electrons from light, before the fixed pattern; none negative.
    response, offset_e, dark_rate_e_per_s
        (rows, cols) fixed pattern: 1 + PRNU, offset, dark current. Axes of length 1 stand for all pixels.
    exposure_s, well_capacity_e, read_noise_e, gain_dn_per_e, black_level_dn, white_level_dn
        Scalars of the sensor, in electrons and digital numbers.
    frame, k0, k1
        Counter and key.
    """
    rows, cols = photo_e.shape
    out = np.empty((rows, cols), np.uint16)
    zero = np.uint32(0)
    response_r, response_c = _strides(response)
    offset_r, offset_c = _strides(offset_e)
    dark_r, dark_c = _strides(dark_rate_e_per_s)
    for r in prange(rows):
        for c in range(cols):
            pixel = np.uint32(r * cols + c)
            dark_e = float(dark_rate_e_per_s[r * dark_r, c * dark_c]) * exposure_s
            mean_e = float(photo_e[r, c]) * float(response[r * response_r, c * response_c]) + dark_e
            electrons = min(float(poisson(mean_e, pixel, frame, PHOTON, k0, k1)), well_capacity_e)
            electrons += float(offset_e[r * offset_r, c * offset_c])
            if read_noise_e > 0.0:
                w0, _, _, _ = philox4x32(pixel, frame, READ, zero, k0, k1)
                electrons += read_noise_e * normal(uniform(w0))
            dn = math.floor(electrons * gain_dn_per_e + black_level_dn + 0.5)
            out[r, c] = np.uint16(min(max(dn, 0.0), white_level_dn))
    return out


@compiled(inline=True)
def _strides(values: NDArray[np.float32]) -> tuple[int, int]:
    """Steps along rows and columns: 0 on an axis that one value stands for."""
    return (0 if values.shape[0] == 1 else 1), (0 if values.shape[1] == 1 else 1)
