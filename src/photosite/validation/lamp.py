"""The light that a chart stood in: a name, or what a spectroradiometer measured, in a CSV file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.color.illuminants import illuminant
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Spectrum, integration_weights, photons_from_energy
from photosite.color.spectrum_file import read_spectrum
from photosite.color.tristimulus import luminance_cd_m2
from photosite.errors import FileError, did_you_mean
from photosite.scene.charts import macbeth_reflectance

_RADIANCE_PER_UNIT: dict[str, float | None] = {
    "spectral_irradiance_w_per_m2_nm": 1.0 / math.pi,
    "spectral_irradiance_mw_per_m2_nm": 1e-3 / math.pi,
    "spectral_irradiance_uw_per_cm2_nm": 1e-2 / math.pi,
    "spectral_radiance_w_per_sr_m2_nm": 1.0,
    "spectral_radiance_mw_per_sr_m2_nm": 1e-3,
    "relative_energy": None,
}
"""What the second column may hold, and what one of it is as radiance of a perfect white, in W/sr/m2/nm.

A matte white of reflectance 1 in the irradiance E has the radiance E / pi."""

QUANTITIES = tuple(_RADIANCE_PER_UNIT)
"""Names of the second column of a lamp's file."""

_WAVELENGTH = "wavelength_nm"

_FINE_NM = 0.25
"""Step of the sums over a file's spectrum, beside its own entries."""

_SMOOTH = 0.01
"""RMS of what the simulator's wavelengths miss of a spectrum, in parts of its mean, up to which it is sampled."""


@dataclass(frozen=True, eq=False)
class Lamp:
    """A light on a chart.

    Parameters
    ----------
    name
        Of the illuminant, or of the file.
    light
        What `photosite.scene.charts.macbeth` takes as its illuminant.
    wavelength_nm
        (wavelengths,) that a scene in this light is given at.
    chart_luminance_cd_m2
        Mean luminance of a ColorChecker's patches in this light; None where only the shape of the spectrum is known.
    """

    name: str
    light: str | Spectrum
    wavelength_nm: NDArray[np.float64]
    chart_luminance_cd_m2: float | None = None

    @classmethod
    def named(cls, name: str) -> Lamp:
        """An illuminant by its name, as for `photosite.color.illuminants.illuminant`; its level is not known.

        Raises
        ------
        InputError
            If the illuminant is unknown.

        Examples
        --------
        >>> Lamp.named("D65").wavelength_nm.size
        41
        """
        illuminant(name, DEFAULT_WAVELENGTH_NM)
        return cls(name, name, DEFAULT_WAVELENGTH_NM)


def lamp_from(name_or_path: str | PathLike[str]) -> Lamp:
    """A lamp by the name of an illuminant, or from a file.

    Parameters
    ----------
    name_or_path
        A name that ends in .csv, or of a file that is there, is a file.

    Raises
    ------
    InputError
        If the illuminant is unknown.
    FileError
        As `read_lamp`.
    """
    path = Path(name_or_path)
    if path.suffix.lower() == ".csv" or path.is_file():
        return read_lamp(path)
    return Lamp.named(str(name_or_path))


def read_lamp(path: str | PathLike[str]) -> Lamp:
    """What a spectroradiometer measured at the chart.

    Parameters
    ----------
    path
        CSV with the heading `wavelength_nm,` and one of `QUANTITIES`: spectral irradiance on the chart, spectral
        radiance of a white standard in its place, or relative energy, which leaves the level open. A third column of
        standard uncertainties is read over. It is used from 380 to 780 nm, where the chart's reflectance is known, at
        the simulator's wavelengths; lines between these count with their energy.

    Returns
    -------
    Lamp

    Raises
    ------
    FileError
        If the file cannot be read, the heading does not say what the columns are, a value is negative, or all are 0.

    Notes
    -----
    The white standard's reflectance is taken as 1: divide by what its certificate says.

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
    content = read_spectrum(file)
    spectrum = content.spectrum
    per_unit = _RADIANCE_PER_UNIT[_quantity(file, content.columns)]
    if (spectrum.values < 0).any():
        at = int(np.argmin(spectrum.values))
        raise FileError(
            file,
            f"light is not negative, but {spectrum.values[at]:g} at {spectrum.wavelength_nm[at]:g} nm is; "
            "where that is the instrument's noise, write 0",
        )
    light = _brought(file, spectrum)
    if not light.values.any():
        raise FileError(file, "there is no light between 380 and 780 nm; check the columns")
    level = None if per_unit is None else _chart_luminance(light, per_unit)
    return Lamp(file.name, light, light.wavelength_nm, level)


def _quantity(file: Path, heading: tuple[str, ...]) -> str:
    wanted = f"'{_WAVELENGTH},' and one of {', '.join(QUANTITIES)}"
    if len(heading) < 2 or heading[0] != _WAVELENGTH:
        raise FileError(file, f"does not say what its columns are; its first line must be {wanted}")
    if heading[1] not in _RADIANCE_PER_UNIT:
        raise FileError(file, f"unknown quantity '{heading[1]}'; {did_you_mean(heading[1], QUANTITIES)}")
    return heading[1]


def _brought(file: Path, spectrum: Spectrum) -> Spectrum:
    """The spectrum at the simulator's wavelengths, as far as the file reaches.

    A smooth one is sampled there. One with lines or noise finer than that is averaged under a triangle about each: a
    line between two wavelengths is shared by both, with its energy, so that what is linear between the simulator's
    wavelengths has the integral with the lamp that it should have.
    """
    at = spectrum.wavelength_nm
    low, high = max(DEFAULT_WAVELENGTH_NM[0], at[0]), min(DEFAULT_WAVELENGTH_NM[-1], at[-1])
    if not low < high:
        raise FileError(file, f"holds {at[0]:g} to {at[-1]:g} nm; light from 380 to 780 nm is wanted")
    grid = np.union1d(np.clip(DEFAULT_WAVELENGTH_NM, low, high), [low, high])
    fine = np.union1d(np.clip(at, low, high), np.linspace(low, high, 1 + math.ceil((high - low) / _FINE_NM)))
    sampled = Spectrum(grid, spectrum.at(grid))
    missed = spectrum.at(fine) - sampled.at(fine)
    if np.sqrt(np.mean(missed**2)) <= _SMOOTH * spectrum.at(fine).mean():
        return sampled
    energy = spectrum.at(fine) * integration_weights(fine)
    shares = np.stack([np.interp(fine, grid, triangle) for triangle in np.eye(grid.size)])
    return Spectrum(grid, shares @ energy / (shares @ integration_weights(fine)))


def _chart_luminance(light: Spectrum, radiance_per_unit: float) -> float:
    grid = light.wavelength_nm
    white = photons_from_energy(light.values * radiance_per_unit, grid)
    return float(luminance_cd_m2(macbeth_reflectance(grid).mean(axis=0) * white, grid))
