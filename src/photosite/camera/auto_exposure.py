"""Automatic exposure: the exposure time of the next frame of a recording from the last one."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.values.shown import Shown

ExposureControl = Callable[[RawFrame | None], float]
"""Exposure time in s of the next frame, from the last one; from None for the first."""

_SAMPLES = 100_000
_SATURATED_FACTOR = 0.25


@dataclass(frozen=True)
class AutoExposure(Shown):
    """A simple automatic exposure: a percentile of the signal is kept at a level, by proportional control.

    The exposure time is multiplied by (level / percentile)^speed, and by 1/4 where the percentile is saturated. Any
    other function of the last frame, or of None for the first, can take its place.

    Parameters
    ----------
    first_s
        Exposure time of the first frame.
    level
        Target, as a fraction of the range from the black level to the white level; above 0 and below 1.
    percentile
        Of the signal of all pixels, 0 to 100.
    speed
        Above 0, at most 1: fraction of a deviation, in stops, that one frame corrects.
    shortest_s, longest_s
        Limits of the exposure time.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> control = AutoExposure(first_s=0.01, level=0.5, speed=1.0)
    >>> control(None)
    0.01
    >>> control(RawFrame(np.full((4, 4), 1023, np.uint16), bits=12, exposure_s=0.01))
    0.02001...
    """

    first_s: float
    level: float = 0.8
    percentile: float = 99.5
    speed: float = 0.7
    shortest_s: float = 1e-6
    longest_s: float = math.inf

    def __post_init__(self) -> None:
        limits = {"level": (0.0, 1.0), "percentile": (0.0, 100.0), "speed": (0.0, 1.0)}
        for entry in fields(self):
            value = getattr(self, entry.name)
            low, high = limits.get(entry.name, (0.0, math.inf))
            if isinstance(value, bool | str) or not low < value <= high or (entry.name == "level" and value == high):
                expected = (
                    "above 0"
                    if high == math.inf
                    else f"above 0 and {'below' if entry.name == 'level' else 'at most'} {high:g}"
                )
                raise InputError(entry.name, value=value, expected=expected)

    def __call__(self, last: RawFrame | None) -> float:
        """Return the exposure time of the next frame."""
        if last is None:
            return self._limited(self.first_s)
        if last.exposure_s is None:
            raise InputError("exposure_s of the last frame is unknown")
        # An odd step reaches all sites of the color filter array.
        step = math.isqrt(last.dn.size // _SAMPLES) | 1
        signal = float(np.percentile(last.dn[::step, ::step], self.percentile)) - last.black_level_dn
        fraction = signal / (last.white_level_dn - last.black_level_dn)
        if fraction >= 1.0:
            return self._limited(last.exposure_s * _SATURATED_FACTOR)
        # A frame without signal is exposed longer, by at most 6 stops.
        return self._limited(last.exposure_s * (self.level / max(fraction, self.level / 64.0)) ** self.speed)

    def _limited(self, exposure_s: float) -> float:
        return min(max(exposure_s, self.shortest_s), self.longest_s)


def exposure_control(exposure_s: float | Sequence[float] | ExposureControl) -> ExposureControl:
    """Return the control of one exposure time, of several in turn, or the given one.

    Examples
    --------
    >>> bracket = exposure_control([0.01, 0.04])
    >>> [bracket(None) for _ in range(3)]
    [0.01, 0.04, 0.01]
    """
    if callable(exposure_s):
        return exposure_s
    times: list[Any] = list(exposure_s) if isinstance(exposure_s, list | tuple | np.ndarray) else [exposure_s]
    if not times:
        raise InputError("exposure_s", value=exposure_s, expected="one exposure time or more")
    turn = itertools.cycle(times)
    return lambda last: next(turn)
