"""Mean electrons to digital numbers: fixed pattern, temporal noise, well capacity and analog-to-digital converter."""

from __future__ import annotations

import math
from dataclasses import replace
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import read_only, threads_for
from photosite.engine.pixel_model import (
    BlinkingPixels,
    Exposure,
    MeasuredMaps,
    all_light,
    expose_blinking,
    expose_measured,
)
from photosite.engine.random_numbers import key_from_seed
from photosite.errors import InputError
from photosite.sensor.capture_readout import CombinedNumbers, capture_numbers, combined
from photosite.sensor.chip import Blinking, MeasuredChip
from photosite.sensor.device import Computer, Cpu, Device, Gpu, GpuToHost, computer
from photosite.sensor.drawn_readout import drawn_frame, line_noise
from photosite.sensor.io.sensor_file import load_measured_chip
from photosite.sensor.model import Sensor
from photosite.sensor.own_noise import OwnNoise, check_noisier, drawn_maps, missing_light, with_missing_noise
from photosite.sensor.staged_readout import staged_frame

Rectangle = tuple[int, int, int, int]
"""(r0, r1, c0, c1): rows r0 to r1 and columns c0 to c1, the second of each excluded."""


def digital_numbers(
    sensor: Sensor,
    mean_electrons: NDArray[np.float32],
    exposure_s: float,
    *,
    seed: int,
    frame: int = 0,
    region: Rectangle | None = None,
    device: Device | Gpu = "cpu",
    temperature_c: float | None = None,
    own_noise: OwnNoise | None = None,
) -> CombinedNumbers:
    """Return one frame of a sensor, or a rectangle of it, (rows, cols) uint16.

    A sensor with several captures gives their combination (`capture_readout.combined`): uint32 for linear output of
    more than 16 bits.

    The equations are those of `photosite.engine.pixel_model`. A sensor with measured maps takes PRNU, dark current,
    offset and read noise of each pixel from them. Otherwise the fixed pattern is drawn from the sensor's serial.

    Parameters
    ----------
    mean_electrons
        (rows, cols) float32 electrons from light, not negative; of the whole chip, or, for a sensor without effects and
        captures, of the region.
    exposure_s
        Exposure time, for the dark current.
    seed
        Key of the temporal noise, 0 to 2^64 - 1.
    frame
        Frame number, 0 to 2^32 - 1.
    region
        (r0, r1, c0, c1) of the chip; None is the whole chip. Its digital numbers are those of the whole frame.
    device
        "cpu", or "cuda" for an NVIDIA GPU (extra `gpu`). With a `Gpu`, the electrons may be an array on the GPU, and
        the digital numbers stay there; this needs a sensor without captures.
    temperature_c
        Temperature of the sensor, for the dark current; default that of the description.
    own_noise
        Noise that the electrons have, if they were measured; only the missing noise is added, and electrons may be
        negative. None: they are exact means.

    Raises
    ------
    InputError
        If the shape is not the sensor's, a mean is negative or not finite, seed, frame or region is out of range, the
        device is unknown or missing, measured maps have another size, or the well capacity is below half a digital
        number, or the sensor does not state what a temperature needs
        (`Sensor.dark_current_ratio`), or the electrons have noise that the sensor does not have.
    FileError
        If a file of measured maps is missing, or is not the file that the sensor file names by its hash.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=2, cols=2, black_level_dn=64)
    >>> digital_numbers(sensor, np.full((2, 2), 7980, np.float32), 0.01, seed=1).shape
    (2, 2)
    """
    on, light_e = computer(device), mean_electrons
    if own_noise is not None:
        check_noisier(sensor, own_noise)
        light_e = missing_light(mean_electrons, own_noise)
    photo_e, part, exposure = _checked(sensor, light_e, exposure_s, seed, frame, region, on)
    sensor, measured = _at_temperature(sensor, temperature_c)
    if sensor.captures is not None:
        if on is device:
            hint = "Use Camera.capture with device='cuda'"
            raise InputError("captures are combined on the host, not on a GPU", hint=hint)
        return combined(sensor, capture_numbers(sensor, measured, mean_electrons, part, exposure, _through_host(on)))
    if sensor.effects is not None:
        out = staged_frame(sensor, measured, mean_electrons, part, exposure, on)
    elif measured is None and own_noise is None:
        out = drawn_frame(sensor, photo_e, part, exposure, on)
    else:
        out = _mapped_frame(sensor, measured, mean_electrons, photo_e, part, exposure, on, own_noise)
    return out if on is device else on.get(out)


