"""Conditions of the coverage study: families of virtual sensors, and the protocol that measures them."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Literal

import numpy as np

from photosite.errors import InputError, did_you_mean
from photosite.sensor.model import Sensor
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import VirtualLab, virtual_lab
from photosite.values.cfa import cfa_from, channel_names

Range = tuple[float, float]
"""Lowest and highest value; the logarithm is drawn uniformly between them."""

SHORTEST_S, LONGEST_FLAT_S = 1e-4, 0.05
_EFFICIENCY = {"M": 0.5, "R": 0.35, "G": 0.5, "B": 0.3}
"""Quantum efficiency of each channel; sensors vary by 10 %."""

_GOLDEN_RATIO = 0.6180339887498949
"""Its multiples modulo 1 fill the unit interval evenly."""


@dataclass(frozen=True)
class Condition:
    """A family of virtual sensors and the protocol that measures each of them."""

    name: str
    summary: str
    cfa: Literal["mono", "rggb"]
    bits: int
    rows: int
    cols: int
    gain_dn_per_e: Range
    read_noise_dn: Range
    level: float  # signal of the brightest flat field, relative to saturation of the brightest channel; varies by 8 %
    protocol: ShootingProtocol
    black_sigma: float = 10.0  # black level in standard deviations of a dark frame (read noise and DSNU)
    photons_known: bool = False  # whether the light is metered

    def sensor(self, number: int) -> Sensor:
        """Return a sensor with all parameters drawn from its number.

        Saturation of even numbers is limited by the converter, of odd numbers by the well.
        """
        rng = np.random.default_rng([zlib.crc32(self.name.encode()), number])

        def between(low: float, high: float) -> float:
            return float(low * (high / low) ** rng.random())

        gain, read_dn = between(*self.gain_dn_per_e), between(*self.read_noise_dn)
        swing_v, analog_gain = 1.0, between(1.0, 3.0)
        mv_per_dn = 1e3 * swing_v / (analog_gain * 2**self.bits)
        dsnu_dn = read_dn * between(0.3, 1.5)
        black = self.black_sigma * float(np.hypot(read_dn, dsnu_dn))
        range_e = (2**self.bits - 1 - black) / gain
        well_e = float(round(range_e * (0.8 if number % 2 else 1.5)))
        tile = cfa_from(self.cfa)
        return Sensor.model_validate(
            {
                "name": f"{self.name}, sensor {number}",
                "serial": f"{self.name}, chip {number}",
                "array": {"rows": self.rows, "cols": self.cols, "cfa": tile},
                "pixel": {
                    "width_um": 5.0,
                    "height_um": 5.0,
                    "fill_factor": 0.8,
                    "conversion_gain_uv_per_e": gain * mv_per_dn * 1e3,
                    "voltage_swing_v": swing_v,
                    "well_capacity_e": well_e,
                },
                "channels": {
                    name: {
                        "wavelength_nm": (380.0, 780.0),
                        "quantum_efficiency": (_EFFICIENCY[name] * between(0.9, 1.1),) * 2,
                    }
                    for name in channel_names(tile)
                },
                "noise": {
                    "read_noise_mv": read_dn * mv_per_dn,
                    "dsnu_mv": dsnu_dn * mv_per_dn,
                    "prnu_percent": between(0.5, 2.0),
                    "dark_voltage_mv_per_s": between(10.0, 100.0) * gain * mv_per_dn,
                    "dcnu_percent": between(10.0, 50.0),
                },
                "readout": {"bits": self.bits, "analog_gain": analog_gain, "black_level_dn": black},
            }
        )

    def lab(self, number: int) -> VirtualLab:
        """Return the laboratory that measures a sensor."""
        # The light level varies, so that saturation falls anywhere between two exposures.
        level = self.level * (0.92 + 0.16 * ((number * _GOLDEN_RATIO) % 1.0))
        return virtual_lab(
            self.sensor(number), self.protocol, level=level, seed=number, photons_known=self.photons_known
        )


def _protocol(name: str, *, darks: int, repeats: int, levels: int, flats: int, stack: int) -> ShootingProtocol:
    """Dark frames at the shortest exposure and in a series to 5 s, flat fields in equal steps, and a stack at 40 %."""
    times = [LONGEST_FLAT_S * (k + 1) / levels for k in range(levels)]
    half = 0.4 * LONGEST_FLAT_S
    return ShootingProtocol(
        name,
        (
            Step("dark", SHORTEST_S, darks),
            *series("dark", 0.01, 5.0, exposures=5, count=repeats),
            *(Step("light", t, flats) for t in times),
            *((Step("light", half, stack),) if stack else ()),
        ),
    )


FULL = _protocol("full", darks=24, repeats=4, levels=16, flats=4, stack=16)
FEW = _protocol("few frames", darks=4, repeats=2, levels=8, flats=2, stack=0)

_MONO, _BAYER = (48, 64), (72, 88)
_PEDESTAL = "black level at 10 standard deviations of a dark frame"

CONDITIONS: dict[str, Condition] = {
    entry.name: entry
    for entry in (
        Condition(
            "bright-mono-12", f"metered flat fields to 1.25 times saturation, {_PEDESTAL}", "mono", 12, *_MONO,
            (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True,
        ),
        Condition(
            "bright-cfa-12", "flat fields to 2.5 times saturation of the green pixels", "rggb", 12, *_BAYER,
            (0.15, 1.2), (0.8, 4.0), 2.5, FULL,
        ),
        Condition(
            "bright-mono-8", "8 bits: 4000 to 12 000 electrons in 255 steps", "mono", 8, *_MONO,
            (0.02, 0.06), (0.6, 1.5), 1.25, FULL, photons_known=True,
        ),
        Condition(
            "bright-cfa-10", "10 bits", "rggb", 10, *_BAYER,
            (0.05, 0.2), (0.6, 2.0), 2.5, FULL,
        ),
        Condition(
            "bright-mono-16", "16 bits", "mono", 16, *_MONO,
            (1.0, 4.0), (3.0, 20.0), 1.25, FULL, photons_known=True,
        ),
        Condition(
            "dim-mono-12", "brightest flat field at 2 % of saturation", "mono", 12, *_MONO,
            (0.15, 1.2), (0.8, 4.0), 0.02, FULL, photons_known=True,
        ),
        Condition(
            "dim-cfa-14", "brightest flat field at 2 % of saturation of the green pixels", "rggb", 14, *_BAYER,
            (0.5, 2.0), (2.0, 8.0), 0.02, FULL,
        ),
        Condition(
            "few-mono-12", "two frames per setting, four dark frames: 30 frames in total", "mono", 12, *_MONO,
            (0.15, 1.2), (0.8, 4.0), 1.25, FEW, photons_known=True,
        ),
        Condition(
            "few-cfa-12", "two frames per setting, four dark frames: 30 frames in total", "rggb", 12, *_BAYER,
            (0.15, 1.2), (0.8, 4.0), 2.5, FEW,
        ),
        Condition(
            "clipped-mono-12", "black level at one standard deviation of a dark frame: a fifth of the dark pixels at "
            "0", "mono",
            12, *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, black_sigma=1.0, photons_known=True,
        ),
    )
}  # fmt: skip
"""All conditions by name."""


def condition(name: str) -> Condition:
    """Return a condition by name.

    Raises
    ------
    InputError
        If the name is unknown.

    Examples
    --------
    >>> condition("few-mono-12").protocol.frame_count, condition("bright-mono-8").sensor(3).readout.bits
    (30, 8)
    """
    if name not in CONDITIONS:
        raise InputError("condition", value=name, expected="a known name", hint=did_you_mean(name, CONDITIONS))
    return CONDITIONS[name]
