"""The RGB color space of a picture: from its ICC profile (LittleCMS), EXIF, or the tags of PNG and TIFF.

A file that states nothing is sRGB; an unknown statement is an error. A profile that equals a known space is replaced by
that space; any other RGB profile, matrix or table, is applied by LittleCMS with relative colorimetric intent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import colour_science
from photosite.errors import FileError
from photosite.scene.picture_colors import SPACES, display_values, linear_srgb_of, plain_srgb, primaries_to_xyz

Array = NDArray[np.float64]

_WIDE = "ProPhoto RGB"
"""Space of transformed colors, linear: it holds all surface colors, and its white is that of profiles."""
_D50_XYZ = (0.9642, 1.0, 0.8249)
"""White of the profile connection space (ICC.1:2022, 7.2.16)."""
_RELATIVE_COLORIMETRIC = 1
_COLORANT_TOLERANCE = 2e-3
"""Of X, Y and Z of each colorant; known spaces differ by 0.05 or more."""
_CURVE_TOLERANCE = 1e-3
"""Of linear values from 0 to 1; a gamma of 2.2 differs from sRGB's curve by 0.008."""
_MIXTURE_TOLERANCE = 5e-3
_GAMUT_TOLERANCE = 2e-3
"""Linear sRGB this far outside 0 to 1 is rounding of a profile's entries."""
_HDR_TRANSFERS = (b"\x10", b"\x12")
"""PQ and HLG in ITU-T H.273."""
_SPACES = tuple({full: name for name, full in reversed(SPACES.items())}.values())
"""The known spaces, each under the shorter of its names."""
_STEPS = np.linspace(0.0, 1.0, 256)
_BLOCK_VALUES = 1 << 22