def _through_host(on: Computer) -> Computer:
    """Return what computes on the same device, with results on the host."""
    return GpuToHost(on.arrays) if isinstance(on, Gpu) else on


def _mapped_frame(
    sensor: Sensor,
    measured: MeasuredChip | None,
    mean_electrons: NDArray[np.float32],
    photo_e: NDArray[np.float32],
    part: tuple[slice, slice],
    exposure: Exposure,
    on: Computer,
    own_noise: OwnNoise | None,
) -> NDArray[np.uint16]:
    """Return the digital numbers of a rectangle of a measured chip, or of light that has noise."""
    maps = drawn_maps(sensor, part, exposure) if measured is None else _measured_maps(measured, sensor, part, exposure)
    if own_noise is not None:
        electrons = mean_electrons if mean_electrons.shape == photo_e.shape else mean_electrons[part]
        maps, exposure = with_missing_noise(maps, exposure, electrons, own_noise)
    out: NDArray[np.uint16] = on.computed(expose_measured, photo_e, maps, exposure)
    if measured is not None and len(measured.blinking):
        blinking = _blinking_within(measured.blinking, (part[0].start, part[1].start), photo_e.shape)
        out = on.computed(expose_blinking, out, blinking, photo_e, maps, exposure)
    return out


def digital_numbers_of_captures(
    sensor: Sensor,
    mean_electrons: NDArray[np.float32],
    exposure_s: float,
    *,
    seed: int,
    frame: int = 0,
    region: Rectangle | None = None,
    device: Device = "cpu",
    temperature_c: float | None = None,
) -> dict[str, NDArray[np.uint16]]:
    """Return one frame, or a rectangle of it, of each capture of a sensor with captures, by name.

    The arguments and errors are those of `digital_numbers`; `mean_electrons` and the exposure time are those of a
    photodiode of relative sensitivity and exposure 1.
    """
    on = computer(device)
    _, part, exposure = _checked(sensor, mean_electrons, exposure_s, seed, frame, region, Cpu())
    return capture_numbers(*_at_temperature(sensor, temperature_c), mean_electrons, part, exposure, _through_host(on))


def _at_temperature(sensor: Sensor, temperature_c: float | None) -> tuple[Sensor, MeasuredChip | None]:
    """Return a sensor and its measured chip, None without maps, at a temperature; None for that of the description."""
    measured = load_measured_chip(sensor)
    if measured is not None:
        _check_size(measured, sensor)
    if temperature_c is None:
        return sensor, measured
    if measured is not None and measured.dark_rate_dn_per_s is not None:
        ratio = np.float32(sensor.dark_current_ratio(temperature_c).value)
        measured = replace(measured, dark_rate_dn_per_s=measured.dark_rate_dn_per_s * ratio)
    return sensor.at_temperature(temperature_c), measured


def _checked(
    sensor: Sensor,
    mean_electrons: NDArray[np.float32],
    exposure_s: float,
    seed: int,
    frame: int,
    region: Rectangle | None,
    on: Computer,
) -> tuple[NDArray[np.float32], tuple[slice, slice], Exposure]:
    """Return the light and the place of a rectangle, and what its pixels share; see `digital_numbers` for errors."""
    rows, cols = sensor.array.rows, sensor.array.cols
    r0, r1, c0, c1 = region or (0, rows, 0, cols)
    if not (0 <= r0 < r1 <= rows and 0 <= c0 < c1 <= cols):
        expected = f"(r0, r1, c0, c1) with r0 < r1 <= {rows} and c0 < c1 <= {cols}"
        raise InputError("region", value=region, expected=expected)
    part = slice(r0, r1), slice(c0, c1)
    shape, plain = mean_electrons.shape, sensor.effects is None and sensor.captures is None
    if shape != (rows, cols) and not (plain and shape == (r1 - r0, c1 - c0)):
        raise InputError("mean_electrons", value=shape, expected=f"of shape ({rows}, {cols})")
    part_e = mean_electrons[part] if shape == (rows, cols) else mean_electrons
    if isinstance(mean_electrons, np.ndarray):
        part_e = read_only(np.asarray(part_e, np.float32))
        # Stages that move charge use the whole chip.
        used = part_e if plain else read_only(np.asarray(mean_electrons, np.float32))
        with threads_for(used.size):
            valid = all_light(used)
    else:
        valid = float(on.xp.min(mean_electrons)) >= 0 and float(on.xp.max(mean_electrons)) < np.inf
    if not valid:
        xp: Any = np if isinstance(mean_electrons, np.ndarray) else on.xp
        limits = float(xp.min(mean_electrons)), float(xp.max(mean_electrons))
        raise InputError("mean_electrons", value=limits, expected="finite and not negative")
    photo_e = on.put(part_e) if plain else part_e
    for name, number, bits in (("seed", seed, 64), ("frame", frame, 32)):
        whole = isinstance(number, Integral) and not isinstance(number, bool)
        if not (whole and 0 <= number < 1 << bits):
            raise InputError(name, value=number, expected=f"an integer from 0 to 2^{bits} - 1")
    _check_full_well(sensor)
    exposure = Exposure(
        float(exposure_s),
        float(sensor.pixel.well_capacity_e.value),
        float(sensor.system_gain_dn_per_e),
        float(sensor.readout.black_level_dn.value),
        float(sensor.white_level_dn),
        int(r0),
        int(c0),
        cols,
        np.uint32(frame),
        *key_from_seed(int(seed)),
    )
    return photo_e, part, exposure


