"""Pictures of red, green and blue as scenes: PNG, JPEG and TIFF, encoded for a display.

A file without a word about its colours is taken for sRGB; one that names another space, by an ICC profile or in EXIF,
is read in that, or refused where photosite does not know it. None is ignored.
"""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeError
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
                space = _space(path, picture)
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
            distance_m=said.distance_m or DEFAULT_DISTANCE_M,
            width_m=said.width_m,
            name=path.stem,
        )
    except InputError as error:
        raise FileError(path, str(error)) from None


def _values(path: Path, picture: Any) -> NDArray[Any]:
    """(rows, cols, 3) codes of 8 or 16 bits."""
    if picture.format == "PNG" or path.suffix.lower() == ".png":
        _check_png(path)
    if picture.mode == "P":
        picture = picture.convert("RGBA" if "transparency" in picture.info else "RGB")
    if "A" in picture.mode or "transparency" in picture.info:
        if picture.convert("RGBA").getchannel("A").getextrema()[0] < 255:
            raise FileError(path, "is transparent in places; flatten the picture to red, green and blue")
        picture = picture.convert("RGB")
    if picture.mode in ("L", "1"):
        picture = picture.convert("RGB")
    if picture.mode == "I;16":
        grey = np.asarray(picture, dtype=np.uint16)
        return np.repeat(grey[:, :, None], 3, axis=2)
    if picture.mode != "RGB":
        raise FileError(path, f"has colours in the form {picture.mode}; save the picture as red, green and blue")
    return np.asarray(picture)


def _check_png(path: Path) -> None:
    """Refuse what Pillow would take away from a PNG without a word."""
    with path.open("rb") as file:
        head = file.read(1 << 16)
    depth, kind = head[24], head[25]
    if depth == 16 and kind in (2, 6):
        raise FileError(path, "has 16 bits a colour, of which only 8 would be read; save it as 16-bit TIFF")
    if b"cICP" in head.split(b"IDAT", 1)[0]:
        raise FileError(path, "says its colours by code points (cICP), an HDR picture perhaps; save it as sRGB")


def _space(path: Path, picture: Any) -> str:
    """Name of the RGB space that a file says its colours are in."""
    if profile := picture.info.get("icc_profile"):
        return _profile_space(path, profile)
    gamma = picture.info.get("gamma")
    if gamma is not None and "srgb" not in picture.info and abs(gamma / _DISPLAY_GAMMA - 1) > 0.02:
        raise FileError(path, f"says that its values are light to the power of {gamma:g}; save the picture as sRGB")
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
