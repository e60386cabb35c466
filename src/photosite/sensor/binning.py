"""The description of a sensor whose pixels are combined in blocks."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

from photosite.errors import InputError
from photosite.sensor.sections import SECTIONS
from photosite.values.cfa import binned
from photosite.values.uncertain import Measured
from photosite.values.validated import check_choice

if TYPE_CHECKING:
    from photosite.sensor.model import Sensor

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


def binned_description(sensor: Sensor, factor: int, kind: Binning) -> dict[str, Any]:
    """Return the fields of `Sensor.binned`."""
    check_choice("kind", kind, Binning)
    if factor > min(sensor.array.rows, sensor.array.cols):
        expected = f"at most the chip's {sensor.array.rows} rows and {sensor.array.cols} columns"
        raise InputError("factor", value=factor, expected=expected)
    cfa = binned(sensor.array.cfa, factor)
    if sensor.optical_stack is not None and sensor.optical_stack.crosstalk is not None:
        hint = "Pass with_(crosstalk=None) first"
        raise InputError("a sensor with crosstalk cannot be binned", where="optical_stack", hint=hint)
    if sensor.effects is not None:
        raise InputError("a sensor with effects cannot be binned", hint="Pass with_(effects=None) first")
    n = factor**2
    extra_bits = math.ceil(math.log2(n)) if kind == "sum" else 0
    if sensor.readout.bits + extra_bits > 16:
        expected = f"at most {16 - extra_bits} for a sum of {n} pixels"
        raise InputError("bits", where="readout", value=sensor.readout.bits, expected=expected, hint="Use 'mean'")
    amplifier = {"charge": 1.0, "sum": 2.0**-extra_bits, "mean": 1.0 / n}[kind]
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
        for old in (sensor.measured(name),)
    }
    if kind == "mean":
        black = values["black_level_dn"]
        values["black_level_dn"] = replace(black, value=black.value + mean_offset_dn(n))
    # The readings of n pixels, each rounded. The mean of n is a multiple of 1/n before it is rounded again.
    rounding_dn2 = {"charge": 0.0, "sum": (n - 1) / 12, "mean": 1 / (12 * n) - 1 / (12 * n**2)}[kind]
    mv_per_dn = sensor.mv_per_dn * (n if kind == "mean" else 1.0)
    old = sensor.noise.read_noise_mv
    squares = (reads * sensor.noise.pixel_noise_mv) ** 2 + rounding_dn2 * mv_per_dn**2
    read_mv = math.sqrt(squares + sum(values[name].value ** 2 for name in ("row_noise_mv", "column_noise_mv")))
    slope = reads**2 * old.value / read_mv if read_mv else reads
    values["read_noise_mv"] = Measured(read_mv, slope * old.standard_uncertainty, note, assumed=old.assumed)
    data = sensor.model_dump()
    data |= {"maps": None, "gain_settings": ()}
    data["array"] |= {"rows": sensor.array.rows // factor, "cols": sensor.array.cols // factor, "cfa": cfa}
    data["readout"]["bits"] += extra_bits
    if sensor.covariance is not None:
        data["covariance"] = sensor.covariance.without(set(values))
    if sensor.shutter is not None and sensor.shutter.line_time_us is not None and kind != "charge":
        line = sensor.shutter.line_time_us
        data["shutter"]["line_time_us"] = Measured(factor * line.value, factor * line.standard_uncertainty, note)
    for section in SECTIONS:
        data[section] |= {name: value for name, value in values.items() if name in data[section]}
    return data
