"""The pixel model: mean electrons to digital numbers, and the fixed-pattern maps of a chip.

For pixel i of frame n::

    mean_i = photo_i response_i + dark_i                                        electrons
    e_i    = min(Poisson(mean_i), well capacity)
    dn_i   = gain gain_ratio_i (e_i + offset_e_i + noise_e_i z_in)              before the amplifier
             + map_gain_ratio (offset_dn_i + noise_dn_i z_in) + black level     after it
    dn_i   = clip(floor(dn_i + 1/2), 0, white level)

with z_in standard normal. offset_dn_i contains the offsets of the pixel's row and column in this frame.
`mean_electrons` and `digital_number` are these equations. They are compiled into every kernel: CPU and GPU, drawn and
measured chips. The kernels differ in where the parameters of a pixel come from:

- `DrawnMaps`: 16-bit deviates of a chip that a serial number stands for, in electrons.
- `MeasuredMaps`: maps measured from frames, in digital numbers at a gain of their own.

CPU kernels process runs of a row, in straight loops that become vector instructions (`random_runs`). A pixel takes
the same random words whatever its chip's maps and whatever the device.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, compiled, prefetch
from photosite.engine.random_numbers import (
    BLINKING,
    EXPOSURE,
    normal,
    philox4x32,
    poisson,
    uniform,
)
from photosite.engine.random_runs import (
    NORMAL_ERROR,
    marked,
    new_run,
    normal_run,
    poisson_run,
    random_words,
    short_normals,
)
from photosite.engine.threads import COPIES_PER_THREAD, parallel_for, threads_for

DEVIATE_STEP = 2.0**-12
"""Standard deviations per unit of a 16-bit deviate: the range is 8 standard deviations, and deviates reach 6.3."""

RUN = 4096
"""Pixels that a kernel processes at a time: several rows, or a part of one."""

ROWS = 16
"""Rows that a thread processes with the same arrays."""


class Exposure(NamedTuple):
    """What all pixels of a frame share: constants of the sensor, the place on the chip, counter and key."""

    exposure_s: float
    # Constants of the sensor; gain is the system gain, electrons to digital numbers
    well_capacity_e: float
    gain_dn_per_e: float
    black_level_dn: float
    white_level_dn: float
    # First row and column of the frame's rectangle on the chip
    first_row: int
    first_col: int
    chip_cols: int
    frame: np.uint32  # frame number, a word of the random counter
    # Key of the random numbers
    k0: np.uint32
    k1: np.uint32


class DrawnConstants(NamedTuple):
    """What all pixels of a drawn chip share."""

    # Units of the deviates in `DrawnMaps`
    prnu_scale: float
    offset_scale_e: float
    read_noise_e: float


class DrawnMaps(NamedTuple):
    """Fixed pattern of a drawn chip, and the line noise of one frame.

    Maps are those of the whole chip, so that a rectangle needs no copies; shape (1, 1) is one value for all pixels, and
    shape (1,) for all lines.
    """

    # int16 deviates in units of the scales in `DrawnConstants`: relative deviation of the response, and DSNU
    prnu: NDArray[np.int16]
    offset: NDArray[np.int16]
    dark_rate_e_per_s: F32  # float32 dark current
    # (rows,), (cols,) float64 offset of each line in this frame
    row_dn: F64
    column_dn: F64


class MeasuredMaps(NamedTuple):
    """Maps of a measured chip, (rows, cols) float32, and the line noise of one frame."""

    prnu: F32  # relative deviation of the response in electrons; a response measured below 0 counts as 0
    # Deviation from the black level, and dark current. A dark current measured below 0 lowers the level and has no shot
    # noise, so that the mean is as measured.
    offset_dn: F32
    dark_rate_dn_per_s: F32
    # Temporal standard deviation, line noise included. A variance measured below 0 is stored as minus the root of its
    # magnitude, and counts as 0.
    read_noise_dn: F32
    # Gain of the pixel over `gain_dn_per_e`, by which dark currents above 0 are divided; (1, 1) for the same everywhere
    gain_ratio: F32
    # (rows,), (cols,) float64 offset of each line in this frame
    row_dn: F64
    column_dn: F64
    # Variance of `row_dn` plus that of `column_dn`, which is subtracted from that of `read_noise_dn`
    line_variance_dn2: float
    gain_dn_per_e: float  # gain at which the maps were measured


class MeasuredConstants(NamedTuple):
    """What all pixels of a measured chip share: the last two fields of `MeasuredMaps`."""

    line_variance_dn2: float
    gain_dn_per_e: float


class BlinkingPixels(NamedTuple):
    """Pixels with random telegraph noise, which are in one of two states in each frame."""

    place: I64  # (pixels, 2) row and column in the frame
    # (pixels,) distance between the states, fraction of frames in the upper one, and noise within a state. The offset
    # in `MeasuredMaps` is the mean over both states.
    amplitude_dn: F64
    high_fraction: F64
    noise_dn: F64


class Pixel(NamedTuple):
    """Parameters of one pixel in the pixel model; see the equations at the top of this file."""

    response: float
    dark_e: float
    offset_e: float
    noise_e: float
    offset_dn: float
    noise_dn: float
    map_gain_ratio: float
    gain_ratio: float


@compiled(inline=True)
def mean_electrons(photo_e: float, pixel: Pixel) -> float:
    """Return the mean electrons of a pixel, from light and dark current."""
    return photo_e * pixel.response + pixel.dark_e


@compiled(inline=True)
def unrounded_dn(electrons: float, deviate: float, pixel: Pixel, exposure: Exposure) -> float:
    """Return the digital number of a pixel plus 1/2, not yet rounded and clipped."""
    charge_e = min(electrons, exposure.well_capacity_e) + pixel.offset_e + pixel.noise_e * deviate
    after_gain = (pixel.offset_dn + pixel.noise_dn * deviate) * pixel.map_gain_ratio
    return charge_e * (exposure.gain_dn_per_e * pixel.gain_ratio) + after_gain + exposure.black_level_dn + 0.5


@compiled(inline=True)
def rounded_dn(dn: float, exposure: Exposure) -> np.uint16:
    """Return a digital number from `unrounded_dn`."""
    # Clip before converting to an integer, which would overflow from 2^63 on.
    return np.uint16(min(max(dn, 0.0), exposure.white_level_dn))


@compiled(inline=True)
def digital_number(electrons: float, deviate: float, pixel: Pixel, exposure: Exposure) -> np.uint16:
    """Return the digital number of a pixel from its electron count and a standard normal deviate."""
    return rounded_dn(unrounded_dn(electrons, deviate, pixel, exposure), exposure)


@compiled(inline=True)
def may_round_differently(dn: float, pixel: Pixel, exposure: Exposure) -> np.uint8:
    """Return 1 if the exact deviate could give another number than that from `short_normals`, which gave `dn`; or 0."""
    noise_dn = pixel.noise_e * (exposure.gain_dn_per_e * pixel.gain_ratio) + pixel.noise_dn * pixel.map_gain_ratio
    error = NORMAL_ERROR * noise_dn + (_DN_ROUNDING if noise_dn > 0.0 else 0.0)
    above = dn - np.floor(dn)
    clipped = (dn < -error) | (dn > exposure.white_level_dn + error)
    return np.uint8(not (clipped | ((above >= error) & (above <= 1.0 - error))))


_DN_ROUNDING = 1e-9
"""Bound of the rounding errors of `unrounded_dn` between black and white."""


@compiled(inline=True)
def drawn_pixel(
    prnu: np.int16,
    offset: np.int16,
    dark_rate: np.float32,
    line_dn: float,
    constants: DrawnConstants,
    exposure: Exposure,
) -> Pixel:
    """Return a pixel's parameters from its values in `DrawnMaps`; `line_dn` is the sum of its row's and column's."""
    return Pixel(
        1.0 + float(prnu) * constants.prnu_scale,
        float(dark_rate) * exposure.exposure_s,
        float(offset) * constants.offset_scale_e,
        constants.read_noise_e,
        line_dn,
        0.0,
        1.0,
        1.0,
    )


