"""The light of a spectral band: its spectrum, the photons in it, and which part of a response it sees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.spectrum import Spectrum, photons_from_energy
from photosite.errors import InputError

_GAUSS_NODES, _GAUSS_WEIGHTS = np.array([-1.0, 1.0]) / np.sqrt(3.0), np.array([0.5, 0.5])
"""Gauss and Legendre's rule of two points on a step of width 1: exact for cubic polynomials."""


@dataclass(frozen=True, eq=False)
class Passband:
    """The spectrum of a band's light, linear between its entries, or a line.

    Parameters
    ----------
    energy
        Relative spectral energy: (wavelengths,) none negative, some positive. One wavelength is a line.
    centre_nm
        Where the band is said to be: the wavelength that a quantum efficiency from it is written at.

    Raises
    ------
    InputError
        If a value is negative, all are 0, or the centre lies outside the band.

    Examples
    --------
    >>> band = triangular_passband(550.0, 10.0)
    >>> band.fwhm_nm, bool(abs(band.mean_of(lambda nm: 2.0 * nm) - 1100.0) < 0.1)
    (10.0, True)
    """

    energy: Spectrum
    centre_nm: float

    def __post_init__(self) -> None:
        grid, values = self.energy.wavelength_nm, self.energy.values
        if (values < 0).any() or not (values > 0).any():
            raise InputError("a band's spectral energy is 0 or more everywhere, and more somewhere")
        if not grid[0] <= self.centre_nm <= grid[-1]:
            raise InputError(f"a band from {grid[0]:g} to {grid[-1]:g} nm has its centre inside, not {self.centre_nm}")

    @classmethod
    def of_energy(cls, energy: Spectrum) -> Passband:
        """A band of measured spectrum; its centre is where its photons balance."""
        whole = cls(energy, float(energy.wavelength_nm[int(np.argmax(energy.values))]))
        return cls(energy, whole.mean_of(lambda nm: nm))

    @property
    def fwhm_nm(self) -> float:
        """Full width at half maximum: between the outermost wavelengths of half the largest value; 0 for a line."""
        grid, values = self.energy.wavelength_nm, self.energy.values
        half = 0.5 * values.max()
        above = np.flatnonzero(values >= half)
        left, right = above[0], above[-1]
        low = grid[left] if left == 0 else np.interp(half, values[left - 1 : left + 1], grid[left - 1 : left + 1])
        high = (
            grid[right]
            if right == grid.size - 1
            else np.interp(half, values[right : right + 2][::-1], grid[right : right + 2][::-1])
        )
        return float(high - low)

    def moved(self, by_nm: float) -> Passband:
        """The band at other wavelengths."""
        return Passband(Spectrum(self.energy.wavelength_nm + by_nm, self.energy.values), self.centre_nm + by_nm)

    def quadrature(self, breaks_nm: ArrayLike = ()) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(points,) wavelengths and (points,) shares of the band's energy, for integrals over it.

        Parameters
        ----------
        breaks_nm
            Where the integrand bends. Between these and its own entries the band's energy is linear, so an integrand
            that is quadratic there is integrated exactly.

        Returns
        -------
        tuple
            `shares @ f(wavelengths)` is the mean of f over the band's energy.
        """
        grid, values = self.energy.wavelength_nm, self.energy.values
        if grid.size == 1:
            return grid, np.ones(1)
        breaks = np.asarray(breaks_nm, np.float64)
        edges = np.union1d(grid, breaks[(breaks > grid[0]) & (breaks < grid[-1])])
        middle, width = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
        points = (middle[:, None] + width[:, None] / 2 * _GAUSS_NODES).ravel()
        shares = (width[:, None] * _GAUSS_WEIGHTS).ravel() * np.interp(points, grid, values)
        return points, shares / shares.sum()

    def mean_of(self, function: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> float:
        """The mean of a function of wavelength over the band's photons."""
        points, shares = self.quadrature()
        photons = photons_from_energy(shares, points)
        return float(photons @ function(points) / photons.sum())

    @property
    def photons_per_joule(self) -> float:
        """Photons in a joule of the band's light."""
        points, shares = self.quadrature()
        return float(photons_from_energy(shares, points).sum())

    def mean_responsivity_a_per_w(self, responsivity: Spectrum) -> float:
        """A photodiode's amperes per watt of the band's light.

        Raises
        ------
        InputError
            If the responsivity is not known over the whole band.
        """
        grid, known = self.energy.wavelength_nm, responsivity.wavelength_nm
        lit = grid[self.energy.values > 0]
        if lit[0] < known[0] or lit[-1] > known[-1]:
            raise InputError(
                f"the photodiode's responsivity is known from {known[0]:g} to {known[-1]:g} nm, and the band has light "
                f"from {lit[0]:g} to {lit[-1]:g} nm"
            )
        points, shares = self.quadrature(known)
        return float(shares @ responsivity.at(points))


def triangular_passband(centre_nm: float, fwhm_nm: float) -> Passband:
    """A monochromator's band with entrance and exit slits of equal width: a triangle. 0 is a line.

    Raises
    ------
    InputError
        If the width is negative, or the band would reach 0 nm.

    Examples
    --------
    >>> triangular_passband(500.0, 5.0).energy.wavelength_nm
    array([495., 500., 505.])
    """
    if not 0 <= fwhm_nm < centre_nm:
        raise InputError(f"a band of centre {centre_nm:g} nm has a width of 0 or more and below that, not {fwhm_nm:g}")
    if fwhm_nm == 0:
        return Passband(Spectrum(np.array([centre_nm]), np.ones(1)), centre_nm)
    grid = np.array([centre_nm - fwhm_nm, centre_nm, centre_nm + fwhm_nm])
    return Passband(Spectrum(grid, np.array([0.0, 1.0, 0.0])), centre_nm)


def band_matrix(bands: tuple[Passband, ...], *, beyond: Literal["level", "zero"] = "level") -> NDArray[np.float64]:
    """(bands, bands): what each band sees of a response that is linear between the bands' centres.

    Row b holds the mean over band b's photons of each centre's hat function, so that `matrix @ q` are the band means of
    the response that a sensor file keeps as q at the centres. Beyond the first and last centre the response is taken as
    level, or as zero: what the bands there saw is not told apart from what they saw inside.

    Examples
    --------
    >>> bands = tuple(triangular_passband(nm, 10.0) for nm in (500.0, 510.0, 520.0))
    >>> band_matrix(bands).round(3)
    array([[0.832, 0.168, 0.   ],
           [0.165, 0.667, 0.168],
           [0.   , 0.165, 0.835]])
    """
    centres = np.array([band.centre_nm for band in bands])
    matrix = np.empty((len(bands), len(bands)))
    for row, band in enumerate(bands):
        points, shares = band.quadrature(centres)
        photons = photons_from_energy(shares, points)
        end = None if beyond == "level" else 0.0
        hats = np.stack([np.interp(points, centres, unit, end, end) for unit in np.eye(centres.size)])
        matrix[row] = hats @ photons / photons.sum()
    return matrix
