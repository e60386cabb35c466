"""MTF and PSF of a lens, sampled for plots."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.optics.point_spread import FieldPsf, PointSpread, otf_at
from photosite.values.shown import Shown, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Kind = Literal["mtf", "psf"]

_LARGEST_GRID = 512
_SHOWN_ENERGY = 0.9
_LEAST_HALF = 24  # samples: three periods of the cutoff


class LensBlur(Shown):
    """Base of lenses: a plot of their blur."""

    @abstractmethod
    def point_spread(self, distance_m: float) -> PointSpread:
        """Return the point spread function on the sensor."""

    def plot(
        self,
        kind: Kind = "mtf",
        *,
        wavelength_nm: float | Sequence[float] = (450.0, 550.0, 650.0),
        distance_m: float = math.inf,
        at_mm: tuple[float, float] = (0.0, 0.0),
        ax: Axes | None = None,
    ) -> Axes:
        """Draw the MTF or the PSF on Matplotlib axes and return them.

        Parameters
        ----------
        kind
            "mtf": modulation against frequency, along the columns, and dashed along the rows where it differs. "psf":
            the point spread function at the middle one of the wavelengths, on a logarithmic scale.
        wavelength_nm, distance_m
            Wavelengths, and distance of the object.
        at_mm
            Image point (y, x) on the sensor, from the axis.
        ax
            Axes to draw on; None makes new ones.

        Raises
        ------
        InputError
            If the kind is unknown.
        """
        return drawn(self, ax, kind, wavelength_nm, distance_m, at_mm)


def mtf(spread: PointSpread, frequency_per_m: Array, wavelength_nm: float, at_m: tuple[float, float]) -> Array:
    """Return the MTF at an image point (y, x), (2, frequencies): along the columns, and along the rows."""
    zero = np.zeros(frequency_per_m.size)
    pairs = (zero, frequency_per_m), (frequency_per_m, zero)
    return np.stack([np.abs(otf_at(spread, fy, fx, wavelength_nm, *at_m)) for fy, fx in pairs])


def cutoff_per_m(spread: PointSpread, wavelength_nm: float) -> float:
    """Return the frequency beyond which the OTF is 0."""
    parts = spread.modes if isinstance(spread, FieldPsf) else (spread,)
    return max(part.cutoff_per_m(wavelength_nm) for part in parts)


def sampled_psf(spread: PointSpread, wavelength_nm: float, at_m: tuple[float, float]) -> tuple[Array, float]:
    """Return the PSF at an image point (y, x), (n, n), and the distance between samples in m.

    It is the inverse Fourier transform of the OTF, cropped to the square that holds 90 % of the energy.

    Examples
    --------
    >>> import photosite as ps
    >>> psf, step_m = sampled_psf(ps.DiffractionLimited(8, 50).point_spread(math.inf), 550.0, (0.0, 0.0))
    >>> bool(psf.argmax() == psf.size // 2), round(float(psf.sum()), 1)
    (True, 0.9)
    """
    parts = spread.modes if isinstance(spread, FieldPsf) else (spread,)
    step_m = 0.125 / cutoff_per_m(spread, wavelength_nm)
    reach_m = max(part.reach_m(wavelength_nm) for part in parts)
    size = min(_LARGEST_GRID, 1 << math.ceil(math.log2(2 * reach_m / step_m)))
    frequency: Array = np.fft.fftfreq(size, step_m).astype(np.float64)
    otf = otf_at(spread, frequency[:, None], frequency[None, :], wavelength_nm, *at_m)
    psf = np.fft.fftshift(np.fft.ifft2(otf).real)
    distance = np.maximum(*np.abs(np.indices(psf.shape) - size // 2))
    enclosed = np.cumsum(np.bincount(distance.ravel(), psf.ravel()))
    half = int(np.searchsorted(enclosed, _SHOWN_ENERGY * enclosed[-1]))
    half = min(max(half, _LEAST_HALF), size // 2 - 1)
    middle = slice(size // 2 - half, size // 2 + half + 1)
    return psf[middle, middle], step_m
