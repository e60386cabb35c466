"""The numbers of a picture: codes to values, encoded to linear, one space's red, green and blue to sRGB's."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colour_science import colour_science
from photosite.errors import InputError, did_you_mean
from photosite.values.validated import check_choice

Array = NDArray[np.float64]

Method = Literal["mallett-yuksel", "jakob-hanika"]
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
_LIGHT_ROUNDING = 1e-3, 1e-7
"""Of light, below 0 by this part of the pixel's own brightest value, or of the picture's, is rounding: of 16-bit floats
that a change of primaries multiplies, and of single precision."""
_BLOCK = 1 << 20
"""Values that are held in double precision."""


class OutsideSrgbError(InputError):
    """Colours that sRGB lacks, and nobody said what becomes of them.

    Parameters
    ----------
    pixels, of
        How many have such colours, and how many there are.
    advice
        What may be asked for.
    """

    def __init__(self, pixels: int, of: int, advice: str) -> None:
        self.counted = f"{pixels} of {of} pixels have colours that sRGB lacks"
        super().__init__(f"{self.counted}; {advice}")


def checked_picture(picture: ArrayLike, out_of_gamut: OutOfGamut = "refuse") -> NDArray[Any]:
    """(rows, cols, 3) codes of a display picture, or values from 0 to 1; still encoded.

    Floats outside by rounding, or by anything if they are to be clipped, are clipped.

    Raises
    ------
    InputError
        If it has another shape or type, or values outside 0 to 1.
    """
    codes = np.asarray(picture)
    if codes.ndim != 3 or codes.shape[2] != 3 or codes.size == 0:
        raise InputError(f"a picture is (rows, cols, 3), red, green and blue, not an array of shape {codes.shape}")
    if codes.dtype in (np.uint8, np.uint16):
        return codes
    if not np.issubdtype(codes.dtype, np.floating):
        raise InputError(f"a picture holds unsigned integers of 8 or 16 bits or floats from 0 to 1, not {codes.dtype}")
    low, high = codes.min(), codes.max()
    if not (np.isfinite(low) and np.isfinite(high)):  # a minimum is no number where one value is none
        raise InputError("a picture's values lie from 0 to 1; some are infinite or no numbers")
    if out_of_gamut != "clip" and not (low >= -_ROUNDING and high <= 1 + _ROUNDING):
        raise InputError(
            f"a picture's values lie from 0 to 1, not from {low:.6g} to {high:.6g}; ask for out_of_gamut='clip', or "
            "give light of any range to from_hdr"
        )
    return codes if low >= 0 and high <= 1 else np.clip(codes, 0.0, 1.0)


def display_values(codes: NDArray[Any]) -> Array:
    """Values from 0 to 1.

    Examples
    --------
    >>> display_values(np.array([[[0, 51, 255]]], np.uint8))
    array([[[0. , 0.2, 1. ]]])
    """
    if np.issubdtype(codes.dtype, np.floating):
        return codes.astype(np.float64)
    return codes / float(np.iinfo(codes.dtype).max)


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
    found = _known(space)
    return _in_srgb(values if linear else _decoded(values, found), found)


def _known(space: str) -> str:
    """The space's name in colour-science."""
    if not isinstance(space, str):
        raise InputError(f"a space is the name of one, not {space!r:.40}; known are {', '.join(SPACES)}")
    known = {name.lower(): name for name in SPACES}
    if space.lower() not in known:
        raise InputError(f"unknown RGB space '{space}'; {did_you_mean(space, SPACES)}")
    return SPACES[known[space.lower()]]


def _decoded(values: Array, found: str) -> Array:
    """Encoded values, each by itself, proportional to light."""
    if found == "sRGB":
        return plain_srgb(values)
    return np.asarray(colour_science().RGB_COLOURSPACES[found].cctf_decoding(values), dtype=np.float64)


def _in_srgb(light: Array, found: str) -> Array:
    return light if found == "sRGB" else light @ _matrix_to_srgb(found).T


def _linear(codes: NDArray[Any], found: str, linear: bool) -> Callable[[NDArray[Any]], Array]:
    """From rows of a picture to linear sRGB; codes are few, and looked up."""
    if np.issubdtype(codes.dtype, np.floating):
        return lambda rows: _in_srgb(display_values(rows) if linear else _decoded(display_values(rows), found), found)
    every = display_values(np.arange(np.iinfo(codes.dtype).max + 1, dtype=codes.dtype))
    table = every if linear else _decoded(every, found)
    return lambda rows: _in_srgb(table[rows], found)


@lru_cache(maxsize=8)
def _matrix_to_srgb(found: str) -> Array:
    """(3, 3) from the primaries themselves, so that white stays white: published matrices have four digits."""
    space = colour_science().RGB_COLOURSPACES[found]
    return primaries_to_srgb(space.primaries, space.whitepoint)


