"""Illuminants: CIE tables, blackbodies, daylight of any color temperature, sunlight, LEDs, and measured spectra."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import lru_cache
from numbers import Real
from os import PathLike
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import color_matching_functions
from photosite.color.spectrum import (
    DEFAULT_WAVELENGTH_NM,
    LIGHT_SPEED_M_S,
    PLANCK_J_S,
    Spectrum,
    energy_from_photons,
    load_spectrum,
    wavelength_grid,
)
from photosite.color.tables import rows, spectra
from photosite.errors import FileError, InputError, did_you_mean
from photosite.values.choice import check_choice

__all__ = [
    "ENERGY_COLUMNS",
    "PHOTON_COLUMNS",
    "blackbody",
    "daylight",
    "illuminant",
    "led",
    "load_illuminant",
    "sunlight",
    "white_led",
]
__dir__ = __all__.copy

Array = NDArray[np.float64]
Sunlight = Literal["global", "direct"]

BOLTZMANN_J_K = 1.380649e-23

_WEAKEST_W_SR_M2_NM = 1e-100
"""Radiance of a blackbody at about 75 K in the visible: no photon in the age of the universe."""

_A_K, _A_C2_M_K = 2848.0, 1.435e-2
"""Temperature and c2 in the definition of CIE standard illuminant A (ISO 11664-2)."""

_NOMINAL_K = {"D50": 5000.0, "D55": 5500.0, "D65": 6500.0, "D75": 7500.0}
_C2_RATIO = 1.4388 / 1.4380
"""Nominal temperatures times this are on the present temperature scale (CIE 015:2018)."""

_DAYLIGHT_K = (4000.0, 25000.0)
_WHITE_LED_K = (2200.0, 10000.0)

_LED_NM = np.arange(300.0, 1101.0)

_DIE_NM, _DIE_FWHM_NM, _PHOSPHOR_FWHM_NM = 450.0, 20.0, 120.0
"""An InGaN die, and a phosphor as wide as YAG:Ce."""

_OHNO_HALF = math.sqrt(-math.log(0.8086092632))
"""x at which Ohno's shape (g + 2 g^5) / 3, g = exp(-x^2), is 1/2."""

_BY_TEMPERATURE = re.compile(r"(?P<kind>daylight|d|led)[ :]*(?P<kelvin>\d{4,5}(?:\.\d+)?) ?k?", re.IGNORECASE)

_SUN_NAMES = ("sunlight", "AM1.5G", "AM1.5D")
_SUNLIGHT: dict[str, Sunlight] = {"sunlight": "global", "am1.5g": "global", "am1.5d": "direct"}

ENERGY_COLUMNS = (
    "relative_energy",
    "spectral_irradiance_w_per_m2_nm",
    "spectral_irradiance_mw_per_m2_nm",
    "spectral_irradiance_uw_per_cm2_nm",
    "spectral_radiance_w_per_sr_m2_nm",
    "spectral_radiance_mw_per_sr_m2_nm",
)
PHOTON_COLUMNS = ("relative_photons",)
"""Names of the second column of an illuminant file."""


def illuminant(name: str | float | Spectrum, wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM) -> Array:
    """Return the relative spectral energy of an illuminant, (wavelengths,).

    Parameters
    ----------
    name
        One of:

        - a CIE illuminant: `"A"`, `"D65"`, `"FL2"` or `"F2"`, `"LED-B1"`, ...; `"tungsten"` is CIE A;
        - a blackbody's temperature: `3200`, `"3200K"` or `"blackbody 3200"`;
        - daylight or a white LED of a color temperature: `"daylight 5600"` or `"D5600"`, `"led 4000"`;
        - the sun with the sky, also in the near infrared: `"sunlight"` or `"AM1.5G"`, or without it: `"AM1.5D"`;
        - a CSV file, `"lamp.csv"` (`load_illuminant`);
        - a `Spectrum` of relative energy.
    wavelength_nm
        (wavelengths,). Values are linear between the table's entries. CIE tables end at 780 nm, daylight covers 300 to
        830 nm, sunlight 280 to 4000 nm. Beyond its table CIE A follows its definition, Planck's formula.

    Raises
    ------
    InputError
        If the illuminant is unknown, or its table does not cover the wavelengths.
    FileError
        If a file cannot be read.

    Examples
    --------
    >>> illuminant("A", [560.0]), illuminant("tungsten", [560.0])
    (array([100.]), array([100.]))
    >>> illuminant("LED-B11")
    Traceback (most recent call last):
    photosite.errors.InputError: illuminant must be a known name, got 'LED-B11'. Did you mean 'LED-B1'?
    """
    grid = wavelength_grid(wavelength_nm)
    if isinstance(name, Spectrum):
        return _interpolated(name, grid, "spectrum")
    if not isinstance(name, str):
        if isinstance(name, bool) or not isinstance(name, Real):
            raise InputError("illuminant", value=name, expected="a name, a temperature in K or a Spectrum")
        return _blackbody_illuminant(float(name), grid)
    text = name.strip()
    if temperature := re.fullmatch(r"(?:blackbody[ :]*)?(\d+(?:\.\d+)?) ?k?", text, re.IGNORECASE):
        return _blackbody_illuminant(float(temperature[1]), grid)
    if text.lower().endswith(".csv"):
        return _interpolated(load_illuminant(text), grid, name)
    if text.lower() in _SUNLIGHT:
        return _interpolated(sunlight(_SUNLIGHT[text.lower()]), grid, name)
    if named := _BY_TEMPERATURE.fullmatch(text):
        kelvin = float(named["kelvin"])
        return _interpolated(white_led(kelvin) if named["kind"].lower() == "led" else daylight(kelvin), grid, name)
    table = _cie_illuminant(name)
    if name.lower() in ("a", "tungsten"):
        inside = (grid >= table.wavelength_nm[0]) & (grid <= table.wavelength_nm[-1])
        return np.where(inside, np.interp(grid, table.wavelength_nm, table.values), _cie_a_definition(grid))
    return _interpolated(table, grid, name)


