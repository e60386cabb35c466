"""Frames of a measured chip."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import threads_for
from photosite.engine.measured_pixels import blink, expose_measured, line_deviates
from photosite.errors import InputError
from photosite.sensor.measured_chip import Blinking, MeasuredChip
from photosite.sensor.model import Sensor


def expose_chip(
    chip: MeasuredChip,
    sensor: Sensor,
    photo_e: NDArray[np.float32],
    exposure_s: float,
    corner: tuple[int, int],
    frame: np.uint32,
    key: tuple[np.uint32, np.uint32],
) -> NDArray[np.uint16]:
    """One frame of a measured chip, or a rectangle of it.

    Of the sensor's description converter, gain, black level and well are used; what the maps hold takes the place of
    its read noise, DSNU, PRNU, dark voltage and its non-uniformity. Noise is normal with each pixel's standard
    deviation; blinking pixels take one of their two levels, in every frame anew. What measurement noise put below
    zero and cannot be below zero (a variance, a response) counts as zero; a dark current below zero lowers the level.
    A map that was not measured is as if even: no PRNU, or the description's dark current.

    Parameters
    ----------
    chip
        The maps.
    sensor
        The rest of the description.
    photo_e
        (rows, cols) float32 mean electrons from light, of the rectangle.
    exposure_s
        Exposure time.
    corner
        The rectangle's first row and column on the chip.
    frame, key
        Counter and key of the temporal noise.

    Raises
    ------
    InputError
        If the maps are not of the sensor's size.
    """
    size = sensor.array.rows, sensor.array.cols
    if chip.shape != size:
        raise InputError(
            f"the measured maps are {chip.shape[0]} x {chip.shape[1]} pixels, the sensor {size[0]} x {size[1]}; "
            f"take that size, or a sensor without maps (with_(maps=None)), whose chip is drawn"
        )
    rows, cols = photo_e.shape
    r0, c0 = corner
    gain = chip.system_gain_dn_per_e or sensor.system_gain_dn_per_e
    even_dark = np.float32(sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value) * gain)
    part = (slice(r0, r0 + rows), slice(c0, c0 + cols))
    maps: list[Any] = [
        np.ascontiguousarray(np.full(photo_e.shape, even, np.float32) if values is None else values[part])
        for values, even in ((chip.prnu, np.float32(0)), (chip.offset_dn, 0), (chip.dark_rate_dn_per_s, even_dark))
    ]
    # A variance of lines that came out negative is no noise.
    spreads = [max(chip.row_noise_dn, 0.0), max(chip.column_noise_dn, 0.0)]
    lines: list[Any] = [
        spread * line_deviates(first, count, word, frame, *key) if spread else np.zeros(count)
        for word, (spread, first, count) in enumerate(zip(spreads, corner, photo_e.shape, strict=True))
    ]
    scalars: tuple[Any, ...] = (
        math.hypot(*spreads) ** 2,
        gain,
        exposure_s,
        sensor.pixel.well_capacity_e.value,
        sensor.system_gain_dn_per_e,
        sensor.readout.black_level_dn.value,
        sensor.white_level_dn,
        corner,
        size[1],
        frame,
        *key,
    )
    with threads_for(photo_e.size):
        read_noise = np.ascontiguousarray(chip.read_noise_dn[part])
        arguments: tuple[Any, ...] = (photo_e, *maps, read_noise, *lines, *scalars)
        out = expose_measured(*arguments)
    if len(chip.blinking):
        place, columns = _within(chip.blinking, corner, photo_e.shape)
        arguments = (out, place, *columns, photo_e, *maps, *lines, *scalars)
        blink(*arguments)
    return out


def _within(
    blinking: Blinking, corner: tuple[int, int], shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], tuple[Any, ...]]:
    """Blinking pixels of a rectangle: (n, 2) place in it, and their columns."""
    place = np.column_stack([blinking.row - corner[0], blinking.col - corner[1]])
    inside = ((place >= 0) & (place < np.array(shape))).all(axis=1)
    columns = blinking.amplitude_dn, blinking.high_fraction, blinking.noise_dn
    return place[inside], tuple(np.ascontiguousarray(column[inside]) for column in columns)
