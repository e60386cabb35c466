"""A spectral measurement: bands of light with their frames, dark frames, and the photodiode."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.spectrum import Spectrum, photons_from_energy
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSource
from photosite.sensor.model import Sensor
from photosite.values.cfa import Cfa
from photosite.values.exposure import check_exposure
from photosite.values.region import Region
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured

_GAUSS_NODES, _GAUSS_WEIGHTS = np.array([-1.0, 1.0]) / np.sqrt(3.0), np.array([0.5, 0.5])
"""Gauss and Legendre's rule of two points on a step of width 1: exact for cubic polynomials."""


@dataclass(frozen=True, eq=False)
class Passband(Shown):
    """Spectrum of a band's light: linear between its entries, or a single line.

    Parameters
    ----------
    energy
        Relative spectral energy, not negative and not all 0. A single wavelength is a line.
    centre_nm
        Nominal wavelength, inside the band, at which its quantum efficiency is reported.

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
            raise InputError("energy", expected="0 or more at every wavelength, and above 0 at one or more")
        if not grid[0] <= self.centre_nm <= grid[-1]:
            expected = f"inside the band, {grid[0]:g} to {grid[-1]:g}"
            raise InputError("centre_nm", value=self.centre_nm, expected=expected)

    @classmethod
    def of_energy(cls, energy: Spectrum) -> Passband:
        """Return a band with a measured spectrum; its center is the mean wavelength of its photons."""
        whole = cls(energy, float(energy.wavelength_nm[int(np.argmax(energy.values))]))
        return cls(energy, whole.mean_of(lambda nm: nm))

    @property
    def fwhm_nm(self) -> float:
        """Full width at half maximum: distance of the outermost wavelengths at half the largest value; 0 for a line."""
        grid, values = self.energy.wavelength_nm, self.energy.values
        half = 0.5 * values.max()
        above = np.flatnonzero(values >= half)
        rise = slice(max(above[0] - 1, 0), above[0] + 1)  # a single entry at the end of the grid
        fall = slice(above[-1], above[-1] + 2)
        low, high = np.interp(half, values[rise], grid[rise]), np.interp(half, values[fall][::-1], grid[fall][::-1])
        return float(high - low)

    def moved(self, by_nm: float) -> Passband:
        """Return the band shifted in wavelength."""
        return Passband(Spectrum(self.energy.wavelength_nm + by_nm, self.energy.values), self.centre_nm + by_nm)

    def quadrature(self, breaks_nm: ArrayLike = ()) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return wavelengths and fractions (points,) for integrals over the band, weighted with its energy.

        `fractions @ f(wavelengths)` is the mean of f. It is exact if f is quadratic between the band's own entries and
        `breaks_nm`, where it may have kinks.
        """
        grid, values = self.energy.wavelength_nm, self.energy.values
        if grid.size == 1:
            return grid, np.ones(1)
        breaks = np.asarray(breaks_nm, np.float64)
        edges = np.union1d(grid, breaks[(breaks > grid[0]) & (breaks < grid[-1])])
        middle, width = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
        points = (middle[:, None] + width[:, None] / 2 * _GAUSS_NODES).ravel()
        fractions = (width[:, None] * _GAUSS_WEIGHTS).ravel() * np.interp(points, grid, values)
        return points, fractions / fractions.sum()

    def mean_of(self, function: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> float:
        """Return the mean of a function of wavelength over the band's photons."""
        points, fractions = self.quadrature()
        photons = photons_from_energy(fractions, points)
        return float(photons @ function(points) / photons.sum())

    @property
    def photons_per_joule(self) -> float:
        """Number of photons per joule of the band's light."""
        points, fractions = self.quadrature()
        return float(photons_from_energy(fractions, points).sum())

    def mean_responsivity_a_per_w(self, responsivity: Spectrum) -> float:
        """Return a photodiode's amperes per watt of the band's light, which its responsivity must cover."""
        grid, known = self.energy.wavelength_nm, responsivity.wavelength_nm
        lit = grid[self.energy.values > 0]
        if lit[0] < known[0] or lit[-1] > known[-1]:
            raise InputError(
                "responsivity",
                value=f"{known[0]:g} to {known[-1]:g} nm",
                expected=f"known wherever the band has light, {lit[0]:g} to {lit[-1]:g} nm",
            )
        points, fractions = self.quadrature(known)
        return float(fractions @ responsivity.at(points))


def triangular_passband(centre_nm: float, fwhm_nm: float) -> Passband:
    """Return the band of a monochromator with slits of equal width: a triangle, or a line for width 0.

    Examples
    --------
    >>> triangular_passband(500.0, 5.0).energy.wavelength_nm
    array([495., 500., 505.])
    """
    if not 0 <= fwhm_nm < centre_nm:
        raise InputError("bandwidth_nm", value=fwhm_nm, expected=f"0 or more and below the center, {centre_nm:g}")
    if fwhm_nm == 0:
        return Passband(Spectrum(np.array([centre_nm]), np.ones(1)), centre_nm)
    grid = np.array([centre_nm - fwhm_nm, centre_nm, centre_nm + fwhm_nm])
    return Passband(Spectrum(grid, np.array([0.0, 1.0, 0.0])), centre_nm)


def band_matrix(bands: tuple[Passband, ...], *, beyond: Literal["level", "zero"] = "level") -> NDArray[np.float64]:
    """Return the matrix (bands, bands) that maps a response at the bands' centers to its means over the bands.

    The response is linear between the centers, as in a sensor file. Row b holds the mean of each center's hat function
    over the photons of band b. Beyond the first and last center the response is constant, or zero.

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
        points, fractions = band.quadrature(centres)
        photons = photons_from_energy(fractions, points)
        end = None if beyond == "level" else 0.0
        hats = np.stack([np.interp(points, centres, unit, end, end) for unit in np.eye(centres.size)])
        matrix[row] = hats @ photons / photons.sum()
    return matrix


@dataclass(frozen=True, eq=False)
class Photodiode(Shown):
    """A calibrated photodiode, for readings in amperes.

    Parameters
    ----------
    responsivity_a_per_w
        Responsivity over wavelength, above 0, linear between entries.
    standard_uncertainty_a_per_w
        (wavelengths,) independent uncertainty of each entry. A common uncertainty goes into
        `SpectralFrames.scale_uncertainty_percent`.
    area_mm2
        Sensitive area, above 0.
    """

    responsivity_a_per_w: Spectrum
    standard_uncertainty_a_per_w: NDArray[np.float64]
    area_mm2: Measured

    def __post_init__(self) -> None:
        if (self.responsivity_a_per_w.values <= 0).any():
            raise InputError("responsivity", value=self.responsivity_a_per_w.values.min(), expected="above 0 A/W")
        if not self.area_mm2.value > 0:
            raise InputError("area_mm2", value=self.area_mm2.value, expected="above 0")


@dataclass(frozen=True, eq=False)
class Band(Shown):
    """Frames and photodiode reading of one band of light.

    Parameters
    ----------
    name
        Name for messages and figures, such as "550 nm".
    passband
        Spectrum of the light.
    exposure_s, frames
        Exposure time, and the frames.
    reading
        Photodiode reading at the position of the sensor, less the dark reading: irradiance in W/m2, or current in A.
    photodiode
        The photodiode, for a reading in amperes; None for one in W/m2.
    centre_uncertainty_nm
        Standard uncertainty of the band's wavelength, independent between bands.

    Raises
    ------
    InputError
        If the reading is not above 0, there are no frames, or the photodiode does not cover the band.
    """

    name: str
    passband: Passband
    exposure_s: float
    frames: tuple[FrameSource, ...]
    reading: Measured
    photodiode: Photodiode | None = None
    centre_uncertainty_nm: float = 0.0

    def __post_init__(self) -> None:
        check_exposure(self.exposure_s)
        if not self.reading.value > 0:
            raise InputError("reading", where=self.name, value=self.reading.value, expected="above 0")
        if not self.frames:
            raise InputError("frames", where=self.name, value=(), expected="at least one frame")
        if not (math.isfinite(self.centre_uncertainty_nm) and self.centre_uncertainty_nm >= 0):
            value = self.centre_uncertainty_nm
            raise InputError("centre_uncertainty_nm", where=self.name, value=value, expected="0 or more")
        self.photons_m2()

    def photons_m2(self, moved_nm: float = 0.0) -> Measured:
        """Return the photons per m2 during the exposure, with the uncertainty of the reading.

        `moved_nm` is an assumed error of the band's wavelength: actual minus nominal.
        """
        band = self.passband.moved(moved_nm)
        watts = 1.0
        if (diode := self.photodiode) is not None:
            amperes_per_watt = band.mean_responsivity_a_per_w(diode.responsivity_a_per_w)
            watts = 1.0 / (amperes_per_watt * diode.area_mm2.value * 1e-6)
        scale = watts * band.photons_per_joule * self.exposure_s
        return Measured(self.reading.value * scale, self.reading.standard_uncertainty * scale)

    def diode_deviations(self) -> NDArray[np.float64]:
        """Return the relative standard uncertainty (entries,) of the photons due to each entry of the responsivity.

        Bands that use the same entry share its error.
        """
        if (diode := self.photodiode) is None:
            return np.zeros(0)
        known = diode.responsivity_a_per_w.wavelength_nm
        points, fractions = self.passband.quadrature(known)
        # The mean responsivity is linear in the entries; each entry contributes through its hat function.
        weight = np.array([fractions @ np.interp(points, known, unit) for unit in np.eye(known.size)])
        mean = self.passband.mean_responsivity_a_per_w(diode.responsivity_a_per_w)
        return np.asarray(weight * diode.standard_uncertainty_a_per_w / mean)


@dataclass(frozen=True, eq=False)
class SpectralFrames(Shown):
    """A spectral measurement: bands, dark frames, and what they have in common.

    Parameters
    ----------
    bands
        The bands, with different centers; sorted by wavelength.
    darks
        Dark frames by exposure time. Each exposure time of a band needs some.
    rows, cols, bits, cfa
        Format of all frames.
    sensor
        The sensor that supplies gain, pixel size and fill factor, or None.
    region
        Evenly lit part of the frame; None for the whole frame.
    scale_uncertainty_percent, exposure_uncertainty_percent
        Relative standard uncertainty common to all readings, and common to bands of one exposure time.
    source
        Where the measurement was read from.
    """

    bands: tuple[Band, ...]
    darks: Mapping[float, tuple[FrameSource, ...]]
    rows: int
    cols: int
    bits: int
    cfa: Cfa
    sensor: Sensor | None = None
    region: Region | None = None
    scale_uncertainty_percent: float = 0.0
    exposure_uncertainty_percent: float = 0.0
    source: str = "memory"

    def __post_init__(self) -> None:
        bands = tuple(sorted(self.bands, key=lambda band: band.passband.centre_nm))
        if not bands:
            raise InputError("bands", value=(), expected="at least one band")
        for one, other in pairwise(bands):
            if one.passband.centre_nm == other.passband.centre_nm:
                hint = "Put the frames of one wavelength into one band"
                raise InputError("centre_nm", where=one.name, expected="different for each band", hint=hint)
        for band in bands:
            if not self.darks.get(band.exposure_s):
                known = ", ".join(f"{exposure_s:g}" for exposure_s in sorted(self.darks))
                expected = f"dark frames at the band's exposure time, {band.exposure_s:g} s"
                hint = "Take dark frames with the same exposure time and the light blocked"
                value = f"dark frames at {known or 'no'} s"
                raise InputError("darks", where=band.name, value=value, expected=expected, hint=hint)
        object.__setattr__(self, "bands", bands)

    @property
    def frame_count(self) -> int:
        """Number of frames, light and dark."""
        return sum(len(band.frames) for band in self.bands) + sum(map(len, self.darks.values()))
