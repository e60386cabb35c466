"""Spectra: wavelength grids, integration over wavelength, conversion between photons and energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError

Rule = Literal["trapezoid", "rectangle"]

PLANCK_J_S = 6.62607015e-34
LIGHT_SPEED_M_S = 299_792_458.0

DEFAULT_WAVELENGTH_NM: NDArray[np.float64] = np.arange(380.0, 781.0, 10.0)
DEFAULT_WAVELENGTH_NM.flags.writeable = False


def wavelength_grid(wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Return wavelengths as a float array.

    Raises `InputError` if they are not one-dimensional, positive, finite and increasing.
    """
    grid = np.asarray(wavelength_nm, dtype=np.float64)
    if grid.ndim != 1 or grid.size == 0 or not np.isfinite(grid).all() or grid[0] <= 0:
        raise InputError("wavelength_nm", value=wavelength_nm, expected="a non-empty list of finite numbers above 0")
    if (np.diff(grid) <= 0).any():
        raise InputError("wavelength_nm", value=wavelength_nm, expected="increasing", hint="Sort it with its values")
    return grid


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A quantity as a function of wavelength.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,), increasing.
    values
        (wavelengths,), finite; the unit depends on the use.

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
            expected = f"one finite number for each of {grid.size} wavelengths"
            raise InputError("values", value=self.values, expected=expected)
        object.__setattr__(self, "wavelength_nm", grid)
        object.__setattr__(self, "values", values)

    def at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Return the values at other wavelengths: linear between entries, 0 outside the table."""
        wanted = np.asarray(wavelength_nm, dtype=np.float64)
        return np.interp(wanted, self.wavelength_nm, self.values, left=0.0, right=0.0)


def integration_weights(wavelength_nm: ArrayLike, rule: Rule = "trapezoid") -> NDArray[np.float64]:
    """Return (wavelengths,) weights in nm; `values @ weights` is the integral over wavelength.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,), increasing. A single wavelength gets the weight 1 nm.
    rule
        "trapezoid", or "rectangle" (sum times step) for comparison with tools that use it; it needs equal steps.

    Raises
    ------
    InputError
        If the rule is unknown, or the rectangle rule is used with unequal steps.

    Examples
    --------
    >>> integration_weights([400, 410, 420]), integration_weights([400, 410, 420], "rectangle")
    (array([ 5., 10.,  5.]), array([10., 10., 10.]))
    """
    grid = wavelength_grid(wavelength_nm)
    if rule not in ("trapezoid", "rectangle"):
        raise InputError("rule", value=rule, expected="'trapezoid' or 'rectangle'")
    if grid.size == 1:
        return np.ones(1)
    step = np.diff(grid)
    if rule == "rectangle":
        if not np.allclose(step, step[0], rtol=1e-9):
            raise InputError("the rectangle rule needs equal wavelength steps", hint="Use the trapezoidal rule")
        return np.full(grid.size, step[0])
    weights = np.zeros(grid.size)
    weights[:-1] += step / 2
    weights[1:] += step / 2
    return weights


def photons_from_energy(energy: ArrayLike, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Convert (..., wavelengths) joules to photons: divide by h c / lambda.

    Examples
    --------
    >>> float(photons_from_energy(1.0, 555.0)) / 1e18
    2.79...
    """
    wavelength_m = np.asarray(wavelength_nm, dtype=np.float64) * 1e-9
    return np.asarray(energy, dtype=np.float64) * wavelength_m / (PLANCK_J_S * LIGHT_SPEED_M_S)


def energy_from_photons(photons: ArrayLike, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Convert (..., wavelengths) photons to joules: multiply by h c / lambda.

    Examples
    --------
    >>> float(energy_from_photons(photons_from_energy(2.0, 500.0), 500.0))
    2.0
    """
    wavelength_m = np.asarray(wavelength_nm, dtype=np.float64) * 1e-9
    return np.asarray(photons, dtype=np.float64) * (PLANCK_J_S * LIGHT_SPEED_M_S) / wavelength_m