_EXIF_IFD, _COLOR_SPACE, _INTEROP_IFD, _INTEROP_INDEX = 0x8769, 0xA001, 0xA005, 1
_EXIF_SRGB, _EXIF_ADOBE, _EXIF_UNCALIBRATED = 1, 2, 0xFFFF
"""EXIF's ColorSpace; 2 is not in the standard, cameras write it for Adobe RGB."""
_DISPLAY_GAMMA = 1 / 2.2
_WHITE, _PRIMARIES = (0.3127, 0.329), (0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
"""Chromaticities of sRGB (IEC 61966-2-1)."""
_TRANSFER, _WHITE_POINT, _TIFF_PRIMARIES, _ICC, _EXIF = 301, 318, 319, 34675, 34665
"""Tags of TIFF."""
_SAVE_AS_SRGB = "Save the picture as sRGB"


@dataclass(frozen=True)
class RgbSpace:
    """What red, green and blue of a picture mean: a space of `photosite.scene.picture_colors.SPACES`.

    With `linear`, values are proportional to light. An ICC profile is applied by `decoded` first. `stated` is whether
    the file names the space.
    """

    name: str
    linear: bool = False
    profile: bytes | None = None
    stated: bool = field(default=True, compare=False)

    def decoded(self, codes: NDArray[Any]) -> NDArray[Any]:
        """Return (rows, cols, 3) codes of the picture as values of the space `name`."""
        if self.profile is None:
            return codes
        to_srgb = np.linalg.inv(_to_xyz("sRGB"))
        to_wide = np.linalg.inv(_to_xyz(_WIDE)) @ _to_xyz("sRGB")
        out = np.empty(codes.shape, np.float32)
        step = max(1, _BLOCK_VALUES // codes[0].size)
        for first in range(0, len(codes), step):
            srgb = _transformed(display_values(codes[first : first + step]), self.profile) @ to_srgb.T
            out[first : first + step] = _rounded(_rounded(srgb) @ to_wide.T)
        return out


SRGB = RgbSpace("sRGB")


def space_of_profile(path: Path, profile: bytes) -> RgbSpace:
    """Return the color space of an ICC profile."""
    if len(profile) >= 20 and profile[16:20] != b"RGB ":
        space = profile[16:20].decode("latin-1").strip()
        raise FileError(path, "color space of the ICC profile", value=space, expected="RGB", hint=_SAVE_AS_SRGB)
    if _is_hdr(profile):
        raise FileError(path, "has the ICC profile of an HDR picture", hint=_SAVE_AS_SRGB)
    try:
        return _known_space(profile) or RgbSpace(_WIDE, True, profile)
    except ValueError as error:
        raise FileError(path, f"has an ICC profile that cannot be used ({error})", hint=_SAVE_AS_SRGB) from None


def _rounded(values: Array) -> Array:
    """Return values with those just outside 0 to 1 clipped."""
    inside = np.clip(values, 0.0, 1.0)
    return np.where(np.abs(values - inside) <= _GAMUT_TOLERANCE, inside, values)


def _is_hdr(profile: bytes) -> bool:
    """LittleCMS ignores the tag that marks HDR, and the other tags of such profiles are meaningless."""
    at = profile.find(b"cicp", 132)
    start = int.from_bytes(profile[at + 4 : at + 8], "big") if at > 0 else 0
    return profile[start : start + 4] == b"cicp" and profile[start + 9 : start + 10] in _HDR_TRANSFERS


def _transformed(values: Array, profile: bytes) -> Array:
    """Return (..., 3) values from 0 to 1 as XYZ relative to D50; `ValueError` if LittleCMS cannot use the profile."""
    import imagecodecs

    try:
        xyz = imagecodecs.cms_transform(
            np.ascontiguousarray(values, np.float32),
            profile,
            imagecodecs.cms_profile("xyz"),
            colorspace="rgb",
            outcolorspace="xyz",
            outdtype=np.float64,
            intent=_RELATIVE_COLORIMETRIC,
        )
    except Exception as error:  # of the library's own classes
        raise ValueError(" ".join(str(error).split())) from None
    if not np.isfinite(xyz).all() or not xyz.any():
        raise ValueError("it gives no finite colors")
    return np.asarray(xyz, np.float64)


def _known_space(profile: bytes) -> RgbSpace | None:
    """Return the known space that the profile equals, found by probing: ramps of each channel, and mixtures."""
    ramps = np.zeros((3, 256, 3))
    for k in range(3):
        ramps[k, :, k] = _STEPS
    seen = _transformed(ramps, profile)
    colorants = seen[:, -1]
    power = np.maximum(np.einsum("kx,kx->k", colorants, colorants), 1e-9)
    curves = np.einsum("ksx,kx->ks", seen, colorants) / power[:, None]
    steps = np.linspace(0, 255, 6).astype(int)
    mixed = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(1, -1, 3)
    sums = np.stack([curves[k, mixed[..., k]] for k in range(3)], axis=-1) @ colorants
    if np.abs(sums - _transformed(_STEPS[mixed], profile)).max() > _MIXTURE_TOLERANCE:
        return None
    for name in _SPACES:
        if np.abs(colorants - _to_xyz(name).T).max() > _COLORANT_TOLERANCE:
            continue
        for linear in (False, True):
            wanted = _STEPS if linear else _curve(name)
            if np.abs(curves - wanted).max() <= _CURVE_TOLERANCE:
                return RgbSpace(name, linear)
    return None


@lru_cache(maxsize=8)
def _to_xyz(space: str) -> Array:
    """(3, 3) from linear values of a space to XYZ relative to D50."""
    found = colour_science().RGB_COLOURSPACES[SPACES[space]]
    return primaries_to_xyz(found.primaries, found.whitepoint, _D50_XYZ)


@lru_cache(maxsize=8)
def _curve(space: str) -> Array:
    gray = np.repeat(_STEPS[None, :, None], 3, axis=2)
    return linear_srgb_of(gray, space, linear=False)[0, :, 1]


def space_of_picture(path: Path, picture: Any) -> RgbSpace:
    """Return the color space of a PNG or JPEG file that Pillow opened."""
    info = picture.info
    if profile := info.get("icc_profile"):
        return space_of_profile(path, profile)
    if "icc_profile" in info:
        raise FileError(path, "has an ICC profile that cannot be decompressed", hint=_SAVE_AS_SRGB)
    stated = "srgb" in info
    if not stated:
        gamma = info.get("gamma")
        if gamma is not None and abs(gamma / _DISPLAY_GAMMA - 1) > 0.02:
            raise FileError(path, "gamma (gAMA)", value=gamma, expected="1/2.2", hint=_SAVE_AS_SRGB)
        stated = gamma is not None
        if "chromaticity" in info:
            _check_primaries(path, info["chromaticity"], (*_WHITE, *_PRIMARIES))
    exif = exif_of(picture)
    interoperability = exif.get_ifd(_INTEROP_IFD).get(_INTEROP_INDEX)
    return _exif_space(path, exif.get_ifd(_EXIF_IFD).get(_COLOR_SPACE), interoperability, stated)


def exif_of(picture: Any) -> Any:
    """Return the EXIF data of a file that Pillow opened, without decoding its pixels."""
    from PIL import Image

    return Image.Image.getexif(picture)


def space_of_tiff(path: Path, page: Any) -> RgbSpace:
    """Return the color space of a page that tifffile read."""
    codes = (_ICC, _WHITE_POINT, _TIFF_PRIMARIES, _TRANSFER, _EXIF)
    tags = {code: page.tags[code].value for code in codes if code in page.tags}
    if _ICC in tags:
        return space_of_profile(path, bytes(tags[_ICC]))
    for code, wanted in ((_WHITE_POINT, _WHITE), (_TIFF_PRIMARIES, _PRIMARIES)):
        if code in tags:
            _check_primaries(path, _fractions(tags[code]), wanted)
    if stated := _TRANSFER in tags:
        _check_transfer(path, np.asarray(tags[_TRANSFER], np.float64).ravel(), 1 << int(page.bitspersample))
    exif = tags.get(_EXIF)
    return _exif_space(path, exif.get("ColorSpace") if isinstance(exif, Mapping) else None, None, stated)


def _exif_space(path: Path, color_space: Any, interoperability: Any, stated: bool) -> RgbSpace:
    if color_space == _EXIF_ADOBE or (color_space == _EXIF_UNCALIBRATED and interoperability == "R03"):
        return RgbSpace("Adobe RGB")
    if color_space in (None, _EXIF_SRGB):
        return RgbSpace("sRGB", stated=stated or color_space == _EXIF_SRGB)
    raise FileError(path, "is not sRGB according to its EXIF data, which name no other space", hint=_SAVE_AS_SRGB)


def _check_primaries(path: Path, stated: ArrayLike, wanted: tuple[float, ...]) -> None:
    values = np.asarray(stated, np.float64)
    if values.shape != (len(wanted),) or not np.allclose(values, wanted, atol=0.005):
        shown = [float(f"{value:.4g}") for value in values.ravel()[:8]]
        expected = f"sRGB's, {list(wanted)}"
        raise FileError(path, "primaries and white", value=shown, expected=expected, hint=_SAVE_AS_SRGB)


def _fractions(values: Any) -> Array:
    """Return alternating numerators and denominators as quotients."""
    pairs = np.asarray(values, np.float64).ravel()
    with np.errstate(all="ignore"):
        return np.asarray(pairs[0::2] / pairs[1::2] if pairs.size % 2 == 0 else pairs)


def _check_transfer(path: Path, stated: Array, codes: int) -> None:
    """Check TIFF's TransferFunction: linear values from 0 to 65535 by code."""
    wanted = plain_srgb(np.linspace(0.0, 1.0, codes))
    good = stated.size in (codes, 3 * codes)
    if not good or np.abs(stated.reshape(-1, codes) / 65535.0 - wanted).max() > 1e-3:
        raise FileError(path, "has a TransferFunction that is not sRGB's", hint=_SAVE_AS_SRGB)
