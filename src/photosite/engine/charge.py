"""The pixel model in two steps, for sensors with effects: collected charge, and its conversion to digital numbers.

Between the two steps, stages of `photosite.sensor.effects` change the charge of whole neighborhoods. The equations are
those of `pixel_model` with a response curve s, gains and offsets of readout channels, and an error of the converter::

    q_i  = min(Poisson(photo_i response_i + dark_i), well capacity)                         electrons
    dn_i = gain channel_gain_i (s(q_i) + offset_e_i + noise_e_i z_in) + line_dn_i + black level
    dn_i = clip(floor(dn_i + converter_error(dn_i) + 1/2), 0, white level)

A pixel takes the same random words as in `pixel_model`: without effects both give the same frame, up to the rounding of
maps to 32 bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, compiled
from photosite.engine.pixel_model import RUN, Exposure, constant_run, pixel_number, row_from
from photosite.engine.random_numbers import (
    EXPOSURE,
    normal,
    philox4x32,
    poisson,
)
from photosite.engine.random_runs import new_run, normal_run, poisson_run, random_words
from photosite.engine.threads import parallel_for


class ConversionMaps(NamedTuple):
    """What converts the charge of a rectangle: maps (rows, cols), or (1, 1) for one value; tables; values of lines."""

    offset_e: F32  # added to every reading
    noise_e: F32  # temporal standard deviation
    # (rows,), (cols,) float64 offset of each line in this frame, or (1,) for all lines
    row_dn: F64
    column_dn: F64
    # (rows,) group of each row, or (1,); gain and offset of the group's readout channel at each column, (groups, cols)
    # or (1, 1)
    row_group: I64
    channel_gain: F64
    channel_offset_e: F64
    # Signal in electrons at equal steps of charge from 0 on; (1,) for a straight response
    curve_e: F64
    curve_step_e: float
    # Error of the converter in DN, at equal steps from 0 to the white level; (1,) for none
    converter_error_dn: F64
    output_dn: NDArray[np.uint16]  # the number that is saved for each of the converter; (1,) for the same


# The functions of one pixel take numbers, not arrays, so that numba's CUDA simulator can call them.


@compiled(inline=True)
def mean_charge(photo_e: float, prnu: float, dark_rate_e_per_s: float, exposure: Exposure) -> float:
    """Return the mean electrons of a pixel, from light and dark current."""
    return photo_e * max(1.0 + prnu, 0.0) + dark_rate_e_per_s * exposure.exposure_s


@compiled(inline=True)
def collected_pixel(mean_e: float, r: int, c: int, exposure: Exposure) -> np.float32:
    """Return the electrons that a pixel collects; `collect_charge` gives the same for whole runs."""
    number = pixel_number(r, c, exposure)
    electrons = poisson(mean_e, number, exposure.frame, EXPOSURE, exposure.k0, exposure.k1)
    return np.float32(min(electrons, exposure.well_capacity_e))


@compiled(inline=True)
def read_deviate(r: int, c: int, exposure: Exposure) -> float:
    """Return the standard normal deviate of a pixel's read noise; `convert_charge` takes the same for whole runs."""
    number = pixel_number(r, c, exposure)
    _, _, word, _ = philox4x32(number, exposure.frame, EXPOSURE, np.uint32(0), exposure.k0, exposure.k1)
    return normal(word)


@compiled(inline=True)
def step_below(place: float, entries: int) -> np.int32:
    """Return the entry of a table below a place from 0 on, which is in units of the table's steps."""
    return np.int32(min(place, entries - 2.0))


@compiled(inline=True)
def between(low: float, high: float, fraction: float) -> float:
    """Return the value between two entries of a table; the second one beyond it."""
    return low + min(fraction, 1.0) * (high - low)


@compiled(inline=True)
def converter_input(signal_e: float, read_e: float, gain: float, line_dn: float, exposure: Exposure) -> float:
    """Return a pixel's value in front of the converter, DN, limited to just beyond the converter's range."""
    dn = (signal_e + read_e) * (exposure.gain_dn_per_e * gain) + line_dn + exposure.black_level_dn
    return min(max(dn, -1.0), exposure.white_level_dn + 1.0)


@compiled(inline=True)
def rounded(dn: float, exposure: Exposure) -> np.uint16:
    """Return the converter's output."""
    return np.uint16(min(max(dn + 0.5, 0.0), exposure.white_level_dn))


