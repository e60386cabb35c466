"""The captures of one exposure: charges of the same light, each read once or several times, and their combination.

A capture is the pixel model with its own gain, read noise and well (`part_sensor`). Its photodiode or exposure collects
`Captures.light` times the electrons of the sensor's pixel. Captures that share a charge have the same shot noise, PRNU
and dark current; read noise, row and column noise and DSNU are independent.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.combination import CombinationConstants, combine
from photosite.engine.jit import read_only
from photosite.engine.pixel_model import Exposure
from photosite.engine.random_numbers import CAPTURES, philox4x32
from photosite.engine.threads import threads_for
from photosite.errors import InputError
from photosite.sensor.captures import Captures
from photosite.sensor.chip import MeasuredChip
from photosite.sensor.device import Backend
from photosite.sensor.drawn_readout import drawn_frame
from photosite.sensor.effects.model import Effects
from photosite.sensor.model import Sensor
from photosite.sensor.shot import Part
from photosite.sensor.staged_readout import charge_stages, collected_charge, converted_charge, fixed_pattern

CombinedNumbers = NDArray[np.uint16] | NDArray[np.uint32]


def captures_of(sensor: Sensor) -> Captures:
    """Return the section `captures` of a sensor; raise `InputError` if it has none."""
    if sensor.captures is None:
        hint = "Its sensor file needs a section captures"
        raise InputError(f"sensor '{sensor.name}' has a single capture", hint=hint)
    return sensor.captures


def part_sensor(sensor: Sensor, name: str) -> Sensor:
    """Return one capture as a sensor without captures.

    The fill factor contains the relative sensitivity. The exposure time is that of the capture.

    Raises
    ------
    InputError
        If the sensor has no such capture.

    Examples
    --------
    >>> import photosite as ps
    >>> parts = [{"name": "a"}, {"name": "b", "relative_sensitivity": 0.5}]
    >>> sensor = ps.load_sensor("nikon-d200").with_(captures={"parts": parts, "combination": {"dn_per_e": 1}})
    >>> part_sensor(sensor, "b").pixel.fill_factor.value / sensor.pixel.fill_factor.value
    0.5
    """
    captures = captures_of(sensor)
    part, owner = captures[name], captures.owner(name)
    first = part is captures.parts[0]
    values: dict[str, Any] = {
        "analog_gain": sensor.readout.analog_gain.value * part.relative_gain.value,
        "well_capacity_e": part.well_capacity_e,
        "read_noise_e": part.read_noise_e,
        "dark_current_e_per_s": owner.dark_current_e_per_s,
        "fill_factor": sensor.pixel.fill_factor.value * captures.sensitivity(name),
        "serial": None if first else f"{sensor.serial}/{name}",
    }
    given = {key: value for key, value in values.items() if value is not None}
    return sensor.with_(captures=None, maps=None, gain_settings=(), covariance=None, **given)


def capture_numbers(
    sensor: Sensor,
    measured: MeasuredChip | None,
    mean_electrons: NDArray[np.float32],
    part: Part,
    exposure: Exposure,
    backend: Backend,
) -> dict[str, NDArray[np.uint16]]:
    """Return the digital numbers of each capture of a rectangle.

    `mean_electrons`, of the whole chip, and `exposure` are those of the sensor; measured maps, those of the first
    capture. All results are on the host.
    """
    captures, charges, out = captures_of(sensor), {}, {}
    sensors = {name: part_sensor(sensor, name) for name in captures.names}
    read_again = {each.charge_of for each in captures.parts}
    first = captures.names[0]
    sensors[first] = sensors[first].model_copy(update={"maps": sensor.maps})
    # The pixels around a rectangle couple to it.
    around, stages = charge_stages(sensor, sensor.effects or Effects(), part, exposure)
    inside = tuple(slice(a.start - b.start, a.stop - b.start) for a, b in zip(part, around, strict=True))
    photo_e = np.asarray(mean_electrons[around], np.float32)
    for number, each in enumerate(captures.parts):
        one = sensors[each.name]
        key = _key(exposure, number)
        own = exposure._replace(
            exposure_s=exposure.exposure_s * captures.owner(each.name).relative_exposure.value,
            well_capacity_e=float(one.pixel.well_capacity_e.value),
            gain_dn_per_e=float(one.system_gain_dn_per_e),
            k0=key[0],
            k1=key[1],
        )
        chip = measured if each.name == first else None
        light_e = None if each.charge_of is not None else read_only(photo_e * np.float32(captures.light(each.name)))
        if light_e is not None and one.effects is None and chip is None and each.name not in read_again:
            out[each.name] = drawn_frame(one, light_e, part, own, backend)
            continue
        wide = own._replace(first_row=around[0].start, first_col=around[1].start)
        pattern = fixed_pattern(one, chip, around, wide)
        if light_e is not None:
            largest = wide._replace(well_capacity_e=_largest_well_e(captures, sensors, each.name))
            charges[each.name] = collected_charge(pattern, light_e, largest, backend)
        charge_e = charges[each.charge_of or each.name]
        if each.charge == "overflow":
            charge_e = np.maximum(charge_e - np.float32(_well_e(sensors[str(each.charge_of)])), np.float32(0.0))
        read_e = np.minimum(charge_e, np.float32(own.well_capacity_e))
        for kernel, order, *arguments in stages:
            read_e = backend.run(kernel, read_only(read_e[order]), *arguments)[order]
        if around != part:
            read_e, pattern = read_e[inside], fixed_pattern(one, chip, part, own)
        out[each.name] = converted_charge(one, pattern, read_only(read_e), part, own, backend)
    return out


def _key(exposure: Exposure, number: int) -> tuple[np.uint32, np.uint32]:
    """Return the key of the random numbers of a capture: that of the frame for the first, else derived from it."""
    if number == 0:
        return exposure.k0, exposure.k1
    zero = np.uint32(0)
    k0, k1, _, _ = philox4x32(np.uint32(number), zero, CAPTURES, zero, exposure.k0, exposure.k1)
    return np.uint32(k0), np.uint32(k1)


def _well_e(sensor: Sensor) -> float:
    return float(sensor.pixel.well_capacity_e.value)


def _largest_well_e(captures: Captures, sensors: Mapping[str, Sensor], owner: str) -> float:
    """Return the electrons that a charge can have: the largest well that reads it, with what overflows from the own."""
    wells = [
        _well_e(sensors[part.name]) + (_well_e(sensors[owner]) if part.charge == "overflow" else 0.0)
        for part in captures.parts
        if owner in (part.name, part.charge_of)
    ]
    return max(wells)


class CaptureScale(NamedTuple):
    """Constants of a capture: DN per electron of light in the sensor's pixel, and DN from black to saturation."""

    dn_per_light_e: float
    saturation_dn: float


