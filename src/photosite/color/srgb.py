"""The sRGB display (IEC 61966-2-1): its primaries and its encoding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.color.tristimulus import D65_WHITE_XYZ

_PRIMARIES_XY = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
"""Chromaticities of red, green and blue (IEC 61966-2-1, ITU-R BT.709)."""


def _xyz_from_srgb() -> NDArray[np.float64]:
    """Return the primaries' XYZ as columns, scaled so that (1, 1, 1) is the white."""
    primaries = np.column_stack([_PRIMARIES_XY, 1.0 - _PRIMARIES_XY.sum(axis=1)]).T
    return np.asarray(primaries * np.linalg.solve(primaries, D65_WHITE_XYZ))


XYZ_FROM_SRGB: NDArray[np.float64] = _xyz_from_srgb()
"""(3, 3), linear sRGB to XYZ (Y = 1 for white), from the primaries; the standard prints it rounded."""
XYZ_FROM_SRGB.flags.writeable = False

SRGB_FROM_XYZ: NDArray[np.float64] = np.asarray(np.linalg.inv(XYZ_FROM_SRGB), dtype=np.float64)
"""(3, 3), XYZ to linear sRGB."""
SRGB_FROM_XYZ.flags.writeable = False


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
