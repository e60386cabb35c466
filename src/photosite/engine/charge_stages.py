"""Stages that change the collected charge before its conversion: blooming, transfer, multiplication, coupling.

Each takes and returns (rows, cols) float32 electrons, and computes in 64 bits (numba's `float` keeps 32). `cuda` has
the same stages for a GPU: functions of one pixel are shared, so that the results have the same bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from photosite.engine.jit import F32, F64, I64, compiled
from photosite.engine.pixel_model import RUN, Exposure, pixel_number
from photosite.engine.random_numbers import (
    MULTIPLICATION,
    WordArray,
    exp,
    gamma,
    gamma_candidate,
    gamma_constants,
    gamma_squeeze,
    philox4x32,
    poisson_small,
    uniform,
    uniform_53,
)
from photosite.engine.random_runs import new_run, normal_run
from photosite.engine.threads import parallel_for

_COLUMNS = 256


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
def coupled(center: float, sides: float, corners: float, side_fraction: float, corner_fraction: float) -> float:
    """Return the signal of a pixel from its own and the sums of its four next and four diagonal neighbors."""
    return center + side_fraction * (sides - 4.0 * center) + corner_fraction * (corners - 4.0 * center)


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


def bloom_columns(charge_e: F32, well_e: float, kept: float) -> F32:
    """Return the charge after blooming: what a pixel cannot hold flows along its column, half each way.

    `kept` is the fraction of the overflow that the anti-blooming drain leaves. Charge that reaches an end of the column
    turns around; what finds no room in the whole column is lost.
    """
    rows, cols = charge_e.shape
    out = np.empty((rows, cols), np.float32)
    parallel_for(_bloom_columns, (cols + _COLUMNS - 1) // _COLUMNS, charge_e, well_e, kept, out)
    return out


@compiled()
def _bloom_columns(start: int, stop: int, charge_e: F32, well_e: float, kept: float, out: F32) -> None:
    rows, cols = charge_e.shape
    for block in range(start, stop):
        first = block * _COLUMNS
        last = min(first + _COLUMNS, cols)
        flow = np.zeros(last - first)
        beyond = False
        for r in range(rows):
            charge, target = charge_e[r, first:last], out[r, first:last]
            for i in range(flow.size):
                beyond |= charge[i] > well_e
                target[i] = charge[i]
        if not beyond:
            continue
        for r in range(rows):
            _flow_past(charge_e[r, first:last], out[r, first:last], flow, well_e, kept)
        for r in range(rows - 1, -1, -1):
            _flow_past(charge_e[r, first:last], out[r, first:last], flow, well_e, kept)
        if flow.max() > 0.0:
            for r in range(rows):
                _flow_past(charge_e[r, first:last], out[r, first:last], flow, well_e, 0.0)


@compiled()
def _flow_past(charge_e: F32, held_e: F32, flow_e: F64, well_e: float, kept: float) -> None:
    """Let the charge that flows along columns pass a row, which takes some and adds its own overflow."""
    for i in range(flow_e.size):
        held = min(np.float64(held_e[i]), well_e)
        more = taken(held, flow_e[i], well_e)
        held_e[i] = np.float32(held + more)
        flow_e[i] += overflow(np.float64(charge_e[i]), well_e, kept) - more


def transfer_charge(charge_e: F32, row_shares: F64, column_shares: F64) -> F32:
    """Return the charge after its transfers along the columns and then along the rows.

    `row_shares` is (late, rows): the fraction of a row's charge that arrives so many rows late; `column_shares`
    (late, cols) likewise.
    """
    out = np.empty(charge_e.shape, np.float32)
    parallel_for(_transfer_charge, len(out), charge_e, row_shares, column_shares, out)
    return out


@compiled()
def _transfer_charge(start: int, stop: int, charge_e: F32, row_shares: F64, column_shares: F64, out: F32) -> None:
    cols = charge_e.shape[1]
    for r in range(start, stop):
        moved, total = np.zeros(cols), np.zeros(cols)
        for late in range(min(row_shares.shape[0], r + 1)):
            _add_fraction(moved, charge_e[r - late], row_shares[late, r - late])
        for late in range(min(column_shares.shape[0], cols)):
            _add_fractions(total[late:], moved, column_shares[late])
        target = out[r]
        for c in range(cols):
            target[c] = np.float32(total[c])


@compiled()
def _add_fraction(total: F64, values: F32, fraction: float) -> None:
    for i in range(total.size):
        total[i] += fraction * np.float64(values[i])


@compiled()
def _add_fractions(total: F64, values: F64, fractions: F64) -> None:
    for i in range(total.size):
        total[i] += fractions[i] * values[i]


def multiply_charge(charge_e: F32, register: Register, exposure: Exposure) -> F32:
    """Return the charge behind the multiplication register."""
    out = np.empty(charge_e.shape, np.float32)
    parallel_for(_multiply_charge, len(out), charge_e, register, exposure, out)
    return out


@compiled()
def _multiply_charge(start: int, stop: int, charge_e: F32, register: Register, exposure: Exposure, out: F32) -> None:
    cols = charge_e.shape[1]
    frame, k0, k1 = exposure.frame, exposure.k0, exposure.k1
    shape_per_e, scale_e, well_e, induced_e = register
    without = exp(-induced_e)
    for r in range(start, stop):
        run = new_run(RUN)
        shape, value, deviates, late = run.mean, run.electrons, run.deviates, run.late
        words = np.empty((4, RUN), np.uint32)
        for c in range(0, cols, RUN):
            n = min(RUN, cols - c)
            first = pixel_number(r, c, exposure)
            charge, target = charge_e[r, c:], out[r, c:]
            _all_words(first, n, frame, MULTIPLICATION, k0, k1, words)
            normal_run(n, words[0], run)
            for i in range(n):
                shape[i] = np.float64(charge[i]) * shape_per_e
            if induced_e > 0.0:
                for i in range(n):
                    words[0, i] = np.uint32(uniform_53(words[2, i], words[3, i]) > without)
                for j in range(_listed(n, words[0], late)):
                    i = late[j]
                    induced = poisson_small(induced_e, words[2, i], words[3, i])
                    shape[i] = (np.float64(charge[i]) + induced) * shape_per_e
            for i in range(n):
                d, spread = gamma_constants(max(shape[i], 1.0))
                value[i] = gamma_candidate(d, spread, deviates[i])
                accepted = gamma_squeeze(d, spread, deviates[i], uniform(words[1, i]))
                words[0, i] = np.uint32((shape[i] < 1.0) | (not accepted))
            left = _listed(n, words[0], late)
            for j in range(left):
                i = late[j]
                value[i] = 0.0
                if shape[i] > 0.0:
                    value[i] = gamma(shape[i], np.uint32(first + np.uint32(i)), frame, MULTIPLICATION, k0, k1)
            for i in range(n):
                target[i] = np.float32(min(value[i] * scale_e, well_e))


@compiled()
def _listed(n: int, chosen: WordArray, late: I64) -> int:
    """List the pixels whose word is 1; return how many these are."""
    left = 0
    for i in range(n):
        late[left] = i
        left += int(chosen[i])
    return left


@compiled()
def _all_words(
    first: np.uint32, n: int, frame: np.uint32, use: np.uint32, k0: np.uint32, k1: np.uint32, words: WordArray
) -> None:
    """Fill (4, n) with the random words of each pixel."""
    for i in range(n):
        w0, w1, w2, w3 = philox4x32(np.uint32(first + np.uint32(i)), frame, use, np.uint32(0), k0, k1)
        words[0, i] = w0
        words[1, i] = w1
        words[2, i] = w2
        words[3, i] = w3


def couple_pixels(charge_e: F32, side_fraction: float, corner_fraction: float) -> F32:
    """Return the signals of pixels that couple a fraction of theirs to each next and each diagonal neighbor.

    Beyond the edges the array is continued by its outer pixels, which keeps the sum of all signals.
    """
    out = np.empty(charge_e.shape, np.float32)
    parallel_for(_couple_pixels, len(out), charge_e, side_fraction, corner_fraction, out)
    return out


@compiled()
def _couple_pixels(
    start: int, stop: int, charge_e: F32, side_fraction: float, corner_fraction: float, out: F32
) -> None:
    rows, cols = charge_e.shape
    for r in range(start, stop):
        # The row, and the sum of those above and below, with a pixel more at each end
        row, column = np.empty(cols + 2), np.empty(cols + 2)
        _add_rows(charge_e[max(r - 1, 0)], charge_e[min(r + 1, rows - 1)], column[1:-1])
        row[1:-1] = charge_e[r]
        for values in (row, column):
            values[0], values[-1] = values[1], values[-2]
        _couple_row(row, column, side_fraction, corner_fraction, out[r])


@compiled()
def _add_rows(above: F32, below: F32, out: F64) -> None:
    for c in range(out.size):
        out[c] = np.float64(above[c]) + np.float64(below[c])


@compiled()
def _couple_row(row: F64, column: F64, side_fraction: float, corner_fraction: float, out: F32) -> None:
    before, center, after = row[:-2], row[1:-1], row[2:]
    column_before, column_center, column_after = column[:-2], column[1:-1], column[2:]
    for c in range(out.size):
        sides = column_center[c] + (before[c] + after[c])
        corners = column_before[c] + column_after[c]
        out[c] = np.float32(coupled(center[c], sides, corners, side_fraction, corner_fraction))
