"""Mean electrons to digital numbers: the chip's fixed pattern, temporal noise, well and converter."""

from __future__ import annotations

from numbers import Integral
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import threads_for
from photosite.engine.philox import key_from_seed
from photosite.engine.pixels import expose
from photosite.errors import InputError
from photosite.sensor.chip import draw_chip
from photosite.sensor.io.maps_file import load_measured_chip
from photosite.sensor.measured_readout import expose_chip
from photosite.sensor.model import Sensor

Rectangle = tuple[int, int, int, int]
"""(r0, r1, c0, c1): rows r0 to r1 and columns c0 to c1, the second of each excluded."""

Device = Literal["cpu", "cuda"]
"""Where the pixels are computed; the digital numbers are the same."""


def digital_numbers(
    sensor: Sensor,
    mean_electrons: NDArray[np.float32],
    exposure_s: float,
    *,
    seed: int,
    frame: int = 0,
    region: Rectangle | None = None,
    device: Device = "cpu",
) -> NDArray[np.uint16]:
    """One frame of the chip that the sensor's maps hold, or its serial stands for; or a rectangle of the frame.

    For pixel i of frame n: mean_i = photo_i (1 + prnu_i) + dark_rate_i t; e_i = min(Poisson(mean_i), well);
    dn_i = clip(round(gain (e_i + offset_i + read noise) + black level), 0, 2^bits - 1). A sensor with measured maps
    takes prnu, dark rate, offset and read noise of each pixel from them (`measured_readout`).

    Parameters
    ----------
    sensor
        The sensor.
    mean_electrons
        (rows, cols) float32 electrons from light, none negative.
    exposure_s
        Exposure time, for the dark current.
    seed
        Key of the temporal noise, 0 to 2^64 - 1.
    frame
        Number of the frame, 0 to 2^32 - 1.
    region
        (r0, r1, c0, c1) of the chip; None is all of it. Its pixels have the numbers they have in the whole frame.
    device
        "cpu", or "cuda" for an NVIDIA GPU (extra `gpu`).

    Returns
    -------
    ndarray
        (rows, cols) uint16, of the region where one is given.

    Raises
    ------
    InputError
        If the shape is not the sensor's, a mean is negative or not finite, seed, frame or region are out of range,
        the device is unknown or missing, or measured maps are of another size or wanted on a GPU.
    FileError
        If a file of measured maps is missing or not the one that the sensor file hashed.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=2, cols=2, black_level_dn=64)
    >>> digital_numbers(sensor, np.full((2, 2), 7980, np.float32), 0.01, seed=1).shape
    (2, 2)
    """
    shape = (sensor.array.rows, sensor.array.cols)
    if mean_electrons.shape != shape:
        raise InputError(f"mean electrons are {shape[0]} x {shape[1]} for this sensor, not {mean_electrons.shape}")
    # Two reductions instead of a mask: a 150-megapixel frame should not need a second one.
    lowest, highest = float(mean_electrons.min()), float(mean_electrons.max())
    if not (lowest >= 0 and highest < np.inf):
        raise InputError(f"mean electrons are finite and not negative; they run from {lowest:g} to {highest:g}")
    for name, number, bits in (("seed", seed, 64), ("frame", frame, 32)):
        whole = isinstance(number, Integral) and not isinstance(number, bool)
        if not (whole and 0 <= number < 1 << bits):
            raise InputError(f"{name} is a whole number from 0 to 2^{bits} - 1, not {number!r}")
    r0, r1, c0, c1 = region or (0, shape[0], 0, shape[1])
    if not (0 <= r0 < r1 <= shape[0] and 0 <= c0 < c1 <= shape[1]):
        raise InputError(
            f"a region is (r0, r1, c0, c1) within the chip's {shape[0]} rows and {shape[1]} columns, not {region}"
        )
    photo_e = np.ascontiguousarray(mean_electrons[r0:r1, c0:c1], np.float32)
    if (measured := load_measured_chip(sensor)) is not None:
        if device != "cpu":
            raise InputError("a measured chip is simulated on the CPU: take device='cpu', or maps=None for a drawn one")
        return expose_chip(measured, sensor, photo_e, exposure_s, (r0, c0), np.uint32(frame), key_from_seed(int(seed)))
    chip = draw_chip(sensor)
    return _exposed(
        device,
        photo_e,
        _part(chip.prnu.deviates, r0, r1, c0, c1),
        chip.prnu.scale,
        _part(chip.offset_e.deviates, r0, r1, c0, c1),
        chip.offset_e.scale,
        _part(chip.dark_rate_e_per_s, r0, r1, c0, c1),
        exposure_s,
        sensor.pixel.well_capacity_e.value,
        sensor.electrons(sensor.noise.read_noise_mv.value),
        sensor.system_gain_dn_per_e,
        sensor.readout.black_level_dn.value,
        sensor.white_level_dn,
        (r0, c0),
        shape[1],
        np.uint32(frame),
        *key_from_seed(int(seed)),
    )


def _exposed(device: Device, *arguments: Any) -> NDArray[np.uint16]:
    """`expose` on the device."""
    if device == "cpu":
        with threads_for(arguments[0].size):
            return expose(*arguments)
    if device != "cuda":
        raise InputError(f"device is one of {', '.join(get_args(Device))}, not {device!r}")
    try:
        from photosite.engine.cuda import NoCudaError, expose_cuda
    except ImportError:
        raise _no_cuda("numba.cuda cannot be imported") from None
    try:
        return expose_cuda(*arguments)
    except NoCudaError as error:
        raise _no_cuda(str(error)) from None


def _no_cuda(reason: str) -> InputError:
    return InputError(
        f"device='cuda' needs an NVIDIA GPU and photosite's extra 'gpu' (pip install 'photosite[gpu]'), and {reason}; "
        "device='cpu' gives the same numbers"
    )


def _part(values: NDArray[Any], r0: int, r1: int, c0: int, c1: int) -> NDArray[Any]:
    """A rectangle of a map; a map of one value stays as it is."""
    return values if values.shape == (1, 1) else values[r0:r1, c0:c1]