def collect_charge(photo_e: F32, prnu: F32, dark_rate_e_per_s: F32, exposure: Exposure) -> F32:
    """Return (rows, cols) electrons that the pixels of a rectangle collect in one frame.

    `photo_e` is (rows, cols) mean electrons from light, not negative; the maps are of the same rows and columns, or
    (1, 1) for one value.
    """
    out = np.empty(photo_e.shape, np.float32)
    parallel_for(_collect_charge, len(out), photo_e, prnu, dark_rate_e_per_s, exposure, out)
    return out


@compiled()
def _collect_charge(
    start: int, stop: int, photo_e: F32, prnu: F32, dark_rate_e_per_s: F32, exposure: Exposure, out: F32
) -> None:
    cols = photo_e.shape[1]
    frame, k0, k1, well_e = exposure.frame, exposure.k0, exposure.k1, exposure.well_capacity_e
    for r in range(start, stop):
        run = new_run(RUN)
        mean, electrons = run.mean, run.electrons
        prnu_1, dark_1 = constant_run(prnu), constant_run(dark_rate_e_per_s)
        for c in range(0, cols, RUN):
            n = min(RUN, cols - c)
            photo, target = photo_e[r, c:], out[r, c:]
            response, dark_rate = row_from(prnu, r, c, prnu_1), row_from(dark_rate_e_per_s, r, c, dark_1)
            random_words(pixel_number(r, c, exposure), 0, n, frame, EXPOSURE, k0, k1, run)
            for i in range(n):
                mean[i] = mean_charge(float(photo[i]), float(response[i]), float(dark_rate[i]), exposure)
            poisson_run(n, run, frame, k0, k1)
            for i in range(n):
                target[i] = np.float32(min(electrons[i], well_e))


def convert_charge(charge_e: F32, maps: ConversionMaps, exposure: Exposure) -> NDArray[np.uint16]:
    """Return the digital numbers of a rectangle from its (rows, cols) charge in electrons."""
    out = np.empty(charge_e.shape, np.uint16)
    parallel_for(_convert_charge, len(out), charge_e, maps, exposure, out)
    return out


@compiled()
def _convert_charge(
    start: int, stop: int, charge_e: F32, maps: ConversionMaps, exposure: Exposure, out: NDArray[np.uint16]
) -> None:
    cols = charge_e.shape[1]
    curve, error, output = maps.curve_e, maps.converter_error_dn, maps.output_dn
    curve_step, error_steps = maps.curve_step_e, (error.size - 1) / exposure.white_level_dn
    row_dn, column_dn, row_group = maps.row_dn, maps.column_dn, maps.row_group
    for r in range(start, stop):
        run = new_run(RUN)
        words, deviates, signal, dn = run.words, run.deviates, run.mean, run.electrons
        offset_1, noise_1 = constant_run(maps.offset_e), constant_run(maps.noise_e)
        gain_1, channel_1 = constant_run(maps.channel_gain), constant_run(maps.channel_offset_e)
        line = row_dn[r] if row_dn.size > 1 else row_dn[0]
        group = row_group[r] if row_group.size > 1 else row_group[0]
        line_dn = np.full(RUN, line + column_dn[0])
        for c in range(0, cols, RUN):
            n = min(RUN, cols - c)
            charge, target = charge_e[r, c:], out[r, c:]
            offset_e, noise_e = row_from(maps.offset_e, r, c, offset_1), row_from(maps.noise_e, r, c, noise_1)
            gain = row_from(maps.channel_gain, group, c, gain_1)
            channel_e = row_from(maps.channel_offset_e, group, c, channel_1)
            first = pixel_number(r, c, exposure)
            random_words(first, 0, n, exposure.frame, EXPOSURE, exposure.k0, exposure.k1, run)
            normal_run(n, words[2], run)
            for i in range(n):
                signal[i] = charge[i]
            if curve.size > 1:
                for i in range(n):
                    place = max(signal[i], 0.0) / curve_step
                    low = step_below(place, curve.size)
                    signal[i] = between(curve[low], curve[low + 1], place - low)
            if column_dn.size > 1:
                for i in range(n):
                    line_dn[i] = line + column_dn[c + i]
            for i in range(n):
                read_e = (offset_e[i] + channel_e[i]) + noise_e[i] * deviates[i]
                dn[i] = converter_input(signal[i], read_e, gain[i], line_dn[i], exposure)
            if error.size > 1:
                for i in range(n):
                    place = max(dn[i], 0.0) * error_steps
                    low = step_below(place, error.size)
                    dn[i] += between(error[low], error[low + 1], place - low)
            for i in range(n):
                target[i] = rounded(dn[i], exposure)
            if output.size > 1:
                for i in range(n):
                    target[i] = output[target[i]]