def primaries_to_srgb(primaries: ArrayLike, white: ArrayLike) -> Array:
    """(3, 3) to linear sRGB from light of other primaries, whites matched by Bradford's transform.

    Parameters
    ----------
    primaries
        x, y of red, of green and of blue: six numbers.
    white
        x, y of red = green = blue.

    Raises
    ------
    InputError
        If these make no colours.

    Examples
    --------
    >>> primaries_to_srgb([0.64, 0.33, 0.3, 0.6, 0.15, 0.06], [0.3127, 0.329]).round(6) + 0.0
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 1.]])
    """
    srgb = colour_science().RGB_COLOURSPACES["sRGB"]
    d65 = np.asarray(colour_science().xy_to_XYZ(srgb.whitepoint), dtype=np.float64)
    from_xyz = np.linalg.inv(primaries_to_xyz(srgb.primaries, srgb.whitepoint, d65))
    return np.asarray(from_xyz @ primaries_to_xyz(primaries, white, d65), dtype=np.float64)


def primaries_to_xyz(primaries: ArrayLike, white: ArrayLike, onto: ArrayLike) -> Array:
    """(3, 3) to XYZ from light of primaries, by Bradford's transform to another white, `onto` in XYZ.

    Raises
    ------
    InputError
        As for `primaries_to_srgb`.

    Examples
    --------
    >>> primaries_to_xyz([0.64, 0.33, 0.3, 0.6, 0.15, 0.06], [0.3127, 0.329], [0.9642, 1, 0.8249])[:, 0].round(3)
    array([0.436, 0.222, 0.014])
    """
    colour = colour_science()
    corners, whites = np.asarray(primaries, np.float64).reshape(3, 2), np.asarray(white, np.float64)
    if (
        not np.isfinite(corners).all()
        or (corners[:, 1] == 0).any()
        or not (np.isfinite(whites).all() and whites[1] > 0)
    ):
        raise InputError(f"no colours have the primaries {corners.ravel().round(4)} and the white {whites.round(4)}")
    try:
        to_xyz = colour.models.normalised_primary_matrix(corners, whites)
    except np.linalg.LinAlgError:
        raise InputError("primaries on one line make no colours") from None
    adapt = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        colour.xy_to_XYZ(whites), np.asarray(onto, np.float64), transform="Bradford"
    )
    return np.asarray(adapt @ to_xyz, dtype=np.float64)


def srgb_weights(
    codes: NDArray[Any], space: str, *, linear: bool, out_of_gamut: OutOfGamut, highest: float = 1.0
) -> NDArray[np.float32]:
    """(3, rows, cols) linear sRGB between 0 and the highest value, some rows of the picture at a time.

    Parameters
    ----------
    codes
        (rows, cols, 3), as `checked_picture` has it, or floats of any range.
    space, linear
        As for `linear_srgb_of`.
    out_of_gamut
        What becomes of colours beyond, but for rounding.
    highest
        1, or infinity for a picture of light.

    Raises
    ------
    OutsideSrgbError
        If colours lie outside and are to be refused; with how many.
    InputError
        If the space is unknown.

    Examples
    --------
    >>> codes = np.array([[[0, 128, 255]]], np.uint8)
    >>> srgb_weights(codes, "sRGB", linear=False, out_of_gamut="refuse").ravel().round(4)
    array([0.    , 0.2159, 1.    ], dtype=float32)
    """
    check_choice("out_of_gamut", out_of_gamut, OutOfGamut)
    bounded = bool(np.isfinite(highest))
    to_linear = _linear(codes, _known(space), linear)
    weights = np.empty((3, *codes.shape[:2]), np.float32)
    brightest = 1.0 if bounded else float(codes.max())
    step, outside = max(1, _BLOCK // codes[0].size), 0
    for first in range(0, len(codes), step):
        values = to_linear(codes[first : first + step])
        low = _ROUNDING if bounded else _rounding_of_light(values, brightest)
        outside += int(((values < -low) | (values > highest + _ROUNDING)).any(axis=2).sum())
        with np.errstate(over="ignore"):  # the caller's affair
            weights[:, first : first + step] = np.moveaxis(np.clip(values, 0.0, highest), 2, 0)
    if out_of_gamut == "refuse" and outside:
        other = ", or method='jakob-hanika'" if bounded else ""
        raise OutsideSrgbError(outside, weights[0].size, f"ask for out_of_gamut='clip'{other}")
    return weights


def _rounding_of_light(values: Array, brightest: float) -> Array:
    """(rows, cols, 1), for light of (rows, cols, 3) in a picture whose brightest value is given."""
    own, whole = _LIGHT_ROUNDING
    return np.asarray(np.maximum(own * values.max(axis=2, keepdims=True), whole * max(brightest, 0.0)))
