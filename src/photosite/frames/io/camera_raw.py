"""Frames in camera makers' raw formats (NEF, CR2, CR3, ARW, RAF, ...), decoded by LibRaw through rawpy.

The frame is the visible area; the level of the borders is kept in the metadata (`photosite.frames.raw_frame`). LibRaw
gives levels as whole numbers. Exposure and ISO come from Exif or TIFF/EP if the format is based on TIFF (NEF, CR2,
ARW, ...), otherwise from LibRaw.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.frames.covered_lines import line_means
from photosite.frames.frame_file import FrameHeader
from photosite.frames.io.format_table import CAMERA_RAW, TIFF
from photosite.frames.io.tiff import (
    LENGTH,
    SUB_IFDS,
    WIDTH,
    Directory,
    camera_settings,
    exposure_of,
    image_end,
    read_directories,
)
from photosite.frames.raw_frame import MASKED_BORDER, RawFrame, masked_border_level, neutral_text
from photosite.values.cfa import MONOCHROME, Cfa, channel_names

_MAGIC = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"\0MRM", b"FOVb")


def recognizes(path: Path, head: bytes) -> bool:
    """Return whether a file is a camera's raw file; one in TIFF has a mark of CR2 or a suffix of a camera."""
    if head.startswith(TIFF.signatures):
        return head[8:10] == b"CR" or path.suffix.lower() in CAMERA_RAW.suffixes
    return head.startswith(_MAGIC) or head[4:11] == b"ftypcrx" or head[6:14] == b"HEAPCCDR"


@contextmanager
def open_libraw(path: Path) -> Iterator[Any]:
    """Open a file with LibRaw; errors of LibRaw become a FileError."""
    import rawpy

    try:
        with rawpy.imread(str(path)) as decoder:
            if decoder.raw_type != rawpy.RawType.Flat:
                raise FileError(path, "the file has several numbers per pixel; a raw frame has one")
            yield decoder
    except rawpy.LibRawError as error:
        problem = f"the file cannot be decoded: {_reason(error)}"
        raise FileError(path, problem, hint="It may be truncated") from None


def _reason(error: Exception) -> str:
    """Return the message of LibRaw, which is bytes, or of rawpy."""
    return error.args[0].decode() if error.args and isinstance(error.args[0], bytes) else str(error)


def read_headers(path: Path) -> tuple[FrameHeader]:
    """Read the header of a camera's raw file without decoding it: size, exposure, ISO."""
    import rawpy

    tags = _tags(path)
    try:
        with rawpy.imread(str(path)) as decoder:
            rows, cols = decoder.sizes.height, decoder.sizes.width
            check_size(path, decoder.sizes)
            shutter_s, iso = float(decoder.other.shutter_speed), float(decoder.other.iso_speed)
    except rawpy.LibRawError as error:
        raise FileError(path, f"LibRaw cannot open the file: {_reason(error)}") from None
    metadata = _metadata(tags, iso)
    return (FrameHeader(rows, cols, None, exposure_s=_exposure_s(tags, shutter_s), metadata=metadata),)


def read_frame(path: Path, bits: int | None = None, cfa: Cfa | None = None) -> tuple[RawFrame, tuple[str, ...]]:
    """Read the visible area of a camera's raw file, with notes for warnings."""
    return read_bordered(path, bits, cfa)[:2]


def read_bordered(
    path: Path, bits: int | None = None, cfa: Cfa | None = None
) -> tuple[RawFrame, tuple[str, ...], NDArray[np.float64]]:
    """Read the visible area of a camera's raw file, notes for warnings, and the means of the lines beside it.

    By default, the bit depth is the bits that the white level needs.
    """
    tags = _tags(path)
    with open_libraw(path) as decoder:
        check_size(path, decoder.sizes)
        dn = decoder.raw_image_visible.copy()  # the view is invalid once the decoder is closed
        check_filled(path, decoder.raw_image)
        colors = _tile(decoder)
        names = decoder.color_desc.decode("ascii")
        levels = [int(level) for level in decoder.black_level_per_channel]
        white = int(decoder.white_level)
        matrix = np.asarray(decoder.rgb_xyz_matrix, dtype=np.float64)
        shutter_s, iso = float(decoder.other.shutter_speed), float(decoder.other.iso_speed)
        strips = _border(decoder)
        border_dn, lines = masked_border_level(strips), line_means(strips)
        gains = [float(gain) for gain in decoder.camera_whitebalance[:3]]
    tile = MONOCHROME if colors is None else tuple(tuple(names[c] for c in row) for row in colors)
    used = [0] if colors is None else sorted({int(c) for c in colors.ravel()})
    black_level_dn, notes = _black_level(levels, colors)
    metadata = _metadata(tags, iso) | ({} if border_dn is None else {MASKED_BORDER: border_dn})
    if set(channel_names(tile)) == {"R", "G", "B"} and names.startswith("RGB") and min(gains) > 0:
        metadata["as_shot_neutral"] = neutral_text([1 / gain for gain in gains])
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
        metadata=metadata,
    )
    return header.to_frame(path, dn, bits, cfa), notes, lines


