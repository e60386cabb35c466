"""In which space a picture's file says that its colours are: ICC profiles, EXIF, PNG's and TIFF's own words.

A file without a word is taken for sRGB; what is said and not known is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from photosite.errors import FileError
from photosite.files.png import PngFile
from photosite.scene.io.icc import SRGB, RgbSpace, space_of_profile
from photosite.scene.picture_colors import plain_srgb

_EXIF_IFD, _COLOR_SPACE, _INTEROP_IFD, _INTEROP_INDEX = 0x8769, 0xA001, 0xA005, 1
_SRGB_COLORS, _ADOBE_COLORS, _UNCALIBRATED = 1, 2, 0xFFFF
"""EXIF's ColorSpace; the second is no standard's, and what cameras write for Adobe RGB."""
_DISPLAY_GAMMA = 1 / 2.2
_WHITE, _PRIMARIES = (0.3127, 0.329), (0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
"""Chromaticities of sRGB's white, and of its red, green and blue (IEC 61966-2-1)."""
_TRANSFER, _WHITE_POINT, _TIFF_PRIMARIES, _ICC, _EXIF = 301, 318, 319, 34675, 34665
"""Tags of TIFF."""


def space_of_picture(path: Path, picture: Any, png: PngFile | None) -> RgbSpace:
    """The space of a PNG or JPEG file, as Pillow has it and, of a PNG, as it is.

    Raises
    ------
    FileError
        If it is not known.
    """
    if profile := picture.info.get("icc_profile"):
        return space_of_profile(path, profile)
    if png is not None and b"iCCP" in png.chunks:
        raise FileError(path, "has an ICC profile that cannot be decompressed; save the picture as sRGB")
    if "srgb" not in picture.info:
        gamma, said = picture.info.get("gamma"), picture.info.get("chromaticity")
        if gamma is not None and abs(gamma / _DISPLAY_GAMMA - 1) > 0.02:
            raise FileError(path, f"says that its values are light to the power of {gamma:g}; save the picture as sRGB")
        if said is not None:
            _check_primaries(path, said, (*_WHITE, *_PRIMARIES))
    exif = picture.getexif()
    return _of_exif(path, exif.get_ifd(_EXIF_IFD).get(_COLOR_SPACE), exif.get_ifd(_INTEROP_IFD).get(_INTEROP_INDEX))


def space_of_tiff(path: Path, page: Any) -> RgbSpace:
    """The space of a TIFF file's page, as tifffile has it.

    Raises
    ------
    FileError
        If it is not known.
    """
    said = {
        code: page.tags[code].value
        for code in (_ICC, _WHITE_POINT, _TIFF_PRIMARIES, _TRANSFER, _EXIF)
        if code in page.tags
    }
    if _ICC in said:
        return space_of_profile(path, bytes(said[_ICC]))
    for code, wanted in ((_WHITE_POINT, _WHITE), (_TIFF_PRIMARIES, _PRIMARIES)):
        if code in said:
            _check_primaries(path, _fractions(said[code]), wanted)
    if _TRANSFER in said:
        _check_transfer(path, np.asarray(said[_TRANSFER], np.float64).ravel(), 1 << int(page.bitspersample))
    exif = said.get(_EXIF)
    return _of_exif(path, exif.get("ColorSpace"), None) if isinstance(exif, Mapping) else SRGB


def _of_exif(path: Path, color_space: Any, interoperability: Any) -> RgbSpace:
    if color_space == _ADOBE_COLORS or (color_space == _UNCALIBRATED and interoperability == "R03"):
        return RgbSpace("Adobe RGB")
    if color_space in (None, _SRGB_COLORS):
        return SRGB
    raise FileError(path, "says that its colours are not sRGB, and not what they are; save the picture as sRGB")


def _check_primaries(path: Path, said: ArrayLike, wanted: tuple[float, ...]) -> None:
    values = np.asarray(said, np.float64)
    if values.shape != (len(wanted),) or not np.allclose(values, wanted, atol=0.005):
        shown = ", ".join(f"{value:.4g}" for value in values.ravel()[:8])
        raise FileError(
            path,
            f"says that its colours are of other primaries than sRGB's or another white ({shown}); save it as sRGB",
        )


def _fractions(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """From numerators and denominators in turn."""
    pairs = np.asarray(values, np.float64).ravel()
    with np.errstate(all="ignore"):
        return np.asarray(pairs[0::2] / pairs[1::2] if pairs.size % 2 == 0 else pairs)


def _check_transfer(path: Path, said: np.ndarray[Any, np.dtype[np.float64]], codes: int) -> None:
    """Refuse TIFF's own curve, light by code from 0 to 65535, where it is not sRGB's."""
    wanted = plain_srgb(np.linspace(0.0, 1.0, codes))
    good = said.size in (codes, 3 * codes)
    if not good or np.abs(said.reshape(-1, codes) / 65535.0 - wanted).max() > 1e-3:
        raise FileError(path, "has a curve of its own (TransferFunction) that is not sRGB's; save the picture as sRGB")
