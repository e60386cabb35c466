"""Conditions of the coverage study: families of virtual sensors, and the protocol that measures them."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from photosite.errors import InputError, did_you_mean
from photosite.sensor.capture_readout import part_sensor
from photosite.sensor.model import Sensor
from photosite.studies.disturbed_lab import DisturbedLab, disturbances
from photosite.studies.effect_study import Drawing, Range, effect_studies, log_uniform
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import VirtualLab, virtual_lab
from photosite.values.cfa import cfa_from, channel_names

SHORTEST_S, LONGEST_FLAT_S, LONGEST_WIDE_S = 1e-4, 0.05, 0.5
_EFFICIENCY = {"M": 0.5, "R": 0.35, "G": 0.5, "B": 0.3}
"""Quantum efficiency of each channel; sensors vary by 10 %."""

_GOLDEN_RATIO = 0.6180339887498949
"""Its multiples modulo 1 fill the unit interval evenly."""


def _protocol(
    name: str, *, darks: int, repeats: int, levels: int, flats: int, stack: int, reference_s: float = SHORTEST_S
) -> ShootingProtocol:
    """Dark frames at one exposure and in a series to 5 s, flat fields in equal steps, and a stack at 40 %."""
    times = [LONGEST_FLAT_S * (k + 1) / levels for k in range(levels)]
    half = 0.4 * LONGEST_FLAT_S
    return ShootingProtocol(
        name,
        (
            Step("dark", reference_s, darks),
            *series("dark", 0.01, 5.0, exposures=5, count=repeats),
            *(Step("light", t, flats) for t in times),
            *((Step("light", half, stack),) if stack else ()),
        ),
    )


FULL = _protocol("full", darks=24, repeats=4, levels=16, flats=4, stack=16)
WARM = _protocol("warm", darks=24, repeats=4, levels=16, flats=4, stack=16, reference_s=1.0)
WIDE = ShootingProtocol(
    "high dynamic range",
    (
        Step("dark", SHORTEST_S, 24),
        *series("dark", 0.01, 5.0, exposures=5, count=4),
        *series("light", 1e-3 * LONGEST_WIDE_S, LONGEST_WIDE_S, exposures=24, count=4),
    ),
)
FEW = _protocol("few frames", darks=4, repeats=2, levels=8, flats=2, stack=0)


@dataclass(frozen=True)
class Condition:
    """A family of virtual sensors and the protocol that measures each of them."""

    name: str
    summary: str
    cfa: str = "mono"  # name of the tile
    bits: int = 12
    shape: tuple[int, int] = (48, 64)
    gain_dn_per_e: Range = (0.15, 1.2)
    read_noise_dn: Range = (0.8, 4.0)
    level: float = 1.25  # signal of the brightest flat field, relative to saturation of the brightest channel
    protocol: ShootingProtocol = FULL
    black_sigma: float = 10.0  # black level in standard deviations of a dark frame (read noise and DSNU)
    photons_known: bool = True  # whether the light is metered
    effects: Mapping[str, Range] = field(default_factory=dict)  # sizes, in the unit of the effect's study
    maps: bool = False  # whether the maps of the chip are measured, too
    well: tuple[float, float] = (1.5, 0.8)  # well over the converter's range, of even and of odd numbers
    captures: bool = False  # a charge read with two gains, and a smaller photodiode
    disturbed: str | None = None  # name of what disturbs the frames, which a plain camera then makes

    def sensor(self, number: int) -> Sensor:
        """Return a sensor with all parameters drawn from its number.

        Saturation of even numbers is limited by the converter, of odd numbers by the well.
        """
        rng = np.random.default_rng([zlib.crc32(self.name.encode()), number])

        between = partial(log_uniform, rng)

        gain, read_dn = between(*self.gain_dn_per_e), between(*self.read_noise_dn)
        swing_v, analog_gain = 1.0, between(1.0, 3.0)
        mv_per_dn = 1e3 * swing_v / (analog_gain * 2**self.bits)
        dsnu_dn = read_dn * between(0.3, 1.5)
        black = self.black_sigma * float(np.hypot(read_dn, dsnu_dn))
        range_e = (2**self.bits - 1 - black) / gain
        well_e = float(round(range_e * self.well[number % 2]))
        tile = cfa_from(self.cfa)
        captures = {"captures": _captures(between, read_dn / gain)} if self.captures else {}
        sign = 1.0 if number // 2 % 2 else -1.0
        drawing = Drawing(rng, sign, self.bits, well_e, read_dn * mv_per_dn, read_dn / gain, dsnu_dn / gain)
        return Sensor.model_validate(
            {
                **captures,
                "name": f"{self.name}, sensor {number}",
                "serial": f"{self.name}, chip {number}",
                "array": {"rows": self.shape[0], "cols": self.shape[1], "cfa": tile},
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
                    **self._drawn("noise", drawing),
                    "dsnu_mv": dsnu_dn * mv_per_dn,
                    "prnu_percent": between(0.5, 2.0),
                    "dark_voltage_mv_per_s": between(10.0, 100.0) * gain * mv_per_dn,
                    "dcnu_percent": between(10.0, 50.0),
                },
                "readout": {"bits": self.bits, "analog_gain": analog_gain, "black_level_dn": black},
                "effects": self._drawn("effects", drawing) or None,
            }
        )

    def _drawn(self, section: str, drawing: Drawing) -> dict[str, Any]:
        """Return the fields of a section that the effects draw."""
        fields: dict[str, Any] = {}
        for name, size in self.effects.items():
            study = effect_studies()[name]
            if study.draw is not None and study.section == section:
                fields |= study.draw(drawing, size)
        return fields

    def lab(self, number: int) -> VirtualLab | DisturbedLab:
        """Return the laboratory that measures a sensor."""
        # The light level varies, so that saturation falls anywhere between two exposures.
        level = self.level * (0.92 + 0.16 * ((number * _GOLDEN_RATIO) % 1.0))
        sensor = self.sensor(number)
        if sensor.captures is not None:  # to the saturation of the least sensitive capture
            last = part_sensor(sensor, sensor.captures.names[-1])
            level *= last.saturation_capacity_e / sensor.saturation_capacity_e / sensor.captures.light("small")
        if self.disturbed is None:
            return virtual_lab(sensor, self.protocol, level=level, seed=number, photons_known=self.photons_known)
        disturbance, factors = disturbances()[self.disturbed](sensor, np.random.default_rng([number]))
        seed = zlib.crc32(self.name.encode()) + number
        return DisturbedLab(sensor, self.protocol, level, disturbance, factors, seed=seed)


def _captures(between: Callable[[float, float], float], read_noise_e: float) -> dict[str, Any]:
    """Return the section of captures: one charge with a high and a low gain, and a small photodiode."""
    low = {"name": "low", "charge": "shared", "charge_of": "high", "relative_gain": between(0.2, 0.5)}
    small = {"name": "small", "relative_sensitivity": between(0.03, 0.3), "crosstalk": {"high": between(1e-3, 1e-2)}}
    low["read_noise_e"], small["read_noise_e"] = (read_noise_e * between(1.0, 3.0) for _ in range(2))
    return {"parts": ({"name": "high"}, low, small), "combination": {"dn_per_e": 16.0, "black_level_dn": 4096.0}}


_LARGE, _TILES, _CURVE, _PAIRS = (96, 128), (96, 120), (144, 192), (192, 256)
_CFA: dict[str, Any] = {"cfa": "rggb", "shape": (72, 88), "level": 2.5, "photons_known": False}
_PEDESTAL = "black level at 10 standard deviations of a dark frame"

CONDITIONS: dict[str, Condition] = {
    entry.name: entry
    for entry in (
        Condition("bright-mono-12", f"metered flat fields to 1.25 times saturation, {_PEDESTAL}", maps=True),
        Condition("bright-cfa-12", "flat fields to 2.5 times saturation of the green pixels", **_CFA),
        Condition("quad-cfa-12", "Quad Bayer", **_CFA | {"cfa": "quad-rggb", "shape": _TILES}),
        Condition("xtrans-cfa-12", "X-Trans", **_CFA | {"cfa": "x-trans", "shape": _TILES}),
        Condition(
            "bright-mono-8", "8 bits: 4000 to 12 000 electrons in 255 steps",
            bits=8, gain_dn_per_e=(0.02, 0.06), read_noise_dn=(0.6, 1.5),
        ),
        Condition(
            "bright-cfa-10", "10 bits", **_CFA, bits=10, gain_dn_per_e=(0.05, 0.2), read_noise_dn=(0.6, 2.0)
        ),
        Condition("bright-mono-16", "16 bits", bits=16, gain_dn_per_e=(1.0, 4.0), read_noise_dn=(3.0, 20.0)),
        Condition("dim-mono-12", "brightest flat field at 2 % of saturation", level=0.02),
        Condition(
            "dim-cfa-14", "brightest flat field at 2 % of saturation of the green pixels",
            **_CFA | {"level": 0.02}, bits=14, gain_dn_per_e=(0.5, 2.0), read_noise_dn=(2.0, 8.0),
        ),
        Condition(
            "few-mono-12", "two frames per setting, four dark frames: 30 frames in total", protocol=FEW
        ),
        Condition("few-cfa-12", "two frames per setting, four dark frames: 30 frames in total", **_CFA, protocol=FEW),
        Condition(
            "warm-mono-12", "24 reference dark frames at 1 s, with 10 to 100 electrons of dark current", protocol=WARM
        ),
        Condition(
            "clipped-mono-12",
            "black level at one standard deviation of a dark frame: a fifth of the dark pixels at 0", black_sigma=1.0,
        ),
        Condition(
            "bent-mono-12", "response bent by 0.5 to 10 % at saturation, of either sign, second to fourth power",
            disturbed="response_curve",
        ),
        Condition(
            "curve-mono-12",
            "response bent by 1 to 3 % at the well capacity, of either sign, third power; 144 x 192 pixels",
            shape=_CURVE, effects={"response_curve": (1.0, 3.0)},
        ),
        Condition(
            "curve-level-mono-12",
            "the same at saturation, and light of one level 4 % off the stated one; 144 x 192 pixels",
            shape=_CURVE, disturbed="bend_and_wrong_level",
        ),
        Condition(
            "channels-mono-12", "gains of odd and even columns that differ by 1 to 4 %; 192 x 256 pixels",
            shape=_PAIRS, effects={"readout_channels": (1.0, 4.0)},
        ),
        Condition(
            "pattern-mono-12",
            "fixed offsets of rows and columns of 0.1 to 1 times the DSNU, gains of columns of 0.1 to 1 %",
            shape=_LARGE, effects={"line_pattern": (0.1, 1.0)},
        ),
        Condition(
            "crosstalk-mono-12", "crosstalk of 0.5 to 3 % of the charge to each next pixel",
            shape=_LARGE, disturbed="interpixel_capacitance",
        ),
        Condition(
            "coupled-mono-12", "interpixel capacitance of 0.3 to 2 % to each next pixel",
            shape=_LARGE, effects={"interpixel_capacitance": (0.3, 2.0)},
        ),
        Condition(
            "coupled-cfa-12", "the same; 192 x 256 pixels",
            **_CFA | {"shape": _PAIRS}, effects={"interpixel_capacitance": (0.3, 2.0)},
        ),
        Condition(
            "uneven-mono-12",
            "read noise with a log-normal spread of 0.1 to 0.4, and 2 to 10 % blinking pixels; black "
            "level at 30 standard deviations of a dark frame without them",
            shape=_LARGE, maps=True, black_sigma=30.0,
            effects={"read_noise_spread": (0.1, 0.4), "telegraph_noise": (0.02, 0.1)},
        ),
        Condition(
            "flicker-mono-12", "flicker of the light: bands of 0.2 to 2 %, with a period of 10 to 40 rows",
            disturbed="flicker",
        ),
        Condition("rows-mono-12", "row noise of 0.1 to 1 times the read noise", disturbed="line_noise"),
        Condition(
            "lines-mono-12", "row noise and column noise of 0.05 to 0.6 times the read noise",
            effects={"line_noise": (0.05, 0.6)},
        ),
        Condition("lines-cfa-12", "the same", **_CFA, effects={"line_noise": (0.05, 0.6)}),
        Condition(
            "hot-mono-12", "0.3 to 1 % hot pixels with 2000 to 6000 e-/s", shape=_LARGE, disturbed="hot_pixels"
        ),
        Condition("shaded-mono-12", "corners 2 to 20 % darker than the center", disturbed="shading"),
        Condition("level-mono-12", "light of one level 1 to 10 % off the stated one", disturbed="wrong_level"),
        Condition(
            "captures-mono-12",
            "three captures: a charge read with two gains, and a photodiode of 3 to 30 % of the response; 24 levels in "
            "equal ratios",
            protocol=WIDE, photons_known=False, captures=True,
        ),
        Condition(
            "blooming-mono-12", "5 to 95 % of the overflow of hot pixels drained", shape=_LARGE, maps=True,
            well=(0.7, 0.8), effects={"blooming": (0.05, 0.95)},
        ),
        Condition(
            "transfer-mono-12", "charge transfer inefficiency of 3e-6 to 3e-4; 8 lines of overscan", shape=_LARGE,
            effects={"charge_transfer": (3e-6, 3e-4)},
        ),
        Condition(
            "em-mono-16", "electron multiplication by 20 to 400", bits=16, gain_dn_per_e=(0.05, 0.2),
            read_noise_dn=(3.0, 20.0), effects={"em_gain": (20.0, 400.0)},
        ),
        Condition(
            "converter-mono-10", "random errors of the converter's codes of 0.02 to 0.08 LSB", bits=10, shape=_PAIRS,
            gain_dn_per_e=(0.05, 0.2), read_noise_dn=(2.0, 4.0), effects={"converter_error": (0.02, 0.08)},
        ),
        Condition(
            "output-mono-14", "one to three low bits dropped", bits=14, gain_dn_per_e=(0.5, 2.0),
            read_noise_dn=(8.0, 20.0), well=(0.7, 0.8), effects={"output": (1.0, 3.0)},
        ),
        Condition(
            "tail-mono-12", "0.3 to 2 % hot pixels with a log-normal tail", shape=_PAIRS, maps=True,
            effects={"hot_pixels": (0.003, 0.02)},
        ),
        Condition(
            "dead-mono-12", "0.1 to 1 % dead pixels, and two clusters", shape=_LARGE, maps=True,
            effects={"pixel_defects": (1e-3, 1e-2)},
        ),
        Condition(
            "glow-mono-12", "glow of 10 to 60 e-/s at one edge or corner", shape=_LARGE,
            effects={"glow": (10.0, 60.0)},
        ),
        Condition(
            "drift-mono-12", "1/f drift of the black level of 0.1 to 1 times the read noise",
            effects={"black_level_drift": (0.1, 1.0)},
        ),
        Condition(
            "covered-mono-12", "2 to 12 covered lines at each side", shape=_LARGE,
            effects={"optical_black": (2.0, 12.0)},
        ),
        Condition("lag-mono-12", "1.5 to 5 % of the charge stays for the next frame", shape=_LARGE, disturbed="lag"),
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
