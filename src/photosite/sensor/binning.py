"""The values of a sensor whose pixels are combined in blocks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

from photosite.values.uncertain import Measured

Binning = Literal["charge", "sum", "mean"]
"""What is combined of the pixels of a block: their electrons before the reading, or their digital numbers after it."""


def mean_offset_dn(n: int) -> float:
    """Return by how much rounding, halves up, raises the mean of n whole numbers.

    Examples
    --------
    >>> mean_offset_dn(4), mean_offset_dn(9)
    (0.125, 0.0)
    """
    return 0.5 / n if n % 2 == 0 else 0.0


def binned_values(
    measured: Callable[[str], Measured], scale: tuple[float, float], factor: int, kind: Binning
) -> dict[str, Measured]:
    """Return the values of a sensor that binning changes, by name.

    Parameters
    ----------
    measured
        The sensor's value of a name.
    scale
        The sensor's read noise of a pixel, without that of rows and columns, and a digital number, both in mV.
    factor, kind
        As for `Sensor.binned`.
    """
    n = factor**2
    amplifier = {"charge": 1.0, "sum": 2.0 ** -extra_bits(n, kind), "mean": 1.0 / n}[kind]
    reads, lines = (1.0, 1.0) if kind == "charge" else (math.sqrt(n), factor**1.5)
    factors = {
        **dict.fromkeys(("width_um", "height_um"), float(factor)),
        **dict.fromkeys(("well_capacity_e", "dark_voltage_mv_per_s"), float(n)),
        **dict.fromkeys(("prnu_percent", "dcnu_percent"), 1.0 / factor),
        **dict.fromkeys(("row_noise_mv", "column_noise_mv"), lines),
        "dsnu_mv": reads,
        "analog_gain": amplifier,
        "black_level_dn": float(n) if kind == "sum" else 1.0,
    }
    note = f"from {factor} x {factor} pixels ({kind})"
    values = {
        name: Measured(by * old.value, by * old.standard_uncertainty, note, assumed=old.assumed)
        for name, by in factors.items()
        for old in (measured(name),)
    }
    if kind == "mean":
        black = values["black_level_dn"]
        values["black_level_dn"] = replace(black, value=black.value + mean_offset_dn(n))
    # The readings of n pixels, each rounded. The mean of n is a multiple of 1/n before it is rounded again.
    rounding_dn2 = {"charge": 0.0, "sum": (n - 1) / 12, "mean": 1 / (12 * n) - 1 / (12 * n**2)}[kind]
    pixel_noise_mv, mv_per_dn = scale[0], scale[1] * (n if kind == "mean" else 1.0)
    old = measured("read_noise_mv")
    squares = (reads * pixel_noise_mv) ** 2 + rounding_dn2 * mv_per_dn**2
    read_mv = math.sqrt(squares + sum(values[name].value ** 2 for name in ("row_noise_mv", "column_noise_mv")))
    slope = reads**2 * old.value / read_mv if read_mv else reads
    values["read_noise_mv"] = Measured(read_mv, slope * old.standard_uncertainty, note, assumed=old.assumed)
    return values


def extra_bits(n: int, kind: Binning) -> int:
    """Return by how much the bit depth grows."""
    return math.ceil(math.log2(n)) if kind == "sum" else 0
