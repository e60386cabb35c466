"""Power spectra of the lines of a mean frame, by which regular patterns show."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spatial.strips import Plane, plane_mean, strips


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


def spectrogram(planes: Sequence[Plane], axis: int, *, scale: float = 1.0, temporal: float = 0.0) -> Spectrogram:
    """The spectrogram of one map, or of several of one size together.

    Parameters
    ----------
    planes
        (rows, cols) each; each one's mean is taken off.
    axis
        1 for the horizontal spectrogram, along rows; 0 for the vertical one, along columns.
    scale
        By which the map is multiplied.
    temporal
        Temporal variance left in the map, thus multiplied.

    Examples
    --------
    >>> wave = 3.0 * np.sin(2 * np.pi * 0.125 * np.arange(64.0)) + 100.0
    >>> found = spectrogram([np.tile(wave, (8, 1))], axis=1)
    >>> float(found.frequency[found.power.argmax()]), round(float(found.amplitude().max()), 12)
    (0.125, 3.0)
    """
    from scipy import fft

    length = planes[0].shape[axis]
    total, lines = np.zeros(length // 2 + 1), 0
    for plane in planes:
        mean = plane_mean(plane)
        for _, some in strips(plane, axis):
            transform = fft.rfft(some - mean, axis=1, overwrite_x=True, workers=os.cpu_count() or 1)
            total += np.einsum("ij,ij->j", transform.real, transform.real, dtype=np.float64)
            total += np.einsum("ij,ij->j", transform.imag, transform.imag, dtype=np.float64)
            lines += len(some)
    power = total * (scale**2 / (lines * length))
    # At frequency 0 stands what lines differ by in their means; it is no part of the flat floor, nor of a wave.
    return Spectrogram(np.arange(len(power)) / length, power, length, float(np.median(power[1:])), temporal)
