"""Layouts of headerless files, as options and protocols state them.

A layout is text such as `3280x2464,uint16,little,offset=32768,stride=6560` or `3280x2464,packed=mipi10,stride=4128`:
columns x rows, then in any order

    uint8, uint16     numbers of one or two bytes (uint16 by default), little or big endian (little by default)
    packed=mipi10     4 pixels in 5 bytes: 8 high bits of each, then the low bits of all, those of the first one lowest
    packed=mipi12     2 pixels in 3 bytes: 8 high bits of each, then the low bits of both, likewise
    packed=nikon12    2 pixels in 3 bytes, the highest bit first, as in uncompressed NEF files of 12 bits
    packed=d100       likewise, with an empty byte after 10 pixels (Nikon D100)
    offset=BYTES      before the first pixel (0 by default)
    stride=BYTES      from one row to the next (those of the pixels by default)

The packings `mipi10` and `mipi12` are those of MIPI CSI-2 (RAW10, RAW12) and V4L2 (SRGGB10P, SRGGB12P).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from photosite.errors import InputError

_FORM = "COLUMNSxROWS,uint8|uint16|packed=mipi10|mipi12|nikon12|d100[,little|big][,offset=BYTES][,stride=BYTES]"

PACKED = {"mipi10": (4, 5, 10), "mipi12": (2, 3, 12), "nikon12": (2, 3, 12), "d100": (10, 16, 12)}
"""Pixels and bytes of a group, and bits of a pixel."""


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
        if self.numbers not in PACKED:
            return self.cols * (2 if self.numbers == "uint16" else 1)
        pixels, size, bits = PACKED[self.numbers]
        if self.numbers == "d100":
            return self.cols // pixels * size + -(-(self.cols % pixels) * bits // 8)
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
        packed = self.numbers in PACKED
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
        if part in ("uint8", "uint16") or part in PACKED or (name == "packed" and value in PACKED):
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
