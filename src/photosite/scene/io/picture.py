"""Pictures of red, green and blue as scenes: PNG and JPEG files, and what pictures of all formats share.

Pillow reads headers and metadata (it discards half of 16-bit codes and pads missing rows), imagecodecs decodes PNG.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeError
from photosite.files.quiet import no_stderr
from photosite.files.small_files import reading
from photosite.scene.io.color_space import RgbSpace, exif_of, space_of_picture
from photosite.scene.options import ReadOptions
from photosite.scene.picture_colors import OutsideSrgbError
from photosite.scene.pictures import from_hdr, from_rgb
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.values.exif_time import TIMES, iso_time
from photosite.values.orientation import turned_upright

ORIENTATION = 0x0112
"""Tag of EXIF and TIFF."""
TRANSPARENT = "is transparent in places"
FLATTEN = "Flatten the picture to red, green and blue"

_EXIF_IFD = 34665
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
"""Of the display pictures that `read_codes` reads."""
_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
_ALWAYS_READ_PIXELS = 100_000_000
"""Pictures up to this size are read from a file however small."""
_PIXELS_PER_BYTE = 1100
"""Limit for larger pictures; a PNG of 8 bits reaches 1032, a JPEG 512."""
_MOST_PIXELS = 4_000_000_000
_PNG_BYTES_PER_BYTE = 1040
"""Limit of decompressed rows; deflate reaches 1032."""
_BYTES_PER_PIXEL, _MOST_METADATA = 16, 64 << 20
"""Limit of a file's size, beyond which it is damaged: twice four channels of 16 bits, and metadata."""


def read(path: Path, options: ReadOptions) -> Scene:
    """Read a PNG or JPEG file as a flat print of its colors, under the options' illuminant."""
    return scene_of_picture(path, *read_codes(path), options)


def read_codes(path: Path) -> tuple[NDArray[Any], RgbSpace]:
    """Read the upright (rows, cols, 3) codes of a PNG or JPEG file, and their color space."""
    with _opened(path, "a PNG or JPEG picture") as picture:
        codes = _png_codes(path, picture) if picture.format == "PNG" else _jpeg_codes(path, picture)
        space = space_of_picture(path, picture)
        return turned(codes, exif_of(picture).get(ORIENTATION)), space


def largest_quantization(path: Path) -> float | None:
    """Return the largest quantization step of luma of a JPEG file, in codes; None for PNG files."""
    with _opened(path, "a PNG or JPEG picture") as picture:
        tables = getattr(picture, "quantization", None)
        return float(max(tables[min(tables)])) if tables else None


def time_of(path: Path) -> str | None:
    """Return the time that EXIF data of a PNG or JPEG file state, in ISO 8601; None where they state none."""
    with _opened(path, "a PNG or JPEG picture") as picture:
        exif = exif_of(picture)
        tags = dict(exif) | dict(exif.get_ifd(_EXIF_IFD))
    texts = ([value if isinstance(value := tags.get(tag), str) else None for tag in each] for each in TIMES)
    return next(filter(None, (iso_time(*each) for each in texts)), None)


def turned(codes: NDArray[Any], orientation: Any) -> NDArray[Any]:
    """Return (rows, cols, 1 or 3) codes upright and with three channels."""
    upright = turned_upright(codes, orientation)
    return np.broadcast_to(upright, (*upright.shape[:2], 3))


def _png_codes(path: Path, picture: Any) -> NDArray[Any]:
    """Return (rows, cols, 1 or 3) codes of 8 or 16 bits."""
    codes = _decoded_png(path, picture)
    if codes.shape[2] in (1, 3):
        return codes
    if codes[:, :, -1].min() < np.iinfo(codes.dtype).max:
        raise FileError(path, TRANSPARENT, hint=FLATTEN)
    return codes[:, :, :-1]