def _check_full_well(sensor: Sensor) -> None:
    """Refuse a well capacity, such as one that is still to be measured, at which every frame is black."""
    well = sensor.pixel.well_capacity_e
    if well.value * sensor.system_gain_dn_per_e < 0.5:
        hint = "Every frame would be black"
        if well.assumed:
            hint += "; measure it with flat fields up to saturation, two or more at each exposure, or state it"
        expected = f"at least {0.5 / sensor.system_gain_dn_per_e:.3g} (half a digital number)"
        name = f"sensor '{sensor.name}'"
        raise InputError("well_capacity_e", where=name, value=well.value, expected=expected, hint=hint)


def _check_size(chip: MeasuredChip, sensor: Sensor) -> None:
    """Refuse maps of another size than the sensor's."""
    size = sensor.array.rows, sensor.array.cols
    if chip.shape != size:
        hint = "Give the sensor the size of its maps, or use with_(maps=None) to simulate a drawn chip"
        raise InputError("maps", value=chip.shape, expected=f"of the sensor's size {size}", hint=hint)


def _measured_maps(chip: MeasuredChip, sensor: Sensor, part: tuple[slice, slice], exposure: Exposure) -> MeasuredMaps:
    """Return a rectangle of a measured chip's maps, and the line noise of one frame.

    The maps replace read noise, DSNU, PRNU and dark voltage of the sensor's description. A map that was not measured is
    constant: no PRNU, or the dark current of the description.
    """
    gain = float(chip.system_gain_dn_per_e or sensor.system_gain_dn_per_e)
    constant_dark = np.float32(sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value) * gain)
    shape = part[0].stop - part[0].start, part[1].stop - part[1].start
    prnu, offset, dark_rate = (
        read_only(np.full(shape, constant, np.float32) if values is None else values[part])
        for values, constant in ((chip.prnu, 0), (chip.offset_dn, 0), (chip.dark_rate_dn_per_s, constant_dark))
    )
    # A variance that was measured below 0 counts as 0.
    spreads = max(chip.row_noise_dn, 0.0), max(chip.column_noise_dn, 0.0)
    # The kernel reads a value for each line.
    row_dn, column_dn = (
        np.broadcast_to(values, count).copy()
        for values, count in zip(line_noise(spreads, part, exposure), shape, strict=True)
    )
    read_noise = read_only(chip.read_noise_dn[part])
    return MeasuredMaps(prnu, offset, dark_rate, read_noise, row_dn, column_dn, math.hypot(*spreads) ** 2, gain)


def _blinking_within(blinking: Blinking, corner: tuple[int, int], shape: tuple[int, ...]) -> BlinkingPixels:
    """Return the blinking pixels of a rectangle."""
    place = np.column_stack([blinking.row - corner[0], blinking.col - corner[1]])
    inside = ((place >= 0) & (place < np.array(shape))).all(axis=1)
    columns = blinking.amplitude_dn, blinking.high_fraction, blinking.noise_dn
    return BlinkingPixels(place[inside], *(np.ascontiguousarray(column[inside]) for column in columns))
