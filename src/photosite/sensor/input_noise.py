"""Noise that measured light already has: only the variance that a frame lacks is drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import read_only
from photosite.engine.pixel_model import Exposure, MeasuredMaps
from photosite.errors import InputError
from photosite.sensor.chip import draw_chip
from photosite.sensor.drawn_readout import line_noise, line_noise_dn
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import NoiseTerms
from photosite.sensor.shot import Part
from photosite.values.shown import Shown

Map = NDArray[np.float32]


@dataclass(frozen=True)
class InputNoise(Shown):
    """Noise of measured electrons: the variance of a value of mean e is `shot` e + `floor_e2`.

    Parameters
    ----------
    shot
        Variance per electron: 1 for one frame, 1/N for the mean of N frames.
    floor_e2
        Variance at e = 0 in electrons squared: read noise and rounding.

    Raises
    ------
    InputError
        If a value is negative or not finite.

    Examples
    --------
    >>> InputNoise(1.0, 9.0).scaled(0.5)
    InputNoise(shot=0.5, floor_e2=2.25)
    """

    shot: float = 1.0
    floor_e2: float = 0.0

    def __post_init__(self) -> None:
        for name in ("shot", "floor_e2"):
            if not 0 <= getattr(self, name) < math.inf:
                raise InputError(name, value=getattr(self, name), expected="0 or above, and finite")

    def scaled(self, light: float) -> InputNoise:
        """Return the noise of the values times a factor, by the mean of these products."""
        return InputNoise(self.shot * light, self.floor_e2 * light**2)

    @classmethod
    def of_sensor(cls, sensor: Sensor, frames: int = 1) -> InputNoise:
        """Return the temporal noise of electrons from the mean of several frames of a sensor.

        Examples
        --------
        >>> import photosite as ps
        >>> InputNoise.of_sensor(ps.load_sensor("nikon-d200"), frames=4)
        InputNoise(shot=0.25, floor_e2=76.4...)
        """
        if frames < 1:
            raise InputError("frames", value=frames, expected="1 or more")
        terms = NoiseTerms(sensor)
        return cls(terms.shot / frames, (terms.read_e2 + float(terms.rounding_e2(0.0))) / frames)


def largest_light(sensor: Sensor, own: InputNoise) -> float:
    """Return the largest factor on measured light at which a sensor is noisier than the light is.

    The shot noise of a sensor with mean e is e, and that of the light `own.shot` e per factor; its read noise is
    compared with `own.floor_e2`.

    Examples
    --------
    >>> import photosite as ps
    >>> largest_light(ps.load_sensor("nikon-d200"), InputNoise(shot=1.0, floor_e2=4.0))
    1.0
    """
    read_e = sensor.electrons(sensor.noise.pixel_noise_mv)
    return min(
        math.inf if own.shot == 0 else 1.0 / own.shot, math.inf if own.floor_e2 == 0 else read_e / own.floor_e2**0.5
    )


def check_noisier(sensor: Sensor, own: InputNoise) -> None:
    """Raise `InputError` if light has noise that a sensor does not have, or if the sensor has effects or captures."""
    if sensor.effects is not None or sensor.captures is not None:
        expected = "None for a sensor with effects or several captures"
        hint = "Use light without noise, or a sensor without effects"
        raise InputError("input_noise", where=f"sensor '{sensor.name}'", value=own, expected=expected, hint=hint)
    if (limit := largest_light(sensor, own)) < 1.0:
        raise InputError(
            "the light has more noise than the sensor",
            where=f"sensor '{sensor.name}'",
            value=own,
            hint=f"Multiply the light by at most {limit:.3g}, or give the mean of several frames",
        )


def drawn_maps(sensor: Sensor, part: Part, exposure: Exposure) -> MeasuredMaps:
    """Return a rectangle of a drawn chip in the form of a measured one's maps."""
    chip, gain = draw_chip(sensor, part), float(sensor.system_gain_dn_per_e)
    shape = part[0].stop - part[0].start, part[1].stop - part[1].start
    prnu, offset, rate, noise = (
        read_only(np.broadcast_to(values, shape).astype(np.float32))
        for values in (
            chip.prnu.map(),
            chip.offset_e.map() * np.float32(gain),
            chip.dark_rate_e_per_s * np.float32(gain),
            np.full((1, 1), sensor.electrons(sensor.noise.pixel_noise_mv) * gain, np.float32),
        )
    )
    row_dn, column_dn = (
        np.broadcast_to(values, count).copy()
        for values, count in zip(line_noise(line_noise_dn(sensor), part, exposure), shape, strict=True)
    )
    return MeasuredMaps(prnu, offset, rate, noise, np.ones((1, 1), np.float32), row_dn, column_dn, 0.0, gain)


def missing_light(electrons: Map, own: InputNoise) -> Map:
    """Return the electrons whose Poisson noise measured light lacks, (1 - shot) e; 0 where e is negative."""
    return np.asarray(np.maximum(electrons * np.float32(1.0 - own.shot), np.float32(0.0)), np.float32)


def with_missing_noise(
    maps: MeasuredMaps, exposure: Exposure, electrons: Map, own: InputNoise
) -> tuple[MeasuredMaps, Exposure]:
    """Return maps and exposure that, on `missing_light`, give the frame of measured electrons.

    The rest of the electrons is an offset. The read noise is reduced by `own.floor_e2`, and where noise made the
    electrons negative by the shot noise that `missing_light` has too much there, so that the variance is right on
    average. A pixel of a measured chip that is quieter than the light gets no read noise.
    """
    gain = np.float32(maps.gain_dn_per_e)
    rest_e = electrons - missing_light(electrons, own)
    excess_e2 = np.float32(own.floor_e2) - np.float32(1.0 - own.shot) * np.minimum(electrons, np.float32(0.0))
    variance = maps.read_noise_dn * np.abs(maps.read_noise_dn) - excess_e2 * (gain * maps.gain_ratio) ** 2
    noise = np.copysign(np.sqrt(np.abs(variance)), variance)
    offset = maps.offset_dn + rest_e * np.maximum(1 + maps.prnu, np.float32(0.0)) * (gain * maps.gain_ratio)
    # The well holds all electrons, of which the kernel sees a part.
    white = min(exposure.white_level_dn, exposure.black_level_dn + exposure.well_capacity_e * exposure.gain_dn_per_e)
    return (
        maps._replace(offset_dn=read_only(offset), read_noise_dn=read_only(noise)),
        exposure._replace(white_level_dn=float(math.floor(white))),
    )