def _decoded_png(path: Path, picture: Any) -> NDArray[Any]:
    """Return (rows, cols, channels); 2 and 4 channels end in opacity, which a transparent color becomes too."""
    from imagecodecs import png_decode

    content = path.read_bytes()
    if b"cICP" in content[: content.find(b"IDAT")]:
        raise FileError(path, "states its colors by code points (cICP), such as an HDR picture", hint="Save it as sRGB")
    if picture.height * -(-picture.width // 8) > _PNG_BYTES_PER_BYTE * len(content):
        size = f"{picture.height} x {picture.width}"
        raise FileError(path, f"is damaged: {len(content)} bytes cannot hold {size} pixels")
    if "exif" not in picture.info and b"eXIf" in content:
        picture.load()  # Pillow finds metadata behind the pixels only now
    with no_stderr():  # libpng warns of every interlaced picture
        codes = png_decode(content)
    return np.asarray(codes if codes.ndim == 3 else codes[:, :, None])


def _jpeg_codes(path: Path, picture: Any) -> NDArray[Any]:
    if picture.mode not in ("L", "RGB"):
        raise FileError(path, "colors", value=picture.mode, expected="gray, or red, green and blue")
    codes = np.asarray(picture)
    return codes if codes.ndim == 3 else codes[:, :, None]


def read_alpha(path: Path) -> NDArray[np.float32]:
    """Read the opacity of a plane, (rows, cols) from 0 (transparent) to 1 (opaque).

    The file is a gray picture of 1, 8 or 16 bits, black for 0 and white for 1; or one with an alpha channel, which is
    used.

    Raises
    ------
    FileError
        If the file is not a picture, is damaged, or is in color without an alpha channel.
    """
    with _opened(path, "a PNG, JPEG or TIFF picture") as picture:
        mode = picture.mode
        if picture.format == "PNG":
            codes = _decoded_png(path, picture)
            codes = codes[:, :, -1] if "A" in mode else codes[:, :, 0] if codes.shape[2] < 3 else codes
        else:
            codes = np.asarray(picture.getchannel("A") if "A" in mode else picture)
    if codes.dtype == np.bool_:
        return codes.astype(np.float32)
    if codes.ndim != 2 or mode in ("P", "F"):
        raise FileError(path, "opacity", value=mode, expected="a gray picture, or one with an alpha channel")
    white = 255 if codes.dtype == np.uint8 else 65535
    if codes.min() < 0 or codes.max() > white:
        raise FileError(path, "opacity", value=int(codes.max()), expected="of 8 or 16 bits")
    return (codes / np.float32(white)).astype(np.float32)


@contextmanager
def _opened(path: Path, kind: str) -> Iterator[Any]:
    """Open a file with Pillow and check its size; every failure in the block becomes a `FileError`."""
    from PIL import JpegImagePlugin, PngImagePlugin, TiffImagePlugin

    with reading(path), path.open("rb") as file:
        head = file.read(len(_PNG))
    if not head:
        raise FileError(path, "is empty")
    # Opened directly, without the size limit of Image.open, and without the formats that start other programs.
    openers: dict[bytes, Callable[[Path], Any]] = {
        _PNG: PngImagePlugin.PngImageFile,
        _JPEG: JpegImagePlugin.JpegImageFile,
        b"II*\0": TiffImagePlugin.TiffImageFile,
        b"MM\0*": TiffImagePlugin.TiffImageFile,
    }
    opener = next((opener for start, opener in openers.items() if head.startswith(start)), None)
    if opener is None:
        raise FileError(path, f"is not {kind}")
    try:
        with opener(path) as picture:
            check_size(path, picture.height, picture.width)
            yield picture
    except PhotositeError:
        raise
    except Exception as error:  # the decoders' own exceptions
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise FileError(path, f"is damaged or truncated: it cannot be read as {kind} ({reason})") from None


def check_size(path: Path, rows: int, cols: int) -> None:
    """Check that a picture is not too large for its file, or above 4 gigapixels, before it is decoded."""
    pixels, size = rows * cols, path.stat().st_size
    if pixels > _MOST_PIXELS:
        raise FileError(path, "size", value=f"{rows} x {cols} pixels", expected="at most 4 gigapixels")
    if pixels > max(_ALWAYS_READ_PIXELS, _PIXELS_PER_BYTE * size):
        expected = f"at most {_PIXELS_PER_BYTE} pixels a byte above 100 megapixels"
        raise FileError(path, "size", value=f"{rows} x {cols} pixels in {size} bytes", expected=expected)
    if size > _BYTES_PER_PIXEL * pixels + _MOST_METADATA:
        raise FileError(path, f"is damaged: {size} bytes for {rows} x {cols} pixels")


def scene_of_picture(path: Path, codes: NDArray[Any], space: RgbSpace, options: ReadOptions) -> Scene:
    """Return the scene of a display picture: (rows, cols, 3) codes of a color space."""
    options.require(path, "does not state the luminance of its scene", mean_luminance_cd_m2=40)
    assert options.mean_luminance_cd_m2 is not None
    try:
        return from_rgb(
            space.decoded(codes),
            "D65" if options.illuminant is None else options.illuminant,
            options.mean_luminance_cd_m2,
            space=space.name,
            linear=space.linear,
            method=options.method or "mallett-yuksel",
            out_of_gamut=options.out_of_gamut or "refuse",
            tolerance=options.tolerance,
            distance_m=options.distance_m or DEFAULT_DISTANCE_M,
            width_m=options.width_m,
            name=path.stem,
        )
    except InputError as error:
        raise error.in_file(path) from None


def scene_of_light(
    path: Path, values: NDArray[Any], options: ReadOptions, white_luminance_cd_m2: float | None
) -> Scene:
    """Return the scene of a picture of light: (rows, cols, 3) linear sRGB of any range, as in Radiance and OpenEXR.

    Values are negative where sRGB has no such color. White is 1 in all three channels; where its luminance is None,
    the options give the mean.
    """
    try:
        return from_hdr(
            values,
            white_luminance_cd_m2,
            mean_luminance_cd_m2=options.mean_luminance_cd_m2 if white_luminance_cd_m2 is None else None,
            white="D65" if options.illuminant is None else options.illuminant,
            out_of_gamut="clip" if options.negative == "zero" else "refuse",
            distance_m=options.distance_m or DEFAULT_DISTANCE_M,
            width_m=options.width_m,
            name=path.stem,
        )
    except OutsideSrgbError as error:
        hint = "Convert them to sRGB, or pass {negative} to set negative values to 0"
        raise FileError(path, error.what, hint=hint, arguments={"negative": "zero"}) from None
    except InputError as error:
        raise error.in_file(path) from None
