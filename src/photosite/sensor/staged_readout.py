"""A frame of a sensor with effects: charge, the stages that change it, and its conversion to digital numbers.

Each effect of `photosite.sensor.effects` changes one of the arrays here. `engine.charge` has the equations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.charge import ConversionMaps, collect_charge, convert_charge
from photosite.engine.charge_stages import bloom_columns, couple_pixels, multiply_charge, transfer_charge
from photosite.engine.jit import read_only
from photosite.engine.pixel_model import Exposure, replace_pixels
from photosite.sensor.chip import MeasuredChip, draw_chip
from photosite.sensor.chip_effects import (
    add_glow,
    add_hot_pixels,
    add_listed_hot,
    add_measured_blinking,
    add_telegraph_noise,
    border_parts,
    drift_e,
    fixed_lines,
    noise_ratio,
    set_dead_pixels,
    stuck_numbers,
    whole,
)
from photosite.sensor.device import Backend
from photosite.sensor.drawn_readout import line_noise, line_noise_dn, within
from photosite.sensor.effects.model import Effects
from photosite.sensor.model import Sensor
from photosite.sensor.shot import Part

_ANY_CHARGE_E = 1e15
"""Well capacity of pixels whose charge flows over into others."""


@dataclass(frozen=True)
class FixedPattern:
    """Maps of a rectangle in electrons, (rows, cols) float32 or (1, 1); spreads of row and column noise in DN.

    `gain_ratio` is the gain of each pixel over that of the exposure; None if all have it.
    """

    prnu: NDArray[np.float32]
    dark_rate_e_per_s: NDArray[np.float32]
    offset_e: NDArray[np.float32]
    noise_e: NDArray[np.float32]
    line_noise_dn: tuple[float, float]
    gain_ratio: NDArray[np.float32] | None = None


def staged_frame(
    sensor: Sensor,
    measured: MeasuredChip | None,
    mean_electrons: NDArray[np.float32],
    part: Part,
    exposure: Exposure,
    backend: Backend,
) -> NDArray[np.uint16]:
    """Return the digital numbers of a rectangle of a sensor with effects; `mean_electrons` is that of the chip."""
    effects = sensor.effects or Effects()
    if isinstance(mean_electrons, np.ndarray):
        mean_electrons = np.asarray(mean_electrons, np.float32)
    # The charge of a rectangle depends on that around it.
    around, stages = charge_stages(sensor, effects, part, exposure)
    wider = exposure._replace(first_row=around[0].start, first_col=around[1].start)
    if effects.blooming is not None:
        wider = wider._replace(well_capacity_e=_ANY_CHARGE_E)
    pattern = fixed_pattern(sensor, measured, around, wider)
    photo_e = backend.put(mean_electrons[around])
    charge_e = collected_charge(pattern, photo_e, wider, backend)
    for kernel, order, *arguments in stages:
        charge_e = backend.run(kernel, backend.put(charge_e[order]), *arguments)[order]
    if around != part:
        inside = tuple(slice(a.start - b.start, a.stop - b.start) for a, b in zip(part, around, strict=True))
        charge_e, pattern = charge_e[inside], fixed_pattern(sensor, measured, part, exposure)
    return converted_charge(sensor, pattern, charge_e, part, exposure, backend)


def fixed_pattern(sensor: Sensor, measured: MeasuredChip | None, part: Part, exposure: Exposure) -> FixedPattern:
    """Return the maps of a rectangle of the chip, with the states of its blinking pixels in a frame."""
    if measured is not None:
        return _lightless_border(_measured_pattern(sensor, measured, part, exposure), sensor, part)
    corners = tuple((side.start, side.stop) for side in part)
    described = sensor.serial, sensor.array, sensor.pixel, sensor.noise, sensor.effects
    pattern = _lasting_pattern(_PartOfChip((*described, corners), sensor, part))
    if sensor.effects is None or (telegraph := sensor.effects.telegraph_noise) is None:
        return pattern
    offset_e = whole(pattern.offset_e, part)
    add_telegraph_noise(offset_e, telegraph, sensor, part, exposure)
    for empty in _overscan(sensor, part):
        offset_e[empty] = 0.0
    return replace(pattern, offset_e=read_only(offset_e))


@dataclass(frozen=True)
class _PartOfChip:
    """A rectangle of a drawn chip, with all that its maps depend on as a key."""

    key: tuple[Any, ...]
    sensor: Sensor = field(compare=False)
    part: Part = field(compare=False)


# Three captures of one exposure
@lru_cache(maxsize=3)
def _lasting_pattern(chip: _PartOfChip) -> FixedPattern:
    """Return the maps of a rectangle of the chip that the serial stands for, the same in all frames."""
    sensor, part = chip.sensor, chip.part
    drawn, noise = draw_chip(sensor), sensor.noise
    effects = sensor.effects or Effects()
    prnu = within(drawn.prnu.deviates, part) * np.float32(drawn.prnu.scale)
    offset_e = within(drawn.offset_e.deviates, part) * np.float32(drawn.offset_e.scale)
    rate = drawn.dark_rate_e_per_s
    rate, noise_e = rate if rate.shape == (1, 1) else rate[part], _one(sensor.electrons(noise.pixel_noise_mv))
    defects = effects.pixel_defects
    if effects.hot_pixels is not None or effects.glow is not None or defects is not None:
        rate = whole(rate, part)
        if effects.hot_pixels is not None:
            add_hot_pixels(rate, effects.hot_pixels, sensor, part)
        if effects.glow is not None:
            add_glow(rate, effects.glow, sensor, part)
        if defects is not None:
            add_listed_hot(rate, defects, part)
    if defects is not None:
        prnu = whole(prnu, part)
        set_dead_pixels(prnu, defects, sensor, part)
    if effects.read_noise_spread is not None:
        noise_e = noise_e * noise_ratio(effects.read_noise_spread, sensor, part)
    return _lightless_border(FixedPattern(prnu, rate, offset_e, noise_e, line_noise_dn(sensor)), sensor, part)


def _lightless_border(pattern: FixedPattern, sensor: Sensor, part: Part) -> FixedPattern:
    """Return the maps, which may be changed, with those of optical black and overscan, for reading."""
    prnu, rate, offset_e = pattern.prnu, pattern.dark_rate_e_per_s, pattern.offset_e
    effects = sensor.effects
    if effects is not None and effects.optical_black is not None and effects.border is not None:
        prnu = whole(prnu, part)
        for covered in border_parts(effects.border, sensor, part):
            prnu[covered] = -1.0
        for empty in _overscan(sensor, part):
            rate, offset_e = whole(rate, part), whole(offset_e, part)
            rate[empty] = offset_e[empty] = 0.0
    prnu, rate, offset_e, noise_e = (_frozen(values) for values in (prnu, rate, offset_e, pattern.noise_e))
    return replace(pattern, prnu=prnu, dark_rate_e_per_s=rate, offset_e=offset_e, noise_e=noise_e)


def _frozen(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a contiguous map in read-only memory, of which a GPU keeps its copy."""
    values = np.ascontiguousarray(values)
    if values.base is None:
        values.flags.writeable = False
    return read_only(values)