def capture_scale(sensor: Sensor, name: str) -> CaptureScale:
    """Return the constants that convert the digital numbers of a capture to light."""
    captures = captures_of(sensor)
    part = captures[name]
    gain = sensor.system_gain_dn_per_e * part.relative_gain.value
    well_e = (part.well_capacity_e or sensor.pixel.well_capacity_e).value
    head_room_dn = sensor.white_level_dn - sensor.readout.black_level_dn.value
    return CaptureScale(gain * captures.light(name), min(gain * well_e, head_room_dn))


def largest_light_e(sensor: Sensor) -> float:
    """Return the light at which the combined frame saturates, in electrons of the sensor's pixel.

    Examples
    --------
    >>> import photosite as ps
    >>> parts = [{"name": "long"}, {"name": "short", "relative_exposure": 0.0625}]
    >>> sensor = ps.load_sensor("nikon-d200").with_(captures={"parts": parts, "combination": {"dn_per_e": 1}})
    >>> round(largest_light_e(sensor) / sensor.saturation_capacity_e, 6)
    16.0
    """
    captures, lights = captures_of(sensor), []
    for part in captures.parts:
        scale, before_e = capture_scale(sensor, part.name), 0.0
        if part.charge == "overflow":
            before_e = _well_e(part_sensor(sensor, str(part.charge_of))) / captures.light(part.name)
        lights.append(scale.saturation_dn / scale.dn_per_light_e + before_e)
    rule = captures.combination
    of_output = ((1 << rule.bits) - 1 - rule.black_level_dn.value) / rule.dn_per_e.value
    return min(max(lights), of_output)


def combined(sensor: Sensor, frames: Mapping[str, NDArray[Any]]) -> CombinedNumbers:
    """Return the frame that a sensor outputs from its captures.

    With x_k the light by capture k, electrons of a photodiode of relative sensitivity and exposure 1, the frame is
    w_1 x_1 + (1 - w_1)(w_2 x_2 + (1 - w_2)(...)), with the weights of `Combination.weight` at the signal of each
    capture; then linear or companded numbers (`engine.combination`).

    Parameters
    ----------
    sensor
        A sensor with captures.
    frames
        Digital numbers of each capture by name, all of one shape.

    Returns
    -------
    ndarray
        uint16; uint32 for linear output of more than 16 bits.

    Raises
    ------
    InputError
        If the sensor has no captures, or one is missing.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(
    ...     captures={
    ...         "parts": [{"name": "long"}, {"name": "short", "relative_exposure": 0.0625}],
    ...         "combination": {"dn_per_e": 1, "bits": 20},
    ...     }
    ... )
    >>> combined(sensor, {"long": np.array([[1000, 4095]]), "short": np.array([[62, 3000]])})
    array([[  7980, 383040]], dtype=uint32)
    """
    captures, combination = captures_of(sensor), captures_of(sensor).combination
    if missing := [name for name in captures.names if name not in frames]:
        raise InputError("captures", value=sorted(frames), expected=f"with {', '.join(missing)}")
    numbers = np.stack([frames[name] for name in captures.names])
    if numbers.dtype != np.uint16:
        numbers = numbers.astype(np.float64)
    scales = [capture_scale(sensor, name) for name in captures.names]
    first, last = (end * np.array([scale.saturation_dn for scale in scales]) for end in combination.transition)
    knees = combination.companding
    constants = CombinationConstants(
        float(sensor.readout.black_level_dn.value),
        read_only(np.array([scale.dn_per_light_e for scale in scales])),
        read_only(
            np.array(
                [
                    captures.names.index(str(part.charge_of)) if part.charge == "overflow" else -1
                    for part in captures.parts
                ]
            )
        ),
        read_only(first),
        read_only(last),
        combination.dn_per_e.value,
        combination.black_level_dn.value,
        float((1 << combination.bits) - 1),
        read_only(np.array([0.0] if knees is None else knees.linear_dn, np.float64)),
        read_only(np.array([0.0] if knees is None else knees.companded_dn, np.float64)),
    )
    out = np.empty(numbers.shape[1:], np.uint16 if combination.output_bits <= 16 else np.uint32)
    with threads_for(out.size):
        combine(read_only(numbers.reshape(len(numbers), -1)), constants, out.reshape(-1))
    return out
