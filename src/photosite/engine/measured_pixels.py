"""The pixel kernel of a measured chip: every pixel has its own response, offset, dark rate and read noise.

`pixels` serves drawn chips, whose pixels share one read noise and whose maps are 16-bit deviates. Here maps are 32-bit
floats in digital numbers, as they were measured. A pixel takes the same random words as there: a measured chip whose
maps are those of a drawn one gives its frames but for rounding.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange
from photosite.engine.philox import philox4x32
from photosite.engine.runs import EXPOSURE, normal_run, poisson_run, random_words
from photosite.engine.variates import normal, poisson, uniform

# Uses of random blocks after those of `runs`: a block of BLINKING has a pixel's state in its first word, one of LINES
# the deviates of a row (first word) and of a column (second) of the same number.
BLINKING = np.uint32(2)
LINES = np.uint32(3)

_RUN = 1024


@compiled()
def line_deviates(
    first: int, count: int, word: int, frame: np.uint32, k0: np.uint32, k1: np.uint32
) -> NDArray[np.float64]:
    """(count,) standard normal deviates of the lines `first` and after in one frame; word 0 for rows, 1 for columns."""
    out = np.empty(count, np.float64)
    for i in range(count):
        w0, w1, _, _ = philox4x32(np.uint32(first + i), frame, LINES, np.uint32(0), k0, k1)
        out[i] = normal(w0 if word == 0 else w1)
    return out


@compiled(parallel=True)
def expose_measured(
    photo_e: NDArray[np.float32],
    prnu: NDArray[np.float32],
    offset_dn: NDArray[np.float32],
    dark_rate_dn_per_s: NDArray[np.float32],
    read_noise_dn: NDArray[np.float32],
    row_dn: NDArray[np.float64],
    column_dn: NDArray[np.float64],
    line_variance_dn2: float,
    map_gain_dn_per_e: float,
    exposure_s: float,
    well_capacity_e: float,
    gain_dn_per_e: float,
    black_level_dn: float,
    white_level_dn: float,
    corner: tuple[int, int],
    chip_cols: int,
    frame: np.uint32,
    k0: np.uint32,
    k1: np.uint32,
) -> NDArray[np.uint16]:
    """(rows, cols) digital numbers of one frame of a measured chip, or of a rectangle of it.

    Parameters
    ----------
    photo_e
        (rows, cols) mean electrons from light; none negative.
    prnu
        (rows, cols) relative deviation of the response; a response that was measured below 0 counts as 0.
    offset_dn, dark_rate_dn_per_s
        (rows, cols) deviation from the black level, and dark current. A dark current that was measured below 0 lowers
        the level and has no shot noise: the mean is as measured.
    read_noise_dn
        (rows, cols) temporal standard deviation, of which `line_variance_dn2` is the lines' share. A measured variance
        below 0, which is written as minus the root of its size, counts as 0.
    row_dn, column_dn
        (rows,), (cols,) what this frame adds to each line.
    map_gain_dn_per_e
        What the maps' digital numbers are: electrons times this.
    exposure_s, well_capacity_e, gain_dn_per_e, black_level_dn, white_level_dn, corner, chip_cols, frame, k0, k1
        As for `photosite.engine.pixels.expose`.
    """
    rows, cols = photo_e.shape
    out = np.empty((rows, cols), np.uint16)
    ratio = gain_dn_per_e / map_gain_dn_per_e
    rate_e = exposure_s / map_gain_dn_per_e
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
            photo, response, dark = photo_e[r, c:], prnu[r, c:], dark_rate_dn_per_s[r, c:]
            for i in range(n):
                mean[i] = float(photo[i]) * max(1.0 + float(response[i]), 0.0) + max(float(dark[i]), 0.0) * rate_e
            poisson_run(n, mean, words, first, frame, k0, k1, electrons, late, trials)
            normal_run(n, words[2], deviates, late, tails)
            offset, read, columns, target = offset_dn[r, c:], read_noise_dn[r, c:], column_dn[c:], out[r, c:]
            for i in range(n):
                spread = float(read[i])
                noise = math.sqrt(max(spread * abs(spread) - line_variance_dn2, 0.0))
                level = float(offset[i]) + min(float(dark[i]), 0.0) * exposure_s + row_dn[r] + columns[i]
                signal = min(electrons[i], well_capacity_e) * gain_dn_per_e
                dn = signal + (level + noise * deviates[i]) * ratio + black_level_dn + 0.5
                target[i] = np.uint16(min(max(dn, 0.0), white_level_dn))
    return out


@compiled()
def blink(
    out: NDArray[np.uint16],
    place: NDArray[np.int64],
    amplitude_dn: NDArray[np.float64],
    high_fraction: NDArray[np.float64],
    noise_dn: NDArray[np.float64],
    photo_e: NDArray[np.float32],
    prnu: NDArray[np.float32],
    offset_dn: NDArray[np.float32],
    dark_rate_dn_per_s: NDArray[np.float32],
    row_dn: NDArray[np.float64],
    column_dn: NDArray[np.float64],
    line_variance_dn2: float,
    map_gain_dn_per_e: float,
    exposure_s: float,
    well_capacity_e: float,
    gain_dn_per_e: float,
    black_level_dn: float,
    white_level_dn: float,
    corner: tuple[int, int],
    chip_cols: int,
    frame: np.uint32,
    k0: np.uint32,
    k1: np.uint32,
) -> None:
    """Write the blinking pixels of a frame anew: each in one of its two states, frame by frame by chance.

    Parameters
    ----------
    out
        (rows, cols) the frame of `expose_measured`, changed here.
    place
        (pixels, 2) row and column of each in the frame.
    amplitude_dn, high_fraction, noise_dn
        (pixels,) distance between the states, share of the frames in the upper one, and the noise within a state. The
        pixel's offset is the mean over both.
    photo_e, ..., k1
        As for `expose_measured`.
    """
    for j in range(place.shape[0]):
        r, c = place[j, 0], place[j, 1]
        index = np.uint32((r + corner[0]) * chip_cols + c + corner[1])
        dark = float(dark_rate_dn_per_s[r, c])
        mean = float(photo_e[r, c]) * max(1.0 + float(prnu[r, c]), 0.0)
        mean += max(dark, 0.0) * exposure_s / map_gain_dn_per_e
        electrons = min(poisson(mean, index, frame, EXPOSURE, k0, k1), well_capacity_e)
        state, _, _, _ = philox4x32(index, frame, BLINKING, np.uint32(0), k0, k1)
        _, _, word, _ = philox4x32(index, frame, EXPOSURE, np.uint32(0), k0, k1)
        high = 1.0 if uniform(state) < high_fraction[j] else 0.0
        level = float(offset_dn[r, c]) + min(dark, 0.0) * exposure_s + row_dn[r] + column_dn[c]
        level += amplitude_dn[j] * (high - high_fraction[j])
        noise = math.sqrt(max(noise_dn[j] * abs(noise_dn[j]) - line_variance_dn2, 0.0))
        ratio = gain_dn_per_e / map_gain_dn_per_e
        dn = electrons * gain_dn_per_e + (level + noise * normal(word)) * ratio + black_level_dn + 0.5
        out[r, c] = np.uint16(min(max(dn, 0.0), white_level_dn))