def _overscan(sensor: Sensor, part: Part) -> list[Part]:
    """Return the rectangles of overscan within a rectangle."""
    if sensor.effects is None or sensor.effects.optical_black is None:
        return []
    overscan = sensor.effects.optical_black.overscan(sensor.effects.corner)
    return border_parts(overscan, sensor, part) if any(overscan) else []


def collected_charge(
    pattern: FixedPattern, photo_e: NDArray[np.float32], exposure: Exposure, backend: Backend
) -> NDArray[np.float32]:
    """Return the charge of the pixels of a rectangle, electrons."""
    charge_e: NDArray[np.float32] = backend.run(
        collect_charge, photo_e, pattern.prnu, pattern.dark_rate_e_per_s, exposure
    )
    return charge_e


def converted_charge(
    sensor: Sensor,
    pattern: FixedPattern,
    charge_e: NDArray[np.float32],
    part: Part,
    exposure: Exposure,
    backend: Backend,
) -> NDArray[np.uint16]:
    """Return the digital numbers of the charge of a rectangle."""
    effects = sensor.effects or Effects()
    maps = _conversion(sensor, effects, pattern, part, exposure)
    frame_dn: NDArray[np.uint16] = backend.run(convert_charge, backend.put(charge_e), maps, exposure)
    if effects.pixel_defects is not None and sensor.maps is None:
        stuck = stuck_numbers(effects.pixel_defects, sensor, part, maps.output_dn)
        frame_dn = backend.run(replace_pixels, frame_dn, *stuck)
    return frame_dn


