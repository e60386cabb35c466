"""Power spectra of the lines of a mean frame, by which regular patterns show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_VALUES_AT_A_TIME = 1 << 20
"""Values that are transformed together: 24 MB with their spectra."""


@dataclass(frozen=True, eq=False)
class Spectrogram:
    """Mean power spectrum of the lines of a map.

    Parameters
    ----------
    frequency
        (n,) cycles per pixel of the map, from 0 to 0.5.
    power
        (n,) mean over the lines of the squared transform's size over the lines' length, in the squared unit of the
        map. Independent pixels have their variance at every frequency; the mean over all frequencies, those not shown
        because they mirror these included, is the variance.
    length
        Values of a line. A sinusoid of amplitude a along the lines is a peak of a^2 length / 4.
    white
        Power of the part that does not depend on frequency: the median.
    temporal
        Power that temporal noise left in the map.

    Notes
    -----
    EMVA 1288 R4.0, 8.6: horizontal and vertical spectrograms. Their plots show the square root.
    """

    frequency: NDArray[np.float64]
    power: NDArray[np.float64]
    length: int
    white: float
    temporal: float

    def amplitude(self) -> NDArray[np.float64]:
        """(n,) amplitude of the sinusoid that would have each power by itself, in the unit of the map."""
        share = np.full(len(self.frequency), 2.0)
        share[0] = 1.0
        if self.length % 2 == 0:
            share[-1] = 1.0
        return np.asarray(share * np.sqrt(self.power / self.length))


def spectrogram(planes: Sequence[NDArray[np.float64]], axis: int, temporal: float = 0.0) -> Spectrogram:
    """The spectrogram of one map, or of several of one size together.

    Parameters
    ----------
    planes
        (rows, cols) each; each one's mean is taken off.
    axis
        1 for the horizontal spectrogram, along rows; 0 for the vertical one, along columns.
    temporal
        Temporal variance left in the map.

    Examples
    --------
    >>> wave = 3.0 * np.sin(2 * np.pi * 0.125 * np.arange(64.0)) + 100.0
    >>> found = spectrogram([np.tile(wave, (8, 1))], axis=1)
    >>> float(found.frequency[found.power.argmax()]), round(float(found.amplitude().max()), 12)
    (0.125, 3.0)
    """
    length = planes[0].shape[axis]
    total, lines = np.zeros(length // 2 + 1), 0
    for plane in planes:
        mean = float(plane.mean())
        for some in _lines(plane, axis):
            transform = np.fft.rfft(some - mean, axis=1)
            total += np.sum(transform.real**2 + transform.imag**2, axis=0)
            lines += len(some)
    power = total / (lines * length)
    # At frequency 0 stands what lines differ by in their means; it is no part of the flat floor, nor of a wave.
    return Spectrogram(np.arange(len(power)) / length, power, length, float(np.median(power[1:])), temporal)


def _lines(plane: NDArray[np.float64], axis: int) -> Iterator[NDArray[np.float64]]:
    """The lines of a map, some at a time, as rows."""
    across = plane.shape[1 - axis]
    step = max(1, _VALUES_AT_A_TIME // plane.shape[axis])
    for first in range(0, across, step):
        part = slice(first, first + step)
        yield plane[part] if axis == 1 else np.ascontiguousarray(plane[:, part].T)
