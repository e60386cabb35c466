"""One chip: the fixed pattern that its serial number stands for."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.engine.philox import key_from_seed
from photosite.engine.pixels import DARK_CURRENT, DSNU, PRNU, normal_map
from photosite.sensor.model import Sensor


@dataclass(frozen=True, eq=False)
class Chip:
    """A chip's maps, the same in all its frames. A map of shape (1, 1) stands for all pixels.

    Parameters
    ----------
    response
        (rows, cols) float32, 1 + PRNU: multiplies the electrons from light.
    offset_e
        (rows, cols) float32, DSNU: electrons added to every reading.
    dark_rate_e_per_s
        (rows, cols) float32, dark current.
    """

    response: NDArray[np.float32]
    offset_e: NDArray[np.float32]
    dark_rate_e_per_s: NDArray[np.float32]


def draw_chip(sensor: Sensor) -> Chip:
    """The chip of a sensor's serial number.

    PRNU and DSNU are normal; dark current is log-normal with the file's mean and relative spread, so that it stays
    positive. The serial alone decides the pattern; the spreads scale it.

    Examples
    --------
    >>> import photosite as ps
    >>> small = ps.load_sensor("nikon-d200").with_(rows=4, cols=6)
    >>> a, b, other = draw_chip(small), draw_chip(small), draw_chip(small.with_(serial="1"))
    >>> bool((a.response == b.response).all()), bool((a.response == other.response).any())
    (True, False)
    """
    rate = sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value)
    return _draw(
        sensor.serial,
        sensor.array.rows,
        sensor.array.cols,
        sensor.noise.prnu_percent.value / 100,
        sensor.electrons(sensor.noise.dsnu_mv.value),
        rate,
        sensor.noise.dcnu_percent.value / 100,
    )


@lru_cache(maxsize=2)  # one chip shoots many frames; two, so that a comparison of two chips does not redraw each time
def _draw(serial: str, rows: int, cols: int, prnu: float, dsnu_e: float, rate: float, dcnu: float) -> Chip:
    k0, k1 = key_from_seed(int.from_bytes(hashlib.sha256(serial.encode()).digest()[:8], "little"))

    def pattern(source: np.uint32, spread: float) -> NDArray[np.float32]:
        if spread == 0:
            return np.zeros((1, 1), np.float32)
        values = normal_map(rows, cols, source, k0, k1)
        values *= np.float32(spread)
        return values

    response = pattern(PRNU, prnu)
    response += 1.0
    log_spread = math.sqrt(math.log1p(dcnu * dcnu))
    dark_rate = pattern(DARK_CURRENT, log_spread if rate else 0.0)
    dark_rate -= log_spread * log_spread / 2
    np.exp(dark_rate, out=dark_rate)
    dark_rate *= rate
    maps = response, pattern(DSNU, dsnu_e), dark_rate
    for values in maps:
        values.flags.writeable = False
    return Chip(*maps)
