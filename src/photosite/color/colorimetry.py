"""Colorimetry: color-matching functions, luminance, XYZ, Lab, sRGB and color differences.

Spectral radiance is in photons/s/sr/m2/nm unless a name says energy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.spectrum import Rule, energy_from_photons, integration_weights, wavelength_grid
from photosite.color.tables import spectra
from photosite.errors import InputError

LUMINOUS_EFFICACY_LM_W = 683.0
"""K_m of photopic vision, rounded as CIE 015:2018 allows."""

D65_XY = (0.3127, 0.3290)
"""Chromaticity of D65 for the 2 degree observer, to the four digits of IEC 61966-2-1."""

D65_WHITE_XYZ: NDArray[np.float64] = np.array([D65_XY[0] / D65_XY[1], 1.0, (1.0 - D65_XY[0] - D65_XY[1]) / D65_XY[1]])
"""XYZ of the perfect white under D65, Y = 1."""
D65_WHITE_XYZ.flags.writeable = False

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""XYZ to cone responses (ICC.1:2022, annex E)."""

_CAT02 = np.array([[0.7328, 0.4296, -0.1624], [-0.7036, 1.6975, 0.0061], [0.0030, 0.0136, 0.9834]])
"""XYZ to cone responses (CIE 159:2004)."""

_PRIMARIES_XY = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
"""Chromaticities of red, green and blue (IEC 61966-2-1, ITU-R BT.709)."""


