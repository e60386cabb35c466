"""Frames in the camera makers' own formats (NEF, CR2, CR3, ARW, RAF, ...), decoded by LibRaw through rawpy.

The frame is the visible area; borders are left out, and their level is kept beside it (`photosite.frames.levels`).
LibRaw knows the levels as whole numbers. Exposure and ISO are those of Exif or TIFF/EP where the format is built like
TIFF (NEF, CR2, ARW, ...), and LibRaw's own for the others.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.frames.io.header import FrameHeader
from photosite.frames.io.tiff_directory import Directory, read_directories
from photosite.frames.levels import BORDER, border_level
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import MONOCHROME, Cfa, channel_names

_ENDINGS = "3fr arw cr2 cr3 crw dcr erf fff iiq kdc mef mos mrw nef nrw orf pef raf rw2 rwl sr2 srf srw x3f"
SUFFIXES = frozenset(f".{ending}" for ending in _ENDINGS.split())


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """LibRaw's view of a file; whatever LibRaw raises inside becomes a FileError.

    Raises
    ------
    FileError
        If LibRaw cannot open or decode the file, or finds several numbers a pixel in it.
    """
    import rawpy

    try:
        with rawpy.imread(str(path)) as decoder:
            if decoder.raw_type != rawpy.RawType.Flat:
                raise FileError(path, "holds several numbers a pixel; a raw frame has one")
            yield decoder
    except rawpy.LibRawError as error:
        raise FileError(path, f"cannot be decoded: {_reason(error)}; is it truncated?") from None


def _reason(error: Exception) -> str:
    """LibRaw's own words, which come as bytes, or rawpy's."""
    return error.args[0].decode() if error.args and isinstance(error.args[0], bytes) else str(error)


def read_camera_raw_header(path: Path) -> FrameHeader:
    """What a camera's raw file says of its frame without decoding it: size, exposure, ISO."""
    import rawpy

    try:
        with rawpy.imread(str(path)) as decoder:
            rows, cols = decoder.sizes.height, decoder.sizes.width
            shutter_s, iso = float(decoder.other.shutter_speed), float(decoder.other.iso_speed)
    except rawpy.LibRawError as error:
        raise FileError(path, f"is not a raw file that LibRaw can open: {_reason(error)}") from None
    tags = _tags(path)
    metadata = MappingProxyType(_metadata(tags, iso))
    return FrameHeader(rows, cols, None, exposure_s=_exposure_s(tags, shutter_s), metadata=metadata)


def read_camera_raw(path: Path, bits: int | None = None, cfa: Cfa | None = None) -> tuple[RawFrame, tuple[str, ...]]:
    """The visible area of a camera's raw file.

    Parameters
    ----------
    path
        The file.
    bits
        Bits of the converter; what it takes to hold the white level where not given.
    cfa
        What the colour filter array should be, to have it checked.

    Raises
    ------
    FileError
        If the file cannot be decoded, or is not what was expected.

    Returns
    -------
    RawFrame, tuple of str
        The frame, and what its reader should know.
    """
    with opened(path) as decoder:
        dn = decoder.raw_image_visible.copy()  # the view dies with the decoder
        colours = _tile(decoder)
        names = decoder.color_desc.decode("ascii")
        levels = [int(level) for level in decoder.black_level_per_channel]
        white = int(decoder.white_level)
        matrix = np.asarray(decoder.rgb_xyz_matrix, dtype=np.float64)
        shutter_s, iso = float(decoder.other.shutter_speed), float(decoder.other.iso_speed)
        border_dn = border_level(_border(decoder))
    tile = MONOCHROME if colours is None else tuple(tuple(names[c] for c in row) for row in colours)
    tags = _tags(path)
    used = [0] if colours is None else sorted({int(c) for c in colours.ravel()})
    black_level_dn, notes = _black_level(levels, colours)
    header = FrameHeader(
        dn.shape[0],
        dn.shape[1],
        None,
        bits=None if bits is not None else white.bit_length(),
        cfa=tile,
        black_level_dn=black_level_dn,
        white_level_dn=float(white),
        exposure_s=_exposure_s(tags, shutter_s),
        color_matrix=_color_matrix(matrix, names, used, tile),
        metadata=MappingProxyType(_metadata(tags, iso) | ({} if border_dn is None else {BORDER: border_dn})),
    )
    return header.frame(path, dn, bits, cfa), notes


def _tile(decoder: Any) -> NDArray[np.intp] | None:
    """LibRaw's colour numbers over the repeating tile at the visible area's corner, or None without a mosaic."""
    if decoder.num_colors == 1 or decoder.raw_pattern is None:
        return None
    rows, cols = decoder.raw_pattern.shape
    top, left = decoder.sizes.top_margin, decoder.sizes.left_margin
    return np.array([[decoder.raw_color(top + r, left + c) for c in range(cols)] for r in range(rows)])


def _black_level(levels: list[int], colours: NDArray[np.intp] | None) -> tuple[float, tuple[str, ...]]:
    """The mean black level over the tile, and a note where it is a mean of different ones."""
    if colours is None:
        return float(levels[0]), ()
    of_tile = np.array(levels)[colours]
    mean, low, high = float(of_tile.mean()), int(of_tile.min()), int(of_tile.max())
    if low == high:
        return mean, ()
    return mean, (f"black levels differ between the channels, {low} to {high} DN; their mean, {mean:g} DN, is taken",)


def _color_matrix(matrix: NDArray[np.float64], names: str, used: list[int], cfa: Cfa) -> NDArray[np.float64] | None:
    """XYZ to camera from LibRaw's table of cameras; the second green of a Bayer mosaic has no row of its own."""
    first: dict[str, int] = {}
    for number in used:
        first.setdefault(names[number], number)
    if cfa == MONOCHROME or not matrix.any():
        return None
    return matrix[[first[name] for name in channel_names(cfa)]]


def _tags(path: Path) -> Directory:
    """The first directory of a raw file built like TIFF; an empty one for other formats."""
    try:
        return read_directories(path, strict=False)[0]
    except FileError:
        return Directory()


def _exposure_s(tags: Directory, shutter_s: float) -> float | None:
    """Exif's ratio where there is one, else LibRaw's single-precision number, else None."""
    from photosite.frames.io.tiff import exposure_of

    return exposure_of(tags) or (shutter_s if shutter_s > 0 else None)


def _metadata(tags: Directory, iso: float) -> dict[str, Any]:
    """What the tags say, and LibRaw's ISO where they say none; LibRaw has 0 for one it does not know."""
    from photosite.frames.io.tiff import camera_settings

    found = ({"iso": iso} if iso > 0 else {}) | camera_settings(tags)
    return found if "model" not in found else found | {"camera": found["model"]}


def _border(decoder: Any) -> list[NDArray[np.uint16]]:
    """The strips above and left of the visible area, edge on: (lines, pixels). Those after it are often unused."""
    raw, sizes = decoder.raw_image, decoder.sizes
    top, left = sizes.top_margin, sizes.left_margin
    bottom, right = top + sizes.height, left + sizes.width
    return [raw[:top, left:right], raw[top:bottom, :left].T]
