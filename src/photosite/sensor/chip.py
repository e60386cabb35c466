"""A drawn chip: the fixed pattern that is drawn from a sensor's serial number."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import threads_for
from photosite.engine.philox import key_from_seed
from photosite.engine.pixel_model import DEVIATE_STEP, normal_deviates
from photosite.sensor.model import Sensor

_PRNU, _DSNU, _DARK_CURRENT = range(3)


@dataclass(frozen=True, eq=False)
class Pattern:
    """One value per pixel, `deviates * scale`; deviates of shape (1, 1) stand for all pixels.

    16-bit deviates keep a 150-megapixel chip small.
    """

    deviates: NDArray[np.int16]
    scale: float

    def map(self) -> NDArray[np.float32]:
        """Return the values, (rows, cols) float32 or (1, 1)."""
        return self.deviates * np.float32(self.scale)


@dataclass(frozen=True, eq=False)
class Chip:
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


def draw_chip(sensor: Sensor) -> Chip:
    """Return the chip that is drawn from a sensor's serial number.

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
    spreads = (
        noise.prnu_percent.value / 100,
        sensor.electrons(noise.dsnu_mv.value),
        noise.dcnu_percent.value / 100 if noise.dark_voltage_mv_per_s.value else 0.0,
    )
    prnu, dsnu, dark = (
        _deviates(sensor.serial, array.rows, array.cols, word) if spread else np.zeros((1, 1), np.int16)
        for word, spread in enumerate(spreads)
    )
    log_spread = math.sqrt(math.log1p(spreads[_DARK_CURRENT] ** 2))
    rate = np.multiply(dark, np.float32(log_spread * DEVIATE_STEP), dtype=np.float32)
    rate -= np.float32(log_spread**2 / 2)
    np.exp(rate, out=rate)
    rate *= np.float32(sensor.electrons(noise.dark_voltage_mv_per_s.value))
    return Chip(Pattern(prnu, spreads[_PRNU] * DEVIATE_STEP), Pattern(dsnu, spreads[_DSNU] * DEVIATE_STEP), rate)


# Six maps: two chips with all three patterns.
@lru_cache(maxsize=6)
def _deviates(serial: str, rows: int, cols: int, word: int) -> NDArray[np.int16]:
    """Return the normal deviates of a serial's pattern in units of DEVIATE_STEP."""
    key = int.from_bytes(hashlib.sha256(serial.encode()).digest()[:8], "little")
    with threads_for(rows * cols):
        deviates = normal_deviates(rows, cols, word, *key_from_seed(key))
    deviates.flags.writeable = False
    return deviates
