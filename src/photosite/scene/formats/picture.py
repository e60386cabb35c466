"""Pictures of red, green and blue as scenes: PNG, JPEG and TIFF, encoded for a display.

A file without a word about its colours is taken for sRGB; one that names another space, by an ICC profile or in EXIF,
is read in that, or refused where photosite does not know it. None is ignored.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeError
from photosite.png_file import PngFile
from photosite.scene.formats.png16 import read_deep_png
from photosite.scene.options import ReadOptions
from photosite.scene.pictures import from_rgb
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene

_PROFILES = {
    "srgb": "sRGB",
    "display p3": "Display P3",
    "adobe rgb (1998)": "Adobe RGB",
    "prophoto rgb": "ProPhoto RGB",
    "romm rgb": "ProPhoto RGB",
}
"""What an ICC profile's description begins with, and the space that it means."""

_ICC_TAG = 34675
_EXIF_IFD, _COLOR_SPACE, _INTEROP_IFD, _INTEROP_INDEX = 0x8769, 0xA001, 0xA005, 1
_UNCALIBRATED = 0xFFFF
_DISPLAY_GAMMA = 1 / 2.2
_PRIMARIES = (0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
"""Chromaticities of sRGB's white, red, green and blue (IEC 61966-2-1)."""
_ORIENTATION = 0x0112
_TRANSPARENT = "is transparent in places; flatten the picture to red, green and blue"

_TURNED: dict[int, Callable[[NDArray[Any]], NDArray[Any]]] = {
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a[::-1, ::-1].swapaxes(0, 1),
    8: lambda a: np.rot90(a),
}
"""By EXIF's orientation: how (rows, cols, ...) of the file become those of the picture."""


def read(path: Path, said: ReadOptions) -> Scene:
    """The scene of a PNG or JPEG file: a flat print of its colours, under the light that the options say.

    Raises
    ------
    FileError
        If it is damaged, its colours are in a space or a form that is not known, or nobody says how bright it is.
    """
    from PIL import Image, ImageOps

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as picture:
                png = _checked_png(path) if picture.format == "PNG" else None
                space = _space(path, picture)
                if png is not None and png.header.bits == 16:
                    values = _deep_values(png, picture.getexif().get(_ORIENTATION))
                else:
                    values = _values(path, ImageOps.exif_transpose(picture))
    except PhotositeError:
        raise
    except Exception as error:  # Pillow hands on whatever a damaged file makes it stumble over
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileError(path, f"cannot be read as a picture ({reason[:200]}); is it truncated?") from None
    return _scene(path, values, space, said)


def read_tiff_page(path: Path, page: Any, said: ReadOptions) -> Scene:
    """The scene of a TIFF file's page of red, green and blue, as tifffile has it.

    Raises
    ------
    FileError
        As for `read`.
    """
    if page.samplesperpixel != 3:
        raise FileError(path, f"has {page.samplesperpixel} samples a pixel; flatten the picture to red, green and blue")
    if page.dtype not in (np.uint8, np.uint16):
        raise FileError(
            path,
            f"is a picture of {page.dtype}, which may be light or codes for a display; save it as 8 or 16 bits, or "
            "give its array to photosite.pictures.from_rgb or from_hdr",
        )
    tag = page.tags.get(_ICC_TAG)
    space = "sRGB" if tag is None else _profile_space(path, bytes(tag.value))
    values = page.asarray()
    return _scene(path, np.moveaxis(values, 0, 2) if int(page.planarconfig) == 2 else values, space, said)


def check_said(path: Path, said: ReadOptions) -> None:
    """Refuse what a picture has no place for.

    Raises
    ------
    FileError
        If the options say such a thing.
    """
    for name in ("units", "wavelength_nm", "variable"):
        if getattr(said, name) is not None:
            raise FileError(path, f"holds red, green and blue, which have no {name}; leave that out")


def _scene(path: Path, values: NDArray[Any], space: str, said: ReadOptions) -> Scene:
    check_said(path, said)
    if said.mean_luminance_cd_m2 is None:
        raise FileError(path, "a picture does not say how bright its scene is; say it (mean_luminance_cd_m2=40)")
    try:
        return from_rgb(
            values,
            "D65" if said.illuminant is None else said.illuminant,
            said.mean_luminance_cd_m2,
            space=space,
            method=said.method or "mallett-yuksel",
            out_of_gamut=said.out_of_gamut or "refuse",
            tolerance=said.tolerance,
            distance_m=said.distance_m or DEFAULT_DISTANCE_M,
            width_m=said.width_m,
            name=path.stem,
        )
    except InputError as error:
        raise FileError(path, str(error)) from None


def _values(path: Path, picture: Any) -> NDArray[Any]:
    """(rows, cols, 3) codes of 8 bits."""
    if picture.mode == "P":
        picture = picture.convert("RGBA" if "transparency" in picture.info else "RGB")
    if "A" in picture.mode or "transparency" in picture.info:
        if picture.convert("RGBA").getchannel("A").getextrema()[0] < 255:
            raise FileError(path, _TRANSPARENT)
        picture = picture.convert("RGB")
    if picture.mode in ("L", "1"):
        picture = picture.convert("RGB")
    if picture.mode != "RGB":
        raise FileError(path, f"has colours in the form {picture.mode}; save the picture as red, green and blue")
    return np.asarray(picture)


def _deep_values(png: PngFile, orientation: Any) -> NDArray[np.uint16]:
    """(rows, cols, 3) codes of a PNG of 16 bits."""
    found = read_deep_png(png)
    if not found.is_opaque:
        raise FileError(png.path, _TRANSPARENT)
    turn = _TURNED.get(orientation)
    turned = found.colors if turn is None else turn(found.colors)
    return np.broadcast_to(turned, (*turned.shape[:2], 3))


def _checked_png(path: Path) -> PngFile:
    """The file, with all its rows, and its colours said in a way that Pillow hands on."""
    png = PngFile.read(path)
    if b"cICP" in png.chunks:
        raise FileError(path, "says its colours by code points (cICP), an HDR picture perhaps; save it as sRGB")
    if png.header.bits != 16:  # else they are counted when they are unpacked
        png.check_whole()
    return png


def _space(path: Path, picture: Any) -> str:
    """Name of the RGB space that a file says its colours are in."""
    if profile := picture.info.get("icc_profile"):
        return _profile_space(path, profile)
    gamma = picture.info.get("gamma")
    if gamma is not None and "srgb" not in picture.info and abs(gamma / _DISPLAY_GAMMA - 1) > 0.02:
        raise FileError(path, f"says that its values are light to the power of {gamma:g}; save the picture as sRGB")
    primaries = picture.info.get("chromaticity")
    if primaries is not None and "srgb" not in picture.info and not np.allclose(primaries, _PRIMARIES, atol=0.005):
        raise FileError(path, f"says that its colours are of other primaries than sRGB's, {primaries}; save it as sRGB")
    exif = picture.getexif()
    details = exif.get_ifd(_EXIF_IFD)
    if details.get(_COLOR_SPACE) == _UNCALIBRATED:
        if exif.get_ifd(_INTEROP_IFD).get(_INTEROP_INDEX) == "R03":
            return "Adobe RGB"
        raise FileError(path, "says that its colours are not sRGB, and not what they are; save the picture as sRGB")
    return "sRGB"


def _profile_space(path: Path, profile: bytes) -> str:
    from PIL import ImageCms

    try:
        opened = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        name = ImageCms.getProfileDescription(opened).strip()
    except (OSError, ImageCms.PyCMSError):
        raise FileError(path, "has an ICC profile that cannot be read; save the picture as sRGB") from None
    for start, space in _PROFILES.items():
        if name.lower().startswith(start):
            return space
    known = ", ".join(dict.fromkeys(_PROFILES.values()))
    raise FileError(path, f"has the ICC profile '{name}'; known are {known}: save the picture in one of them")
