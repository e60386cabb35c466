"""Spectra of lamps by formula and from files: daylight of any colour temperature, LEDs, a measured spectrum.

`photosite.color.spectrum.illuminant` knows them by name; what is here makes them as spectra of relative energy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import lru_cache
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.cie import colour_science
from photosite.color.spectrum import (
    Spectrum,
    blackbody,
    color_matching_functions,
    energy_from_photons,
)
from photosite.color.spectrum_file import read_heading, read_spectrum
from photosite.errors import FileError, InputError

Array = NDArray[np.float64]

_DAYLIGHT_K = (4000.0, 25000.0)
_WHITE_LED_K = (2200.0, 10000.0)

_LED_NM = np.arange(300.0, 1101.0)

_DIE_NM, _DIE_FWHM_NM, _PHOSPHOR_FWHM_NM = 450.0, 20.0, 120.0
"""An InGaN die, and a phosphor as wide as YAG:Ce's."""

_OHNO_HALF = math.sqrt(-math.log(0.8086092632))
"""Where Ohno's shape (g + 2 g^5) / 3, g = exp(-x^2), has fallen to 1/2."""

_NAMED = re.compile(r"(?P<kind>daylight|d|led)[ :]*(?P<kelvin>\d{4,5}(?:\.\d+)?) ?k?", re.IGNORECASE)

ENERGY_COLUMNS = (
    "relative_energy",
    "spectral_irradiance_w_per_m2_nm",
    "spectral_irradiance_mw_per_m2_nm",
    "spectral_irradiance_uw_per_cm2_nm",
    "spectral_radiance_w_per_sr_m2_nm",
    "spectral_radiance_mw_per_sr_m2_nm",
)
PHOTON_COLUMNS = ("relative_photons",)
"""Names of the second column of a light's file: what its values are."""


def lamp(name: str) -> Spectrum | None:
    """The lamp that a name is of: "daylight 5600", "D5600", "led 4000", or a file "lamp.csv". None: of none of these.

    Raises
    ------
    InputError
        If the colour temperature cannot be.
    FileError
        If the file cannot be read as a light.

    Examples
    --------
    >>> lamp("daylight 5600 K").at([560.0]), lamp("D65")
    (array([100.]), None)
    """
    if name.strip().lower().endswith(".csv"):
        return read_light(name.strip())
    if not (named := _NAMED.fullmatch(name.strip())):
        return None
    kelvin = float(named["kelvin"])
    return white_led(kelvin) if named["kind"].lower() == "led" else daylight(kelvin)


@lru_cache(maxsize=32)
def daylight(temperature_k: float) -> Spectrum:
    """Daylight of a correlated colour temperature, 4000 to 25 000 K: relative energy, 100 at 560 nm, 300 to 830 nm.

    Raises
    ------
    InputError
        If the temperature lies outside.

    Notes
    -----
    CIE 015:2018, 4.1.2, by colour-science. The illuminants D50, D55, D65 and D75 are at 5003, 5503, 6504 and 7504 K:
    the constant c2 of Planck's law has changed by 1.4388 / 1.4380 since they were named.

    Examples
    --------
    >>> daylight(6504).at([460.0]).round(1)   # D65 has 117.8 there
    array([117.8])
    """
    if not _DAYLIGHT_K[0] <= temperature_k <= _DAYLIGHT_K[1]:
        raise InputError(
            f"daylight has a colour temperature from {_DAYLIGHT_K[0]:g} to {_DAYLIGHT_K[1]:g} K, not "
            f"{temperature_k:g}; a blackbody of any is 'blackbody {temperature_k:g}'"
        )
    colour = colour_science()
    table = colour.sd_CIE_illuminant_D_series(colour.temperature.CCT_to_xy_CIE_D(temperature_k))
    return Spectrum(np.asarray(table.wavelengths, np.float64), np.asarray(table.values, np.float64))


def led(peak_nm: ArrayLike, fwhm_nm: ArrayLike, power: Sequence[float] | None = None) -> Spectrum:
    """Light of one or several bare LEDs: relative energy, 300 to 1100 nm.

    Parameters
    ----------
    peak_nm, fwhm_nm
        (n,) or one: wavelength of each peak, and its full width at half maximum.
    power
        (n,) relative radiant power of each; None: all alike.

    Raises
    ------
    InputError
        If lengths differ, a width is not above 0, a peak lies outside 350 to 1050 nm, or a power is negative.

    Notes
    -----
    Y. Ohno, "Spectral design considerations for white LED color rendering", Opt. Eng. 44 (2005): the shape
    (g + 2 g^5) / 3 of a Gaussian g = exp(-((wavelength - peak) / width)^2), whose width is 1.085 times the FWHM.

    Examples
    --------
    >>> led([460, 530, 630], [22, 32, 18]).at([460.0, 471.0]).round(3)
    array([0.038, 0.019])
    """
    peaks = np.atleast_1d(np.asarray(peak_nm, dtype=np.float64))
    widths = np.broadcast_to(np.asarray(fwhm_nm, dtype=np.float64), peaks.shape)
    powers = np.ones(peaks.shape) if power is None else np.asarray(power, dtype=np.float64)
    if peaks.ndim != 1 or powers.shape != peaks.shape:
        raise InputError(f"LEDs need one peak, width and power each: {peaks.size} peaks, {powers.size} powers")
    if not ((peaks >= 350) & (peaks <= 1050)).all() or not ((widths > 0) & (widths <= 300)).all():
        raise InputError("an LED's peak lies from 350 to 1050 nm, and its width is above 0 and up to 300 nm")
    if not ((powers >= 0) & np.isfinite(powers)).all() or not powers.any():
        raise InputError("an LED's power is 0 or more, and not 0 for all of them")
    g = np.exp(-(((_LED_NM - peaks[:, None]) / widths[:, None] * 2 * _OHNO_HALF) ** 2))
    return Spectrum(_LED_NM, powers @ _of_unit_area((g + 2 * g**5) / 3))


