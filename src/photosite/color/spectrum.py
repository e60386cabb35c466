"""Spectra: wavelength grids and integrals over them, illuminants, photons and joules, luminance, tristimulus values.

Spectral radiance and irradiance are in photons/s/m2/nm (radiance also per sr) unless a name says energy.
CIE data come from colour-science, imported when first used.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from numbers import Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.cie import colour_science
from photosite.errors import InputError, did_you_mean

Rule = Literal["trapezoid", "rectangle"]

PLANCK_J_S = 6.62607015e-34
LIGHT_SPEED_M_S = 299_792_458.0
BOLTZMANN_J_K = 1.380649e-23
LUMINOUS_EFFICACY_LM_W = 683.0
"""K_m of photopic vision, rounded as CIE 015:2018 allows."""

_DARK = 1e-100
"""W/sr/m2/nm, of a blackbody below some 75 K in what is visible: no photon in the age of the universe."""

_A_K, _A_C2_M_K = 2848.0, 1.435e-2
"""Of CIE standard illuminant A, whose definition is Planck's formula with these (ISO 11664-2)."""
_DAYLIGHTS_K = {"D50": 5000.0, "D55": 5500.0, "D65": 6500.0, "D75": 7500.0}
_OLDER_C2 = 1.4388 / 1.4380
"""Times these is their temperature on today's scale (CIE 015:2018)."""

DEFAULT_WAVELENGTH_NM: NDArray[np.float64] = np.arange(380.0, 781.0, 10.0)
DEFAULT_WAVELENGTH_NM.flags.writeable = False


