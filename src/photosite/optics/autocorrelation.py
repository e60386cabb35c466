"""OTFs of any pupil with any wavefront: the autocorrelation of the pupil function, by Fourier transforms.

Frequencies are relative to the cutoff 1 / (lambda N), y up; wavefronts are in waves. Rotationally symmetric cases use
the quadrature in `annular`; the tests compare the two.

Sampling errors come from the edge of the pupil, at small shifts, and are the same with and without a wavefront. So only
the change that the wavefront makes is taken from the samples, and added to the exact OTF of the aberration-free pupil
(`Pupil.transfer`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from photosite.optics.annular import Waves
from photosite.optics.pupil import Pupil
from photosite.optics.zernike import Term, zernike_values

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LARGEST_SLOPE = 64.0
"""Slope, waves per pupil radius, up to which the finest grid samples a wavefront well enough."""
_CELLS_BY_SLOPE = ((2.0, 256), (6.0, 384), (12.0, 512), (24.0, 768), (math.inf, 1024))
"""Cells across the pupil by largest slope; the OTF is then right within 2e-4 (tests/optics/test_wavefront.py)."""
_MARGIN = 12
"""Columns of negative frequencies that the spline interpolation needs."""


@dataclass(frozen=True, eq=False)
class PupilAutocorrelation:
    """OTFs of one pupil under wavefronts of the same few Zernike terms, with `count` cells across the pupil."""

    pupil: Pupil
    terms: tuple[Term, ...]
    count: int

    @cached_property
    def _cells(self) -> tuple[Array, Array]:
        """Return the amplitude of all cells, and (terms, open cells) Zernike values."""
        amplitude, y, x = self.pupil.cells(self.count)
        open_ = amplitude > 0
        return amplitude, zernike_values(self.terms, x[open_], y[open_])

    @cached_property
    def _aberration_free(self) -> Array:
        return np.abs(_transform(self._cells[0].astype(np.complex128))) ** 2

    def otf(self, waves: Waves) -> SampledOtf:
        """Return the OTF under a wavefront."""
        from scipy.fft import rfft2
        from scipy.ndimage import spline_filter

        amplitude, values = self._cells
        phase = 2 * math.pi * (np.array([waves[t] for t in self.terms]) @ values)
        field = amplitude.astype(np.complex128)
        field[amplitude > 0] *= np.exp(1j * phase)
        size = 2 * self.count
        image = _transform(field)
        change = rfft2(image.real**2 + image.imag**2 - self._aberration_free, overwrite_x=True)
        change /= size * size * (self.pupil.area * math.pi / 4 * self.count**2)
        real, imag = (
            spline_filter(part, order=3, mode="mirror", output=part)
            for part in (_centred(change.real), _centred(change.imag, sign=-1.0))
        )
        return SampledOtf(self.pupil, self.count, real, imag)


@dataclass(frozen=True, eq=False)
class SampledOtf:
    """The OTF of a pupil with a wavefront: (sy, sx) relative frequencies -> complex values.

    `count` is the number of steps from 0 to the cutoff. `change_real` and `change_imag` are spline coefficients of the
    change that the wavefront makes, see `_centred`.
    """

    pupil: Pupil
    count: int
    change_real: Array
    change_imag: Array

    def __call__(self, sy: Array, sx: Array) -> Complex:
        from scipy.ndimage import map_coordinates

        sy, sx = np.broadcast_arrays(np.asarray(sy, np.float64), np.asarray(sx, np.float64))
        flip = np.where(sx < 0, -1.0, 1.0)
        where = np.stack([((flip * sy + 1) * self.count).ravel(), (flip * sx * self.count + _MARGIN).ravel()])
        real, imag = (
            map_coordinates(part, where, order=3, prefilter=False).reshape(sy.shape)
            for part in (self.change_real, self.change_imag)
        )
        change = np.where(np.hypot(sy, sx) < 1, real + 1j * flip * imag, 0.0)
        return (self.pupil.transfer(sy, sx) + change).astype(np.complex128)


def _transform(field: Complex) -> Complex:
    """Return the transform of a field padded to twice the size, without transforming rows of padding."""
    from scipy.fft import fft

    size = 2 * len(field)
    result: Complex = fft(fft(field, size, axis=1), size, axis=0, overwrite_x=True)
    return result


def _centred(change: Array, sign: float = 1.0) -> Array:
    """Return (rows, cols) of a half-plane transform: rows in rising frequency, columns from a margin below 0.

    The margin is the conjugate: the mirror image of the real part, and with `sign` -1 that of the imaginary part.
    """
    rows, cols = change.shape
    whole = np.empty((rows, _MARGIN + cols))
    whole[: rows // 2, _MARGIN:] = change[rows // 2 :]
    whole[rows // 2 :, _MARGIN:] = change[: rows // 2]
    opposite = (rows // 2 - np.arange(rows)) % rows
    whole[:, :_MARGIN] = sign * change[opposite, _MARGIN:0:-1]
    return whole


def largest_slope(pupil: Pupil, waves: Waves) -> float:
    """Return the largest slope of a wavefront over the pupil, in waves per pupil radius.

    A ray lands 2 slopes times lambda N from the ideal image point.
    """
    if not waves:
        return 0.0
    open_ = pupil.coarsely_open
    middle = (np.arange(len(open_)) + 0.5) * (2 / len(open_)) - 1
    y, x = np.broadcast_arrays(middle[:, None], middle)
    values = np.tensordot(np.array(list(waves.values())), zernike_values(tuple(waves), x, y), 1)
    slope = np.hypot(*np.gradient(values, 2 / len(open_)))
    return float(slope[open_].max())


def cells_for(slope: float) -> int:
    """Return the cells across the pupil that a wavefront of a largest slope needs."""
    return next(count for most, count in _CELLS_BY_SLOPE if slope <= most)
