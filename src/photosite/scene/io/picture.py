"""Pictures of red, green and blue as scenes: PNG, JPEG and TIFF, encoded for a display.

What red, green and blue mean there: `photosite.scene.io.picture_space`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeError
from photosite.files.png import PngFile
from photosite.scene.io.icc import RgbSpace
from photosite.scene.io.picture_space import space_of_picture, space_of_tiff
from photosite.scene.io.pillow import opened, starts_as_png
from photosite.scene.io.png16 import read_deep_png
from photosite.scene.options import ReadOptions
from photosite.scene.pictures import from_rgb
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene

_ORIENTATION = 0x0112
_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE = 0, 1, 2, 3
"""Photometric interpretations of TIFF."""
_GREYS = (_WHITE_IS_ZERO, _BLACK_IS_ZERO)
_OPACITY = (1, 2)
"""Kinds of extra samples, associated or not."""
_APART = 2
"""Planar configuration of planes that follow each other."""
_TIFF_COLORS = {2: "RGB", 3: "of a palette", 5: "CMYK", 6: "YCbCr", 8: "Lab", 9: "Lab (ICC)", 10: "Lab (ITU)"}
_MOST_SAMPLES = 4
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
    from PIL import ImageOps, UnidentifiedImageError

    try:
        png = _checked_png(path) if starts_as_png(path) else None
        with opened(path) as picture:
            space = space_of_picture(path, picture, png)
            if png is not None and png.header.bits == 16:
                values = _deep_values(png, picture.getexif().get(_ORIENTATION))
            else:
                values = _values(path, ImageOps.exif_transpose(picture))
    except PhotositeError:
        raise
    except UnidentifiedImageError:
        raise FileError(path, "is no picture: its first bytes are neither PNG's nor JPEG's") from None
    except Exception as error:  # Pillow hands on whatever a damaged file makes it stumble over
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileError(path, f"cannot be read as a picture ({reason[:200]}); is it truncated?") from None
    return _scene(path, values, space, said)


def is_tiff_picture(page: Any) -> bool:
    """Whether a TIFF file's page, as tifffile has it, is in colours, and not a band or many."""
    return int(page.photometric) in _TIFF_COLORS and page.samplesperpixel <= _MOST_SAMPLES


def is_grey_tiff(page: Any) -> bool:
    """Whether a page could be a grey picture: 8 or 16 bits, and opacity at most beside it."""
    extra = tuple(int(kind) for kind in page.extrasamples)
    alone = page.samplesperpixel == 1 + len(extra) <= 2 and all(kind in _OPACITY for kind in extra)
    return int(page.photometric) in _GREYS and alone and page.dtype in (np.uint8, np.uint16)


def read_tiff_page(path: Path, page: Any, said: ReadOptions) -> Scene:
    """The scene of a TIFF file's page in colours or in grey, as tifffile has it.

    Raises
    ------
    FileError
        As for `read`.
    """
    form = int(page.photometric)
    if form not in (*_GREYS, _RGB, _PALETTE):
        raise FileError(
            path, f"has colours in the form {_TIFF_COLORS.get(form, form)}; save the picture as red, green and blue"
        )
    if page.dtype not in (np.uint8, np.uint16):
        raise FileError(
            path,
            f"is a picture of {page.dtype}, which may be light or codes for a display; save it as 8 or 16 bits, or "
            "give its array to photosite.pictures.from_rgb or from_hdr",
        )
    if int(page.bitspersample) != 8 * page.dtype.itemsize:
        raise FileError(path, f"has {page.bitspersample} bits a value; save the picture in 8 or 16")
    space = space_of_tiff(path, page)
    values = page.asarray()
    values = values.reshape(*values.shape[:2], -1) if int(page.planarconfig) != _APART else np.moveaxis(values, 0, 2)
    count = 3 if form == _RGB else 1
    colors, opacity = values[:, :, :count], values[:, :, count:]
    if (opacity != np.iinfo(values.dtype).max).any():
        raise FileError(path, _TRANSPARENT)
    if form == _PALETTE:
        colors = np.moveaxis(_palette(page)[:, colors[:, :, 0]], 0, 2)
    if form == _WHITE_IS_ZERO:
        colors = np.iinfo(values.dtype).max - colors
    turn = _TURNED.get(page.tags[_ORIENTATION].value if _ORIENTATION in page.tags else 1)
    turned = colors if turn is None else turn(colors)
    return _scene(path, np.broadcast_to(turned, (*turned.shape[:2], 3)), space, said)


def _palette(page: Any) -> NDArray[Any]:
    """(3, colours) of 16 bits; of 8 where their writer left the lower ones empty, and 255 is white."""
    colors = np.asarray(page.colormap, np.uint16)
    return colors if (colors & 0xFF).any() else (colors >> 8).astype(np.uint8)


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


def _scene(path: Path, values: NDArray[Any], space: RgbSpace, said: ReadOptions) -> Scene:
    check_said(path, said)
    if said.mean_luminance_cd_m2 is None:
        raise FileError(path, "a picture does not say how bright its scene is; say it (mean_luminance_cd_m2=40)")
    try:
        return from_rgb(
            values,
            "D65" if said.illuminant is None else said.illuminant,
            said.mean_luminance_cd_m2,
            space=space.name,
            linear=space.linear,
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
