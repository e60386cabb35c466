"""The chip: a fixed pattern drawn from a sensor's serial number, or measured maps with defective pixels."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import IntEnum
from functools import lru_cache
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from photosite.engine.pixel_model import DEVIATE_STEP, normal_deviates
from photosite.engine.random_numbers import FIXED_PATTERN, READ_NOISE, key_from_seed
from photosite.engine.threads import threads_for
from photosite.errors import InputError
from photosite.sensor.model import Sensor
from photosite.values.saved import write
from photosite.values.shown import Shown

if TYPE_CHECKING:
    from photosite.sensor.sections import Maps

_PRNU, _DSNU, _DARK_CURRENT = range(3)

FloatMap = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Pattern(Shown):
    """One value per pixel, `deviates * scale`; deviates of shape (1, 1) stand for all pixels.

    16-bit deviates keep a 150-megapixel chip small.
    """

    deviates: NDArray[np.int16]
    scale: float

    def map(self) -> NDArray[np.float32]:
        """Return the values, (rows, cols) float32 or (1, 1)."""
        return self.deviates * np.float32(self.scale)


@dataclass(frozen=True, eq=False)
class Chip(Shown):
    """Fixed-pattern maps of a chip, the same in all its frames.

    Parameters
    ----------
    prnu, offset_e
        Relative deviation of the response to light; DSNU, electrons added to every reading.
    dark_rate_e_per_s
        (rows, cols) dark current, or (1, 1) for all pixels.
    """

    prnu: Pattern
    offset_e: Pattern
    dark_rate_e_per_s: NDArray[np.float32]


def draw_chip(sensor: Sensor, part: tuple[slice, slice] = (slice(None), slice(None))) -> Chip:
    """Return the chip that is drawn from a sensor's serial number, or a rectangle of it.

    PRNU and DSNU are normal. Dark current is log-normal with the sensor's mean and relative spread, so that it stays
    positive. The pattern depends on the serial alone; the sensor's spreads scale it.

    Examples
    --------
    >>> import photosite as ps
    >>> small = ps.load_sensor("nikon-d200").with_(rows=4, cols=6)
    >>> a, b, other = (draw_chip(s).prnu.map() for s in (small, small, small.with_(serial="1")))
    >>> bool((a == b).all()), bool((a == other).any())
    (True, False)
    """
    noise, array = sensor.noise, sensor.array
    spreads = (noise.prnu_percent.value / 100, sensor.electrons(noise.dsnu_mv.value))
    prnu, dsnu = (
        _deviates(sensor.serial, array.rows, array.cols, word)[part] if spread else np.zeros((1, 1), np.int16)
        for word, spread in enumerate(spreads)
    )
    dark_spread = noise.dcnu_percent.value / 100 if noise.dark_voltage_mv_per_s.value else 0.0
    mean_e = float(sensor.electrons(noise.dark_voltage_mv_per_s.value))
    rate = _dark_rate(sensor.serial, array.rows, array.cols, dark_spread, mean_e)
    rate = rate if rate.shape == (1, 1) else rate[part]
    return Chip(Pattern(prnu, spreads[_PRNU] * DEVIATE_STEP), Pattern(dsnu, spreads[_DSNU] * DEVIATE_STEP), rate)


@lru_cache(maxsize=1)
def _dark_rate(serial: str, rows: int, cols: int, spread: float, mean_e_per_s: float) -> FloatMap:
    """Return the dark current, which all frames at one temperature share; (1, 1) without a spread."""
    rate = _relative_dark_rate(serial, rows, cols, spread) * np.float32(mean_e_per_s)
    rate.flags.writeable = False
    return rate


@lru_cache(maxsize=2)
def _relative_dark_rate(serial: str, rows: int, cols: int, spread: float) -> FloatMap:
    """Return the dark current over its mean, log-normal; (1, 1) without a spread."""
    deviates = _deviates(serial, rows, cols, _DARK_CURRENT) if spread else np.zeros((1, 1), np.int16)
    log_spread = math.sqrt(math.log1p(spread**2))
    rate = np.multiply(deviates, np.float32(log_spread * DEVIATE_STEP), dtype=np.float32)
    rate -= np.float32(log_spread**2 / 2)
    np.exp(rate, out=rate)
    rate.flags.writeable = False
    return rate


def serial_seed(serial: str) -> int:
    """Return the seed of a chip's random numbers."""
    return int.from_bytes(hashlib.sha256(serial.encode()).digest()[:8], "little")


def read_noise_deviates(serial: str, rows: int, cols: int) -> NDArray[np.int16]:
    """Return the normal deviates of the pixels' read noise in units of DEVIATE_STEP."""
    return _deviates(serial, rows, cols, 0, int(READ_NOISE))


# Eight maps: two chips with all three patterns, or a chip with three captures of two photodiodes.
@lru_cache(maxsize=8)
def _deviates(serial: str, rows: int, cols: int, word: int, use: int = int(FIXED_PATTERN)) -> NDArray[np.int16]:
    """Return the normal deviates of a serial's pattern in units of DEVIATE_STEP."""
    with threads_for(rows * cols):
        deviates = normal_deviates(rows, cols, np.uint32(use), word, *key_from_seed(serial_seed(serial)))
    deviates.flags.writeable = False
    return deviates


