"""Pictures as scenes: spectra from colors.

A display picture (`from_rgb`) becomes a flat print: its colors are reflectances under a light. A picture
of light of any range (`from_hdr`) becomes a scene whose colors are radiances.
"""

from __future__ import annotations

import math
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import luminance_cd_m2
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import Rule, Spectrum, photons_from_energy, wavelength_grid
from photosite.color.tables import spectra
from photosite.errors import InputError
from photosite.scene.picture_colors import (
    Method,
    OutOfGamut,
    checked_picture,
    display_values,
    linear_srgb_of,
    srgb_weights,
)
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.scene.sigmoid import raised
from photosite.values.choice import check_choice
from photosite.values.validated import Validated

__all__ = ["from_hdr", "from_rgb", "srgb_reflectance"]
__dir__ = __all__.copy

PICTURE_WAVELENGTH_NM: NDArray[np.float64] = np.arange(380.0, 781.0, 5.0)
"""Wavelengths of the basis reflectances. On a grid of 10 nm the peaks of D65 change a red by a CIEDE2000 of 0.6; here
no color of sRGB changes by more than 0.03."""
PICTURE_WAVELENGTH_NM.flags.writeable = False


class PictureArguments(TypedDict, total=False):
    """Wavelengths, place and name of a picture's scene, with the defaults of `PictureOptions`."""

    wavelength_nm: ArrayLike
    distance_m: float
    width_m: float | None
    rule: Rule
    name: str


class PictureOptions(Validated):
    """Wavelengths, place and name of a picture's scene.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,) of the scene, from 380 to 780 nm.
    distance_m, width_m, name
        As for `photosite.scene.scene.Scene`.
    rule
        Integration rule of the luminance.
    """

    wavelength_nm: Any = PICTURE_WAVELENGTH_NM
    distance_m: Any = DEFAULT_DISTANCE_M
    width_m: Any = None
    rule: Rule = "trapezoid"
    name: str = "picture"

    def scene(self, weights: NDArray[np.float32], basis: NDArray[np.float64], *others: Any) -> Scene:
        """Return the scene of weights and basis, and of what follows the name."""
        return Scene(weights, basis, self.wavelength_nm, self.distance_m, self.width_m, (), self.name, *others)


