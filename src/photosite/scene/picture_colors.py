"""The values of a picture: codes to values, encoded to linear, any RGB space to sRGB."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import colour_science, light_from_srgb
from photosite.engine.jit import read_only
from photosite.engine.patches import looked_up
from photosite.engine.threads import threads_for
from photosite.errors import InputError, did_you_mean
from photosite.values.choice import check_choice

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
"""RGB spaces, and their names in colour-science."""

_ROUNDING = 1e-6
"""Rounding error outside the gamut."""
_LIGHT_ROUNDING = 1e-3, 1e-7
"""Negative light that is rounding, relative to the pixel's and to the picture's brightest value: that of 16-bit floats
after a change of primaries, and of single precision."""
_BLOCK = 1 << 20
"""Values that are processed together in double precision."""


class OutsideSrgbError(InputError):
    """A picture has colors outside sRGB, which are to be refused."""


def checked_picture(picture: ArrayLike, out_of_gamut: OutOfGamut = "refuse") -> NDArray[Any]:
    """Return the encoded (rows, cols, 3) codes of a display picture, or values from 0 to 1.

    Floats outside that range are clipped if it is by rounding, or if `out_of_gamut` is "clip", and else refused.
    """
    codes = np.asarray(picture)
    if codes.ndim != 3 or codes.shape[2] != 3 or codes.size == 0:
        raise InputError("picture", value=codes.shape, expected="(rows, cols, 3): red, green and blue")
    if codes.dtype in (np.uint8, np.uint16):
        return codes
    if not np.issubdtype(codes.dtype, np.floating):
        expected = "unsigned integers of 8 or 16 bits, or floats from 0 to 1"
        raise InputError("picture", value=str(codes.dtype), expected=expected)
    low, high = codes.min(), codes.max()
    if not (np.isfinite(low) and np.isfinite(high)):  # the minimum is NaN where any value is
        raise InputError("picture", expected="finite everywhere, from 0 to 1")
    if out_of_gamut != "clip" and not (low >= -_ROUNDING and high <= 1 + _ROUNDING):
        raise InputError(
            "picture",
            value=(float(low), float(high)),
            expected="from 0 to 1",
            hint="Pass {out_of_gamut}, or use from_hdr for light of any range",
            arguments={"out_of_gamut": "clip"},
        )
    return codes if low >= 0 and high <= 1 else np.clip(codes, 0.0, 1.0)


def display_values(codes: NDArray[Any]) -> Array:
    """Return values from 0 to 1 of codes.

    Examples
    --------
    >>> display_values(np.array([[[0, 51, 255]]], np.uint8))
    array([[[0. , 0.2, 1. ]]])
    """
    if np.issubdtype(codes.dtype, np.floating):
        return codes.astype(np.float64)
    return codes / float(np.iinfo(codes.dtype).max)


def plain_srgb(values: Array) -> Array:
    """Return linear sRGB of encoded sRGB from 0 to 1."""
    return light_from_srgb(values)


def linear_srgb_of(codes: NDArray[Any], space: str, *, linear: bool) -> Array:
    """Return (rows, cols, 3) codes or values of a space as linear sRGB; below 0 or above 1 outside its gamut.

    Examples
    --------
    >>> linear_srgb_of(np.array([[[1.0, 1.0, 1.0]]]), "Display P3", linear=False).round(4)
    array([[[1., 1., 1.]]])
    """
    return _to_linear_srgb(codes.dtype, space, linear)(codes)


def _to_linear_srgb(dtype: np.dtype[Any], space: str, linear: bool) -> Callable[[NDArray[Any]], Array]:
    """A function from codes of a type to linear sRGB; integers are looked up in a table."""
    known = {name.lower(): full for name, full in SPACES.items()}
    if not isinstance(space, str) or space.lower() not in known:
        hint = did_you_mean(str(space), SPACES)
        raise InputError("space", value=space, expected="the name of an RGB space", hint=hint)
    name = known[space.lower()]

    def decoded(codes: NDArray[Any]) -> Array:
        values = display_values(codes)
        if linear:
            return values
        if name == "sRGB":
            return plain_srgb(values)
        return np.asarray(colour_science().RGB_COLOURSPACES[name].cctf_decoding(values), dtype=np.float64)

    def in_srgb(light: Array) -> Array:
        return light if name == "sRGB" else light @ _matrix_to_srgb(name).T

    if np.issubdtype(dtype, np.floating):
        return lambda codes: in_srgb(decoded(codes))
    table = decoded(np.arange(np.iinfo(dtype).max + 1, dtype=dtype))
    return lambda codes: in_srgb(table[codes])


@lru_cache(maxsize=8)
def _matrix_to_srgb(name: str) -> Array:
    """(3, 3) computed from the primaries, so that white stays white: published matrices have four digits."""
    space = colour_science().RGB_COLOURSPACES[name]
    return primaries_to_srgb(space.primaries, space.whitepoint)


def primaries_to_srgb(primaries: ArrayLike, white: ArrayLike) -> Array:
    """Return the matrix (3, 3) from other primaries to linear sRGB, with Bradford adaptation of the white.

    Parameters
    ----------
    primaries
        x, y of red, of green and of blue: six numbers.
    white
        x, y of red = green = blue.

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
    """Return the matrix (3, 3) from primaries to XYZ, with Bradford adaptation to the white `onto` in XYZ.

    Examples
    --------
    >>> primaries_to_xyz([0.64, 0.33, 0.3, 0.6, 0.15, 0.06], [0.3127, 0.329], [0.9642, 1, 0.8249])[:, 0].round(3)
    array([0.436, 0.222, 0.014])
    """
    colour = colour_science()
    corners, whites = np.asarray(primaries, np.float64).reshape(3, 2), np.asarray(white, np.float64)
    if not (np.isfinite(corners).all() and np.isfinite(whites).all() and corners[:, 1].all() and whites[1] > 0):
        value = (corners.ravel().round(4).tolist(), whites.round(4).tolist())
        raise InputError("primaries, white", value=value, expected="valid chromaticities")
    try:
        to_xyz = colour.models.normalised_primary_matrix(corners, whites)
    except np.linalg.LinAlgError:
        raise InputError("primaries", expected="not on one line") from None
    adapt = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        colour.xy_to_XYZ(whites), np.asarray(onto, np.float64), transform="Bradford"
    )
    return np.asarray(adapt @ to_xyz, dtype=np.float64)


