"""The light on a chart: an illuminant by name, or a spectroradiometer's CSV file."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import luminance_cd_m2
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import (
    DEFAULT_WAVELENGTH_NM,
    Spectrum,
    integration_weights,
    load_spectrum,
    photons_from_energy,
)
from photosite.errors import FileError, did_you_mean
from photosite.scene.charts import macbeth_reflectance
from photosite.values.shown import Shown

_RADIANCE_PER_UNIT: dict[str, float | None] = {
    "spectral_irradiance_w_per_m2_nm": 1.0 / math.pi,
    "spectral_irradiance_mw_per_m2_nm": 1e-3 / math.pi,
    "spectral_irradiance_uw_per_cm2_nm": 1e-2 / math.pi,
    "spectral_radiance_w_per_sr_m2_nm": 1.0,
    "spectral_radiance_mw_per_sr_m2_nm": 1e-3,
    "relative_energy": None,
}
"""Quantities of the second column, and the radiance of a perfect white for one unit of each, in W/sr/m2/nm.

A Lambertian white in irradiance E has the radiance E / pi."""

_WAVELENGTH = "wavelength_nm"

_FINE_NM = 0.25  # step of the integrals over a file's spectrum, in addition to its own wavelengths
_SMOOTH = 0.01  # a spectrum is sampled if the RMS interpolation error is at most this fraction of its mean


@dataclass(frozen=True, eq=False)
class Lamp(Shown):
    """The light on a chart.

    Parameters
    ----------
    name, light
        Name of the illuminant or file, and illuminant for `photosite.scene.charts.macbeth`.
    wavelength_nm
        (wavelengths,) of a scene in this light.
    chart_luminance_cd_m2
        Mean luminance of a ColorChecker's patches in this light; None if only the shape of the spectrum is known.
    """

    name: str
    light: str | Spectrum
    wavelength_nm: NDArray[np.float64]
    chart_luminance_cd_m2: float | None = None

    @classmethod
    def from_name(cls, name: str) -> Lamp:
        """Return an illuminant by name (`photosite.color.illuminants.illuminant`), with unknown level.

        Examples
        --------
        >>> Lamp.from_name("D65").wavelength_nm.size
        41
        """
        illuminant(name, DEFAULT_WAVELENGTH_NM)
        return cls(name, name, DEFAULT_WAVELENGTH_NM)


def load_lamp(name_or_path: str | PathLike[str]) -> Lamp:
    """Return a lamp from a file (`read_lamp`) if the name ends in .csv or is that of one, else from an illuminant."""
    path = Path(name_or_path)
    if path.suffix.lower() == ".csv" or os.path.isfile(path):
        return read_lamp(path)
    return Lamp.from_name(str(name_or_path))


def read_lamp(path: str | PathLike[str]) -> Lamp:
    """Read the spectrum that a spectroradiometer measured at the chart.

    Parameters
    ----------
    path
        CSV with the heading `wavelength_nm,` and one of `spectral_irradiance_w_per_m2_nm` (also `_mw_per_m2_nm`,
        `_uw_per_cm2_nm`) on the chart, `spectral_radiance_w_per_sr_m2_nm` (also `_mw_per_sr_m2_nm`) of a white standard
        at its place, or `relative_energy`, which leaves the level unknown. A third column of standard uncertainties is
        ignored. The range from 380 to 780 nm is used, at the simulator's wavelengths;
        spectral lines between these keep their energy.

    Raises
    ------
    FileError
        If the file cannot be read, the heading does not name the columns, a value is negative, or all values are 0.

    Notes
    -----
    The white standard's reflectance is assumed to be 1; divide by its certified value.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "lamp.csv")
    ...     _ = file.write_text("wavelength_nm,spectral_radiance_w_per_sr_m2_nm\\n380,0.001\\n780,0.001\\n")
    ...     lamp = read_lamp(file)
    >>> round(lamp.chart_luminance_cd_m2, 1)
    20.0
    """
    file = Path(path)
    content = load_spectrum(file)
    spectrum = content.spectrum
    per_unit = _RADIANCE_PER_UNIT[_quantity(file, content.columns)]
    if (spectrum.values < 0).any():
        at = int(np.argmin(spectrum.values))
        what, hint = f"light at {spectrum.wavelength_nm[at]:g} nm", "Replace negative instrument noise by 0"
        raise FileError(file, what, value=spectrum.values[at], expected="0 or more", hint=hint)
    light = _resampled(file, spectrum)
    if not light.values.any():
        raise FileError(file, "all values between 380 and 780 nm are 0", hint="Check the columns")
    level = None if per_unit is None else _chart_luminance(light, per_unit)
    return Lamp(file.name, light, light.wavelength_nm, level)


def _quantity(file: Path, heading: tuple[str, ...]) -> str:
    if len(heading) < 2 or heading[0] != _WAVELENGTH:
        expected = f"'{_WAVELENGTH},' and one of {', '.join(_RADIANCE_PER_UNIT)}"
        raise FileError(file, "heading", value=",".join(heading), expected=expected)
    if heading[1] not in _RADIANCE_PER_UNIT:
        hint = did_you_mean(heading[1], _RADIANCE_PER_UNIT)
        what = "heading of the second column"
        raise FileError(file, what, value=heading[1], expected="a known quantity", hint=hint)
    return heading[1]


def _resampled(file: Path, spectrum: Spectrum) -> Spectrum:
    """Return the spectrum at the simulator's wavelengths within the file's range.

    A smooth spectrum is sampled. A spectrum with finer lines or noise is averaged under a triangle about each
    wavelength, so that a line keeps its energy and integrals of the lamp times a piecewise linear function are exact.
    """
    at = spectrum.wavelength_nm
    low, high = max(DEFAULT_WAVELENGTH_NM[0], at[0]), min(DEFAULT_WAVELENGTH_NM[-1], at[-1])
    if not low < high:
        ends = (float(at[0]), float(at[-1]))
        raise FileError(file, "wavelengths", value=ends, expected="partly between 380 and 780 nm")
    grid = np.union1d(np.clip(DEFAULT_WAVELENGTH_NM, low, high), [low, high])
    fine = np.union1d(np.clip(at, low, high), np.linspace(low, high, 1 + math.ceil((high - low) / _FINE_NM)))
    sampled = Spectrum(grid, spectrum.at(grid))
    missed = spectrum.at(fine) - sampled.at(fine)
    if np.sqrt(np.mean(missed**2)) <= _SMOOTH * spectrum.at(fine).mean():
        return sampled
    energy = spectrum.at(fine) * integration_weights(fine)
    fractions = np.stack([np.interp(fine, grid, triangle) for triangle in np.eye(grid.size)])
    return Spectrum(grid, fractions @ energy / (fractions @ integration_weights(fine)))


def _chart_luminance(light: Spectrum, radiance_per_unit: float) -> float:
    grid = light.wavelength_nm
    white = photons_from_energy(light.values * radiance_per_unit, grid)
    return float(luminance_cd_m2(macbeth_reflectance(grid).mean(axis=0) * white, grid))