def wavelength_grid(wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Wavelengths as a float array, checked.

    Raises
    ------
    InputError
        If they are not one-dimensional, positive, finite and increasing.
    """
    grid = np.asarray(wavelength_nm, dtype=np.float64)
    if grid.ndim != 1 or grid.size == 0 or not np.isfinite(grid).all() or grid[0] <= 0:
        raise InputError(f"wavelengths are a list of positive numbers in nm, not an array of shape {grid.shape}")
    if (np.diff(grid) <= 0).any():
        raise InputError("wavelengths must increase from entry to entry; sort them with their values")
    return grid


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A quantity over wavelength.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,), increasing.
    values
        (wavelengths,), finite; the unit is whoever's who holds it.

    Examples
    --------
    >>> Spectrum([400, 500], [0.0, 1.0]).at([400, 450, 600])
    array([0. , 0.5, 0. ])
    """

    wavelength_nm: NDArray[np.float64]
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        grid = wavelength_grid(self.wavelength_nm)
        values = np.asarray(self.values, dtype=np.float64)
        if values.shape != grid.shape or not np.isfinite(values).all():
            raise InputError(
                f"a spectrum needs one finite value per wavelength: {grid.size} wavelengths, values {values.shape}"
            )
        object.__setattr__(self, "wavelength_nm", grid)
        object.__setattr__(self, "values", values)

    def at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """The values at other wavelengths: linear between entries, 0 outside them."""
        return np.interp(
            np.asarray(wavelength_nm, dtype=np.float64), self.wavelength_nm, self.values, left=0.0, right=0.0
        )


def integration_weights(wavelength_nm: ArrayLike, rule: Rule = "trapezoid") -> NDArray[np.float64]:
    """(wavelengths,) nm: `values @ weights` is the integral over wavelength.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,), increasing. A single wavelength is a line of unit width.
    rule
        "trapezoid", or "rectangle" (sum times step), which some other tools use; the rectangle needs equal steps.

    Raises
    ------
    InputError
        If the rule is unknown, or the rectangle rule is asked of unequal steps.

    Examples
    --------
    >>> integration_weights([400, 410, 420]), integration_weights([400, 410, 420], "rectangle")
    (array([ 5., 10.,  5.]), array([10., 10., 10.]))
    """
    grid = wavelength_grid(wavelength_nm)
    if rule not in ("trapezoid", "rectangle"):
        raise InputError(f"unknown integration rule '{rule}'; known are: trapezoid, rectangle")
    if grid.size == 1:
        return np.ones(1)
    step = np.diff(grid)
    if rule == "rectangle":
        if not np.allclose(step, step[0], rtol=1e-9):
            raise InputError("the rectangle rule needs wavelengths in equal steps; use the trapezoidal rule")
        return np.full(grid.size, step[0])
    weights = np.zeros(grid.size)
    weights[:-1] += step / 2
    weights[1:] += step / 2
    return weights


def photons_from_energy(energy: ArrayLike, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Photons for joules, (..., wavelengths): divided by h c / lambda.

    Examples
    --------
    >>> float(photons_from_energy(1.0, 555.0)) / 1e18
    2.79...
    """
    wavelength_m = np.asarray(wavelength_nm, dtype=np.float64) * 1e-9
    return np.asarray(energy, dtype=np.float64) * wavelength_m / (PLANCK_J_S * LIGHT_SPEED_M_S)


def energy_from_photons(photons: ArrayLike, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Joules for photons, (..., wavelengths): times h c / lambda.

    Examples
    --------
    >>> float(energy_from_photons(photons_from_energy(2.0, 500.0), 500.0))
    2.0
    """
    wavelength_m = np.asarray(wavelength_nm, dtype=np.float64) * 1e-9
    return np.asarray(photons, dtype=np.float64) * (PLANCK_J_S * LIGHT_SPEED_M_S) / wavelength_m


def color_matching_functions(wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """(3, wavelengths): CIE 1931 2 degree observer, x, y, z bar; linear between the 1 nm entries, 0 outside 360-830 nm.

    Examples
    --------
    >>> color_matching_functions([555.0])[1]
    array([1.])
    """
    grid, values = _observer()
    wanted = np.asarray(wavelength_nm, dtype=np.float64)
    return np.stack([np.interp(wanted, grid, row, left=0.0, right=0.0) for row in values])


@lru_cache(maxsize=1)
def _observer() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    observer = colour_science().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    return np.asarray(observer.wavelengths, np.float64), np.asarray(observer.values, np.float64).T


def luminance_cd_m2(
    photon_radiance: ArrayLike, wavelength_nm: ArrayLike, rule: Rule = "trapezoid"
) -> NDArray[np.float64]:
    """Luminance of (..., wavelengths) photons/s/sr/m2/nm, in cd/m2.

    683 lm/W times the integral of energy radiance with y bar (CIE 015:2018).

    Examples
    --------
    >>> grid = np.arange(380.0, 781.0)
    >>> one_watt_at_555 = photons_from_energy(np.where(grid == 555, 1.0, 0.0), grid)
    >>> float(luminance_cd_m2(one_watt_at_555, grid).round(3))
    683.0
    """
    grid = wavelength_grid(wavelength_nm)
    weights = color_matching_functions(grid)[1] * integration_weights(grid, rule)
    luminance: NDArray[np.float64] = LUMINOUS_EFFICACY_LM_W * (energy_from_photons(photon_radiance, grid) @ weights)
    return luminance


def xyz(photon_radiance: ArrayLike, wavelength_nm: ArrayLike, rule: Rule = "trapezoid") -> NDArray[np.float64]:
    """CIE 1931 tristimulus values, (..., 3), of (..., wavelengths) photons/s/sr/m2/nm; Y in cd/m2.

    Examples
    --------
    >>> white = photons_from_energy(np.ones(41), DEFAULT_WAVELENGTH_NM)   # equal energy
    >>> X, Y, Z = xyz(white, DEFAULT_WAVELENGTH_NM)
    >>> bool(abs(X / Y - 1) < 2e-3 and abs(Z / Y - 1) < 2e-3)
    True
    """
    grid = wavelength_grid(wavelength_nm)
    weights = color_matching_functions(grid) * integration_weights(grid, rule)
    tristimulus: NDArray[np.float64] = LUMINOUS_EFFICACY_LM_W * (energy_from_photons(photon_radiance, grid) @ weights.T)
    return tristimulus


def blackbody(temperature_k: float, wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM) -> NDArray[np.float64]:
    """Planck's spectral energy radiance, (wavelengths,) W/sr/m2/nm.

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
        raise InputError(f"a blackbody's temperature must be above 0 K, not {temperature_k}")
    wavelength_m = wavelength_grid(wavelength_nm) * 1e-9
    exponent = PLANCK_J_S * LIGHT_SPEED_M_S / (wavelength_m * BOLTZMANN_J_K * temperature_k)
    with np.errstate(over="ignore"):  # so cold that there is no such photon
        per_m = 2 * PLANCK_J_S * LIGHT_SPEED_M_S**2 / wavelength_m**5 / np.expm1(exponent)
    return per_m * 1e-9


def illuminant(name: str | float | Spectrum, wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM) -> NDArray[np.float64]:
    """Relative spectral energy of an illuminant, (wavelengths,).

    Parameters
    ----------
    name
        A CIE illuminant (`"A"`, `"D65"`, `"FL2"` or `"F2"`, `"LED-B1"`, ...), `"tungsten"` (CIE A), a blackbody's
        temperature (`3200`, `"3200K"` or `"blackbody 3200"`), daylight or a white LED of a colour temperature
        (`"daylight 5600"` or `"D5600"`, `"led 4000"`: `photosite.color.lamps`), the name of a CSV file of a light
        (`"lamp.csv"`: `photosite.color.lamps.read_light`), or a `Spectrum` of relative energy.
    wavelength_nm
        Where it is wanted; linear between the table's entries. Tables end at 780 nm, but those of daylight reach from
        300 to 830 nm; beyond its table CIE A is its definition, Planck's formula.

    Raises
    ------
    InputError
        If the illuminant is unknown, or its table does not reach all the wavelengths.
    FileError
        If a light's file cannot be read.

    Examples
    --------
    >>> illuminant("A", [560.0]), illuminant("tungsten", [560.0])
    (array([100.]), array([100.]))
    >>> illuminant("LED-B11")
    Traceback (most recent call last):
    photosite.errors.InputError: unknown illuminant 'LED-B11'; did you mean 'LED-B1'?
    """
    grid = wavelength_grid(wavelength_nm)
    if isinstance(name, Spectrum):
        return _within(name.wavelength_nm, name.values, grid, "the illuminant's spectrum")
    if not isinstance(name, str):
        if isinstance(name, bool) or not isinstance(name, Real):
            raise InputError(f"an illuminant is a name, a temperature in K or a Spectrum, not {name!r:.40}")
        return _glow(float(name), grid)
    if temperature := re.fullmatch(r"(?:blackbody[ :]*)?(\d+(?:\.\d+)?) ?k?", name.strip(), re.IGNORECASE):
        return _glow(float(temperature[1]), grid)
    from photosite.color.lamps import lamp  # it knows spectra by this module's Spectrum

    if (found := lamp(name)) is not None:
        return _within(found.wavelength_nm, found.values, grid, f"the light {name}")
    table, values = _cie_illuminant(name)
    if name.lower() in ("a", "tungsten"):
        return np.where((grid >= table[0]) & (grid <= table[-1]), np.interp(grid, table, values), _incandescent(grid))
    return _within(table, values, grid, f"illuminant {name}")


def _glow(temperature_k: float, grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """A blackbody as a light: one that is too cold to shine at these wavelengths is none."""
    energy = blackbody(temperature_k, grid)
    if not energy.max() > _DARK:
        raise InputError(
            f"a blackbody of {temperature_k:g} K sends out no light from {grid[0]:g} to {grid[-1]:g} nm; give its "
            "temperature in kelvins (3200), or a light by its name (A, D65)"
        )
    return energy


def _incandescent(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIE A by its definition, 100 at 560 nm."""
    exponent = _A_C2_M_K * 1e9 / _A_K
    with np.errstate(over="ignore"):
        energy: NDArray[np.float64] = (560 / grid) ** 5 * np.expm1(exponent / 560) / np.expm1(exponent / grid)
    return 100 * energy


def _within(
    table: NDArray[np.float64], values: NDArray[np.float64], grid: NDArray[np.float64], what: str
) -> NDArray[np.float64]:
    if grid[0] < table[0] - 1e-9 or grid[-1] > table[-1] + 1e-9:
        raise InputError(
            f"{what} is known from {table[0]:g} to {table[-1]:g} nm only, and {grid[0]:g} to {grid[-1]:g} nm "
            "is wanted; ask for wavelengths within that, of a file by its bands "
            f"(band_range_nm=({table[0]:g}, {table[-1]:g})), or take another light"
        )
    return np.interp(grid, table, values)


@lru_cache(maxsize=32)
def _cie_illuminant(name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    tables = colour_science().SDS_ILLUMINANTS
    known = {key.lower(): key for key in tables} | {"tungsten": "A"}
    known |= {f"f{key[2:].lower()}": key for key in tables if key.startswith("FL")}  # the older name
    if name.lower() not in known:
        kinds = (*dict.fromkeys(known.values()), "daylight 5600", "blackbody 3200", "led 4000", "tungsten")
        hint = did_you_mean(name, kinds)
        if not hint.startswith("did"):  # all there are would be fifty
            hint = (
                "known are the CIE's (A, D65, F11, LED-B3, ...), 'daylight 5600', 'blackbody 3200', 'led 4000' and "
                "files (lamp.csv); photosite.color.spectrum.illuminant has them all"
            )
        raise InputError(f"unknown illuminant '{name}'; {hint}")
    found = known[name.lower()]
    table = tables[found]
    grid, values = np.asarray(table.wavelengths, np.float64), np.asarray(table.values, np.float64)
    if found not in _DAYLIGHTS_K:
        return grid, values
    colour = colour_science()  # its tables end at 780 nm, the CIE's at 830: both are of these basis functions
    chromaticity = colour.temperature.CCT_to_xy_CIE_D(_DAYLIGHTS_K[found] * _OLDER_C2)
    whole = colour.sd_CIE_illuminant_D_series(chromaticity)
    beyond = whole.wavelengths > grid[-1]
    return np.append(grid, whole.wavelengths[beyond]), np.append(values, whole.values[beyond])