def srgb_weights(
    codes: NDArray[Any], space: str, *, linear: bool, out_of_gamut: OutOfGamut, highest: float = 1.0
) -> NDArray[np.float32]:
    """Return linear sRGB (3, rows, cols) between 0 and the highest value, computed in blocks of rows.

    Parameters
    ----------
    codes
        (rows, cols, 3), from `checked_picture`, or floats of any range.
    space, linear
        As for `linear_srgb_of`.
    out_of_gamut
        What to do with colors outside, except for rounding.
    highest
        1, or infinity for a picture of light.

    Raises
    ------
    OutsideSrgbError
        If colors are outside and are to be refused; with their number.

    Examples
    --------
    >>> codes = np.array([[[0, 128, 255]]], np.uint8)
    >>> srgb_weights(codes, "sRGB", linear=False, out_of_gamut="refuse").ravel().round(4)
    array([0.    , 0.2159, 1.    ], dtype=float32)
    """
    check_choice("out_of_gamut", out_of_gamut, OutOfGamut)
    bounded = bool(np.isfinite(highest))
    to_linear = _to_linear_srgb(codes.dtype, space, linear)
    if np.issubdtype(codes.dtype, np.integer) and space.lower() == "srgb":  # all values are within 0 and 1
        with threads_for(codes.size):
            return looked_up(_table_of_srgb(codes.dtype, linear), read_only(codes))
    weights = np.empty((3, *codes.shape[:2]), np.float32)
    brightest = 1.0 if bounded else float(codes.max())
    step, outside = max(1, _BLOCK // codes[0].size), 0
    for first in range(0, len(codes), step):
        values = to_linear(codes[first : first + step])
        low = _ROUNDING if bounded else _rounding_of_light(values, brightest)
        outside += int(((values < -low) | (values > highest + _ROUNDING)).any(axis=2).sum())
        with np.errstate(over="ignore"):  # the caller checks for infinity
            weights[:, first : first + step] = np.moveaxis(np.clip(values, 0.0, highest), 2, 0)
    if out_of_gamut == "refuse" and outside:
        bounded_hint = ", or {method} for colors that a surface can have" if bounded else ""
        raise OutsideSrgbError(
            f"{outside} of {weights[0].size} pixels have colors outside sRGB",
            hint="Pass {out_of_gamut}" + bounded_hint,
            arguments={"out_of_gamut": "clip"} | ({"method": "jakob-hanika"} if bounded else {}),
        )
    return weights


@lru_cache(maxsize=4)
def _table_of_srgb(dtype: np.dtype[Any], linear: bool) -> NDArray[np.float32]:
    codes = np.arange(np.iinfo(dtype).max + 1, dtype=dtype)
    return read_only(_to_linear_srgb(dtype, "sRGB", linear)(codes).astype(np.float32))


def _rounding_of_light(values: Array, brightest: float) -> Array:
    """(rows, cols, 1) rounding errors of light (rows, cols, 3), in a picture of a given brightest value."""
    own, whole = _LIGHT_ROUNDING
    return np.asarray(np.maximum(own * values.max(axis=2, keepdims=True), whole * max(brightest, 0.0)))
