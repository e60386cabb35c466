"""Headerless raw files: pixels without a header, in a stated layout.

Layouts are those of `photosite.frames.layout`. A file may hold several frames, one after the other.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.small_files import reading
from photosite.frames.frame_file import FrameHeader, FrameLocation
from photosite.frames.layout import PACKED, Layout, parse_layout

SUFFIXES = (".raw", ".bin", ".dat", ".img", ".data", ".gray", ".bayer", ".y8", ".y10", ".y12", ".y16")
"""Suffixes of headerless files in a folder."""

EXAMPLE = "3280x2464,packed=mipi10"

LAYOUT = "layout:"
"""Beginning of `FrameLocation.part` of a headerless frame; the layout follows."""

_SIZES = (
    *((4056, 3040), (4608, 2592), (3280, 2464), (2592, 1944), (2028, 1520), (2304, 1296), (2028, 1080), (1640, 1232)),
    *((1920, 1080), (1456, 1088), (1332, 990), (1296, 972), (3840, 2160), (2048, 1536), (2448, 2048), (2048, 2048)),
    *(
        (1280, 1024),
        (1280, 960),
        (1280, 800),
        (1280, 720),
        (1024, 1024),
        (1024, 768),
        (800, 600),
        (640, 480),
        (512, 512),
    ),
    *((9248, 6944), (4000, 3000), (4096, 3000), (4096, 2160), (4096, 4096), (5472, 3648), (3096, 2080), (512, 512)),
)
"""Usual columns and rows, those of Raspberry Pi's cameras first."""


def guessed_layouts(size: int) -> list[Layout]:
    """Return layouts of usual sizes that a file of this many bytes can have, the most likely first.

    Examples
    --------
    >>> [str(layout) for layout in guessed_layouts(4128 * 2464)]
    ['3280x2464,packed=mipi10,stride=4128']
    """
    return sorted(_guesses(size), key=lambda layout: layout.stride is not None)[:_MOST_GUESSES]


_MOST_GUESSES = 3


def _guesses(size: int) -> Iterator[Layout]:
    for cols, rows in _SIZES:
        for numbers in ("uint16", "mipi10", "mipi12", "uint8"):
            plain = Layout(cols, rows, numbers)
            aligned = (-(-plain.row_bytes // n) * n for n in (16, 32, 64))
            for stride in dict.fromkeys((plain.row_bytes, *aligned)):
                if stride * rows == size:
                    yield Layout(cols, rows, numbers, stride=None if stride == plain.row_bytes else stride)


def guess_text(path: Path) -> str:
    """Return in words which layouts a file can have."""
    found = guessed_layouts(os.path.getsize(path))
    return " or ".join(map(str, found)) if found else ""


def read_headers(path: Path, layout: Layout) -> tuple[FrameHeader, ...]:
    """Return the headers of the frames of a file."""
    with reading(path):
        size = os.path.getsize(path)
    count = layout.frames(size)
    if not count:
        wanted = layout.offset + layout.frame_bytes
        guess = guess_text(path)
        hint = f"The size is that of {guess}" if guess else "A frame or several must fill the file"
        what = f"has {size} bytes, and the layout {layout} needs {wanted} for each frame"
        raise FileError(path, what, hint=hint)
    bits = PACKED[layout.numbers][2] if layout.numbers in PACKED else None
    return tuple(
        FrameHeader(
            layout.rows,
            layout.cols,
            8 if layout.numbers == "uint8" else 16,
            bits=bits,
            location=FrameLocation("" if count == 1 else f"[{index}]", f"{LAYOUT}{layout}", index, (str(index),)),
        )
        for index in range(count)
    )


def read_pixels(path: Path, location: FrameLocation) -> NDArray[np.uint16]:
    """Read the (rows, cols) digital numbers of one frame."""
    layout = parse_layout(str(location.part).removeprefix(LAYOUT))
    stride = layout.stride or layout.row_bytes
    start = layout.offset + location.index * layout.frame_bytes
    wanted = layout.frame_bytes - stride + layout.row_bytes
    with reading(path), path.open("rb") as file:
        file.seek(start)
        content = np.fromfile(file, np.uint8, wanted)
    if len(content) < wanted:
        raise FileError(path, f"is truncated: frame {location.index} ends at byte {start + wanted}")
    rows = np.lib.stride_tricks.as_strided(content, (layout.rows, layout.row_bytes), (stride, 1))
    return _unpacked(rows, layout)


def _unpacked(rows: NDArray[np.uint8], layout: Layout) -> NDArray[np.uint16]:
    if layout.numbers == "uint8":
        return rows.astype(np.uint16)
    if layout.numbers == "uint16":
        return np.ascontiguousarray(rows).view("<u2" if layout.order == "little" else ">u2").astype(np.uint16)
    pixels, size, _ = PACKED[layout.numbers]
    if layout.numbers == "d100":
        padded = np.pad(rows, ((0, 0), (0, -rows.shape[1] % size)))
        rows, pixels, size = padded.reshape(len(rows), -1, size)[:, :, :-1].reshape(len(rows), -1), 2, 3
    groups = rows.reshape(len(rows), -1, size).astype(np.uint16)
    out = np.empty((*groups.shape[:2], pixels), np.uint16)
    if layout.numbers in ("nikon12", "d100"):
        out[..., 0] = groups[..., 0] << 4 | groups[..., 1] >> 4
        out[..., 1] = (groups[..., 1] & 15) << 8 | groups[..., 2]
    else:
        bits = 8 // pixels
        for number in range(pixels):
            low = groups[..., pixels] >> bits * number & (1 << bits) - 1
            out[..., number] = groups[..., number] << bits | low
    return np.ascontiguousarray(out.reshape(len(rows), -1)[:, : layout.cols])