@compiled(inline=True)
def measured_pixel(
    prnu: np.float32,
    offset_dn: np.float32,
    dark_rate: np.float32,
    noise_dn: float,
    gain_ratio: np.float32,
    row_dn: float,
    column_dn: float,
    shared: MeasuredConstants,
    exposure: Exposure,
) -> Pixel:
    """Return a pixel's parameters from its values in `MeasuredMaps`."""
    # numba's `float` keeps 32 bits.
    dark, noise = np.float64(dark_rate), np.float64(noise_dn)
    return Pixel(
        max(1.0 + float(prnu), 0.0),
        max(dark, 0.0) * (exposure.exposure_s / shared.gain_dn_per_e),
        0.0,
        0.0,
        float(offset_dn) + min(dark, 0.0) * exposure.exposure_s + row_dn + column_dn,
        math.sqrt(max(noise * abs(noise) - shared.line_variance_dn2, 0.0)),
        exposure.gain_dn_per_e / shared.gain_dn_per_e,
        float(gain_ratio),
    )


@compiled(inline=True)
def pixel_number(r: int, c: int, exposure: Exposure) -> np.uint32:
    """Return the number of a pixel on the chip, a word of the random counter."""
    return np.uint32((r + exposure.first_row) * exposure.chip_cols + c + exposure.first_col)


