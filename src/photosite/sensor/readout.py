"""Mean electrons to digital numbers: fixed pattern, temporal noise, well capacity and analog-to-digital converter."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import read_only
from photosite.engine.pixel_model import (
    BlinkingPixels,
    Exposure,
    MeasuredMaps,
    all_light,
    expose_blinking,
    expose_measured,
)
from photosite.engine.random_numbers import key_from_seed
from photosite.engine.threads import threads_for
from photosite.errors import InputError
from photosite.sensor.capture_readout import CombinedNumbers, capture_numbers, combined
from photosite.sensor.chip import Blinking, MeasuredChip
from photosite.sensor.device import Backend, Gpu, GpuToHost, backend_for
from photosite.sensor.drawn_readout import drawn_frame, line_noise
from photosite.sensor.input_noise import InputNoise, check_noisier, drawn_maps, missing_light, with_missing_noise
from photosite.sensor.io.sensor_file import load_measured_chip
from photosite.sensor.model import Sensor
from photosite.sensor.shot import Part, Shot, ShotOptions
from photosite.sensor.staged_readout import staged_frame


def digital_numbers(
    sensor: Sensor,
    mean_electrons: NDArray[np.float32],
    exposure_s: float,
    *,
    input_noise: InputNoise | None = None,
    **shot: Unpack[ShotOptions],
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
        captures, of the region. With a `Gpu` as the device, they may be an array on the GPU.
    exposure_s
        Exposure time, for the dark current.
    input_noise
        Noise that the electrons have, if they were measured; only the missing noise is added, and electrons may be
        negative. None: they are exact means.
    **shot
        `seed`, `frame`, `region`, `device` and `temperature_c` of a `Shot`.

    Raises
    ------
    InputError
        If the shape is not the sensor's, a mean is negative or not finite, seed, frame or region is out of range, the
        device is unknown or missing, or a `Gpu` and the sensor has captures, measured maps have another size, or the
        well capacity is below half a digital number, or the sensor does not state what a temperature needs
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
    return read_frame(sensor, load_measured_chip(sensor), mean_electrons, exposure_s, Shot(**shot), input_noise)


def read_frame(
    sensor: Sensor,
    chip: MeasuredChip | None,
    mean_electrons: NDArray[np.float32],
    exposure_s: float,
    shot: Shot,
    input_noise: InputNoise | None = None,
) -> CombinedNumbers:
    """Return `digital_numbers` of a sensor whose measured chip, None without maps, has been loaded."""
    light_e = mean_electrons
    if input_noise is not None:
        check_noisier(sensor, input_noise)
        light_e = missing_light(mean_electrons, input_noise)
    if sensor.captures is not None:
        if isinstance(shot.device, Gpu):
            hint = "Use Camera.capture with device='cuda'"
            raise InputError("captures are combined on the host, not on a GPU", hint=hint)
        return combined(sensor, read_captures(sensor, chip, mean_electrons, exposure_s, shot))
    backend = backend_for(shot.device)
    photo_e, part, exposure = _checked(sensor, light_e, exposure_s, shot, backend)
    sensor, chip = _at_temperature(sensor, chip, shot.temperature_c)
    if sensor.effects is not None:
        out = staged_frame(sensor, chip, mean_electrons, part, exposure, backend)
    elif chip is None and input_noise is None:
        out = drawn_frame(sensor, photo_e, part, exposure, backend)
    else:
        out = _mapped_frame(sensor, chip, mean_electrons, photo_e, part, exposure, backend, input_noise)
    return out if backend is shot.device else backend.get(out)


def read_captures(
    sensor: Sensor, chip: MeasuredChip | None, mean_electrons: NDArray[np.float32], exposure_s: float, shot: Shot
) -> dict[str, NDArray[np.uint16]]:
    """Return one frame, or a rectangle of it, of each capture of a sensor with captures, by name.

    Arguments and errors are those of `read_frame`; `mean_electrons` and the exposure time are those of a photodiode of
    relative sensitivity and exposure 1.
    """
    backend = backend_for(shot.device)
    _, part, exposure = _checked(sensor, mean_electrons, exposure_s, shot, backend)
    sensor, chip = _at_temperature(sensor, chip, shot.temperature_c)
    on_host = GpuToHost(backend.arrays) if isinstance(backend, Gpu) else backend
    return capture_numbers(sensor, chip, mean_electrons, part, exposure, on_host)


def _mapped_frame(
    sensor: Sensor,
    chip: MeasuredChip | None,
    mean_electrons: NDArray[np.float32],
    photo_e: NDArray[np.float32],
    part: Part,
    exposure: Exposure,
    backend: Backend,
    input_noise: InputNoise | None,
) -> NDArray[np.uint16]:
    """Return the digital numbers of a rectangle of a measured chip, or of light that has noise."""
    maps = drawn_maps(sensor, part, exposure) if chip is None else _measured_maps(chip, sensor, part, exposure)
    if input_noise is not None:
        electrons = mean_electrons if mean_electrons.shape == photo_e.shape else mean_electrons[part]
        maps, exposure = with_missing_noise(maps, exposure, electrons, input_noise)
    out: NDArray[np.uint16] = backend.run(expose_measured, photo_e, maps, exposure)
    if chip is not None and len(chip.blinking):
        blinking = _blinking_within(chip.blinking, (part[0].start, part[1].start), photo_e.shape)
        out = backend.run(expose_blinking, out, blinking, photo_e, maps, exposure)
    return out


def _at_temperature(
    sensor: Sensor, chip: MeasuredChip | None, temperature_c: float | None
) -> tuple[Sensor, MeasuredChip | None]:
    """Return a sensor and its measured chip at a temperature; None for that of the description."""
    size = sensor.array.rows, sensor.array.cols
    if chip is not None and chip.shape != size:
        hint = "Give the sensor the size of its maps, or use with_(maps=None) to simulate a drawn chip"
        raise InputError("maps", value=chip.shape, expected=f"of the sensor's size {size}", hint=hint)
    if temperature_c is None:
        return sensor, chip
    if chip is not None and chip.dark_rate_dn_per_s is not None:
        ratio = np.float32(sensor.dark_current_ratio(temperature_c).value)
        chip = replace(chip, dark_rate_dn_per_s=chip.dark_rate_dn_per_s * ratio)
    return sensor.at_temperature(temperature_c), chip


def _checked(
    sensor: Sensor, mean_electrons: NDArray[np.float32], exposure_s: float, shot: Shot, backend: Backend
) -> tuple[NDArray[np.float32], Part, Exposure]:
    """Return the light and the place of a rectangle, and what its pixels share; see `digital_numbers` for errors."""
    rows, cols = sensor.array.rows, sensor.array.cols
    part = shot.part(rows, cols)
    shape, plain = mean_electrons.shape, sensor.effects is None and sensor.captures is None
    if shape != (rows, cols) and not (plain and shape == tuple(side.stop - side.start for side in part)):
        raise InputError("mean_electrons", value=shape, expected=f"of shape ({rows}, {cols})")
    part_e = mean_electrons[part] if shape == (rows, cols) else mean_electrons
    if isinstance(mean_electrons, np.ndarray):
        part_e = read_only(np.asarray(part_e, np.float32))
        # Stages that move charge use the whole chip.
        used = part_e if plain else read_only(np.asarray(mean_electrons, np.float32))
        with threads_for(used.size):
            valid = all_light(used)
    else:
        valid = float(backend.xp.min(mean_electrons)) >= 0 and float(backend.xp.max(mean_electrons)) < np.inf
    if not valid:
        xp: Any = np if isinstance(mean_electrons, np.ndarray) else backend.xp
        limits = float(xp.min(mean_electrons)), float(xp.max(mean_electrons))
        raise InputError("mean_electrons", value=limits, expected="finite and not negative")
    photo_e = backend.put(part_e) if plain else part_e
    _check_full_well(sensor)
    exposure = Exposure(
        float(exposure_s),
        float(sensor.pixel.well_capacity_e.value),
        float(sensor.system_gain_dn_per_e),
        float(sensor.readout.black_level_dn.value),
        float(sensor.white_level_dn),
        int(part[0].start),
        int(part[1].start),
        cols,
        np.uint32(shot.frame),
        *key_from_seed(int(shot.seed)),
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


def _measured_maps(chip: MeasuredChip, sensor: Sensor, part: Part, exposure: Exposure) -> MeasuredMaps:
    """Return a rectangle of a measured chip's maps, and the line noise of one frame.

    The maps replace read noise, DSNU, PRNU and dark voltage of the sensor's description. A map that was not measured is
    constant: no PRNU, or the dark current of the description.
    """
    gain = chip.gain_dn_per_e(sensor.system_gain_dn_per_e)
    constant_dark = np.float32(sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value) * gain)
    shape = part[0].stop - part[0].start, part[1].stop - part[1].start
    ratio, dark = read_only(chip.gain_ratio(gain, part)), chip.dark_rate_dn_per_s
    if dark is not None:
        dark = dark[part]
        if chip.pixel_gain_dn_per_e is not None:  # the kernel takes electrons from the gain that pixels share
            dark = np.where(dark > 0, dark / ratio, dark)
    prnu, offset, dark_rate = (
        read_only(np.full(shape, constant, np.float32) if values is None else values)
        for values, constant in ((chip.response_e(gain, part), 0), (chip.offset_dn[part], 0), (dark, constant_dark))
    )
    # A variance that was measured below 0 counts as 0.
    spreads = max(chip.row_noise_dn, 0.0), max(chip.column_noise_dn, 0.0)
    # The kernel reads a value for each line.
    row_dn, column_dn = (
        np.broadcast_to(values, count).copy()
        for values, count in zip(line_noise(spreads, part, exposure), shape, strict=True)
    )
    read_noise = read_only(chip.read_noise_dn[part])
    return MeasuredMaps(prnu, offset, dark_rate, read_noise, ratio, row_dn, column_dn, math.hypot(*spreads) ** 2, gain)


def _blinking_within(blinking: Blinking, corner: tuple[int, int], shape: tuple[int, ...]) -> BlinkingPixels:
    place = np.column_stack([blinking.row - corner[0], blinking.col - corner[1]])
    inside = ((place >= 0) & (place < np.array(shape))).all(axis=1)
    columns = blinking.amplitude_dn, blinking.high_fraction, blinking.noise_dn
    return BlinkingPixels(place[inside], *(np.ascontiguousarray(column[inside]) for column in columns))