@lru_cache(maxsize=32)
def white_led(temperature_k: float) -> Spectrum:
    """A white LED, a blue die under a phosphor, of a correlated colour temperature of 2200 to 10 000 K.

    A model: a die at 450 nm, 20 nm wide, and a Gaussian phosphor, 120 nm wide, whose peak and share are those that give
    the chromaticity of a blackbody below 5000 K and of daylight from there on. Measured ones: "LED-B1" to "LED-B5".

    Returns
    -------
    Spectrum
        Relative energy, 300 to 1100 nm.

    Raises
    ------
    InputError
        If the temperature lies outside.

    Notes
    -----
    The nominal chromaticities are those of ANSI C78.377.

    Examples
    --------
    >>> spectrum = white_led(4000)
    >>> float(spectrum.wavelength_nm[spectrum.values.argmax()])
    450.0
    """
    if not _WHITE_LED_K[0] <= temperature_k <= _WHITE_LED_K[1]:
        raise InputError(
            f"a white LED has a colour temperature from {_WHITE_LED_K[0]:g} to {_WHITE_LED_K[1]:g} K, "
            f"not {temperature_k:g}"
        )
    from scipy.optimize import brentq

    observer = color_matching_functions(_LED_NM)
    target = blackbody(temperature_k, _LED_NM) if temperature_k < 5000 else daylight(temperature_k).at(_LED_NM)
    x, y = (observer @ target)[:2] / (observer @ target).sum()
    die = led(_DIE_NM, _DIE_FWHM_NM).values
    blue = observer @ die

    def off_line(peak: float) -> float:
        """Twice the area of the triangle of the target, the die and a phosphor: 0 where the target lies between."""
        yellow = observer @ _phosphor(peak)
        (x0, y0), (x1, y1) = blue[:2] / blue.sum(), yellow[:2] / yellow.sum()
        return float((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0))

    peak = brentq(off_line, 530.0, 660.0, xtol=1e-9)
    phosphor = _phosphor(peak)
    yellow = observer @ phosphor
    # The share of phosphor at which x is right; y then is.
    share = (x * blue.sum() - blue[0]) / (x * (blue.sum() - yellow.sum()) - (blue[0] - yellow[0]))
    return Spectrum(_LED_NM, (1 - share) * die + share * phosphor)


def _phosphor(peak_nm: float) -> Array:
    return _of_unit_area(np.exp(-4 * math.log(2) * ((_LED_NM - peak_nm) / _PHOSPHOR_FWHM_NM) ** 2))


def _of_unit_area(shape: Array) -> Array:
    area: Array = shape / shape.sum(axis=-1, keepdims=True)  # per nm, on steps of 1 nm
    return area


def read_light(path: str | PathLike[str]) -> Spectrum:
    """A light's relative energy from a CSV file.

    Parameters
    ----------
    path
        As for `photosite.color.spectrum_file.read_spectrum`. The first line names the columns: `wavelength_nm` and
        one of
        `ENERGY_COLUMNS` or `PHOTON_COLUMNS`, since a spectrum in photons is another than one in energy.

    Raises
    ------
    FileError
        If the file cannot be read, does not say what its values are, or has a negative value or nothing but 0.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "lamp.csv")
    ...     _ = file.write_text("wavelength_nm,relative_energy\\n380,1\\n780,3\\n")
    ...     float(read_light(file).at([580.0])[0])
    2.0
    """
    spectrum, _ = read_spectrum(path)
    heading = read_heading(path)
    known = (*ENERGY_COLUMNS, *PHOTON_COLUMNS)
    if len(heading) < 2 or heading[0] != "wavelength_nm" or heading[1] not in known:
        raise FileError(
            path,
            "does not say what its values are: the first line must be 'wavelength_nm,' and one of "
            f"{', '.join(known)}, not '{','.join(heading)}'",
            1,
        )
    if (spectrum.values < 0).any() or not spectrum.values.any():
        raise FileError(path, "a light's energy is 0 or more at each wavelength, and not 0 at all of them")
    if heading[1] in PHOTON_COLUMNS:
        energy = energy_from_photons(spectrum.values, spectrum.wavelength_nm)
        return Spectrum(spectrum.wavelength_nm, energy / energy.max())
    return spectrum