def _tile(decoder: Any) -> NDArray[np.intp] | None:
    """Return LibRaw's color numbers of the tile at the visible area's corner, or None without a mosaic."""
    if decoder.num_colors == 1 or decoder.raw_pattern is None:
        return None
    rows, cols = decoder.raw_pattern.shape
    top, left = decoder.sizes.top_margin, decoder.sizes.left_margin
    return np.array([[decoder.raw_color(top + r, left + c) for c in range(cols)] for r in range(rows)])


def _black_level(levels: list[int], colors: NDArray[np.intp] | None) -> tuple[float, tuple[str, ...]]:
    """Return the mean black level over the tile, and a note if the levels differ."""
    if colors is None:
        return float(levels[0]), ()
    of_tile = np.array(levels)[colors]
    mean, low, high = float(of_tile.mean()), int(of_tile.min()), int(of_tile.max())
    if low == high:
        return mean, ()
    return mean, (f"black levels differ between channels, {low} to {high} DN; their mean, {mean:g} DN, is used",)


def _color_matrix(matrix: NDArray[np.float64], names: str, used: list[int], cfa: Cfa) -> NDArray[np.float64] | None:
    """Return XYZ to camera from LibRaw's camera table; the second green of a Bayer mosaic has no row."""
    first: dict[str, int] = {}
    for number in used:
        first.setdefault(names[number], number)
    if cfa == MONOCHROME or not matrix.any():
        return None
    return matrix[[first[name] for name in channel_names(cfa)]]


def _tags(path: Path) -> Directory:
    """Return the first directory of a raw file based on TIFF, an empty one for other formats.

    Raises
    ------
    FileError
        If the largest image ends beyond the end of the file: LibRaw fills what is missing with zeros.
    """
    try:
        directories = read_directories(path, strict=False)
    except FileError:
        return Directory()
    every = [child for page in directories for child in (page, *page.children.get(SUB_IFDS, ()))]
    largest = max(every, key=lambda page: (page.number(WIDTH) or 0) * (page.number(LENGTH) or 0))
    size, end = os.path.getsize(path), image_end(largest)
    if end > size:
        raise FileError(path, f"is truncated: its image data end at byte {end}, the file at {size}")
    return directories[0]


_LEAST_BITS = 0.5
"""Bits of a pixel that a compressed raw file holds at least; lossless ones of darkness need about 2."""
_FILLED_ROWS = 8
"""Rows of zeros at the end of a frame that are not those of a dark frame without a black level."""


def check_size(path: Path, sizes: Any) -> None:
    """Raise `FileError` for a file that is too short to hold its pixels."""
    size, pixels = os.path.getsize(path), sizes.raw_height * sizes.raw_width
    if 8 * size < _LEAST_BITS * pixels:
        what = f"is truncated: {size} bytes cannot hold {sizes.raw_height} x {sizes.raw_width} pixels"
        raise FileError(path, what)


def check_filled(path: Path, raw: NDArray[np.uint16]) -> None:
    """Raise `FileError` where LibRaw filled the last rows with zeros because the file ends before them."""
    lit = np.flatnonzero(raw.any(axis=1)) if not raw[-_FILLED_ROWS:].any() else np.arange(len(raw))
    if len(lit) and len(raw) - 1 - lit[-1] >= _FILLED_ROWS:
        what = f"is truncated: the last {len(raw) - 1 - lit[-1]} of {len(raw)} rows have no data and are zeros"
        raise FileError(path, what)


def _exposure_s(tags: Directory, shutter_s: float) -> float | None:
    """Return Exif's ratio, else LibRaw's single-precision number, else None."""
    return exposure_of(tags) or (shutter_s if shutter_s > 0 else None)


def _metadata(tags: Directory, iso: float) -> dict[str, Any]:
    """Return the tags' metadata, and LibRaw's ISO if the tags have none; LibRaw gives 0 if it is unknown."""
    found = ({"iso": iso} if iso > 0 else {}) | camera_settings(tags)
    return found if "model" not in found else found | {"camera": found["model"]}


def _border(decoder: Any) -> list[NDArray[np.uint16]]:
    """Return the strips above and left of the visible area, (lines, pixels); the other sides are often unused."""
    raw, sizes = decoder.raw_image, decoder.sizes
    top, left = sizes.top_margin, sizes.left_margin
    bottom, right = top + sizes.height, left + sizes.width
    return [raw[:top, left:right], raw[top:bottom, :left].T]
