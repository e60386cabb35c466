"""Flicker: the light of lamps over time, with its exact integral over an exposure.

A waveform is periodic and relative to the mean over its period, so that the radiance of a scene stays its mean
radiance.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.values.shown import Shown

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flicker(Shown, ABC):
    """A periodic light of mean 1.

    Parameters
    ----------
    frequency_hz
        Periods per second; mains lamps have twice the frequency of the mains.
    """

    frequency_hz: float

    def __post_init__(self) -> None:
        _check("frequency_hz", self.frequency_hz, "above 0", self.frequency_hz > 0)

    @abstractmethod
    def _light(self, phase: Array) -> Array:
        """Return the light at phases from 0 to 1."""

    @abstractmethod
    def _since_start(self, phase: Array) -> Array:
        """Return the integral of the light over the phase, from 0; 1 at phase 1."""

    @property
    def _start(self) -> float:
        """The phase at time 0, in periods."""
        return 0.0

    def light(self, time_s: ArrayLike) -> Array:
        """Return the light at times, relative to its mean."""
        return self._light(np.mod(np.asarray(time_s) * self.frequency_hz + self._start, 1.0))

    def integral_s(self, begin_s: ArrayLike, end_s: ArrayLike) -> Array:
        """Return the integral of the light from some times to others, in s: exact, not a sum of samples.

        Examples
        --------
        >>> flicker = SineFlicker(100.0, depth=0.5)
        >>> flicker.integral_s([0.0, 0.005], [0.01, 0.0075]).round(6)
        array([0.01    , 0.001704])
        """
        begin, length = np.asarray(begin_s, np.float64), np.asarray(end_s, np.float64) - np.asarray(begin_s, np.float64)
        # Phases below 1 keep their digits at times far from 0.
        first = np.mod(begin * self.frequency_hz + self._start, 1.0)
        last = first + length * self.frequency_hz
        whole = np.floor(last)
        return np.asarray((whole + self._since_start(last - whole) - self._since_start(first)) / self.frequency_hz)


@dataclass(frozen=True)
class SineFlicker(Flicker):
    """Flicker as of lamps on the mains: 1 + depth cos(2 pi f t + phase).

    Parameters
    ----------
    frequency_hz
        Twice the frequency of the mains: 100 or 120.
    depth
        Highest less lowest light over their sum, 0 to 1: the percent flicker of IEEE 1789-2015.
    phase_deg
        Phase at time 0; 0 is the brightest.

    Examples
    --------
    >>> flicker = SineFlicker(100.0, depth=0.2)
    >>> flicker.light([0.0, 0.005])
    array([1.2, 0.8])

    An exposure of T s keeps sinc(f T) of the depth, and one of a whole period nothing:

    >>> (flicker.integral_s(0.0, 0.01) / 0.01).round(9) + 0.0
    np.float64(1.0)
    """

    depth: float
    phase_deg: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _check("depth", self.depth, "from 0 to 1", 0 <= self.depth <= 1)
        _check("phase_deg", self.phase_deg, "finite")

    @property
    def _start(self) -> float:
        return self.phase_deg / 360.0

    def _light(self, phase: Array) -> Array:
        return np.asarray(1.0 + self.depth * np.cos(2.0 * np.pi * phase))

    def _since_start(self, phase: Array) -> Array:
        return np.asarray(phase + self.depth * np.sin(2.0 * np.pi * phase) / (2.0 * np.pi))


@dataclass(frozen=True)
class PulseFlicker(Flicker):
    """Light that is switched on and off, as of LEDs with pulse width modulation.

    Parameters
    ----------
    frequency_hz
        Pulses per second.
    duty
        Fraction of the period with light, above 0, at most 1. The pulses are 1 / duty times as bright as the mean.
    phase_deg
        Phase at time 0; the pulse is from 0 to 360 duty.

    Examples
    --------
    >>> flicker = PulseFlicker(1000.0, duty=0.25)
    >>> flicker.light([0.0002, 0.0003]), flicker.integral_s(0.0002, 0.001).round(7)
    (array([4., 0.]), np.float64(0.0002))
    """

    duty: float
    phase_deg: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _check("duty", self.duty, "above 0 and at most 1", 0 < self.duty <= 1)
        _check("phase_deg", self.phase_deg, "finite")

    @property
    def _start(self) -> float:
        return self.phase_deg / 360.0

    def _light(self, phase: Array) -> Array:
        return np.where(phase < self.duty, 1.0 / self.duty, 0.0)

    def _since_start(self, phase: Array) -> Array:
        return np.asarray(np.minimum(phase / self.duty, 1.0))


@dataclass(frozen=True)
class TableFlicker(Flicker):
    """Flicker by a table over one period, such as a measured waveform.

    Parameters
    ----------
    frequency_hz
        Periods per second.
    table
        Relative light at evenly spaced times over a period, from time 0; linear between them, and from the last to the
        first. Divided by its mean. Not negative.

    Examples
    --------
    >>> flicker = TableFlicker(100.0, (0.0, 3.0))
    >>> flicker.light([0.0, 0.0025, 0.005]), (flicker.integral_s(0.0, 0.0025) / 0.0025).round(9)
    (array([0., 1., 2.]), np.float64(0.5))
    """

    table: Sequence[float]

    def __post_init__(self) -> None:
        super().__post_init__()
        values = np.asarray(self.table, np.float64)
        if values.ndim != 1 or not values.size:
            raise InputError("table", value=values.shape, expected="a list of numbers")
        _check(
            "table",
            (float(values.min()), float(values.max())),
            "not negative, and not all 0",
            values.min() >= 0 < values.max(),
        )
        object.__setattr__(self, "table", tuple((values / values.mean()).tolist()))

    def _nodes(self) -> Array:
        return np.asarray([*self.table, self.table[0]])

    def _light(self, phase: Array) -> Array:
        nodes = self._nodes()
        return np.interp(phase, np.linspace(0.0, 1.0, nodes.size), nodes)

    def _since_start(self, phase: Array) -> Array:
        nodes = self._nodes()
        count = nodes.size - 1
        before = np.concatenate([[0.0], np.cumsum(0.5 * (nodes[1:] + nodes[:-1]))])
        place = np.minimum((phase * count).astype(np.intp), count - 1)
        into = phase * count - place
        return np.asarray(
            (before[place] + into * (nodes[place] + 0.5 * into * (nodes[place + 1] - nodes[place]))) / count
        )


def _check(name: str, value: object, expected: str, valid: bool = True) -> None:
    """Raise an error unless a number, or some, are finite and a condition is met."""
    if isinstance(value, bool | str) or not (np.isfinite(value).all() and valid):  # type: ignore[call-overload]
        raise InputError(name, value=value, expected=expected)