def color_matching_functions(wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Return the CIE 1931 2 degree observer, (3, wavelengths): x, y and z bar.

    Linear between the 1 nm entries, 0 outside 360 to 830 nm.

    Examples
    --------
    >>> color_matching_functions([555.0])[1]
    array([1.])
    """
    return np.stack([bar.at(wavelength_nm) for bar in spectra("cie_1931_observer").values()])


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


# The sRGB display (IEC 61966-2-1): its primaries and its encoding.


_PRIMARIES = np.column_stack([_PRIMARIES_XY, 1.0 - _PRIMARIES_XY.sum(axis=1)]).T
XYZ_FROM_SRGB: NDArray[np.float64] = _PRIMARIES * np.linalg.solve(_PRIMARIES, D65_WHITE_XYZ)
"""(3, 3), linear sRGB to XYZ (Y = 1 for white), from the primaries; the standard prints it rounded."""
XYZ_FROM_SRGB.flags.writeable = False

SRGB_FROM_XYZ: NDArray[np.float64] = np.asarray(np.linalg.inv(XYZ_FROM_SRGB), dtype=np.float64)
"""(3, 3), XYZ to linear sRGB."""
SRGB_FROM_XYZ.flags.writeable = False


PUBLISHED_SRGB_FROM_XYZ: NDArray[np.float64] = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)
PUBLISHED_XYZ_FROM_SRGB: NDArray[np.float64] = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
"""(3, 3), XYZ to linear sRGB and back, to the four digits of IEC 61966-2-1."""
PUBLISHED_SRGB_FROM_XYZ.flags.writeable = PUBLISHED_XYZ_FROM_SRGB.flags.writeable = False


def encode_srgb(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Encode linear sRGB of any shape for the display, clipped to 0..1.

    References
    ----------
    IEC 61966-2-1:1999, 5.2: 12.92 x up to 0.0031308, 1.055 x^(1/2.4) - 0.055 above.

    Examples
    --------
    >>> encode_srgb(np.array([-0.1, 0.0, 0.002, 0.5, 1.0, 3.0], np.float32)).round(4)
    array([0.    , 0.    , 0.0258, 0.7354, 1.    , 1.    ], dtype=float32)
    """
    clipped = np.clip(linear, 0.0, 1.0, dtype=np.float32)
    # 1.055 p - 0.055, written so that white is 1 exactly.
    curve = 1 - np.float32(1.055) * (1 - clipped ** np.float32(1 / 2.4))
    return np.asarray(np.where(clipped <= np.float32(0.0031308), np.float32(12.92) * clipped, curve))


def srgb_from_light(linear: ArrayLike) -> NDArray[np.float64]:
    """Encode linear sRGB from 0 to 1 in double precision (IEC 61966-2-1:1999, 5.2).

    Examples
    --------
    >>> srgb_from_light([0.0, 0.002, 0.5]).round(4)
    array([0.    , 0.0258, 0.7354])
    """
    light = np.asarray(linear, dtype=np.float64)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


def light_from_srgb(encoded: ArrayLike) -> NDArray[np.float64]:
    """Decode sRGB from 0 to 1 to linear sRGB in double precision (IEC 61966-2-1:1999, 5.2).

    Examples
    --------
    >>> light_from_srgb([0.0, 0.0258, 0.7354]).round(3)
    array([0.   , 0.002, 0.5  ])
    """
    codes = np.asarray(encoded, dtype=np.float64)
    return np.where(codes <= srgb_from_light(0.0031308), codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def xyz_of_chromaticity(xy: ArrayLike) -> NDArray[np.float64]:
    """Return XYZ (3,) of a chromaticity x, y with Y = 1.

    Examples
    --------
    >>> xyz_of_chromaticity([0.25, 0.5])
    array([0.5, 1. , 0.5])
    """
    x, y = np.asarray(xy, dtype=np.float64)
    return np.array([x * (1 / y), 1.0, (1 - (x + y)) * (1 / y)])


def cat02_adaptation(white_xyz: ArrayLike, onto_xyz: ArrayLike) -> NDArray[np.float64]:
    """Return the (3, 3) matrix that adapts XYZ seen under a white to another white: von Kries in CAT02.

    Examples
    --------
    >>> bool(np.allclose(cat02_adaptation([1.1, 1.0, 0.36], D65_WHITE_XYZ) @ [1.1, 1.0, 0.36], D65_WHITE_XYZ))
    True
    """
    gains = (_CAT02 @ np.asarray(onto_xyz, dtype=np.float64)) / (_CAT02 @ np.asarray(white_xyz, dtype=np.float64))
    return np.asarray(np.linalg.inv(_CAT02) @ np.diag(gains) @ _CAT02)


def adaptation_to_d65(white_xyz: ArrayLike) -> NDArray[np.float64]:
    """Return the (3, 3) matrix that adapts XYZ seen under a white to D65 (Y = 1): the linearized Bradford transform.

    Raises
    ------
    InputError
        If the white is not a color of light: a cone response of it is not above 0.

    References
    ----------
    ICC.1:2022, annex E; K. M. Lam, "Metamerism and colour constancy", Ph.D. thesis, University of Bradford, 1985.

    Examples
    --------
    >>> bool(np.allclose(adaptation_to_d65([1.1, 1.0, 0.36]) @ [1.1, 1.0, 0.36], D65_WHITE_XYZ))
    True
    """
    white = np.asarray(white_xyz, dtype=np.float64)
    cones = _BRADFORD @ white
    if white.shape != (3,) or not (cones > 0).all():
        raise InputError("white_xyz", value=white.tolist(), expected="the XYZ of a light")
    return np.asarray(np.linalg.inv(_BRADFORD) @ np.diag(_BRADFORD @ D65_WHITE_XYZ / cones) @ _BRADFORD)


# Color differences between tristimulus values under D65 (CIE 015:2018), computed by colour-science.
#
# All functions take (..., 3) XYZ with Y = 1 for the perfect white under D65, return (...,) differences, and raise
# `InputError` for other shapes and values that are not finite.


def delta_e_76(xyz: ArrayLike, other_xyz: ArrayLike) -> NDArray[np.float64]:
    """Return the CIE 1976 color difference: the distance in L*a*b*.

    Examples
    --------
    >>> from photosite.color.colorimetry import D65_WHITE_XYZ
    >>> float(delta_e_76(D65_WHITE_XYZ, 0.184186519 * D65_WHITE_XYZ).round(3))    # L* 100 and L* 50
    50.0
    """
    return np.asarray(np.linalg.norm(lab(xyz) - lab(other_xyz), axis=-1), dtype=np.float64)


def delta_e_94(reference_xyz: ArrayLike, xyz: ArrayLike) -> NDArray[np.float64]:
    """Return the CIE 1994 color difference with kL = kC = kH = 1 and the constants 0.045 and 0.015.

    The formula is not symmetric: chroma and hue are weighted by the chroma of the reference.

    References
    ----------
    CIE 116-1995, "Industrial color-difference evaluation".

    Examples
    --------
    >>> from photosite.color.colorimetry import D65_WHITE_XYZ
    >>> float(delta_e_94(D65_WHITE_XYZ, 0.184186519 * D65_WHITE_XYZ).round(3))    # no chroma: as CIE 1976
    50.0
    """
    return np.asarray(colour_science().delta_E(lab(reference_xyz), lab(xyz), method="CIE 1994"), dtype=np.float64)


def delta_e_2000(xyz: ArrayLike, other_xyz: ArrayLike) -> NDArray[np.float64]:
    """Return the CIEDE2000 color difference with kL = kC = kH = 1 (ISO/CIE 11664-6:2014).

    Examples
    --------
    >>> from photosite.color.colorimetry import D65_WHITE_XYZ
    >>> float(delta_e_2000(D65_WHITE_XYZ, D65_WHITE_XYZ))
    0.0
    """
    return np.asarray(colour_science().delta_E(lab(xyz), lab(other_xyz), method="CIE 2000"), dtype=np.float64)


def colour_science() -> Any:
    """Return the `colour` package.

    Importing it takes about a second, so that happens only for Lab, color differences and the less common RGB spaces;
    `photosite.color.tables` has the spectra. The import switches NumPy to legacy printing; this function restores the
    print options.

    Examples
    --------
    >>> float(colour_science().SDS_ILLUMINANTS["A"].shape.interval)
    5.0
    """
    options = np.get_printoptions()
    try:
        import colour
    finally:
        np.set_printoptions(**options)
    return colour
