"""Pictures as scenes: a display picture raised to spectra."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.cie import colour_science
from photosite.errors import InputError
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.spectra import Rule, Spectrum, photons_from_energy, wavelength_grid
from photosite.spectra import illuminant as relative_energy

PICTURE_WAVELENGTH_NM: NDArray[np.float64] = np.arange(380.0, 781.0, 5.0)
"""The grid of the basis reflectances. On one of 10 nm the spiky D65 alone turns a raised red by a CIEDE2000 of 0.6;
on this one no colour of sRGB by more than 0.03."""
PICTURE_WAVELENGTH_NM.flags.writeable = False


@lru_cache(maxsize=1)
def _mallett_yuksel_table() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    table = colour_science().recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
    return np.asarray(table.wavelengths, np.float64), np.asarray(table.values, np.float64).T


def srgb_reflectance(wavelength_nm: ArrayLike = PICTURE_WAVELENGTH_NM) -> NDArray[np.float64]:
    """(3, wavelengths) reflectances of sRGB's red, green and blue; linear between 5 nm entries.

    Their sum is 1 at every wavelength and none is negative, so that any linear sRGB from 0 to 1 weighs them to a
    reflectance that can be. Under D65 that reflectance has the colour it was made from; of the many that have, it is
    a smooth one.

    Raises
    ------
    InputError
        If a wavelength lies outside 380 to 780 nm.

    Notes
    -----
    I. Mallett and C. Yuksel, "Spectral Primary Decomposition for Rendering with sRGB Reflectance", Eurographics
    Symposium on Rendering 2019, as tabulated in colour-science.

    Examples
    --------
    >>> basis = srgb_reflectance([450.0, 550.0, 650.0])
    >>> basis.argmax(axis=0).tolist(), basis.sum(axis=0).round(6)
    ([2, 1, 0], array([1., 1., 1.]))
    """
    grid = wavelength_grid(wavelength_nm)
    table, values = _mallett_yuksel_table()
    if grid[0] < table[0] or grid[-1] > table[-1]:
        raise InputError(
            f"the reflectances of a picture are known from {table[0]:g} to {table[-1]:g} nm, "
            f"not from {grid[0]:g} to {grid[-1]:g} nm"
        )
    return np.stack([np.interp(grid, table, row) for row in values])


def from_srgb(
    picture: ArrayLike,
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    wavelength_nm: ArrayLike = PICTURE_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
    name: str = "picture",
) -> Scene:
    """A display picture as a flat print of matt colours, evenly lit.

    Every pixel's linear sRGB becomes a reflectance (`srgb_reflectance`), and the illuminant falls on it. Display white
    is the perfect white. What shade, gloss and light were in the picture is taken for the colour of its surfaces.

    Parameters
    ----------
    picture
        (rows, cols, 3) display sRGB: unsigned integers of 8 or 16 bits, or floats from 0 to 1.
    illuminant
        As for `photosite.spectra.illuminant`. Under "D65" the scene has the picture's colours.
    mean_luminance_cd_m2
        Mean over all samples.
    wavelength_nm
        (wavelengths,) of the scene, from 380 to 780 nm.
    distance_m, width_m, name
        As for `photosite.scene.scene.Scene`.
    rule
        Integration rule of the luminance.

    Returns
    -------
    Scene
        (3, rows, cols) weights, which are linear sRGB, over three spectra; nothing is lost in the raising but float32's
        rounding.

    Raises
    ------
    InputError
        If the picture is not one, is black, a wavelength lies outside 380 to 780 nm, the illuminant is unknown, or
        the luminance cannot be.

    Examples
    --------
    >>> scene = from_srgb(np.full((4, 6, 3), 128, np.uint8), "A", 5.0)
    >>> scene.weights.shape, round(float(scene.weights[0, 0, 0]), 4), round(scene.mean_luminance_cd_m2(), 6)
    ((3, 4, 6), 0.2159, 5.0)
    """
    grid = wavelength_grid(wavelength_nm)
    linear = linear_srgb(picture)
    if not linear.any():
        raise InputError("a black picture cannot be given a luminance: all its values are 0")
    light = photons_from_energy(relative_energy(illuminant, grid), grid)
    reflectance = srgb_reflectance(grid)
    scene = Scene(
        np.moveaxis(linear, 2, 0).astype(np.float32),
        reflectance * light,
        grid,
        distance_m,
        width_m,
        name=name,
        reflectance=reflectance,
    )
    return scene.with_mean_luminance(mean_luminance_cd_m2, rule)


def linear_srgb(picture: ArrayLike) -> NDArray[np.float64]:
    """(rows, cols, 3) linear sRGB, 0 to 1, of a display picture, checked.

    Parameters
    ----------
    picture
        (rows, cols, 3): unsigned integers of 8 or 16 bits, or floats from 0 to 1.

    Raises
    ------
    InputError
        If it has another shape or type, or values outside 0 to 1.

    Notes
    -----
    IEC 61966-2-1:1999, 5.2, by colour-science.

    Examples
    --------
    >>> linear_srgb(np.array([[[0, 128, 255]]], np.uint8)).round(4)
    array([[[0.    , 0.2159, 1.    ]]])
    """
    codes = np.asarray(picture)
    if codes.ndim != 3 or codes.shape[2] != 3 or codes.size == 0:
        raise InputError(f"a picture is (rows, cols, 3), red, green and blue, not an array of shape {codes.shape}")
    if codes.dtype in (np.uint8, np.uint16):
        values = codes / float(np.iinfo(codes.dtype).max)
    elif np.issubdtype(codes.dtype, np.floating):
        values = codes.astype(np.float64)
    else:
        raise InputError(f"a picture holds unsigned integers of 8 or 16 bits or floats from 0 to 1, not {codes.dtype}")
    if not ((values >= 0) & (values <= 1)).all():
        raise InputError("a picture's values lie from 0 to 1; some are outside or no numbers")
    return np.asarray(colour_science().models.eotf_sRGB(values), dtype=np.float64)
