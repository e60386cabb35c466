"""The numbers of a picture: codes to values, encoded to linear, one space's red, green and blue to sRGB's."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.cie import colour_science
from photosite.errors import InputError, did_you_mean

Array = NDArray[np.float64]

OutOfGamut = Literal["refuse", "clip"]

SPACES: dict[str, str] = {
    "sRGB": "sRGB",
    "Display P3": "Display P3",
    "Adobe RGB": "Adobe RGB (1998)",
    "Adobe RGB (1998)": "Adobe RGB (1998)",
    "BT.2020": "ITU-R BT.2020",
    "ProPhoto RGB": "ProPhoto RGB",
}
"""Spaces by the name one asks for, and their names in colour-science."""

_ROUNDING = 1e-6
"""Outside the gamut by this is rounding."""


def display_values(picture: ArrayLike) -> Array:
    """(rows, cols, 3) values from 0 to 1 of a display picture, checked; still encoded.

    Raises
    ------
    InputError
        If it has another shape or type, or values outside 0 to 1.

    Examples
    --------
    >>> display_values(np.array([[[0, 51, 255]]], np.uint8))
    array([[[0. , 0.2, 1. ]]])
    """
    codes = np.asarray(picture)
    if codes.ndim != 3 or codes.shape[2] != 3 or codes.size == 0:
        raise InputError(f"a picture is (rows, cols, 3), red, green and blue, not an array of shape {codes.shape}")
    if codes.dtype in (np.uint8, np.uint16):
        return codes / float(np.iinfo(codes.dtype).max)
    if not np.issubdtype(codes.dtype, np.floating):
        raise InputError(f"a picture holds unsigned integers of 8 or 16 bits or floats from 0 to 1, not {codes.dtype}")
    if not ((codes >= 0) & (codes <= 1)).all():
        raise InputError(
            "a picture's values lie from 0 to 1; some are outside or no numbers (a picture of light is from_hdr's)"
        )
    return codes.astype(np.float64)


def plain_srgb(values: Array) -> Array:
    """Encoded sRGB from 0 to 1 as linear sRGB."""
    return np.asarray(colour_science().models.eotf_sRGB(values), dtype=np.float64)


def linear_srgb_of(values: Array, space: str, *, linear: bool) -> Array:
    """(rows, cols, 3) of a space as linear sRGB; below 0 or above 1 where sRGB has no such colour.

    Raises
    ------
    InputError
        If the space is unknown.

    Examples
    --------
    >>> linear_srgb_of(np.array([[[1.0, 1.0, 1.0]]]), "Display P3", linear=False).round(4)
    array([[[1., 1., 1.]]])
    """
    known = {name.lower(): name for name in SPACES}
    if space.lower() not in known:
        raise InputError(f"unknown RGB space '{space}'; {did_you_mean(space, SPACES)}")
    found = SPACES[known[space.lower()]]
    if found == "sRGB":
        return values if linear else plain_srgb(values)
    source = colour_science().RGB_COLOURSPACES[found]
    light = values if linear else np.asarray(source.cctf_decoding(values), dtype=np.float64)
    return light @ _matrix_to_srgb(found).T


@lru_cache(maxsize=8)
def _matrix_to_srgb(found: str) -> Array:
    """(3, 3) from the primaries themselves, so that white stays white: published matrices have four digits."""
    colour = colour_science()
    source, target = colour.RGB_COLOURSPACES[found], colour.RGB_COLOURSPACES["sRGB"]
    to_xyz, from_xyz = (
        colour.models.normalised_primary_matrix(space.primaries, space.whitepoint) for space in (source, target)
    )
    whites = (colour.xy_to_XYZ(space.whitepoint) for space in (source, target))
    adapt = colour.adaptation.matrix_chromatic_adaptation_VonKries(*whites, transform="Bradford")
    return np.asarray(np.linalg.inv(from_xyz) @ adapt @ to_xyz, dtype=np.float64)


def within_gamut(values: Array, out_of_gamut: OutOfGamut, highest: float = 1.0) -> Array:
    """Linear sRGB between 0 and the highest value, as far as rounding goes; others are refused or clipped.

    Raises
    ------
    InputError
        If colours lie outside and are to be refused; with how many.
    """
    if out_of_gamut not in get_args(OutOfGamut):
        raise InputError(f"out_of_gamut is 'refuse' or 'clip', not {out_of_gamut!r}")
    scale = 1.0 if np.isfinite(highest) else max(1.0, float(values.max()))
    outside = (values < -_ROUNDING * scale) | (values > highest + _ROUNDING)
    if out_of_gamut == "refuse" and outside.any():
        count = int(outside.any(axis=2).sum())
        other = ", or method='jakob-hanika'" if np.isfinite(highest) else ""
        raise InputError(
            f"{count} of {values.shape[0] * values.shape[1]} pixels have colours that sRGB lacks; "
            f"ask for out_of_gamut='clip'{other}"
        )
    return np.clip(values, 0.0, highest)