def _interpolated(spectrum: Spectrum, grid: Array, name: str) -> Array:
    first, last = spectrum.wavelength_nm[0], spectrum.wavelength_nm[-1]
    if grid[0] < first - 1e-9 or grid[-1] > last + 1e-9:
        ends = tuple(int(end) if end == int(end) else float(end) for end in (first, last))
        raise InputError(
            "wavelength_nm",
            where=f"illuminant {name}",
            value=(float(grid[0]), float(grid[-1])),
            expected=f"within {first:g} to {last:g} nm, the range of its table",
            hint="Use another illuminant, or limit a scene file to {band_range_nm}",
            arguments={"band_range_nm": ends},
        )
    return np.interp(grid, spectrum.wavelength_nm, spectrum.values)


def blackbody(temperature_k: float, wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM) -> Array:
    """Return Planck's spectral energy radiance, (wavelengths,) W/sr/m2/nm.

    Raises
    ------
    InputError
        If the temperature is not above 0.

    Examples
    --------
    >>> float(blackbody(5778.0, [500.0])[0].round(0))   # the sun's surface, W/sr/m2/nm
    26376.0
    """
    if not (np.isfinite(temperature_k) and temperature_k > 0):
        raise InputError("temperature_k", value=temperature_k, expected="finite and above 0")
    wavelength_m = wavelength_grid(wavelength_nm) * 1e-9
    exponent = PLANCK_J_S * LIGHT_SPEED_M_S / (wavelength_m * BOLTZMANN_J_K * temperature_k)
    with np.errstate(over="ignore"):  # infinite for very low temperatures: the radiance is then 0
        per_m = 2 * PLANCK_J_S * LIGHT_SPEED_M_S**2 / wavelength_m**5 / np.expm1(exponent)
    return per_m * 1e-9


def _blackbody_illuminant(temperature_k: float, grid: Array) -> Array:
    try:
        energy = blackbody(temperature_k, grid)
    except InputError as error:
        raise error.within("illuminant") from None
    if not energy.max() > _WEAKEST_W_SR_M2_NM:
        expected = f"high enough to emit light from {grid[0]:g} to {grid[-1]:g} nm"
        hint = "Give kelvins, such as 3200, or a name, such as A or D65"
        raise InputError("temperature_k", where="illuminant", value=temperature_k, expected=expected, hint=hint)
    return energy


def _cie_a_definition(grid: Array) -> Array:
    exponent = _A_C2_M_K * 1e9 / _A_K
    with np.errstate(over="ignore"):
        energy = (560 / grid) ** 5 * np.expm1(exponent / 560) / np.expm1(exponent / grid)
    return np.asarray(100 * energy)