@compiled(inline=True)
def expose_pixel(photo_e: float, pixel: Pixel, r: int, c: int, exposure: Exposure) -> np.uint16:
    """Return the digital number of the pixel at a row and column; the CPU kernels give the same for whole runs."""
    number = pixel_number(r, c, exposure)
    frame, k0, k1 = exposure.frame, exposure.k0, exposure.k1
    electrons = poisson(mean_electrons(photo_e, pixel), number, frame, EXPOSURE, k0, k1)
    _, _, word, _ = philox4x32(number, frame, EXPOSURE, np.uint32(0), k0, k1)
    return digital_number(electrons, normal(word), pixel, exposure)


@compiled(inline=True)
def blinking_state(mean: Pixel, amplitude_dn: float, high_fraction: float, r: int, c: int, exposure: Exposure) -> Pixel:
    """Return a blinking pixel's parameters in the state drawn for this frame, from those of the mean over both."""
    number = pixel_number(r, c, exposure)
    word, _, _, _ = philox4x32(number, exposure.frame, BLINKING, np.uint32(0), exposure.k0, exposure.k1)
    high = 1.0 if uniform(word) < high_fraction else 0.0
    offset_dn = mean.offset_dn + amplitude_dn * (high - high_fraction)
    return Pixel(
        *(mean.response, mean.dark_e, mean.offset_e, mean.noise_e, offset_dn, mean.noise_dn),
        mean.map_gain_ratio,
        mean.gain_ratio,
    )


@compiled(inline=True)
def constant_or(values: NDArray[Any], r: int, c: int) -> Any:
    """Return a value of a map, or the only one of a map of shape (1, 1)."""
    return values[0, 0] if values.shape[0] == 1 and values.shape[1] == 1 else values[r, c]


@compiled(inline=True)
def row_from(values: NDArray[Any], r: int, c: int, constant: NDArray[Any]) -> NDArray[Any]:
    """Return a row of a map from a column on; a row of `constant_run` if the map has shape (1, 1)."""
    return constant if values.shape[0] == 1 and values.shape[1] == 1 else values[r, c:]


@compiled()
def constant_run(values: NDArray[Any]) -> NDArray[Any]:
    """Return a run of the value of a map of shape (1, 1), so that all loops are over rows."""
    return np.full(RUN, values[0, 0], values.dtype)


@compiled(inline=True)
def prefetch_row(values: NDArray[Any], r: int, c: int, n: int) -> None:
    """Prefetch n columns of a map's row from a column on; the row may be beyond the last.

    Rows of a patch are far from each other in a map of the whole chip, and hardware does not foresee the next.
    """
    if values.shape[0] > 1:
        first = values.ctypes.data + r * values.strides[0] + c * values.itemsize
        for at in range(0, n * values.itemsize, _CACHE_LINE):
            prefetch(first + at)


_CACHE_LINE = 64
"""Bytes of a line of most processors' caches."""


