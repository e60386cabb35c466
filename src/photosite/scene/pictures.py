"""Pictures as scenes: colours raised to spectra.

A display picture (`from_srgb`, `from_rgb`) is taken for a flat print: its colours are reflectances, and a light falls
on them. A picture of light itself, of any range (`from_hdr`), is taken for what it shows: its colours are radiances.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colour_science import colour_science
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import Rule, Spectrum, photons_from_energy, wavelength_grid
from photosite.color.tristimulus import luminance_cd_m2
from photosite.errors import InputError
from photosite.scene.picture_colors import (
    Method,
    OutOfGamut,
    checked_picture,
    display_values,
    linear_srgb_of,
    srgb_weights,
)
from photosite.scene.raised import raised
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.values.validated import check_choice

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


def from_rgb(
    picture: ArrayLike,
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    space: str = "sRGB",
    linear: bool = False,
    method: Method = "mallett-yuksel",
    out_of_gamut: OutOfGamut = "refuse",
    tolerance: float = 1e-3,
    wavelength_nm: ArrayLike = PICTURE_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
    name: str = "picture",
) -> Scene:
    """A picture as a flat print of matt colours, evenly lit.

    Every pixel's colour becomes a reflectance, and the illuminant falls on it. Display white is the perfect white. What
    shade, gloss and light were in the picture is taken for the colour of its surfaces.

    Parameters
    ----------
    picture
        (rows, cols, 3): unsigned integers of 8 or 16 bits, or floats from 0 to 1; outside by 1e-6 is rounding.
    illuminant
        As for `photosite.color.illuminants.illuminant`. Under "D65" the scene has the picture's colours.
    mean_luminance_cd_m2
        Mean over all samples.
    space
        Whose red, green and blue these are: one of `photosite.scene.picture_colors.SPACES`, such as "sRGB",
        "Display P3", "Adobe RGB" or "BT.2020".
    linear
        The values are proportional to light. False: they are encoded for a display, by the space's own curve.
    method
        "mallett-yuksel": three basis reflectances, which sRGB weighs; three spectra, nothing lost, colours of sRGB
        only. "jakob-hanika": a smooth reflectance for each colour (`photosite.scene.sigmoid`), reduced to few spectra;
        other spaces' colours too, as far as a surface can have them. It takes about a minute for a million colours.
    out_of_gamut
        What becomes of colours that the method cannot raise: "refuse" them, or "clip" each of red, green and blue to
        what sRGB can show.
    tolerance
        RMS of what "jakob-hanika" may lose by the reduction, in parts of the reflectances' RMS; colours under D65 lose
        nothing by it.
    wavelength_nm
        (wavelengths,) of the scene, from 380 to 780 nm.
    distance_m, width_m, name
        As for `photosite.scene.scene.Scene`.
    rule
        Integration rule of the luminance.

    Raises
    ------
    InputError
        If the picture is not one, is black or has colours that cannot be raised, a wavelength lies outside 380 to
        780 nm, the space, method or illuminant is unknown, or the luminance cannot be.

    Notes
    -----
    Spaces whose white is not D65 are adapted to it by Bradford's transform. Integrated again under D65 on the 5 nm
    grid, colours of sRGB differ by a CIEDE2000 below 0.03, by either method; on one of 1 nm below 0.08 and 0.04. The
    smooth reflectances lie from 0 to 1, reduced ones beyond it by what is lost (0.04 at a tolerance of 1e-3).

    Examples
    --------
    >>> grey = np.full((4, 6, 3), 0.25, np.float32)
    >>> scene = from_rgb(grey, "A", 5.0, linear=True)
    >>> scene.weights.shape, float(scene.weights[0, 0, 0])
    ((3, 4, 6), 0.25)
    """
    grid = wavelength_grid(wavelength_nm)
    check_choice("method", method, Method)
    check_choice("out_of_gamut", out_of_gamut, OutOfGamut)
    codes = checked_picture(picture, out_of_gamut)
    if not codes.any():
        raise InputError("a black picture cannot be given a luminance: all its values are 0")
    light = photons_from_energy(relative_energy(illuminant, grid), grid)
    reflectance, lost = srgb_reflectance(grid), 0.0
    if method == "mallett-yuksel":
        weights = srgb_weights(codes, space, linear=linear, out_of_gamut=out_of_gamut)
    else:
        # A colour that sRGB lacks may be one that a surface has: the smooth method tells by itself.
        values = linear_srgb_of(display_values(codes), space, linear=linear)
        clipped = np.clip(values, 0.0, 1.0) if out_of_gamut == "clip" else values
        weights, reflectance, lost = raised(clipped, grid, tolerance)
    scene = Scene(weights, reflectance * light, grid, distance_m, width_m, (), name, reflectance, lost)
    return scene.with_mean_luminance(mean_luminance_cd_m2, rule)


def from_srgb(
    picture: ArrayLike,
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    method: Method = "mallett-yuksel",
    wavelength_nm: ArrayLike = PICTURE_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
    name: str = "picture",
) -> Scene:
    """An sRGB display picture as a flat print of matt colours, evenly lit: `from_rgb` for what most pictures are.

    Parameters
    ----------
    picture
        (rows, cols, 3) display sRGB: unsigned integers of 8 or 16 bits, or floats from 0 to 1.
    illuminant, mean_luminance_cd_m2, method, wavelength_nm, distance_m, width_m, rule, name
        As for `from_rgb`.

    Returns
    -------
    Scene
        By "mallett-yuksel" (3, rows, cols) weights, which are linear sRGB, over three spectra; nothing is lost in the
        raising but float32's rounding.

    Raises
    ------
    InputError
        As for `from_rgb`.

    Examples
    --------
    >>> scene = from_srgb(np.full((4, 6, 3), 128, np.uint8), "A", 5.0)
    >>> scene.weights.shape, round(float(scene.weights[0, 0, 0]), 4), round(scene.mean_luminance_cd_m2(), 6)
    ((3, 4, 6), 0.2159, 5.0)
    """
    return from_rgb(
        picture,
        illuminant,
        mean_luminance_cd_m2,
        method=method,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=name,
    )


def from_hdr(
    picture: ArrayLike,
    white_luminance_cd_m2: float | None = None,
    *,
    mean_luminance_cd_m2: float | None = None,
    white: str | float | Spectrum = "D65",
    space: str = "sRGB",
    out_of_gamut: OutOfGamut = "refuse",
    wavelength_nm: ArrayLike = PICTURE_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
    name: str = "picture",
) -> Scene:
    """A picture of light, of any range, as the light that it shows.

    Parameters
    ----------
    picture
        (rows, cols, 3) floats proportional to light; above 1 is brighter than white. Below 0 by 1e-3 of the pixel's
        brightest value, or 1e-7 of the picture's, is rounding and taken for 0; by more is a colour outside sRGB.
    white_luminance_cd_m2
        Luminance of red = green = blue = 1. Give this or the mean.
    mean_luminance_cd_m2
        Mean over all samples.
    white
        Spectrum of white light, as for `photosite.color.illuminants.illuminant`; other colours are it through Mallett
        and Yuksel's filters. Under any but "D65" colours shift with it, as in a room with that light.
    space, out_of_gamut, wavelength_nm, distance_m, width_m, rule, name
        As for `from_rgb`.

    Returns
    -------
    Scene
        (3, rows, cols) weights, linear sRGB in float32: the range of the picture is kept. Its reflectances are not
        known: what shines and what is lit cannot be told apart.

    Raises
    ------
    InputError
        If the picture is not one, is black, has values that are infinite or no numbers, or colours outside sRGB that
        are not to be clipped; if none or both of the luminances are given, or one cannot be.

    Examples
    --------
    >>> lamp = np.zeros((2, 2, 3)); lamp[0, 0] = 1e4; lamp[1, 1] = 1e-2
    >>> scene = from_hdr(lamp, 100.0)
    >>> float(luminance_cd_m2(scene.radiance(0, 0), scene.wavelength_nm).round(2))
    1000000.0
    """
    if (white_luminance_cd_m2 is None) == (mean_luminance_cd_m2 is None):
        raise InputError("say how bright the picture is: white_luminance_cd_m2 or mean_luminance_cd_m2, one of them")
    grid = wavelength_grid(wavelength_nm)
    codes = np.asarray(picture)
    if codes.ndim != 3 or codes.shape[2] != 3 or codes.size == 0 or not np.issubdtype(codes.dtype, np.floating):
        raise InputError(
            f"a picture of light is (rows, cols, 3) of floats, not {codes.shape} of {codes.dtype}; "
            "a display picture is from_rgb's"
        )
    if not np.isfinite(codes).all():
        raise InputError("a picture of light holds finite values; some are infinite or no numbers")
    weights = srgb_weights(codes, space, linear=True, out_of_gamut=out_of_gamut, highest=math.inf)
    if not weights.any():
        raise InputError("a black picture cannot be given a luminance: all its values are 0")
    if not np.isfinite(weights.max()):
        raise InputError("a picture of light holds values beyond 3e38, which single precision does not hold; scale it")
    light = photons_from_energy(relative_energy(white, grid), grid)
    scene = Scene(weights, srgb_reflectance(grid) * light, grid, distance_m, width_m, (), name)
    if mean_luminance_cd_m2 is not None:
        return scene.with_mean_luminance(mean_luminance_cd_m2, rule)
    assert white_luminance_cd_m2 is not None
    if not (np.isfinite(white_luminance_cd_m2) and white_luminance_cd_m2 > 0):
        raise InputError(f"the luminance of white is above 0 cd/m2, not {white_luminance_cd_m2}")
    return scene.scaled(white_luminance_cd_m2 / float(luminance_cd_m2(scene.basis.sum(axis=0), grid, rule)))