# A measured chip: maps of its pixels, defective and blinking pixels, row and column noise.


class DefectKind(IntEnum):
    """Kinds of defective pixels, with their numbers in a file of maps."""

    HOT = 1
    """Dark current far above that of the channel; the value is in DN/s."""
    OFFSET = 2
    """Dark level far from that of the channel; the value is in DN. With dark frames of one exposure time this includes
    hot pixels."""
    DEAD = 3
    """Less than half of the channel's response to light; the value is the relative response."""
    RESPONSE = 4
    """Response to light far from that of the channel; the value is the relative response."""
    BLINKING = 5
    """Random telegraph noise between two levels; the value is their distance in DN."""
    NOISY = 6
    """Noise far above that of the channel, without two levels; the value is in DN."""


@dataclass(frozen=True, eq=False)
class Defects(Shown):
    """Defective pixels, arrays (n,); a pixel can have several entries.

    Parameters
    ----------
    row, col
        Position on the chip.
    kind, value
        A `DefectKind`, and the value that it defines.
    deviation
        Distance from the channel's median, in standard deviations of the channel's map; for BLINKING the distance
        between the levels in units of the noise within them, for NOISY the noise in units of the channel's.
    """

    row: NDArray[np.int64]
    col: NDArray[np.int64]
    kind: NDArray[np.uint8]
    value: NDArray[np.float64]
    deviation: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.row)

    def of(self, kind: DefectKind) -> Defects:
        """Return the entries of one kind."""
        return self.where(self.kind == kind)

    def where(self, chosen: NDArray[np.bool_]) -> Defects:
        """Return the entries for which (n,) `chosen` is true."""
        return Defects(*(getattr(self, entry.name)[chosen] for entry in fields(self)))

    def counts(self) -> Mapping[str, int]:
        """Return the number of entries of each kind, by its name in lower case."""
        return {kind.name.lower(): int(np.count_nonzero(self.kind == kind)) for kind in DefectKind}


@dataclass(frozen=True, eq=False)
class Blinking(Shown):
    """Blinking pixels (random telegraph noise between two levels), arrays (n,).

    Parameters
    ----------
    row, col
        Position on the chip.
    amplitude_dn, high_fraction
        Distance between the levels, and fraction of the frames in the upper one.
    noise_dn
        Temporal standard deviation within a level, without rounding and shot noise of the dark current.
    """

    row: NDArray[np.int64]
    col: NDArray[np.int64]
    amplitude_dn: NDArray[np.float64]
    high_fraction: NDArray[np.float64]
    noise_dn: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.row)


def no_defects() -> Defects:
    """Return an empty list of defects."""
    none, whole = np.zeros(0), np.zeros(0, np.int64)
    return Defects(whole, whole, np.zeros(0, np.uint8), none, none)


