"""Headerless raw files: pixels without a header, in a stated layout.

A layout is text such as `3280x2464,uint16,little,offset=32768,stride=6560` or `3280x2464,packed=mipi10,stride=4128`:
columns x rows, then in any order

    uint8, uint16     numbers of one or two bytes (uint16 by default), little or big endian (little by default)
    packed=mipi10     4 pixels in 5 bytes: 8 high bits of each, then the low bits of all, those of the first one lowest
    packed=mipi12     2 pixels in 3 bytes: 8 high bits of each, then the low bits of both, likewise
    packed=nikon12    2 pixels in 3 bytes, the highest bit first, as in uncompressed NEF files of 12 bits
    offset=BYTES      before the first pixel (0 by default)
    stride=BYTES      from one row to the next (those of the pixels by default)

The packings `mipi10` and `mipi12` are those of MIPI CSI-2 (RAW10, RAW12) and V4L2 (SRGGB10P, SRGGB12P). A file may hold
several frames, one after the other.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.files.small_files import reading
from photosite.frames.frame_file import FrameHeader, FrameLocation

SUFFIXES = (".raw", ".bin", ".dat", ".img", ".data", ".gray", ".bayer", ".y8", ".y10", ".y12", ".y16")
"""Suffixes of headerless files in a folder."""

LAYOUT = "layout:"
"""Beginning of `FrameLocation.part` of a headerless frame; the layout follows."""

_FORM = "COLUMNSxROWS,uint8|uint16|packed=mipi10|mipi12|nikon12[,little|big][,offset=BYTES][,stride=BYTES]"

_PACKED = {"mipi10": (4, 5, 10), "mipi12": (2, 3, 12), "nikon12": (2, 3, 12)}
"""Pixels and bytes of a group, and bits of a pixel."""

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


@dataclass(frozen=True)
class Layout:
    """How the pixels of a headerless file are stored; fields as in the text of a layout."""

    cols: int
    rows: int
    numbers: str = "uint16"
    order: str = "little"
    offset: int = 0
    stride: int | None = None

    @property
    def row_bytes(self) -> int:
        """Bytes of the pixels of a row."""
        if self.numbers not in _PACKED:
            return self.cols * (2 if self.numbers == "uint16" else 1)
        pixels, size, _ = _PACKED[self.numbers]
        return -(-self.cols // pixels) * size

    @property
    def frame_bytes(self) -> int:
        """Bytes from the beginning of one frame to the next."""
        return self.rows * (self.stride or self.row_bytes)

    def frames(self, size: int) -> int:
        """Return the number of frames in a file of a size; 0 if it does not fit."""
        last = (self.stride or self.row_bytes) - self.row_bytes  # the end of the last row may be missing
        count, rest = divmod(size - self.offset, self.frame_bytes)
        if rest == self.frame_bytes - last and last:
            count, rest = count + 1, 0
        return count if rest == 0 and size > self.offset else 0

    def __str__(self) -> str:
        packed = self.numbers in _PACKED
        parts = [f"{self.cols}x{self.rows}", f"packed={self.numbers}" if packed else self.numbers]
        parts += [self.order] if self.numbers == "uint16" and self.order != "little" else []
        parts += [f"offset={self.offset}"] if self.offset else []
        return ",".join([*parts, *([f"stride={self.stride}"] if self.stride else [])])


def parse_layout(text: str) -> Layout:
    """Return the layout of a text.

    Raises
    ------
    InputError
        If the text is no layout.

    Examples
    --------
    >>> parse_layout("3280x2464,packed=mipi10,stride=4128").row_bytes
    4100
    """
    error = InputError("layout", value=text, expected=_FORM, hint="Such as 3280x2464,uint16 or 4056x3040,packed=mipi12")
    first, *parts = text.replace(" ", "").lower().split(",")
    found = re.fullmatch(r"(\d+)[x×](\d+)", first)
    if found is None:
        raise error
    fields: dict[str, Any] = {}
    for part in parts:
        name, _, value = part.partition("=")
        if part in ("uint8", "uint16") or part in _PACKED or (name == "packed" and value in _PACKED):
            key, value = "numbers", part if part in ("uint8", "uint16") else value or part
        elif part in ("little", "big"):
            key, value = "order", part
        elif name in ("offset", "stride") and value.isdecimal():
            key = name
        else:
            raise error
        if key in fields:
            raise error
        fields[key] = int(value) if key in ("offset", "stride") else value
    layout = Layout(int(found[1]), int(found[2]), **fields)
    if min(layout.cols, layout.rows) < 1 or (layout.stride is not None and layout.stride < layout.row_bytes):
        raise error
    return layout


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
    bits = _PACKED[layout.numbers][2] if layout.numbers in _PACKED else None
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
    pixels, size, _ = _PACKED[layout.numbers]
    groups = rows.reshape(len(rows), -1, size).astype(np.uint16)
    out = np.empty((*groups.shape[:2], pixels), np.uint16)
    if layout.numbers == "nikon12":
        out[..., 0] = groups[..., 0] << 4 | groups[..., 1] >> 4
        out[..., 1] = (groups[..., 1] & 15) << 8 | groups[..., 2]
    else:
        bits = 8 // pixels
        for number in range(pixels):
            low = groups[..., pixels] >> bits * number & (1 << bits) - 1
            out[..., number] = groups[..., number] << bits | low
    return np.ascontiguousarray(out.reshape(len(rows), -1)[:, : layout.cols])
