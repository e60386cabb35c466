"""Point spreads as samples: their transfer function, and what brings several of them onto one grid.

Samples are those of a band-limited function, (rows, cols), rows downwards and upright as the frame is, at distances of
`spacing` on both axes; the origin is the sample (rows // 2, cols // 2). Between samples the function is the sum of
sinc functions, so that its transfer function is the samples' Fourier sum up to half the sampling frequency, and 0
beyond.
"""

from __future__ import annotations

import math
from copy import copy
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_CHUNK = 2048
_OVERSAMPLING = 4
"""Before splines of fifth order take over: they then err by some 1e-5 of the highest frequency."""
_ROTATION_ORDER = 5
_SMALLEST_SPACING_UM = 0.01
"""A tenth of what the shortest waves through the fastest lens ask for: less is in another unit."""


def offsets(count: int, spacing: float) -> Array:
    """(count,) positions of samples on an axis.

    Examples
    --------
    >>> offsets(4, 0.5)
    array([-1. , -0.5,  0. ,  0.5])
    """
    positions: Array = (np.arange(count, dtype=np.float64) - count // 2) * spacing
    return positions


def transfer(samples: Array, spacing_m: float, fy_per_m: Array, fx_per_m: Array) -> Complex:
    """The samples' Fourier sum at any frequencies.

    Parameters
    ----------
    samples
        (n, n).
    spacing_m
        Between samples.
    fy_per_m, fx_per_m
        Broadcast against each other; a column and a row are fastest.

    Returns
    -------
    ndarray
        Complex, of the shape to which the frequencies broadcast; 0 beyond half the sampling frequency on an axis.

    Examples
    --------
    >>> one = np.zeros((3, 3)); one[1, 2] = 1.0      # a sample to the right of the origin
    >>> transfer(one, 1e-6, np.zeros(1), np.array([0.25e6])).round(6)
    array([0.-1.j])
    """
    fy, fx = np.asarray(fy_per_m, np.float64), np.asarray(fx_per_m, np.float64)
    limit = 0.5 / spacing_m * (1 + 1e-12)
    rows, cols = samples.shape
    if fy.ndim == 2 and fx.ndim == 2 and fy.shape[1] == 1 and fx.shape[0] == 1:
        down = _turns(fy.tobytes(), rows, spacing_m) * (np.abs(fy) <= limit)
        across = _turns(fx.tobytes(), cols, spacing_m) * (np.abs(fx.T) <= limit)
        product: Complex = down @ (samples @ across.T)
        return product
    fy, fx = np.broadcast_arrays(fy, fx)
    flat_y, flat_x = fy.reshape(-1), fx.reshape(-1)
    out = np.empty(flat_y.size, np.complex128)
    for first in range(0, out.size, _CHUNK):
        part = slice(first, first + _CHUNK)
        down, across = (
            _turns(flat[part].tobytes(), count, spacing_m) for flat, count in ((flat_y, rows), (flat_x, cols))
        )
        out[part] = np.einsum("ij,ij->i", down @ samples, across)
    out[(np.abs(flat_y) > limit) | (np.abs(flat_x) > limit)] = 0
    return out.reshape(fy.shape)


@lru_cache(maxsize=16)
def _turns(frequency_per_m: bytes, count: int, spacing_m: float) -> Complex:
    """(frequencies, count): each sample's phase; the modes of a lens ask for the same frequencies."""
    turns: Complex = np.exp((-2j * math.pi) * np.frombuffer(frequency_per_m)[:, None] * offsets(count, spacing_m))
    turns.flags.writeable = False
    return turns


def check_spacing(spacing_um: float | None) -> None:
    """Refuse a distance of samples that is none, or in another unit than um.

    Raises
    ------
    InputError
        If it is missing, not above 0, or below 0.01 um.
    """
    if spacing_um is None or not (math.isfinite(spacing_um) and spacing_um > 0):
        raise InputError(f"spacing_um, between a point spread's samples, must be above 0 um, not {spacing_um}")
    if spacing_um < _SMALLEST_SPACING_UM:
        raise InputError(
            f"samples {spacing_um:g} um apart are finer than any point spread's; spacing_um is in um: if that is in m, "
            "multiply by 1e6, if in mm, by 1000"
        )


def normalised(samples: Array, what: str) -> Array:
    """Samples over their sum.

    Raises
    ------
    InputError
        If they hold what a point spread cannot: NaN, a sum that is not above 0, or dark below -2 % of the peak.
    """
    if not np.isfinite(samples).all():
        raise InputError(f"{what} holds NaN or infinite samples")
    total = float(samples.sum())
    if not total > 0:
        raise InputError(f"{what} holds no light: its samples sum to {total:g}")
    if samples.min() < -0.02 * samples.max():
        raise InputError(f"{what} is negative somewhere, {samples.min():g} where the peak is {samples.max():g}")
    return samples / total


def resampled(samples: Array, origin: tuple[float, float], spacing: float, count: int, to_spacing: float) -> Array:
    """Samples on another grid: sums of sinc functions, 0 beyond the samples given.

    Parameters
    ----------
    samples
        (rows, cols).
    origin
        (row, col) where the origin is.
    spacing
        Of the samples.
    count
        Of new samples on each axis.
    to_spacing
        Of the new samples, in the same unit; not above `spacing`, or the finest detail would fold.

    Returns
    -------
    ndarray
        (count, count), the light unchanged.
    """
    matrices = []
    for axis in (0, 1):
        position = offsets(count, to_spacing)[:, None]
        own = (np.arange(samples.shape[axis]) - origin[axis]) * spacing
        matrices.append(np.sinc((position - own) / spacing) * (to_spacing / spacing))
    result: Array = matrices[0] @ samples @ matrices[1].T
    return result


class Rotated:
    """One point spread, to be had at any turn about its origin.

    Parameters
    ----------
    samples
        (n, n).
    """

    def __init__(self, samples: Array) -> None:
        from scipy.ndimage import spline_filter

        count = samples.shape[0]
        self.samples = samples
        self.padded = count + 2 * (count // 8 + 2)  # the Fourier sum is periodic: room for its ends
        border = (self.padded - count) // 2
        fine = _oversampled(np.pad(samples, border), _OVERSAMPLING)
        self.coefficients = spline_filter(fine, order=_ROTATION_ORDER, mode="grid-wrap")

    def towards(self, other: Rotated, share: float) -> Rotated:
        """Between this and another of as many samples: 0 this, 1 the other."""
        between = copy(self)
        between.samples = (1 - share) * self.samples + share * other.samples
        between.coefficients = (1 - share) * self.coefficients + share * other.coefficients
        return between

    def at(self, angle_rad: float) -> Array:
        """(n, n) samples of it turned from right (x) towards down (y) by an angle; its light unchanged."""
        from scipy.ndimage import map_coordinates

        quarter = round(angle_rad / (math.pi / 2))
        if abs(angle_rad - quarter * math.pi / 2) < 1e-12 and self.samples.shape[0] % 2 == 1:
            return np.rot90(self.samples, -quarter).copy()
        count = self.samples.shape[0]
        y, x = offsets(count, 1.0)[:, None], offsets(count, 1.0)[None, :]
        cos, sin = math.cos(angle_rad), math.sin(angle_rad)
        place = np.stack(np.broadcast_arrays(cos * y - sin * x, sin * y + cos * x))
        middle = (self.padded // 2) * _OVERSAMPLING
        turned = map_coordinates(
            self.coefficients, place * _OVERSAMPLING + middle, order=_ROTATION_ORDER, mode="grid-wrap", prefilter=False
        )
        # What stood in the corners may have left the square, or come into it by the period.
        outside = np.abs(place).max(axis=0) > count // 2
        turned[outside] = 0
        result: Array = turned * (self.samples.sum() / turned.sum())
        return result


def _oversampled(samples: Array, times: int) -> Array:
    """A period of the Fourier sum at `times` as many places on each axis; those of the samples among them."""
    import scipy.fft

    count = samples.shape[0]
    spectrum = np.fft.fftshift(scipy.fft.fft2(samples))
    size = count * times
    whole = np.zeros((size, size), np.complex128)
    first = size // 2 - count // 2
    whole[first : first + count, first : first + count] = spectrum
    result: Array = scipy.fft.ifft2(np.fft.ifftshift(whole)).real * times**2
    return result


def box_blurred(samples: Array, spacing: float, side: float) -> Array:
    """(..., n, n) samples of the mean over a square of a side around each place.

    Examples
    --------
    >>> axis = np.arange(-20, 21) / 2
    >>> gauss = np.exp(-(axis[:, None] ** 2 + axis**2) / 2)
    >>> float(box_blurred(gauss, 0.5, 1.0)[20, 20].round(6))    # 2 pi erf(0.5 / sqrt(2))^2
    0.921313
    """
    import scipy.fft

    count = samples.shape[-1]
    size = scipy.fft.next_fast_len(count + 2 * math.ceil(side / spacing), real=True)
    f = np.fft.fftfreq(size, spacing)
    window = np.sinc(f * side)[:, None] * np.sinc(f[: size // 2 + 1] * side)
    spectrum = scipy.fft.rfft2(samples, s=(size, size)) * window
    result: Array = scipy.fft.irfft2(spectrum, s=(size, size))[..., :count, :count]
    return result


def light_radius(samples: Array, spacing: float, share: float) -> float:
    """Radius about the origin that holds a share of the light, in the unit of the spacing."""
    y, x = (offsets(count, spacing) for count in samples.shape)
    radius = np.hypot(y[:, None], x).ravel()
    order = np.argsort(radius, kind="stable")
    held = np.cumsum(np.abs(samples).ravel()[order])
    index = min(int(np.searchsorted(held, share * held[-1])), held.size - 1)
    return float(radius[order][index])
