"""Frames without noise: what a sensor makes of the mean light alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.charge_stages import multiply_charge
from photosite.engine.jit import read_only
from photosite.engine.pixel_model import Exposure, clean_frame
from photosite.sensor.capture_readout import captures_of, combined, part_sensor
from photosite.sensor.device import Cpu
from photosite.sensor.effects.model import Effects
from photosite.sensor.effects.output import Output
from photosite.sensor.model import Sensor
from photosite.sensor.staged_readout import charge_stages


def clean_numbers(sensor: Sensor, mean_electrons: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the frame of mean electrons without noise, fixed pattern, dark current and rounding.

    Parameters
    ----------
    sensor
        The sensor. Its wells, its response curve, the stages that move or multiply charge and its digital stages act
        as in a frame; several captures are combined, and rounded.
    mean_electrons
        (rows, cols) mean electrons from light.

    Returns
    -------
    ndarray
        (rows, cols) float32, in digital numbers.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=1, cols=2, black_level_dn=64)
    >>> light = np.array([[798.0, 1e6]], np.float32)
    >>> clean_numbers(sensor, light).round(2)
    array([[ 164., 4095.]], dtype=float32)
    >>> clean_numbers(sensor.with_(output={"subtract_black_level": True}), light).round(2)
    array([[ 100., 4031.]], dtype=float32)
    """
    if sensor.captures is not None:
        return np.asarray(combined(sensor, _clean_captures(sensor, mean_electrons)), np.float32)
    if sensor.effects is None and mean_electrons.dtype == np.float32:
        levels_dn = sensor.readout.black_level_dn.value, sensor.white_level_dn
        constants = map(np.float32, (sensor.pixel.well_capacity_e.value, sensor.system_gain_dn_per_e, *levels_dn))
        clean: NDArray[np.float32] = Cpu().run(clean_frame, read_only(mean_electrons), *constants)
        return clean
    effects = sensor.effects or Effects()
    dn = _converted(sensor, _clean_charge(sensor, effects, mean_electrons))
    return dn if effects.output is None else _after(effects.output, dn, sensor)


def _clean_charge(sensor: Sensor, effects: Effects, mean_electrons: NDArray[np.float32]) -> NDArray[np.float32]:
    rows, cols, well_e = sensor.array.rows, sensor.array.cols, sensor.pixel.well_capacity_e.value
    charge_e = mean_electrons if effects.blooming is not None else np.minimum(mean_electrons, np.float32(well_e))
    zero = np.uint32(0)
    exposure = Exposure(
        0.0, well_e, sensor.system_gain_dn_per_e, 0.0, sensor.white_level_dn, 0, 0, cols, zero, zero, zero
    )
    _, stages = charge_stages(sensor, effects, (slice(0, rows), slice(0, cols)), exposure)
    for kernel, order, *arguments in stages:
        if kernel is multiply_charge:
            assert effects.em_gain is not None
            charge_e = np.minimum(charge_e * np.float32(effects.em_gain.gain), np.float32(arguments[0].well_e))
        else:
            charge_e = Cpu().run(kernel, read_only(charge_e[order]), *arguments)[order]
    return charge_e


def _converted(sensor: Sensor, charge_e: NDArray[Any]) -> NDArray[np.float32]:
    """Return the digital numbers of a charge, not rounded."""
    if sensor.effects is not None and (curve := sensor.effects.response_curve) is not None:
        signal_e, step = curve.nodes(sensor.pixel.well_capacity_e.value)
        charge_e = np.interp(charge_e, np.arange(signal_e.size) * step, signal_e).astype(np.float32)
    # In place: new memory takes longer than the arithmetic.
    dn = np.asarray(charge_e * np.float32(sensor.system_gain_dn_per_e), np.float32)
    dn += np.float32(sensor.readout.black_level_dn.value)
    return np.minimum(dn, np.float32(sensor.white_level_dn), out=dn)


def _after(output: Output, dn: NDArray[np.float32], sensor: Sensor) -> NDArray[np.float32]:
    """Return the numbers behind the digital stages: a saved number holds in the middle of those that share it."""
    table = output.table(sensor.white_level_dn, sensor.readout.black_level_dn.value)
    saved, first, count = np.unique(table, return_index=True, return_counts=True)
    middle = first + 0.5 * (count - 1.0)
    if output.subtract_black_level:
        # Numbers below the black level are clipped, and share the first saved number.
        middle[0] = first[0] + count[0] - 1.0
    return np.interp(dn, middle, saved).astype(np.float32)


def _clean_captures(sensor: Sensor, mean_electrons: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    captures, out = captures_of(sensor), {}
    for part in captures.parts:
        one = part_sensor(sensor, part.name)
        charge_e = mean_electrons * np.float32(captures.light(part.name))
        if part.charge == "overflow":
            well_e = part_sensor(sensor, str(part.charge_of)).pixel.well_capacity_e.value
            charge_e = np.maximum(charge_e - np.float32(well_e), np.float32(0.0))
        out[part.name] = _converted(one, np.minimum(charge_e, np.float32(one.pixel.well_capacity_e.value)))
    return out