def srgb_reflectance(wavelength_nm: ArrayLike = PICTURE_WAVELENGTH_NM) -> NDArray[np.float64]:
    """Return the reflectances (3, wavelengths) of sRGB's red, green and blue; linear between 5 nm entries.

    They are not negative and their sum is 1 at every wavelength, so that linear sRGB from 0 to 1 gives a valid
    reflectance. Under D65 it has the color that it was made from; of all such reflectances it is a smooth one.

    Raises
    ------
    InputError
        If a wavelength is outside 380 to 780 nm.

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
    primaries = list(spectra("srgb_reflectances").values())
    first, last = primaries[0].wavelength_nm[[0, -1]]
    if grid[0] < first or grid[-1] > last:
        ends = (float(grid[0]), float(grid[-1]))
        raise InputError("wavelength_nm", value=ends, expected=f"within {first:g} to {last:g} nm for a picture")
    return np.stack([primary.at(grid) for primary in primaries])


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
    **options: Unpack[PictureArguments],
) -> Scene:
    """Return a picture, by default of sRGB, as a flat, evenly lit print of matte colors.

    Every pixel's color becomes a reflectance under the illuminant. Display white is the perfect white. Shadows, gloss
    and light in the picture become colors of the print.

    Parameters
    ----------
    picture
        (rows, cols, 3): unsigned integers of 8 or 16 bits, or floats from 0 to 1, with 1e-6 for rounding.
    illuminant
        As for `photosite.color.illuminants.illuminant`. Under "D65" the scene has the picture's colors.
    mean_luminance_cd_m2
        Mean over all samples.
    space
        The RGB space: one of `photosite.scene.picture_colors.SPACES`, such as "sRGB", "Display P3", "Adobe RGB" or
        "BT.2020".
    linear
        Whether the values are proportional to light. False: they are encoded by the space's own curve.
    method
        "mallett-yuksel": three basis reflectances weighted by sRGB; three spectra, exact, for colors of sRGB only.
        "jakob-hanika": a smooth reflectance for each color (`photosite.scene.sigmoid`), reduced to few spectra; for
        all colors that a surface can have. It takes about a minute for a million colors.
    out_of_gamut
        What to do with colors that the method cannot represent: "refuse" them, or "clip" red, green and blue to sRGB.
    tolerance
        Largest RMS error of the reduction with "jakob-hanika", relative to the reflectances' RMS; it does not change
        colors under D65.
    **options
        Fields of `PictureOptions`: `wavelength_nm`, `distance_m`, `width_m`, `rule` and `name`.

    Returns
    -------
    Scene
        With "mallett-yuksel", (3, rows, cols) weights over three spectra: linear sRGB, exact to float32.

    Raises
    ------
    InputError
        If the picture is black or has colors that cannot be represented, or an argument is invalid.

    Notes
    -----
    Spaces whose white is not D65 are adapted to it by Bradford's transform. Integrated again under D65 on the 5 nm
    grid, colors of sRGB differ by a CIEDE2000 below 0.03, by either method; on one of 1 nm below 0.08 and 0.04. The
    smooth reflectances are from 0 to 1; reduced ones exceed it by the error (0.04 at a tolerance of 1e-3).

    Examples
    --------
    >>> scene = from_rgb(np.full((4, 6, 3), 128, np.uint8), "A", 5.0)
    >>> scene.weights.shape, round(float(scene.weights[0, 0, 0]), 4), round(scene.mean_luminance_cd_m2(), 6)
    ((3, 4, 6), 0.2159, 5.0)
    """
    given = PictureOptions(**dict[str, Any](options))
    grid = wavelength_grid(given.wavelength_nm)
    check_choice("method", method, Method)
    check_choice("out_of_gamut", out_of_gamut, OutOfGamut)
    codes = checked_picture(picture, out_of_gamut)
    if not codes.any():
        raise InputError("a black picture cannot be scaled to a luminance: all its values are 0")
    light = photons_from_energy(relative_energy(illuminant, grid), grid)
    reflectance, lost = srgb_reflectance(grid), 0.0
    if method == "mallett-yuksel":
        weights = srgb_weights(codes, space, linear=linear, out_of_gamut=out_of_gamut)
    else:
        # A surface can have colors outside sRGB; the smooth method itself rejects impossible ones.
        values = linear_srgb_of(display_values(codes), space, linear=linear)
        clipped = np.clip(values, 0.0, 1.0) if out_of_gamut == "clip" else values
        weights, reflectance, lost = raised(clipped, grid, tolerance)
    scene = given.scene(weights, reflectance * light, reflectance, lost)
    return scene.with_mean_luminance(mean_luminance_cd_m2, given.rule)


def from_hdr(
    picture: ArrayLike,
    white_luminance_cd_m2: float | None = None,
    *,
    mean_luminance_cd_m2: float | None = None,
    white: str | float | Spectrum = "D65",
    space: str = "sRGB",
    out_of_gamut: OutOfGamut = "refuse",
    **options: Unpack[PictureArguments],
) -> Scene:
    """Return a picture of light, of any range, as a scene of that light.

    Parameters
    ----------
    picture
        (rows, cols, 3) floats proportional to light; above 1 is brighter than white. Negative values up to 1e-3 of the
        pixel's brightest value, or 1e-7 of the picture's, are rounding and become 0; others are outside sRGB.
    white_luminance_cd_m2
        Luminance of red = green = blue = 1. Give either this or the mean.
    mean_luminance_cd_m2
        Mean over all samples.
    white
        Spectrum of white light, as for `photosite.color.illuminants.illuminant`; other colors are
        this light through the filters of Mallett and Yuksel. Any light but "D65" shifts all colors.
    space, out_of_gamut, **options
        As for `from_rgb`.

    Returns
    -------
    Scene
        (3, rows, cols) weights, linear sRGB in float32, of the picture's full range. Its reflectances are unknown:
        light sources and lit surfaces cannot be distinguished.

    Raises
    ------
    InputError
        If the picture is black or has colors outside sRGB that are not to be clipped, or an argument is invalid.

    Examples
    --------
    >>> lamp = np.zeros((2, 2, 3)); lamp[0, 0] = 1e4; lamp[1, 1] = 1e-2
    >>> scene = from_hdr(lamp, 100.0)
    >>> float(luminance_cd_m2(scene.radiance(0, 0), scene.wavelength_nm).round(2))
    1000000.0
    """
    if (white_luminance_cd_m2 is None) == (mean_luminance_cd_m2 is None):
        hint = "Give white_luminance_cd_m2 or mean_luminance_cd_m2"
        raise InputError("a picture of light needs one luminance", hint=hint)
    given = PictureOptions(**dict[str, Any](options))
    grid = wavelength_grid(given.wavelength_nm)
    codes = np.asarray(picture)
    if codes.ndim != 3 or codes.shape[2] != 3 or codes.size == 0 or not np.issubdtype(codes.dtype, np.floating):
        value, expected = f"{codes.shape} of {codes.dtype}", "(rows, cols, 3) of floats"
        raise InputError("picture", value=value, expected=expected, hint="Use from_rgb for a display picture")
    if not np.isfinite(codes).all():
        raise InputError("picture", expected="finite everywhere")
    weights = srgb_weights(codes, space, linear=True, out_of_gamut=out_of_gamut, highest=math.inf)
    if not weights.any():
        raise InputError("a black picture cannot be scaled to a luminance: all its values are 0")
    if not np.isfinite(weights.max()):
        raise InputError("picture", expected="at most 3e38, the limit of single precision")
    light = photons_from_energy(relative_energy(white, grid), grid)
    scene = given.scene(weights, srgb_reflectance(grid) * light)
    if mean_luminance_cd_m2 is not None:
        return scene.with_mean_luminance(mean_luminance_cd_m2, given.rule)
    assert white_luminance_cd_m2 is not None
    if not (np.isfinite(white_luminance_cd_m2) and white_luminance_cd_m2 > 0):
        raise InputError("white_luminance_cd_m2", value=white_luminance_cd_m2, expected="above 0")
    return scene.scaled(white_luminance_cd_m2 / float(luminance_cd_m2(scene.basis.sum(axis=0), grid, given.rule)))
