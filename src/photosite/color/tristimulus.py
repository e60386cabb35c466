"""Color-matching functions, luminance, XYZ and Lab.

Spectral radiance is in photons/s/sr/m2/nm unless a name says energy.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colour_science import colour_science
from photosite.color.spectrum import Rule, energy_from_photons, integration_weights, wavelength_grid
from photosite.errors import InputError

LUMINOUS_EFFICACY_LM_W = 683.0
"""K_m of photopic vision, rounded as CIE 015:2018 allows."""

D65_XY = (0.3127, 0.3290)
"""Chromaticity of D65 for the 2 degree observer, to the four digits of IEC 61966-2-1."""

D65_WHITE_XYZ: NDArray[np.float64] = np.array([D65_XY[0] / D65_XY[1], 1.0, (1.0 - D65_XY[0] - D65_XY[1]) / D65_XY[1]])
"""XYZ of the perfect white under D65, Y = 1."""
D65_WHITE_XYZ.flags.writeable = False


def color_matching_functions(wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Return the CIE 1931 2 degree observer, (3, wavelengths): x, y and z bar.

    Linear between the 1 nm entries, 0 outside 360 to 830 nm.

    Examples
    --------
    >>> color_matching_functions([555.0])[1]
    array([1.])
    """
    grid, values = _observer()
    requested = np.asarray(wavelength_nm, dtype=np.float64)
    return np.stack([np.interp(requested, grid, row, left=0.0, right=0.0) for row in values])


@lru_cache(maxsize=1)
def _observer() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    observer = colour_science().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    return np.asarray(observer.wavelengths, np.float64), np.asarray(observer.values, np.float64).T


def luminance_cd_m2(
    photon_radiance: ArrayLike, wavelength_nm: ArrayLike, rule: Rule = "trapezoid"
) -> NDArray[np.float64]:
    """Return the luminance, in cd/m2, of (..., wavelengths) photons/s/sr/m2/nm.

    683 lm/W times the integral of energy radiance times y bar (CIE 015:2018).

    Examples
    --------
    >>> from photosite.color.spectrum import photons_from_energy
    >>> grid = np.arange(380.0, 781.0)
    >>> one_watt_at_555 = photons_from_energy(np.where(grid == 555, 1.0, 0.0), grid)
    >>> float(luminance_cd_m2(one_watt_at_555, grid).round(3))
    683.0
    """
    grid = wavelength_grid(wavelength_nm)
    weights = color_matching_functions(grid)[1] * integration_weights(grid, rule)
    return np.asarray(LUMINOUS_EFFICACY_LM_W * (energy_from_photons(photon_radiance, grid) @ weights))


def xyz(photon_radiance: ArrayLike, wavelength_nm: ArrayLike, rule: Rule = "trapezoid") -> NDArray[np.float64]:
    """Return CIE 1931 tristimulus values, (..., 3), of (..., wavelengths) photons/s/sr/m2/nm; Y in cd/m2.

    Examples
    --------
    >>> from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, photons_from_energy
    >>> white = photons_from_energy(np.ones(41), DEFAULT_WAVELENGTH_NM)   # equal energy
    >>> X, Y, Z = xyz(white, DEFAULT_WAVELENGTH_NM)
    >>> bool(abs(X / Y - 1) < 2e-3 and abs(Z / Y - 1) < 2e-3)
    True
    """
    grid = wavelength_grid(wavelength_nm)
    weights = color_matching_functions(grid) * integration_weights(grid, rule)
    return np.asarray(LUMINOUS_EFFICACY_LM_W * (energy_from_photons(photon_radiance, grid) @ weights.T))


def lab(xyz: ArrayLike) -> NDArray[np.float64]:
    """Return CIE 1976 L*a*b*, (..., 3), of tristimulus values under D65.

    Parameters
    ----------
    xyz
        (..., 3), Y = 1 for the perfect white under D65. Slightly negative values, as a fitted matrix can produce, use
        the linear part of the formula.

    Raises
    ------
    InputError
        If the last axis does not have length 3 or a value is not finite.

    Examples
    --------
    >>> lab(D65_WHITE_XYZ).round(6) + 0.0
    array([100.,   0.,   0.])
    """
    values = np.asarray(xyz, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] != 3 or not np.isfinite(values).all():
        raise InputError("xyz", value=xyz, expected="an array (..., 3) of finite numbers")
    return np.asarray(colour_science().XYZ_to_Lab(values, illuminant=np.array(D65_XY)), dtype=np.float64)
