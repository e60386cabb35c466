"""Transfer functions of pupils with a wavefront: the autocorrelation of the pupil function.

Frequencies are over the cutoff 1 / (lambda N), y up; wavefronts are in waves. This is the way for any pupil and
any wavefront, by Fourier transforms; what is rotationally symmetric has `ring`, by quadrature; each checks the other.

A sampled pupil errs where the two copies of its edge lie on each other, which is at small shifts, and there as much
without a wavefront as with it. So only the difference of the two is taken from the samples; the transfer function of
the bare opening is exact (`Pupil.transfer`) and added.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from photosite.optics.pupil import Pupil
from photosite.optics.zernike import Term, zernike_values

Array = NDArray[np.float64]
Waves = dict[Term, float]
"""Zernike coefficients, each the RMS of its term over the full circle, in waves."""

LARGEST_SLOPE = 64.0
"""Waves per radius of the pupil up to which a wavefront is sampled well enough by the most cells there may be."""
_COUNTS = ((2.0, 256), (6.0, 384), (12.0, 512), (24.0, 768), (math.inf, 1024))
"""Cells across the pupil for slopes up to some: the transfer function is right within 2e-4, see tests."""
_MARGIN = 12


@dataclass(frozen=True, eq=False)
class PupilTransfer:
    """Transfer functions of one opening under wavefronts of the same few terms.

    Parameters
    ----------
    pupil
        The opening.
    terms
        Of the wavefront.
    count
        Cells across the pupil.
    """

    pupil: Pupil
    terms: tuple[Term, ...]
    count: int

    @cached_property
    def _cells(self) -> tuple[Array, Array]:
        """Amplitude of the open cells' rows and columns, and (terms, open cells) values."""
        amplitude, y, x = self.pupil.cells(self.count)
        open_ = amplitude > 0
        return amplitude, zernike_values(self.terms, x[open_], y[open_])

    @cached_property
    def _bare(self) -> Array:
        return np.abs(_transform(self._cells[0].astype(np.complex128))) ** 2

    def at(self, waves: Waves) -> Callable[[Array, Array], NDArray[np.complex128]]:
        """The transfer function, (sy, sx) -> complex, under a wavefront."""
        from scipy.fft import rfft2
        from scipy.ndimage import map_coordinates, spline_filter

        amplitude, values = self._cells
        phase = 2 * math.pi * (np.array([waves[t] for t in self.terms]) @ values)
        field = amplitude.astype(np.complex128)
        field[amplitude > 0] *= np.exp(1j * phase)
        size = 2 * self.count
        image = _transform(field)
        change = rfft2(image.real**2 + image.imag**2 - self._bare, overwrite_x=True)
        change /= size * size * (self.pupil.area * math.pi / 4 * self.count**2)
        parts = [
            spline_filter(part, order=3, mode="mirror", output=part)
            for part in (_upright(change.real), _upright(change.imag, sign=-1.0))
        ]

        def transfer(sy: Array, sx: Array) -> NDArray[np.complex128]:
            sy, sx = np.broadcast_arrays(np.asarray(sy, np.float64), np.asarray(sx, np.float64))
            flip = np.where(sx < 0, -1.0, 1.0)
            where = np.stack([((flip * sy + 1) * self.count).ravel(), (flip * sx * self.count + _MARGIN).ravel()])
            real, imag = (map_coordinates(p, where, order=3, prefilter=False).reshape(sy.shape) for p in parts)
            change = np.where(np.hypot(sy, sx) < 1, real + 1j * flip * imag, 0.0)
            return (self.pupil.transfer(sy, sx) + change).astype(np.complex128)

        return transfer


def _transform(field: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Padded to twice the size; rows of padding are not worth a transform."""
    from scipy.fft import fft

    size = 2 * len(field)
    result: NDArray[np.complex128] = fft(fft(field, size, axis=1), size, axis=0, overwrite_x=True)
    return result


def _upright(change: Array, sign: float = 1.0) -> Array:
    """(rows, cols) of frequencies: rows in rising order, columns from 0 on, and a margin for the interpolation.

    The rest is the conjugate: of the real part the mirror image, of the imaginary part with the other `sign`.
    """
    rows, cols = change.shape
    whole = np.empty((rows, _MARGIN + cols))
    whole[: rows // 2, _MARGIN:] = change[rows // 2 :]
    whole[rows // 2 :, _MARGIN:] = change[: rows // 2]
    opposite = (rows // 2 - np.arange(rows)) % rows
    whole[:, :_MARGIN] = sign * change[opposite, _MARGIN:0:-1]
    return whole


def largest_slope(pupil: Pupil, waves: Waves) -> float:
    """Largest slope of a wavefront over the opening, in waves per radius of the pupil.

    A ray lands 2 slopes times lambda N beside its place.
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
    """Cells across the pupil that a wavefront of some slope wants, up to the most there may be."""
    return next(count for most, count in _COUNTS if slope <= most)