@lru_cache(maxsize=32)
def _cie_illuminant(name: str) -> Spectrum:
    tables = spectra("cie_illuminants")
    known = {key.lower(): key for key in tables} | {"tungsten": "A"}
    known |= {f"f{key[2:].lower()}": key for key in tables if key.startswith("FL")}  # the older names of FL1, FL2, ...
    if name.lower() not in known:
        kinds = (*dict.fromkeys(known.values()), "daylight 5600", "blackbody 3200", "led 4000", "tungsten", *_SUN_NAMES)
        hint = did_you_mean(name, kinds)
        if not hint.startswith("Did"):  # the full list has fifty entries
            named = "the CIE illuminants (A, D65, F11, LED-B3, ...), 'daylight 5600', 'blackbody 3200'"
            hint = f"Known are {named}, 'led 4000', 'sunlight' and CSV files (lamp.csv)"
        raise InputError("illuminant", value=name, expected="a known name", hint=hint)
    found = known[name.lower()]
    table = tables[found]
    if found not in _NOMINAL_K:
        return table
    # The tables end at 780 nm; CIE's own, computed from the same basis functions, at 830 nm.
    full = _daylight_table(_NOMINAL_K[found] * _C2_RATIO)
    beyond = full.wavelength_nm > table.wavelength_nm[-1]
    return Spectrum(
        np.append(table.wavelength_nm, full.wavelength_nm[beyond]), np.append(table.values, full.values[beyond])
    )


@lru_cache(maxsize=32)
def daylight(temperature_k: float) -> Spectrum:
    """Return daylight of a correlated color temperature: relative energy, 100 at 560 nm, 300 to 830 nm.

    Raises
    ------
    InputError
        If the temperature is outside 4000 to 25 000 K.

    Notes
    -----
    CIE 015:2018, 4.1.2. The illuminants D50, D55, D65 and D75 are at 5003, 5503, 6504 and 7504 K:
    since they were named, the constant c2 of Planck's law has changed by 1.4388 / 1.4380.

    Examples
    --------
    >>> daylight(6504).at([460.0]).round(1)   # D65 has 117.8 there
    array([117.8])
    """
    low, high = _DAYLIGHT_K
    if not low <= temperature_k <= high:
        expected, hint = f"{low:g} to {high:g}", f"'blackbody {temperature_k:g}' exists at any temperature"
        raise InputError("temperature_k", where="daylight", value=temperature_k, expected=expected, hint=hint)
    return _daylight_table(temperature_k)


def _daylight_table(temperature_k: float) -> Spectrum:
    t = np.float64(temperature_k)
    if t <= 7000:
        x = -4.607e9 / t**3 + 2.9678e6 / t**2 + 99.11 / t + 0.244063
    else:
        x = -2.0064e9 / t**3 + 1.9018e6 / t**2 + 247.48 / t + 0.23704
    y = -3.0 * x**2 + 2.87 * x - 0.275
    m = 0.0241 + 0.2562 * x - 0.7341 * y
    m1 = np.around((-1.3515 - 1.7703 * x + 5.9114 * y) / m, 3)
    m2 = np.around((0.0300 - 31.4424 * x + 30.0717 * y) / m, 3)
    s0, s1, s2 = spectra("daylight_basis").values()
    return Spectrum(s0.wavelength_nm, s0.values + m1 * s1.values + m2 * s2.values)


@lru_cache(maxsize=2)
def sunlight(kind: Sunlight = "global") -> Spectrum:
    """Return the reference spectrum of sunlight at air mass 1.5: W/m2/nm, 280 to 4000 nm.

    Parameters
    ----------
    kind
        "global": from the sun, the sky and the ground, on a surface tilted by 37 degrees towards the sun (AM1.5G).
        "direct": from the sun and 2.5 degrees around it, on a surface that faces it (AM1.5D).

    Raises
    ------
    InputError
        If the kind is unknown.

    Notes
    -----
    The steps are 0.5 nm below 400 nm, 1 nm up to 1700 nm and 5 nm beyond. The spectrum has narrow absorption bands,
    such as oxygen's at 761 nm and water's at 935 nm, which a scene in steps of 10 nm samples coarsely. Give a scene
    steps of 2 nm where single bands matter.

    References
    ----------
    ASTM G173-03, "Standard tables for reference solar spectral irradiances".

    Examples
    --------
    >>> sunlight().at([550.0, 850.0, 940.0])
    array([1.5399 , 0.89372, 0.47181])
    """
    check_choice("kind", kind, Sunlight)
    table = rows("astm_g173")
    return Spectrum(table["wavelength_nm"], table[kind])


