"""The pixel kernels: fixed pattern maps, and mean electrons to digital numbers in one pass.

Pixels are taken in short runs of a row. Over a run the common work (random words, first trials, quantiles, conversion)
is done in straight loops, which become vector instructions; the fewer pixels that need more (rejected trials, tails)
are listed and worked off after. What a pixel gets depends on its counter alone, not on the run it was in.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.elementary import exp
from photosite.engine.jit import compiled, prange
from photosite.engine.philox import philox4x32
from photosite.engine.variates import (
    INVERSE,
    MOST_SMALL,
    SMALL_MEAN,
    normal,
    normal_central,
    normal_tail,
    poisson,
    poisson_accept,
    poisson_after,
    poisson_candidate,
    poisson_squeeze,
    uniform,
    uniform_53,
)

# Uses of random blocks: the third counter word. A number once given never changes: seeds keep their meaning.
# A block is four words: EXPOSURE's first two are the Poisson trial, its third the read noise; FIXED_PATTERN's are PRNU,
# DSNU and dark current.
EXPOSURE = np.uint32(0)
FIXED_PATTERN = np.uint32(1)

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
        _random_words(np.uint32(r * cols), cols, np.uint32(0), FIXED_PATTERN, k0, k1, words)
        _normal_run(cols, words[word], deviates, late)
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
        work = np.empty((5, _RUN), np.float64)
        for c in range(0, cols, _RUN):
            n = min(_RUN, cols - c)
            first = np.uint32((r + corner[0]) * chip_cols + c + corner[1])
            _random_words(first, n, frame, EXPOSURE, k0, k1, words)
            _mean_run(n, photo_e[r, c:], _row(prnu, r, c), prnu_scale, mean)
            _add_dark_run(n, _row(dark_rate_e_per_s, r, c), exposure_s, mean)
            _poisson_run(n, mean, words, first, frame, k0, k1, electrons, late, work)
            if read_noise_e > 0.0:
                _normal_run(n, words[2], deviates, late)
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
def _random_words(
    first: np.uint32,
    n: int,
    frame: np.uint32,
    use: np.uint32,
    k0: np.uint32,
    k1: np.uint32,
    words: NDArray[np.uint32],
) -> None:
    zero = np.uint32(0)
    for i in range(n):
        w0, w1, w2, _ = philox4x32(np.uint32(first + np.uint32(i)), frame, use, zero, k0, k1)
        words[0, i] = w0
        words[1, i] = w1
        words[2, i] = w2


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
def _poisson_run(
    n: int,
    mean: NDArray[np.float64],
    words: NDArray[np.uint32],
    first: np.uint32,
    frame: np.uint32,
    k0: np.uint32,
    k1: np.uint32,
    electrons: NDArray[np.float64],
    late: NDArray[np.int64],
    work: NDArray[np.float64],
) -> None:
    """Poisson counts of a run: first trials for all, then those that the squeeze left, then small means."""
    for i in range(n):
        electrons[i] = poisson_candidate(mean[i], words[0, i])
    left = 0
    for i in range(n):
        late[left] = i
        taken = poisson_squeeze(mean[i], words[0, i], words[1, i])
        left += int((mean[i] >= SMALL_MEAN) & (not taken))
    _poisson_late(left, mean, words, first, frame, k0, k1, electrons, late, work)
    left = 0
    for i in range(n):
        late[left] = i
        left += int(mean[i] < SMALL_MEAN)
    if left:
        _poisson_small(left, mean, words, electrons, late, work)


@compiled()
def _poisson_late(
    left: int,
    mean: NDArray[np.float64],
    words: NDArray[np.uint32],
    first: np.uint32,
    frame: np.uint32,
    k0: np.uint32,
    k1: np.uint32,
    electrons: NDArray[np.float64],
    late: NDArray[np.int64],
    work: NDArray[np.float64],
) -> None:
    """The listed pixels' candidates judged by the exact ratio, and drawn again where that refuses them."""
    for j in range(left):
        i = late[j]
        # Below 16 the ratio's series does not hold: any number will do, the draw is looked at again.
        candidate = max(electrons[i], 16.0)
        work[0, j] = 1.0 if poisson_accept(mean[i], candidate, words[0, i], words[1, i]) else 0.0
    for j in range(left):
        i = late[j]
        if electrons[i] < 16.0 or work[0, j] == 0.0:
            draw = np.uint32(0) if electrons[i] < 16.0 else np.uint32(1)
            electrons[i] = poisson_after(mean[i], np.uint32(first + np.uint32(i)), frame, EXPOSURE, draw, k0, k1)


@compiled()
def _poisson_small(
    left: int,
    mean: NDArray[np.float64],
    words: NDArray[np.uint32],
    electrons: NDArray[np.float64],
    late: NDArray[np.int64],
    work: NDArray[np.float64],
) -> None:
    """Inversion for the listed pixels, all a count further at a time: the same sums as `poisson_small`'s."""
    p, term, total, small, count = work
    for j in range(left):
        i = late[j]
        small[j] = mean[i]
        p[j] = uniform_53(words[0, i], words[1, i])
    for j in range(left):
        term[j] = exp(-small[j])
        total[j] = term[j]
        count[j] = 1.0 if p[j] > total[j] else 0.0
    step = 1
    more = True
    while more and step < MOST_SMALL:
        open_ = 0.0
        for j in range(left):
            term[j] *= small[j] * INVERSE[step]
            total[j] += term[j]
            beyond = 1.0 if p[j] > total[j] else 0.0
            count[j] += beyond
            open_ = max(open_, beyond)
        more = open_ > 0.0
        step += 1
    for j in range(left):
        electrons[late[j]] = count[j]


@compiled()
def _normal_run(n: int, words: NDArray[np.uint32], deviates: NDArray[np.float64], late: NDArray[np.int64]) -> None:
    """Standard normal deviates of a run: the central range for all, then the tails."""
    for i in range(n):
        deviates[i] = normal_central(uniform(words[i]) - 0.5)
    left = 0
    for i in range(n):
        late[left] = i
        left += int(abs(uniform(words[i]) - 0.5) > 0.425)
    for j in range(left):
        i = late[j]
        deviates[i] = normal_tail(uniform(words[i]) - 0.5)


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
    dn = math.floor((signal_e + read_noise_e * deviate) * gain_dn_per_e + black_level_dn + 0.5)
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
