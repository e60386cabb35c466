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

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, compiled, prange
from photosite.engine.pixel_model import Exposure, pixel_number
from photosite.engine.random_numbers import (
    EXPOSURE,
    new_run,
    normal,
    normal_run,
    philox4x32,
    poisson,
    poisson_run,
    random_words,
)

_RUN = 1024


class ConversionMaps(NamedTuple):
    """What converts the charge of a rectangle: maps (rows, cols), or (1, 1) for one value; tables; values of lines."""

    offset_e: F32  # added to every reading
    noise_e: F32  # temporal standard deviation
    # (rows,), (cols,) float64 offset of each line in this frame, or (1,) for all lines
    row_dn: F64
    column_dn: F64
    # Readout channel of each row and column, (rows,) and (cols,), or (1,); gain and offset of each pair
    row_group: I64
    column_group: I64
    group_gain: F64
    group_offset_e: F64
    # Signal in electrons at equal steps of charge from 0 on; (1,) for a straight response
    curve_e: F64
    curve_step_e: float
    # Error of the converter in DN, at equal steps from 0 to the white level; (1,) for none
    converter_error_dn: F64


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
def step_below(place: float, entries: int) -> int:
    """Return the entry of a table below a place, which is in units of the table's steps."""
    return min(int(place), entries - 2)


@compiled(inline=True)
def between(low: float, high: float, share: float) -> float:
    """Return the value between two entries of a table; the second one beyond it."""
    return low + min(share, 1.0) * (high - low)


@compiled(inline=True)
def converter_input(signal_e: float, read_e: float, gain: float, line_dn: float, exposure: Exposure) -> float:
    """Return a pixel's value in front of the converter, DN, limited to just beyond the converter's range."""
    dn = (signal_e + read_e) * (exposure.gain_dn_per_e * gain) + line_dn + exposure.black_level_dn
    return min(max(dn, -1.0), exposure.white_level_dn + 1.0)


@compiled(inline=True)
def rounded(dn: float, exposure: Exposure) -> np.uint16:
    """Return the converter's output."""
    return np.uint16(min(max(dn + 0.5, 0.0), exposure.white_level_dn))


@compiled(inline=True)
def _at(values: F32, r: int, c: int) -> float:
    """Return the value of a map at a row and column; a map of shape (1, 1) has one value for all pixels."""
    return float(values[min(r, values.shape[0] - 1), min(c, values.shape[1] - 1)])


@compiled(inline=True)
def _line(values: NDArray[Any], i: int) -> Any:
    return values[min(i, values.shape[0] - 1)]


@compiled(parallel=True)
def collect_charge(photo_e: F32, prnu: F32, dark_rate_e_per_s: F32, exposure: Exposure) -> F32:
    """Return (rows, cols) electrons that the pixels of a rectangle collect in one frame.

    `photo_e` is (rows, cols) mean electrons from light, not negative; the maps are of the same rows and columns, or
    (1, 1) for one value.
    """
    rows, cols = photo_e.shape
    out = np.empty((rows, cols), np.float32)
    for line in prange(rows):
        r: Any = np.int64(line)  # signed, as column numbers are: numba mixes both to floating point
        run = new_run(_RUN)
        mean, electrons = run.mean, run.electrons
        for c in range(0, cols, _RUN):
            n = min(_RUN, cols - c)
            first = pixel_number(r, c, exposure)
            random_words(first, n, exposure.frame, EXPOSURE, exposure.k0, exposure.k1, run.words)
            for i in range(n):
                mean[i] = mean_charge(
                    float(photo_e[r, c + i]), _at(prnu, r, c + i), _at(dark_rate_e_per_s, r, c + i), exposure
                )
            poisson_run(n, run, first, exposure.frame, exposure.k0, exposure.k1)
            for i in range(n):
                out[r, c + i] = np.float32(min(electrons[i], exposure.well_capacity_e))
    return out


@compiled(parallel=True)
def convert_charge(charge_e: F32, maps: ConversionMaps, exposure: Exposure) -> NDArray[np.uint16]:
    """Return the digital numbers of a rectangle from its (rows, cols) charge in electrons."""
    rows, cols = charge_e.shape
    curve, error = maps.curve_e, maps.converter_error_dn
    error_steps = (error.shape[0] - 1) / exposure.white_level_dn
    out = np.empty((rows, cols), np.uint16)
    for line in prange(rows):
        r: Any = np.int64(line)  # signed, as column numbers are: numba mixes both to floating point
        run = new_run(_RUN)
        deviates = run.deviates
        for c in range(0, cols, _RUN):
            n = min(_RUN, cols - c)
            first = pixel_number(r, c, exposure)
            random_words(first, n, exposure.frame, EXPOSURE, exposure.k0, exposure.k1, run.words)
            normal_run(n, run.words[2], run)
            for i in range(n):
                signal_e = float(charge_e[r, c + i])
                if curve.shape[0] > 1:
                    place = max(signal_e, 0.0) / maps.curve_step_e
                    low = step_below(place, curve.shape[0])
                    signal_e = between(curve[low], curve[low + 1], place - low)
                group = _line(maps.row_group, r), _line(maps.column_group, c + i)
                read_e = (
                    _at(maps.offset_e, r, c + i)
                    + maps.group_offset_e[group]
                    + _at(maps.noise_e, r, c + i) * deviates[i]
                )
                line_dn = _line(maps.row_dn, r) + _line(maps.column_dn, c + i)
                dn = converter_input(signal_e, read_e, maps.group_gain[group], line_dn, exposure)
                if error.shape[0] > 1:
                    place = max(dn, 0.0) * error_steps
                    low = step_below(place, error.shape[0])
                    dn += between(error[low], error[low + 1], place - low)
                out[r, c + i] = rounded(dn, exposure)
    return out
