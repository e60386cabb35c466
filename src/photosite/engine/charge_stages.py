"""Stages that change the collected charge before its conversion: blooming, transfer, multiplication, coupling.

Each takes and returns (rows, cols) float32 electrons, and computes in 64 bits (numba's `float` keeps 32). `cuda` has
the same stages for a GPU: functions of one pixel are shared, so that the results have the same bits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from photosite.engine.jit import F32, F64, compiled, prange
from photosite.engine.pixel_model import Exposure, pixel_number
from photosite.engine.random_numbers import (
    MULTIPLICATION,
    gamma,
    gamma_candidate,
    gamma_squeeze,
    new_run,
    normal_run,
    philox4x32,
    poisson_small,
    random_words,
    uniform,
)

_RUN = 1024
_COLUMNS = 64


class Register(NamedTuple):
    """The multiplication register of an EMCCD: each electron becomes a gamma-distributed number of electrons."""

    shape_per_e: float
    scale_e: float
    well_e: float
    clock_induced_e: float  # mean electrons in front of the register, a Poisson count in each pixel


# Functions of one pixel take numbers, not arrays, so that numba's CUDA simulator can call them.


@compiled(inline=True)
def overflow(charge_e: float, well_e: float, kept: float) -> float:
    """Return half of the electrons that a pixel cannot hold, less those that the drain removes."""
    return 0.5 * (max(charge_e - well_e, 0.0) * kept)


@compiled(inline=True)
def taken(held_e: float, passing_e: float, well_e: float) -> float:
    """Return the electrons that a pixel takes of those that flow past it."""
    return min(max(well_e - held_e, 0.0), passing_e)


@compiled(inline=True)
def coupled(center: float, sides: float, corners: float, side_share: float, corner_share: float) -> float:
    """Return the signal of a pixel from its own and the sums of its four next and four diagonal neighbors."""
    return center + side_share * (sides - 4.0 * center) + corner_share * (corners - 4.0 * center)


@compiled(inline=True)
def multiplied_pixel(charge_e: float, r: int, c: int, register: Register, exposure: Exposure) -> np.float32:
    """Return the electrons behind the register; `multiply_charge` gives the same for whole runs."""
    number = pixel_number(r, c, exposure)
    zero = np.uint32(0)
    _, _, w2, w3 = philox4x32(number, exposure.frame, MULTIPLICATION, zero, exposure.k0, exposure.k1)
    electrons = charge_e
    if register.clock_induced_e > 0.0:
        electrons += poisson_small(register.clock_induced_e, w2, w3)
    value = 0.0
    if electrons > 0.0:
        shape = electrons * register.shape_per_e
        value = gamma(shape, number, exposure.frame, MULTIPLICATION, exposure.k0, exposure.k1)
    return np.float32(min(value * register.scale_e, register.well_e))


@compiled(parallel=True)
def bloom_columns(charge_e: F32, well_e: float, kept: float) -> F32:
    """Return the charge after blooming: what a pixel cannot hold flows along its column, half each way.

    `kept` is the share of the overflow that the anti-blooming drain leaves. Charge that reaches an end of the column
    turns around; what finds no room in the whole column is lost.
    """
    rows, cols = charge_e.shape
    out = np.empty((rows, cols), np.float32)
    for block in prange((cols + _COLUMNS - 1) // _COLUMNS):
        first: Any = np.int64(block) * _COLUMNS
        last = min(first + _COLUMNS, cols)
        flow = np.zeros(_COLUMNS)
        for r in range(rows):
            for c in range(first, last):
                charge = np.float64(charge_e[r, c])
                held = min(charge, well_e)
                more = taken(held, flow[c - first], well_e)
                out[r, c] = np.float32(held + more)
                flow[c - first] += overflow(charge, well_e, kept) - more
        for r in range(rows - 1, -1, -1):
            for c in range(first, last):
                held = np.float64(out[r, c])
                more = taken(held, flow[c - first], well_e)
                out[r, c] = np.float32(held + more)
                flow[c - first] += overflow(np.float64(charge_e[r, c]), well_e, kept) - more
        if flow.max() > 0.0:
            for r in range(rows):
                for c in range(first, last):
                    held = np.float64(out[r, c])
                    more = taken(held, flow[c - first], well_e)
                    out[r, c] = np.float32(held + more)
                    flow[c - first] -= more
    return out


@compiled(parallel=True)
def transfer_charge(charge_e: F32, row_shares: F64, column_shares: F64) -> F32:
    """Return the charge after its transfers along the columns and then along the rows.

    `row_shares` is (late, rows): the share of a row's charge that arrives so many rows late; `column_shares`
    (late, cols) likewise.
    """
    rows, cols = charge_e.shape
    out = np.empty((rows, cols), np.float32)
    for line in prange(rows):
        r: Any = np.int64(line)
        moved, total = np.zeros(cols), np.zeros(cols)
        for late in range(min(row_shares.shape[0], r + 1)):
            source, share = charge_e[r - late], row_shares[late, r - late]
            for c in range(cols):
                moved[c] += share * np.float64(source[c])
        for late in range(min(column_shares.shape[0], cols)):
            shares = column_shares[late]
            for c in range(late, cols):
                total[c] += shares[c - late] * moved[c - late]
        for c in range(cols):
            out[r, c] = np.float32(total[c])
    return out


@compiled(parallel=True)
def multiply_charge(charge_e: F32, register: Register, exposure: Exposure) -> F32:
    """Return the charge behind the multiplication register."""
    rows, cols = charge_e.shape
    frame, k0, k1 = exposure.frame, exposure.k0, exposure.k1
    out = np.empty((rows, cols), np.float32)
    for line in prange(rows):
        r: Any = np.int64(line)
        run = new_run(_RUN)
        words, shape, value, deviates, late = run.words, run.mean, run.electrons, run.deviates, run.late
        for c in range(0, cols, _RUN):
            n = min(_RUN, cols - c)
            first = pixel_number(r, c, exposure)
            random_words(first, n, frame, MULTIPLICATION, k0, k1, words)
            normal_run(n, words[0], run)
            for i in range(n):
                shape[i] = np.float64(charge_e[r, c + i]) * register.shape_per_e
            if register.clock_induced_e > 0.0:
                for i in range(n):
                    number = np.uint32(first + np.uint32(i))
                    _, _, w2, w3 = philox4x32(number, frame, MULTIPLICATION, np.uint32(0), k0, k1)
                    electrons = np.float64(charge_e[r, c + i]) + poisson_small(register.clock_induced_e, w2, w3)
                    shape[i] = electrons * register.shape_per_e
            left = 0
            for i in range(n):
                value[i] = gamma_candidate(max(shape[i], 1.0), deviates[i])
            for i in range(n):
                accepted = (value[i] > 0.0) & gamma_squeeze(deviates[i], uniform(words[1, i]))
                late[left] = i
                left += int((shape[i] < 1.0) | (not accepted))
            for j in range(left):
                i = late[j]
                value[i] = 0.0
                if shape[i] > 0.0:
                    value[i] = gamma(shape[i], np.uint32(first + np.uint32(i)), frame, MULTIPLICATION, k0, k1)
            for i in range(n):
                out[r, c + i] = np.float32(min(value[i] * register.scale_e, register.well_e))
    return out


@compiled(parallel=True)
def couple_pixels(charge_e: F32, side_share: float, corner_share: float) -> F32:
    """Return the signals of pixels that couple a share of theirs to each next and each diagonal neighbor.

    Beyond the edges the array is continued by its outer pixels, which keeps the sum of all signals.
    """
    rows, cols = charge_e.shape
    out = np.empty((rows, cols), np.float32)
    for line in prange(rows):
        r: Any = np.int64(line)
        above, row, below = charge_e[max(r - 1, 0)], charge_e[r], charge_e[min(r + 1, rows - 1)]
        column = np.empty(cols)
        for c in range(cols):
            column[c] = np.float64(above[c]) + np.float64(below[c])
        for c in range(cols):
            before, after = max(c - 1, 0), min(c + 1, cols - 1)
            sides = column[c] + (np.float64(row[before]) + np.float64(row[after]))
            corners = column[before] + column[after]
            out[r, c] = np.float32(coupled(np.float64(row[c]), sides, corners, side_share, corner_share))
    return out
