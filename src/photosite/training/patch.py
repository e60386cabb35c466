"""A patch of an image: its place, drawn by a counter from seed and number, with flips that keep the filter array."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.pixel_draws import fractions_of
from photosite.engine.random_numbers import DATA, key_from_seed
from photosite.sensor.model import Sensor
from photosite.values.cfa import Cfa
from photosite.values.shown import Shown

_COUNT = 12


def chances(seed: int, number: int) -> list[float]:
    """Return numbers from 0 to below 1 that depend on the seed and a patch's number alone.

    Examples
    --------
    >>> [round(u, 3) for u in chances(1, 2)[:3]] == [round(u, 3) for u in chances(1, 2)[:3]]
    True
    >>> chances(1, 2)[0] == chances(1, 3)[0]
    False
    """
    numbers: list[float] = fractions_of(number, _COUNT, DATA, *key_from_seed(seed)).tolist()
    return numbers


def between(low: float, high: float, chance: float) -> float:
    """Return a number from `low` to `high`, uniform in its logarithm.

    Examples
    --------
    >>> round(between(0.01, 1.0, 0.5), 6)
    0.1
    """
    return float(low * (high / low) ** chance)


@lru_cache(maxsize=64)
def flip_offset(cfa: Cfa, size: int, axis: int) -> int | None:
    """Return where a window of `size` starts in the tile so that, flipped, it has the tile's order; None if nowhere.

    Examples
    --------
    >>> flip_offset((("R", "G"), ("G", "B")), 128, axis=1)
    1
    """
    tile = np.array(cfa)
    period = tile.shape[axis]
    places = np.arange(size)
    wanted = np.take(tile, places % period, axis)
    for offset in range(period):
        if np.array_equal(np.take(tile, (offset + size - 1 - places) % period, axis), wanted):
            return offset
    return None


@dataclass(frozen=True, eq=False)
class Patch(Shown):
    """What a source of light is asked for.

    Parameters
    ----------
    shape
        (rows, cols) in pixels.
    sensor
        The sensor.
    place
        Two chances, for the first row and column.
    flips
        Whether rows and columns are reversed.
    light, exposure_s
        Factor on the light, and exposure time.
    choices
        Two chances for what else a source chooses.
    """

    shape: tuple[int, int]
    sensor: Sensor
    place: tuple[float, float]
    flips: tuple[bool, bool]
    light: float
    exposure_s: float
    choices: tuple[float, float]

    def corner(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return the first row and column in a mosaic of a size, whose tile begins at its first pixel."""
        cfa = self.sensor.array.cfa
        found = []
        for axis, period in enumerate((len(cfa), len(cfa[0]))):
            offset = flip_offset(cfa, self.shape[axis], axis) if self.flips[axis] else 0
            last = size[axis] - self.shape[axis]
            found.append(first_of(last, period, offset or 0, self.place[axis]))
        return found[0], found[1]

    def cut(self, mosaic: NDArray[Any], corner: tuple[int, int]) -> NDArray[Any]:
        """Return the patch at a corner of a mosaic, flipped; a view."""
        rows, cols = self.shape
        window = mosaic[corner[0] : corner[0] + rows, corner[1] : corner[1] + cols]
        return window[:: -1 if self.flips[0] else 1, :: -1 if self.flips[1] else 1]


def first_of(last: int, period: int, offset: int, chance: float) -> int:
    """Return one of offset, offset + period, ... up to `last`.

    Examples
    --------
    >>> [first_of(5, 2, 1, chance) for chance in (0.0, 0.5, 0.99)]
    [1, 3, 5]
    """
    return offset + period * int(chance * ((last - offset) // period + 1))