def no_blinking() -> Blinking:
    """Return an empty list of blinking pixels."""
    none, whole = np.zeros(0), np.zeros(0, np.int64)
    return Blinking(whole, whole, none, none, none)


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredChip(Shown):
    """The maps of one chip, (rows, cols) float32 each, in digital numbers; `..._uncertainty` is the measurement's.

    They are neither smoothed nor clipped: a map's spread is that of the chip and of its measurement.

    Parameters
    ----------
    offset_dn, offset_uncertainty_dn
        Dark level at an exposure of 0 minus the black level, and its standard uncertainty. With dark frames of one
        exposure time, the level at `reference_exposure_s`.
    read_noise_dn
        Temporal standard deviation without rounding, shot noise of the dark current and shifts of whole frames. A
        negative variance estimate -v is stored as -sqrt(v).
    read_noise_freedom
        Degrees of freedom of each pixel's temporal variance; None if it is not known.
    pixel_gain_dn_per_e, pixel_gain_uncertainty_dn_per_e
        System gain of each pixel, above 0, and its standard uncertainty without that of the system gain. None: all have
        `system_gain_dn_per_e`.
    dark_rate_dn_per_s, dark_rate_uncertainty_dn_per_s
        Dark current; None with dark frames of one exposure time, or where the black level moved between the exposures.
    prnu, prnu_uncertainty
        Relative deviation of the response to light, in digital numbers, from the channel's mean, including the fall-off
        of lamp and lens. None without light frames: each pixel turns the same light into the same mean electrons.
    row_noise_dn, column_noise_dn
        Temporal noise common to a row or a column, part of `read_noise_dn`; negative if its variance estimate is.
    black_level_dn
        Reference of `offset_dn`.
    system_gain_dn_per_e
        System gain of these maps, or None.
    reference_exposure_s
        Exposure time of the dark frames for `read_noise_dn`.
    defects, blinking
        Defective and blinking pixels.

    Raises
    ------
    InputError
        If the maps differ in size or type or have values that are not finite, or another value is invalid.

    Examples
    --------
    >>> offset, noise = (np.full((4, 6), value, np.float32) for value in (0, 2))
    >>> chip = MeasuredChip(offset_dn=offset, read_noise_dn=noise, pixel_gain_dn_per_e=noise, black_level_dn=100)
    >>> chip.shape, list(chip.maps())
    ((4, 6), ['offset_dn', 'read_noise_dn', 'pixel_gain_dn_per_e'])
    """

    offset_dn: FloatMap
    read_noise_dn: FloatMap
    offset_uncertainty_dn: FloatMap | None = None
    read_noise_freedom: int | None = None
    pixel_gain_dn_per_e: FloatMap | None = None
    pixel_gain_uncertainty_dn_per_e: FloatMap | None = None
    dark_rate_dn_per_s: FloatMap | None = None
    dark_rate_uncertainty_dn_per_s: FloatMap | None = None
    prnu: FloatMap | None = None
    prnu_uncertainty: FloatMap | None = None
    row_noise_dn: float = 0.0
    column_noise_dn: float = 0.0
    black_level_dn: float = 0.0
    system_gain_dn_per_e: float | None = None
    reference_exposure_s: float = 0.0
    defects: Defects = field(default_factory=no_defects)
    blinking: Blinking = field(default_factory=no_blinking)

    def __post_init__(self) -> None:
        for name, values in self.maps().items():
            if values.shape != self.offset_dn.shape or values.ndim != 2 or values.dtype != np.float32:
                found, expected = f"{values.shape} of {values.dtype}", f"{self.offset_dn.shape} of float32"
                raise InputError(name, value=found, expected=expected)
            # The sum is finite if all values are, and needs no temporary array.
            if not np.isfinite(values.sum(dtype=np.float64)):
                raise InputError(name, expected="finite everywhere")
        if (gain := self.pixel_gain_dn_per_e) is not None and not gain.min() > 0:
            raise InputError("pixel_gain_dn_per_e", value=float(gain.min()), expected="above 0 everywhere")
        if self.system_gain_dn_per_e is not None and not 0 < self.system_gain_dn_per_e < np.inf:
            raise InputError("system_gain_dn_per_e", value=self.system_gain_dn_per_e, expected="finite and above 0")
        for what, listed in (("defects", self.defects), ("blinking", self.blinking)):
            for name, places, size in (("row", listed.row, self.shape[0]), ("col", listed.col, self.shape[1])):
                if len(places) and not (places.min() >= 0 and places.max() < size):
                    ends = (int(places.min()), int(places.max()))
                    raise InputError(name, where=what, value=ends, expected=f"from 0 to {size - 1}")

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        rows, cols = self.offset_dn.shape
        return rows, cols

    def gain_dn_per_e(self, otherwise: float) -> float:
        """Return the system gain, the median of the pixels' gains, or that of a description, in this order."""
        if self.system_gain_dn_per_e is not None:
            return float(self.system_gain_dn_per_e)
        return otherwise if self.pixel_gain_dn_per_e is None else float(np.median(self.pixel_gain_dn_per_e))

    def gain_ratio(self, gain: float, part: tuple[slice, slice]) -> FloatMap:
        """Return the gain of the pixels of a rectangle over a gain, (1, 1) if all have the same."""
        if self.pixel_gain_dn_per_e is None:
            return np.ones((1, 1), np.float32)
        return np.ascontiguousarray(self.pixel_gain_dn_per_e[part] / np.float32(gain))

    def response_e(self, gain: float, part: tuple[slice, slice]) -> FloatMap | None:
        """Return the relative deviation of the pixels' response in electrons; None if it is 0 everywhere."""
        if self.prnu is None or self.pixel_gain_dn_per_e is None:
            return None if self.prnu is None else self.prnu[part]
        return np.asarray((1 + self.prnu[part]) / self.gain_ratio(gain, part) - 1, np.float32)

    def maps(self) -> dict[str, FloatMap]:
        """Return the maps that are not None, by name."""
        found = {name: getattr(self, name) for name in MAP_UNITS}
        return {name: values for name, values in found.items() if values is not None}

    def save(self, path: str | PathLike[str]) -> Maps:
        """Write the maps to an HDF5 file; raise `FileError` if it cannot be written.

        The name and SHA-256 that it returns go into a sensor file: `sensor.with_(maps=chip.save("mine.maps.h5"))`.
        """
        maps: Maps = write(self, path)
        return maps


MAP_UNITS = {
    "offset_dn": "DN",
    "offset_uncertainty_dn": "DN",
    "read_noise_dn": "DN",
    "pixel_gain_dn_per_e": "DN/e-",
    "pixel_gain_uncertainty_dn_per_e": "DN/e-",
    "dark_rate_dn_per_s": "DN/s",
    "dark_rate_uncertainty_dn_per_s": "DN/s",
    "prnu": "1",
    "prnu_uncertainty": "1",
}
"""The maps of a `MeasuredChip` and their units in the file."""
