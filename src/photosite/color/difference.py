"""Color differences between tristimulus values under D65 (CIE 015:2018), computed by colour-science.

All functions take (..., 3) XYZ with Y = 1 for the perfect white under D65, return (...,) differences, and raise
`InputError` for other shapes and values that are not finite.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colour_science import colour_science
from photosite.color.tristimulus import lab


def delta_e_76(xyz: ArrayLike, other_xyz: ArrayLike) -> NDArray[np.float64]:
    """Return the CIE 1976 color difference: the distance in L*a*b*.

    Examples
    --------
    >>> from photosite.color.tristimulus import D65_WHITE_XYZ
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
    >>> from photosite.color.tristimulus import D65_WHITE_XYZ
    >>> float(delta_e_94(D65_WHITE_XYZ, 0.184186519 * D65_WHITE_XYZ).round(3))    # no chroma: as CIE 1976
    50.0
    """
    return np.asarray(colour_science().delta_E(lab(reference_xyz), lab(xyz), method="CIE 1994"), dtype=np.float64)


def delta_e_2000(xyz: ArrayLike, other_xyz: ArrayLike) -> NDArray[np.float64]:
    """Return the CIEDE2000 color difference with kL = kC = kH = 1 (ISO/CIE 11664-6:2014).

    Examples
    --------
    >>> from photosite.color.tristimulus import D65_WHITE_XYZ
    >>> float(delta_e_2000(D65_WHITE_XYZ, D65_WHITE_XYZ))
    0.0
    """
    return np.asarray(colour_science().delta_E(lab(xyz), lab(other_xyz), method="CIE 2000"), dtype=np.float64)