@compiled()
def run_shape(cols: int) -> tuple[int, int]:
    """Return the rows and columns of a run in a frame of `cols` columns."""
    return min(max(RUN // cols, 1), ROWS), min(RUN, cols)


def all_light(values: F32) -> bool:
    """Return whether all values (rows, cols) are finite and not negative."""
    others = np.zeros(len(values), np.int64)
    with threads_for(values.size, COPIES_PER_THREAD):
        parallel_for(_count_others, len(values), values, others)
    return not others.any()


@compiled()
def _count_others(start: int, stop: int, values: F32, others: I64) -> None:
    """Count the values of each row that are not light: as integers, the bits of light are below those of infinity."""
    cols = values.shape[1]
    for r in range(start, stop):
        bits, largest = values[r].view(np.uint32), np.uint32(0)
        for c in range(cols):
            largest = max(largest, bits[c])
        if largest >= _INFINITE:  # -0 is light, too
            for c in range(cols):
                others[r] += int(not ((values[r, c] >= 0.0) & (values[r, c] < np.inf)))


_INFINITE = np.uint32(0x7F800000)


def clean_frame(photo_e: F32, well_e: np.float32, gain: np.float32, black_dn: np.float32, white_dn: np.float32) -> F32:
    """Return (rows, cols) digital numbers of light without noise, dark current, fixed pattern and rounding.

    `photo_e` is (rows, cols); the others are single numbers in 32 bits.
    """
    out = np.empty(photo_e.shape, np.float32)
    with threads_for(out.size, COPIES_PER_THREAD):
        parallel_for(_clean_frame, len(out), photo_e, well_e, gain, black_dn, white_dn, out)
    return out


@compiled()
def _clean_frame(
    start: int,
    stop: int,
    photo_e: F32,
    well_e: np.float32,
    gain: np.float32,
    black_dn: np.float32,
    white_dn: np.float32,
    out: F32,
) -> None:
    cols = photo_e.shape[1]
    for r in range(start, stop):
        photo, target = photo_e[r], out[r]
        for c in range(cols):
            target[c] = min(min(photo[c], well_e) * gain + black_dn, white_dn)


@compiled(inline=True)
def _set_line_offsets(line_dn: F64, row_dn: F64, column_dn: F64, r: int, c: int, n: int) -> None:
    """Set the first n offsets to those of a row and of the columns from c on."""
    of_row = row_dn[r] if row_dn.size > 1 else row_dn[0]
    if column_dn.size > 1:
        for i in range(n):
            line_dn[i] = of_row + column_dn[c + i]
    else:
        for i in range(n):
            line_dn[i] = of_row + column_dn[0]


def expose_drawn(photo_e: F32, maps: DrawnMaps, constants: DrawnConstants, exposure: Exposure) -> NDArray[np.uint16]:
    """Return (rows, cols) digital numbers of a frame of a drawn chip, or of a rectangle of it.

    `photo_e` is (rows, cols) mean electrons from light, not negative.
    """
    out = np.empty(photo_e.shape, np.uint16)
    parallel_for(_expose_drawn, -(-len(out) // ROWS), photo_e, maps, constants, exposure, out)
    return out


@compiled()
def _expose_drawn(
    start: int,
    stop: int,
    photo_e: F32,
    maps: DrawnMaps,
    constants: DrawnConstants,
    exposure: Exposure,
    out: NDArray[np.uint16],
) -> None:
    rows, cols = photo_e.shape
    frame, k0, k1 = exposure.frame, exposure.k0, exposure.k1
    height, width = run_shape(cols)
    for block in range(start, stop):
        run, line_dn = new_run(RUN), np.empty(RUN)
        marks = run.marks
        prnu_1, offset_1 = constant_run(maps.prnu), constant_run(maps.offset)
        dark_1 = constant_run(maps.dark_rate_e_per_s)
        end = min((block + 1) * ROWS, rows)
        for top in range(block * ROWS, end, height):
            bottom = min(top + height, end)
            for c in range(0, cols, width):
                n, chip_c = min(width, cols - c), c + exposure.first_col
                for r in range(top, bottom):
                    at, chip_r = (r - top) * n, r + exposure.first_row
                    photo, mean = photo_e[r, c:], run.mean[at:]
                    prnu = row_from(maps.prnu, chip_r, chip_c, prnu_1)
                    dark = row_from(maps.dark_rate_e_per_s, chip_r, chip_c, dark_1)
                    prefetch_row(maps.prnu, chip_r + height, chip_c, n)  # for the next run
                    prefetch_row(maps.dark_rate_e_per_s, chip_r + height, chip_c, n)
                    prefetch_row(maps.offset, chip_r, chip_c, n)  # for the end of this run
                    random_words(pixel_number(r, c, exposure), at, n, frame, EXPOSURE, k0, k1, run)
                    for i in range(n):
                        pixel = drawn_pixel(prnu[i], np.int16(0), dark[i], 0.0, constants, exposure)
                        mean[i] = mean_electrons(float(photo[i]), pixel)
                count = (bottom - top) * n
                poisson_run(count, run, frame, k0, k1)
                if constants.read_noise_e > 0.0:
                    short_normals(count, run.words[2], run.short[0])
                else:
                    run.short[0][:count] = np.float32(0.0)
                for r in range(top, bottom):
                    at, chip_r = (r - top) * n, r + exposure.first_row
                    electrons, deviates = run.electrons[at:], run.short[0][at:]
                    words, target = run.words[2, at:], out[r, c:]
                    prnu = row_from(maps.prnu, chip_r, chip_c, prnu_1)
                    offset = row_from(maps.offset, chip_r, chip_c, offset_1)
                    dark = row_from(maps.dark_rate_e_per_s, chip_r, chip_c, dark_1)
                    _set_line_offsets(line_dn, maps.row_dn, maps.column_dn, r, c, n)
                    for i in range(n):
                        pixel = drawn_pixel(prnu[i], offset[i], dark[i], line_dn[i], constants, exposure)
                        dn = unrounded_dn(electrons[i], np.float64(deviates[i]), pixel, exposure)
                        target[i] = rounded_dn(dn, exposure)
                        marks[i] = may_round_differently(dn, pixel, exposure)
                    for j in range(marked(marks, n, run.few)):
                        i = run.few[j]
                        pixel = drawn_pixel(prnu[i], offset[i], dark[i], line_dn[i], constants, exposure)
                        target[i] = digital_number(electrons[i], normal(words[i]), pixel, exposure)


def expose_measured(photo_e: F32, maps: MeasuredMaps, exposure: Exposure) -> NDArray[np.uint16]:
    """Return digital numbers as `expose_drawn`, of a measured chip."""
    out = np.empty(photo_e.shape, np.uint16)
    parallel_for(_expose_measured, -(-len(out) // ROWS), photo_e, maps, exposure, out)
    return out


@compiled()
def _expose_measured(
    start: int, stop: int, photo_e: F32, maps: MeasuredMaps, exposure: Exposure, out: NDArray[np.uint16]
) -> None:
    rows, cols = photo_e.shape
    frame, k0, k1 = exposure.frame, exposure.k0, exposure.k1
    shared = MeasuredConstants(maps.line_variance_dn2, maps.gain_dn_per_e)
    height, width = run_shape(cols)
    for block in range(start, stop):
        run, ratio_1 = new_run(RUN), constant_run(maps.gain_ratio)
        marks = run.marks
        end = min((block + 1) * ROWS, rows)
        for top in range(block * ROWS, end, height):
            bottom = min(top + height, end)
            for c in range(0, cols, width):
                n = min(width, cols - c)
                for r in range(top, bottom):
                    at = (r - top) * n
                    photo, mean = photo_e[r, c:], run.mean[at:]
                    prnu, dark = maps.prnu[r, c:], maps.dark_rate_dn_per_s[r, c:]
                    random_words(pixel_number(r, c, exposure), at, n, frame, EXPOSURE, k0, k1, run)
                    for i in range(n):
                        pixel = measured_pixel(
                            prnu[i], np.float32(0.0), dark[i], 0.0, np.float32(1.0), 0.0, 0.0, shared, exposure
                        )
                        mean[i] = mean_electrons(float(photo[i]), pixel)
                count = (bottom - top) * n
                poisson_run(count, run, frame, k0, k1)
                short_normals(count, run.words[2], run.short[0])
                for r in range(top, bottom):
                    at = (r - top) * n
                    electrons, deviates = run.electrons[at:], run.short[0][at:]
                    words, target = run.words[2, at:], out[r, c:]
                    prnu, dark, row = maps.prnu[r, c:], maps.dark_rate_dn_per_s[r, c:], maps.row_dn[r]
                    offset, noise, column = maps.offset_dn[r, c:], maps.read_noise_dn[r, c:], maps.column_dn[c:]
                    ratio = row_from(maps.gain_ratio, r, c, ratio_1)
                    for i in range(n):
                        pixel = measured_pixel(
                            prnu[i], offset[i], dark[i], noise[i], ratio[i], row, column[i], shared, exposure
                        )
                        dn = unrounded_dn(electrons[i], np.float64(deviates[i]), pixel, exposure)
                        target[i] = rounded_dn(dn, exposure)
                        marks[i] = may_round_differently(dn, pixel, exposure)
                    for j in range(marked(marks, n, run.few)):
                        i = run.few[j]
                        pixel = measured_pixel(
                            prnu[i], offset[i], dark[i], noise[i], ratio[i], row, column[i], shared, exposure
                        )
                        target[i] = digital_number(electrons[i], normal(words[i]), pixel, exposure)


@compiled()
def expose_blinking(
    out: NDArray[np.uint16], blinking: BlinkingPixels, photo_e: F32, maps: MeasuredMaps, exposure: Exposure
) -> NDArray[np.uint16]:
    """Replace the blinking pixels in a frame of `expose_measured`, each in a state drawn for this frame.

    `out` is (rows, cols), changed in place, and returned; the other arguments are those of `expose_measured`.
    """
    for j in range(blinking.place.shape[0]):
        r, c = blinking.place[j, 0], blinking.place[j, 1]
        prnu, offset, dark = maps.prnu[r, c], maps.offset_dn[r, c], maps.dark_rate_dn_per_s[r, c]
        noise_dn, row_dn, column_dn = blinking.noise_dn[j], maps.row_dn[r], maps.column_dn[c]
        shared = MeasuredConstants(maps.line_variance_dn2, maps.gain_dn_per_e)
        ratio = constant_or(maps.gain_ratio, r, c)
        mean = measured_pixel(prnu, offset, dark, noise_dn, ratio, row_dn, column_dn, shared, exposure)
        pixel = blinking_state(mean, blinking.amplitude_dn[j], blinking.high_fraction[j], r, c, exposure)
        out[r, c] = expose_pixel(float(photo_e[r, c]), pixel, r, c, exposure)
    return out


@compiled()
def replace_pixels(out: NDArray[np.uint16], place: I64, numbers: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Set the pixels at (n, 2) rows and columns, each listed once, to (n,) numbers, in place; return `out`."""
    for j in range(place.shape[0]):
        out[place[j, 0], place[j, 1]] = numbers[j]
    return out


def normal_deviates(rows: int, cols: int, use: np.uint32, word: int, k0: np.uint32, k1: np.uint32) -> NDArray[np.int16]:
    """Return (rows, cols) standard normal deviates in units of DEVIATE_STEP, from a word, 0 to 2, of a use."""
    out = np.empty((rows, cols), np.int16)
    parallel_for(_normal_deviates, rows, cols, use, word, k0, k1, out)
    return out


@compiled()
def _normal_deviates(
    start: int,
    stop: int,
    cols: int,
    use: np.uint32,
    word: int,
    k0: np.uint32,
    k1: np.uint32,
    out: NDArray[np.int16],
) -> None:
    for r in range(start, stop):
        run = new_run(cols)
        random_words(np.uint32(r * cols), 0, cols, np.uint32(0), use, k0, k1, run)
        normal_run(cols, run.words[word], run)
        for c in range(cols):
            out[r, c] = np.int16(math.floor(run.deviates[c] / DEVIATE_STEP + 0.5))


@compiled()
def line_deviates(
    first: int, count: int, use: np.uint32, word: int, frame: np.uint32, k0: np.uint32, k1: np.uint32
) -> F64:
    """Return (count,) standard normal deviates of the lines from `first` on: word 0, 1 or 2 of a use."""
    out = np.empty(count, np.float64)
    for i in range(count):
        w0, w1, w2, _ = philox4x32(np.uint32(first + i), frame, use, np.uint32(0), k0, k1)
        out[i] = normal(w0 if word == 0 else (w1 if word == 1 else w2))
    return out