def charge_stages(
    sensor: Sensor, effects: Effects, part: Part, exposure: Exposure
) -> tuple[Part, list[tuple[Any, ...]]]:
    """Return the rectangle whose charge that of a rectangle depends on, and the stages.

    A stage is a kernel, the order in which it takes rows and columns, and its arguments.
    """
    rows, cols = sensor.array.rows, sensor.array.cols
    (top, bottom), (left, right) = ((lines.start, lines.stop) for lines in part)
    stages: list[tuple[Any, ...]] = []
    # From the last stage to the first, the rectangle grows.
    if (coupling := effects.interpixel_capacitance) is not None:
        fractions = coupling.coupling_percent.value / 100.0, coupling.diagonal_percent.value / 100.0
        stages.append((couple_pixels, ..., *fractions))
        top, bottom, left, right = max(top - 1, 0), min(bottom + 1, rows), max(left - 1, 0), min(right + 1, cols)
    fractions_of_lines = None
    if (transfer := effects.charge_transfer) is not None:
        fractions_of_lines = transfer.row_shares(rows), transfer.column_shares(cols)
        late_rows, late_cols = (len(fractions) - 1 for fractions in fractions_of_lines)
        down, across = transfer.order
        top, bottom = _with_earlier(top, bottom, rows, late_rows, down)
        left, right = _with_earlier(left, right, cols, late_cols, across)
    if effects.blooming is not None:
        top, bottom = 0, rows
    around = slice(top, bottom), slice(left, right)
    if effects.em_gain is not None and (register := effects.em_gain.register()) is not None:
        stages.append((multiply_charge, ..., register, exposure._replace(first_row=top, first_col=left)))
    if fractions_of_lines is not None and transfer is not None:
        within_part = (
            read_only(np.ascontiguousarray(fractions[:, order][:, lines][:, order]))
            for fractions, lines, order in zip(fractions_of_lines, around, transfer.order, strict=True)
        )
        stages.append((transfer_charge, transfer.order, *within_part))
    if effects.blooming is not None:
        stages.append((bloom_columns, ..., exposure.well_capacity_e, 1.0 - effects.blooming.drained.value))
    return around, stages[::-1]


def _with_earlier(first: int, last: int, lines: int, late: int, order: slice) -> tuple[int, int]:
    """Return a range of lines with the lines before it in the order of reading."""
    return (max(first - late, 0), last) if order.step > 0 else (first, min(last + late, lines))


