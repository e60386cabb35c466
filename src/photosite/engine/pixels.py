"""The pixel kernels: fixed pattern maps, and mean electrons to digital numbers in one pass.

Pixels are taken in short runs of a row, in straight loops that become vector instructions; `runs` has their random
numbers.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange
from photosite.engine.philox import philox4x32
from photosite.engine.runs import EXPOSURE, FIXED_PATTERN, normal_run, poisson_run, random_words
from photosite.engine.variates import normal, poisson

DEVIATE_GRAIN = 2.0**-12
"""Fixed patterns are kept as 16-bit whole numbers of this many standard deviations; they reach 8, deviates 6.3."""

_RUN = 1024


@compiled(parallel=True)
def normal_deviates(rows: int, cols: int, word: int, k0: np.uint32, k1: np.uint32) -> NDArray[np.int16]:
    """(rows, cols) standard normal deviates in units of DEVIATE_GRAIN, one a pixel.

    Parameters
    ----------
    word
        Of the FIXED_PATTERN block: 0 PRNU, 1 DSNU, 2 dark current.
    """
    out = np.empty((rows, cols), np.int16)
    for r in prange(rows):
        words = np.empty((3, cols), np.uint32)
        deviates = np.empty(cols, np.float64)
        late = np.empty(cols, np.int64)
        random_words(np.uint32(r * cols), cols, np.uint32(0), FIXED_PATTERN, k0, k1, words)
        normal_run(cols, words[word], deviates, late, np.empty(cols, np.float64))
        for c in range(cols):
            out[r, c] = np.int16(math.floor(deviates[c] / DEVIATE_GRAIN + 0.5))
    return out


@compiled(parallel=True)
def expose(
    photo_e: NDArray[np.float32],
    prnu: NDArray[np.int16],
    prnu_scale: float,
    offset: NDArray[np.int16],
    offset_scale_e: float,
    dark_rate_e_per_s: NDArray[np.float32],
    exposure_s: float,
    well_capacity_e: float,
    read_noise_e: float,
    gain_dn_per_e: float,
    black_level_dn: float,
    white_level_dn: float,
    corner: tuple[int, int],
    chip_cols: int,
    frame: np.uint32,
    k0: np.uint32,
    k1: np.uint32,
) -> NDArray[np.uint16]:
    """(rows, cols) digital numbers of one frame, or of a rectangle of it.

    Parameters
    ----------
    photo_e
        (rows, cols) mean electrons from light, before the fixed pattern; none negative.
    prnu, offset
        (rows, cols) fixed pattern in units of the scales beside them: response 1 + prnu * prnu_scale, offset
        offset * offset_scale_e. An array of shape (1, 1) stands for all pixels.
    dark_rate_e_per_s
        (rows, cols) dark current, or (1, 1).
    exposure_s, well_capacity_e, read_noise_e, gain_dn_per_e, black_level_dn, white_level_dn
        Scalars of the sensor, in electrons and digital numbers.
    corner, chip_cols
        First row and column of the rectangle on the chip, and the chip's columns: what a pixel's counter is made of.
    frame, k0, k1
        Counter and key.
    """
    rows, cols = photo_e.shape
    out = np.empty((rows, cols), np.uint16)
    for r in prange(rows):
        words = np.empty((3, _RUN), np.uint32)
        mean = np.empty(_RUN, np.float64)
        electrons = np.empty(_RUN, np.float64)
        deviates = np.empty(_RUN, np.float64)
        late = np.empty(_RUN, np.int64)
        tails = np.empty(_RUN, np.float64)
        trials = np.empty((2, _RUN), np.uint32)
        for c in range(0, cols, _RUN):
            n = min(_RUN, cols - c)
            first = np.uint32((r + corner[0]) * chip_cols + c + corner[1])
            random_words(first, n, frame, EXPOSURE, k0, k1, words)
            _mean_run(n, photo_e[r, c:], _row(prnu, r, c), prnu_scale, mean)
            _add_dark_run(n, _row(dark_rate_e_per_s, r, c), exposure_s, mean)
            poisson_run(n, mean, words, first, frame, k0, k1, electrons, late, trials)
            if read_noise_e > 0.0:
                normal_run(n, words[2], deviates, late, tails)
            else:
                deviates[:n] = 0.0
            _convert_run(
                n,
                electrons,
                deviates,
                _row(offset, r, c),
                offset_scale_e,
                well_capacity_e,
                read_noise_e,
                gain_dn_per_e,
                black_level_dn,
                white_level_dn,
                out[r, c:],
            )
    return out


@compiled(inline=True)
def _row(values: NDArray[Any], r: int, c: int) -> NDArray[Any]:
    """The rest of a row from a column on; all of it where one value stands for all."""
    return values[0] if values.shape[1] == 1 else values[r, c:]


@compiled()
def _mean_run(
    n: int, photo_e: NDArray[np.float32], prnu: NDArray[np.int16], scale: float, mean: NDArray[np.float64]
) -> None:
    if prnu.size == 1:
        response = 1.0 + float(prnu[0]) * scale
        for i in range(n):
            mean[i] = float(photo_e[i]) * response
    else:
        for i in range(n):
            mean[i] = float(photo_e[i]) * (1.0 + float(prnu[i]) * scale)


@compiled()
def _add_dark_run(n: int, rate: NDArray[np.float32], exposure_s: float, mean: NDArray[np.float64]) -> None:
    if rate.size == 1:
        dark_e = float(rate[0]) * exposure_s
        for i in range(n):
            mean[i] += dark_e
    else:
        for i in range(n):
            mean[i] += float(rate[i]) * exposure_s


@compiled()
def _convert_run(
    n: int,
    electrons: NDArray[np.float64],
    deviates: NDArray[np.float64],
    offset: NDArray[np.int16],
    offset_scale_e: float,
    well_capacity_e: float,
    read_noise_e: float,
    gain_dn_per_e: float,
    black_level_dn: float,
    white_level_dn: float,
    out: NDArray[np.uint16],
) -> None:
    """Well, offset, read noise, gain, black level, converter."""
    if offset.size == 1:
        offset_e = float(offset[0]) * offset_scale_e
        for i in range(n):
            electrons[i] = min(electrons[i], well_capacity_e) + offset_e
    else:
        for i in range(n):
            electrons[i] = min(electrons[i], well_capacity_e) + float(offset[i]) * offset_scale_e
    for i in range(n):
        out[i] = _converted(electrons[i], deviates[i], read_noise_e, gain_dn_per_e, black_level_dn, white_level_dn)


@compiled(inline=True)
def _converted(
    signal_e: float,
    deviate: float,
    read_noise_e: float,
    gain_dn_per_e: float,
    black_level_dn: float,
    white_level_dn: float,
) -> np.uint16:
    dn = (signal_e + read_noise_e * deviate) * gain_dn_per_e + black_level_dn + 0.5
    # Clipped before it becomes a whole number, which would overflow from 2^63 on.
    return np.uint16(min(max(dn, 0.0), white_level_dn))


@compiled()
def expose_pixel(
    photo_e: np.float32,
    prnu: np.int16,
    prnu_scale: float,
    offset: np.int16,
    offset_scale_e: float,
    dark_rate_e_per_s: np.float32,
    exposure_s: float,
    well_capacity_e: float,
    read_noise_e: float,
    gain_dn_per_e: float,
    black_level_dn: float,
    white_level_dn: float,
    pixel: int,
    frame: np.uint32,
    k0: np.uint32,
    k1: np.uint32,
) -> np.uint16:
    """What `expose` gives a pixel, for machines that work on one pixel a thread.

    Parameters
    ----------
    photo_e, prnu, ..., white_level_dn
        As for `expose`, the pixel's own values of the arrays.
    pixel
        Row * chip columns + column.
    frame, k0, k1
        Counter and key.
    """
    index = np.uint32(pixel)
    mean = float(photo_e) * (1.0 + float(prnu) * prnu_scale) + float(dark_rate_e_per_s) * exposure_s
    electrons = min(poisson(mean, index, frame, EXPOSURE, k0, k1), well_capacity_e)
    signal_e = electrons + float(offset) * offset_scale_e
    _, _, word, _ = philox4x32(index, frame, EXPOSURE, np.uint32(0), k0, k1)
    return _converted(signal_e, normal(word), read_noise_e, gain_dn_per_e, black_level_dn, white_level_dn)