def led(peak_nm: ArrayLike, fwhm_nm: ArrayLike, power: Sequence[float] | None = None) -> Spectrum:
    """Return the light of one or several bare LEDs: relative energy, 300 to 1100 nm.

    Parameters
    ----------
    peak_nm, fwhm_nm
        (n,) or scalar: wavelength of each peak, 350 to 1050 nm, and its full width at half maximum, up to 300 nm.
    power
        (n,) relative radiant power of each; None: equal powers.

    Raises
    ------
    InputError
        If lengths differ or a value is outside its range.

    References
    ----------
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
        raise InputError("power", value=power, expected=f"one number for each of {peaks.size} peaks")
    if not ((peaks >= 350) & (peaks <= 1050)).all():
        raise InputError("peak_nm", value=peak_nm, expected="350 to 1050")
    if not ((widths > 0) & (widths <= 300)).all():
        raise InputError("fwhm_nm", value=fwhm_nm, expected="above 0 and at most 300")
    if not ((powers >= 0) & np.isfinite(powers)).all() or not powers.any():
        raise InputError("power", value=power, expected="0 or above, and above 0 for at least one LED")
    g = np.exp(-(((_LED_NM - peaks[:, None]) / widths[:, None] * 2 * _OHNO_HALF) ** 2))
    return Spectrum(_LED_NM, powers @ _unit_area((g + 2 * g**5) / 3))


@lru_cache(maxsize=32)
def white_led(temperature_k: float) -> Spectrum:
    """Return a white LED, a blue die with a phosphor, of a correlated color temperature: relative energy.

    A model: a die at 450 nm, 20 nm wide, and a Gaussian phosphor, 120 nm wide. The phosphor's peak and fraction give
    the chromaticity of a blackbody below 5000 K and of daylight above. The range is 300 to 1100 nm. Measured LEDs are
    "LED-B1" to "LED-B5".

    Raises
    ------
    InputError
        If the temperature is outside 2200 to 10 000 K.

    References
    ----------
    ANSI C78.377 for the nominal chromaticities.

    Examples
    --------
    >>> spectrum = white_led(4000)
    >>> float(spectrum.wavelength_nm[spectrum.values.argmax()])
    450.0
    """
    low, high = _WHITE_LED_K
    if not low <= temperature_k <= high:
        raise InputError("temperature_k", where="white LED", value=temperature_k, expected=f"{low:g} to {high:g}")
    from scipy.optimize import brentq

    observer = color_matching_functions(_LED_NM)
    target = blackbody(temperature_k, _LED_NM) if temperature_k < 5000 else daylight(temperature_k).at(_LED_NM)
    x, y = (observer @ target)[:2] / (observer @ target).sum()
    die = led(_DIE_NM, _DIE_FWHM_NM).values
    blue = observer @ die

    def distance_from_line(peak: float) -> float:
        """Return twice the area of the triangle of target, die and phosphor: 0 if the target is on their line."""
        yellow = observer @ _phosphor(peak)
        (x0, y0), (x1, y1) = blue[:2] / blue.sum(), yellow[:2] / yellow.sum()
        return float((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0))

    peak = brentq(distance_from_line, 530.0, 660.0, xtol=1e-9)
    phosphor = _phosphor(peak)
    yellow = observer @ phosphor
    # The phosphor's fraction that gives the target's x; on the line, y follows.
    fraction = (x * blue.sum() - blue[0]) / (x * (blue.sum() - yellow.sum()) - (blue[0] - yellow[0]))
    return Spectrum(_LED_NM, (1 - fraction) * die + fraction * phosphor)


def _phosphor(peak_nm: float) -> Array:
    return _unit_area(np.exp(-4 * math.log(2) * ((_LED_NM - peak_nm) / _PHOSPHOR_FWHM_NM) ** 2))


def _unit_area(shape: Array) -> Array:
    return np.asarray(shape / shape.sum(axis=-1, keepdims=True))  # the steps are 1 nm


def load_illuminant(path: str | PathLike[str]) -> Spectrum:
    """Read an illuminant's relative energy from a CSV file.

    Parameters
    ----------
    path
        As for `photosite.color.spectrum.load_spectrum`. The first line must name the columns: `wavelength_nm` and
        one of `ENERGY_COLUMNS` or `PHOTON_COLUMNS`. Photons are converted to energy, with a maximum of 1.

    Raises
    ------
    FileError
        If the file cannot be read, does not name its columns, or has a negative value or no value above 0.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "lamp.csv")
    ...     _ = file.write_text("wavelength_nm,relative_energy\\n380,1\\n780,3\\n")
    ...     float(load_illuminant(file).at([580.0])[0])
    2.0
    """
    content = load_spectrum(path)
    spectrum, columns = content.spectrum, content.columns
    known = (*ENERGY_COLUMNS, *PHOTON_COLUMNS)
    if len(columns) < 2 or columns[0] != "wavelength_nm" or columns[1] not in known:
        expected = f"'wavelength_nm,' and one of {', '.join(known)}"
        raise FileError(path, "the first line", 1, value=",".join(columns), expected=expected)
    if (spectrum.values < 0).any() or not spectrum.values.any():
        raise FileError(path, columns[1], expected="0 or above, and above 0 at some wavelength")
    if columns[1] in PHOTON_COLUMNS:
        energy = energy_from_photons(spectrum.values, spectrum.wavelength_nm)
        return Spectrum(spectrum.wavelength_nm, energy / energy.max())
    return spectrum
