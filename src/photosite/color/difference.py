"""Colour differences between tristimulus values, in the sense of CIE 015:2018, by colour-science."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.cie import colour_science
from photosite.errors import InputError

D65_XY = (0.3127, 0.3290)
"""Chromaticity of D65 for the 2 degree observer, to the four places that IEC 61966-2-1 gives."""

D65_WHITE_XYZ: NDArray[np.float64] = np.array([D65_XY[0] / D65_XY[1], 1.0, (1.0 - D65_XY[0] - D65_XY[1]) / D65_XY[1]])
"""The perfect white under D65, Y = 1."""
D65_WHITE_XYZ.flags.writeable = False


def lab(xyz: ArrayLike) -> NDArray[np.float64]:
    """CIE 1976 L*a*b* of tristimulus values under D65.

    Parameters
    ----------
    xyz
        (..., 3), Y = 1 for the perfect white under D65. Slightly negative values, as a fitted matrix may
        give, follow the formula's linear part.

    Returns
    -------
    numpy.ndarray
        (..., 3).

    Raises
    ------
    InputError
        If the last axis is not 3 long or a value is not finite.

    Examples
    --------
    >>> lab(D65_WHITE_XYZ).round(6) + 0.0
    array([100.,   0.,   0.])
    """
    values = np.asarray(xyz, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] != 3:
        raise InputError(f"tristimulus values are (..., 3), not an array of shape {values.shape}")
    if not np.isfinite(values).all():
        raise InputError("tristimulus values must be finite")
    return np.asarray(colour_science().XYZ_to_Lab(values, illuminant=np.array(D65_XY)), dtype=np.float64)


def delta_e_76(xyz: ArrayLike, other_xyz: ArrayLike) -> NDArray[np.float64]:
    """CIE 1976 colour difference: the distance in L*a*b*.

    Parameters
    ----------
    xyz, other_xyz
        (..., 3), Y = 1 for the perfect white under D65.

    Returns
    -------
    numpy.ndarray
        (...,).

    Raises
    ------
    InputError
        As `lab`.

    Examples
    --------
    >>> float(delta_e_76(D65_WHITE_XYZ, 0.184186519 * D65_WHITE_XYZ).round(3))    # L* 100 and L* 50
    50.0
    """
    return np.asarray(np.linalg.norm(lab(xyz) - lab(other_xyz), axis=-1), dtype=np.float64)


def delta_e_94(reference_xyz: ArrayLike, xyz: ArrayLike) -> NDArray[np.float64]:
    """CIE 1994 colour difference, with its weights kL = kC = kH = 1 and CIE 116's constants 0.045 and 0.015.

    Parameters
    ----------
    reference_xyz, xyz
        (..., 3), Y = 1 for the perfect white under D65. The formula is not symmetric: chroma and hue are weighed by
        the chroma of the first.

    Returns
    -------
    numpy.ndarray
        (...,).

    Raises
    ------
    InputError
        As `lab`.

    Notes
    -----
    CIE 116-1995, "Industrial colour-difference evaluation".

    Examples
    --------
    >>> gray = 0.184186519 * D65_WHITE_XYZ
    >>> float(delta_e_94(D65_WHITE_XYZ, gray).round(3))    # no chroma: as CIE 1976
    50.0
    """
    difference = colour_science().delta_E(lab(reference_xyz), lab(xyz), method="CIE 1994")
    return np.asarray(difference, dtype=np.float64)


def delta_e_2000(xyz: ArrayLike, other_xyz: ArrayLike) -> NDArray[np.float64]:
    """CIEDE2000 colour difference, with its weights kL = kC = kH = 1 (ISO/CIE 11664-6:2014).

    Parameters
    ----------
    xyz, other_xyz
        (..., 3), Y = 1 for the perfect white under D65.

    Returns
    -------
    numpy.ndarray
        (...,).

    Raises
    ------
    InputError
        As `lab`.

    Examples
    --------
    >>> float(delta_e_2000(D65_WHITE_XYZ, D65_WHITE_XYZ))
    0.0
    """
    difference = colour_science().delta_E(lab(xyz), lab(other_xyz), method="CIE 2000")
    return np.asarray(difference, dtype=np.float64)
