"""Captures of one exposure to one frame: the light by each capture, its blend, and linear or companded numbers.

For capture k of numbers d_k, from the last one, the least sensitive, to the first::

    x_k   = (d_k - black) / dn_per_light_k  (+ x_j, if k reads what overflows from j)       electrons of light
    w_k   = 1 up to first_k, 0 from last_k on, between them linear in d_k - black
    total = w_k x_k + (1 - w_k) total
    dn    = floor(clip(total dn_per_e + output black, 0, highest) + 1/2), then companded by a piecewise linear table
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64, I64, compiled
from photosite.engine.threads import parallel_for

_RUN = 1024


class CombinationConstants(NamedTuple):
    """What all pixels share; arrays (captures,)."""

    black_dn: float
    dn_per_light_e: F64
    overflow_of: I64  # capture whose overflow this one reads; -1 for none
    # Signals, DN above black, at which the transition to the next capture begins and ends
    first_dn: F64
    last_dn: F64
    dn_per_e: float
    output_black_dn: float
    highest_dn: float
    # (knees,) linear and companded numbers; (1,) for linear output
    linear_dn: F64
    companded_dn: F64


def combine(numbers: NDArray[Any], constants: CombinationConstants, out: NDArray[Any]) -> None:
    """Compute `out`, (pixels,) unsigned integers, from (captures, pixels) digital numbers."""
    parallel_for(_combine, -(-numbers.shape[1] // _RUN), numbers, constants, out)


@compiled()
def _combine(start: int, stop: int, numbers: NDArray[Any], constants: CombinationConstants, out: NDArray[Any]) -> None:
    captures, pixels = numbers.shape
    black, scale, overflow_of = constants.black_dn, constants.dn_per_light_e, constants.overflow_of
    dn_per_e, output_black, highest = constants.dn_per_e, constants.output_black_dn, constants.highest_dn
    linear, companded = constants.linear_dn, constants.companded_dn
    first_dn, last_dn = constants.first_dn, constants.last_dn
    for run in range(start, stop):
        begin = run * _RUN
        n = min(_RUN, pixels - begin)
        light, total = np.empty((captures, n)), np.zeros(n)
        for k in range(captures):
            _light(numbers[k, begin : begin + n], black, scale[k], light[k])
            if overflow_of[k] >= 0:
                for i in range(n):
                    light[k, i] += light[overflow_of[k], i]
        for k in range(captures - 1, -1, -1):
            # The last capture has no next one to blend with.
            blends = k < captures - 1
            first, last = (first_dn[k], last_dn[k]) if blends else (np.inf, np.inf)
            _blend(numbers[k, begin : begin + n], black, first, last, light[k], total)
        target = out[begin : begin + n]
        for i in range(n):
            total[i] = np.floor(min(max(total[i] * dn_per_e + output_black, 0.0), highest) + 0.5)
        if linear.size > 1:
            _compand(total, linear, companded)
        for i in range(n):
            target[i] = np.uint32(total[i])


@compiled()
def _light(numbers: NDArray[Any], black: float, dn_per_light_e: float, out: F64) -> None:
    for i in range(out.size):
        out[i] = (np.float64(numbers[i]) - black) / dn_per_light_e


@compiled()
def _blend(numbers: NDArray[Any], black: float, first: float, last: float, light: F64, total: F64) -> None:
    """Blend the light by a capture over that by the less sensitive ones."""
    for i in range(total.size):
        signal = np.float64(numbers[i]) - black
        weight = (last - signal) / (last - first)
        mixed = weight * light[i] + (1.0 - weight) * total[i]
        # Beyond the transition the capture may be saturated: what it holds does not count.
        below = light[i] if signal <= first else mixed
        total[i] = below if signal < last else total[i]


@compiled()
def _compand(values: F64, linear: F64, companded: F64) -> None:
    """Replace numbers by companded ones."""
    for i in range(values.size):
        piece = 0
        while piece < linear.size - 2 and values[i] >= linear[piece + 1]:
            piece += 1
        slope = (companded[piece + 1] - companded[piece]) / (linear[piece + 1] - linear[piece])
        values[i] = np.floor(companded[piece] + slope * (values[i] - linear[piece]) + 0.5)