def _measured_pattern(sensor: Sensor, chip: MeasuredChip, part: Part, exposure: Exposure) -> FixedPattern:
    """Return the maps of a rectangle of a measured chip; see `pixel_model.measured_pixel` for values below 0."""
    shared = np.float32(chip.gain_dn_per_e(sensor.system_gain_dn_per_e))
    ratio_of = chip.gain_ratio(float(shared), part)
    gain = shared * ratio_of
    lines = max(chip.row_noise_dn, 0.0), max(chip.column_noise_dn, 0.0)
    noise_dn = chip.read_noise_dn[part]
    variance = noise_dn * np.abs(noise_dn) - np.float32(math.hypot(*lines) ** 2)
    dark = chip.dark_rate_dn_per_s
    dark_rate = _one(sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value)) if dark is None else dark[part] / gain
    offset = chip.offset_dn[part] / gain + np.minimum(dark_rate, 0.0) * np.float32(exposure.exposure_s)
    noise = np.sqrt(np.maximum(variance, np.float32(0.0))) / gain
    ratio = exposure.gain_dn_per_e / float(shared)
    if len(chip.blinking):
        offset, cols = whole(offset, part), sensor.array.cols
        gains, own = np.full(len(chip.blinking), float(shared)), chip.pixel_gain_dn_per_e
        if own is not None:
            gains = own[chip.blinking.row, chip.blinking.col].astype(np.float64)
        inside, place = add_measured_blinking(offset, chip.blinking, gains, cols, part, exposure)
        within_level = chip.blinking.noise_dn[inside]
        variance = np.maximum(within_level * np.abs(within_level) - math.hypot(*lines) ** 2, 0.0)
        noise[place] = np.sqrt(variance) / np.broadcast_to(gain, offset.shape)[place]
    return FixedPattern(
        _one(0.0) if (response := chip.response_e(float(shared), part)) is None else read_only(response),
        np.maximum(dark_rate, np.float32(0.0)),
        offset,
        noise,
        (lines[0] * ratio, lines[1] * ratio),
        None if chip.pixel_gain_dn_per_e is None else ratio_of,
    )


def _conversion(
    sensor: Sensor, effects: Effects, pattern: FixedPattern, part: Part, exposure: Exposure
) -> ConversionMaps:
    """Return what converts the charge of a rectangle."""
    row_group, gain, offset_e = np.zeros(1, np.int64), np.ones((1, 1)), np.zeros((1, 1))
    if pattern.gain_ratio is not None:  # each row is a group of readout channels, one a pixel
        row_group, gain = np.arange(len(pattern.gain_ratio)), pattern.gain_ratio.astype(np.float64)
        offset_e = np.zeros_like(gain)
    drawn = sensor.maps is None  # measured maps hold the pattern of channels, rows and columns
    if drawn and (channels := effects.readout_channels) is not None:
        row_group, column_group = channels.groups(sensor.array.rows, sensor.array.cols)
        row_group = row_group[part[0]]
        gain, offset_e = (table[:, column_group[part[1]]] for table in channels.tables())
    curve, step = np.zeros(1), 1.0
    if effects.response_curve is not None:
        curve, step = effects.response_curve.nodes(exposure.well_capacity_e)
    row_dn, column_dn = line_noise(pattern.line_noise_dn, part, exposure)
    if drawn and (lines := effects.line_pattern) is not None:
        row_e, column_e, column_gain = fixed_lines(lines, sensor.serial, part)
        row_dn, column_dn = row_dn + row_e * exposure.gain_dn_per_e, column_dn + column_e * exposure.gain_dn_per_e
        gain = gain * column_gain
    if effects.black_level_drift is not None:
        row_dn = row_dn + drift_e(effects.black_level_drift, exposure) * exposure.gain_dn_per_e
    return ConversionMaps(
        pattern.offset_e,
        pattern.noise_e,
        read_only(row_dn),
        read_only(column_dn),
        read_only(row_group),
        read_only(gain),
        read_only(offset_e),
        read_only(curve),
        step,
        read_only(np.zeros(1) if effects.converter_error is None else effects.converter_error.table()),
        read_only(_output_table(effects, exposure)),
    )


def _output_table(effects: Effects, exposure: Exposure) -> NDArray[np.uint16]:
    if effects.output is None:
        return np.zeros(1, np.uint16)
    return effects.output.table(exposure.white_level_dn, exposure.black_level_dn)


def _one(value: float) -> NDArray[np.float32]:
    return read_only(np.full((1, 1), value, np.float32))
