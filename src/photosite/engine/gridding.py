"""The spectrum of a small kernel at the many frequencies of a large frame, row by row.

Along the columns, the kernel is transformed to the frame's length. Along the rows, it is transformed to twice its own
length, and each row of the frame's spectrum is interpolated from the `TAPS` nearest rows, with Kaiser-Bessel weights.
The kernel is divided by the transform of the Kaiser-Bessel function before (gridding: Fessler and Sutton, "Nonuniform
fast Fourier transforms using min-max interpolation", IEEE Trans. Signal Process. 51, 560 (2003), section IV; shape
parameter after Beatty, Nishimura and Pauly, IEEE Trans. Med. Imaging 24, 799 (2005), eq. 5). Interpolation along rows
keeps all neighbors contiguous in memory, for vector instructions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.fft

from photosite.engine.arrays import C64, F32, F64, I64

TAPS = 8
"""Rows that a row is interpolated from; the error is about 1e-7 of the kernel's sum, as single precision has."""
_OVERSAMPLING = 2
_WORKERS = -1


@dataclass(frozen=True, eq=False)
class Gridding:
    """The position of each row of the frame's spectrum among the rows of a kernel's spectrum."""

    size: int  # Q, the rows of the kernel; odd
    first: I64  # (rows,) the first of the `TAPS` rows of the table; the others follow, periodically
    taps: F32  # (rows, TAPS) interpolation weights

    @classmethod
    def of(cls, size: int, rows: int) -> Gridding:
        """Return the gridding for a kernel of `size` rows in a frame of `rows` rows of cells."""
        long = _OVERSAMPLING * size
        position = np.arange(rows) * long / rows
        first = np.floor(position).astype(np.int64) - TAPS // 2 + 1
        offset = position[:, None] - (first[:, None] + np.arange(TAPS))
        inside = np.maximum(1.0 - (2 * offset / TAPS) ** 2, 0.0)
        taps = np.i0(_kaiser_bessel_shape() * np.sqrt(inside)) / np.i0(_kaiser_bessel_shape())
        return cls(size, first % long, taps.astype(np.float32))

    def table(self, kernels: F64, cols: int) -> C64:
        """Return (channels, 2 Q, cols // 2 + 1) complex64: that of (channels, Q, Q) kernels, centered at Q // 2."""
        channels, size = kernels.shape[:2]
        shift = np.arange(size) - size // 2
        lines = np.zeros((channels, size, cols), np.float32)
        for start in range(0, size, cols):  # a kernel wider than the frame wraps around it
            piece = kernels[:, :, start : start + cols] / _kaiser_bessel_transform(shift, _OVERSAMPLING * size)[:, None]
            lines[:, :, : piece.shape[2]] += piece
        narrow = scipy.fft.rfft(lines, axis=2, workers=_WORKERS)
        turns = (np.arange(cols // 2 + 1) * (size // 2)) % cols
        narrow *= np.exp(2j * np.pi / cols * turns).astype(np.complex64)
        wide = np.zeros((channels, _OVERSAMPLING * size, cols // 2 + 1), np.complex64)
        wide[:, shift % (_OVERSAMPLING * size)] = narrow
        return np.asarray(scipy.fft.fft(wide, axis=1, overwrite_x=True, workers=_WORKERS))


def _kaiser_bessel_shape() -> float:
    return math.pi * math.sqrt((TAPS / _OVERSAMPLING * (_OVERSAMPLING - 0.5)) ** 2 - 0.8)


def _kaiser_bessel_transform(shift: I64, long: int) -> F64:
    """Return the transform of the Kaiser-Bessel function at shifts of a table of `long` rows."""
    argument = np.sqrt(_kaiser_bessel_shape() ** 2 - (math.pi * TAPS * shift / long) ** 2)
    return TAPS * np.sinh(argument) / argument / np.i0(_kaiser_bessel_shape())
