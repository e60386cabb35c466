"""A frame of a sensor without effects whose chip is drawn, in one pass; and the line noise of any frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import T, read_only
from photosite.engine.pixel_model import DrawnConstants, DrawnMaps, Exposure, expose_drawn, line_deviates
from photosite.engine.random_numbers import LINES
from photosite.sensor.chip import draw_chip
from photosite.sensor.device import Backend
from photosite.sensor.model import Sensor
from photosite.sensor.shot import Part


def drawn_frame(
    sensor: Sensor, photo_e: NDArray[np.float32], part: Part, exposure: Exposure, backend: Backend
) -> NDArray[np.uint16]:
    """Return the digital numbers of a rectangle of a sensor; `photo_e` is that of the rectangle."""
    chip = draw_chip(sensor)
    maps = DrawnMaps(
        read_only(chip.prnu.deviates),
        read_only(chip.offset_e.deviates),
        read_only(chip.dark_rate_e_per_s),
        *line_noise(line_noise_dn(sensor), part, exposure),
    )
    read_noise_e = sensor.electrons(sensor.noise.pixel_noise_mv)
    constants = DrawnConstants(float(chip.prnu.scale), float(chip.offset_e.scale), float(read_noise_e))
    frame_dn: NDArray[np.uint16] = backend.run(expose_drawn, photo_e, maps, constants, exposure)
    return frame_dn


def within(values: NDArray[T], part: Part) -> NDArray[T]:
    """Return a rectangle of a map; a map of shape (1, 1), which is one value for all pixels, unchanged."""
    return read_only(values if values.shape == (1, 1) else values[part])


def line_noise_dn(sensor: Sensor) -> tuple[float, float]:
    """Return the standard deviations of row and column noise, DN."""
    noise = sensor.noise
    return noise.row_noise_mv.value / sensor.mv_per_dn, noise.column_noise_mv.value / sensor.mv_per_dn


def line_noise(
    spreads: tuple[float, float], part: Part, exposure: Exposure
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the offsets of rows and columns in one frame, DN, of standard deviations in DN; (1,) zero for none."""
    counter = exposure.frame, exposure.k0, exposure.k1
    rows, columns = (
        spread * line_deviates(lines.start, lines.stop - lines.start, LINES, word, *counter) if spread else np.zeros(1)
        for word, (spread, lines) in enumerate(zip(spreads, part, strict=True))
    )
    return rows, columns
