"""Frames of Raspberry Pi's older camera programs (raspistill --raw, picamera): a JPEG picture with raw data behind it.

The raw data begin with "BRCM". The camera's header of 32 768 bytes has the mode's name, width, height, Bayer order and
format at byte 176. Rows of RAW10 or RAW12 (MIPI) follow, padded to 32 bytes. Streams of the newer programs (rpicam-raw,
libcamera) have no header: `photosite.frames.io.headerless`.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.frames.frame_file import FrameHeader, FrameLocation
from photosite.frames.io import headerless
from photosite.frames.layout import Layout
from photosite.values.cfa import cfa_from

_BLOCKS = (18711040, 10270208, 6404096)
"""Bytes of the raw data of the HQ camera and of camera modules 2 and 1, at the end of the file."""

_HEADER_BYTES, _FIELDS_AT, _FIELDS = 32768, 176, "<32s4H24x2H2B"
_ORDERS = ("rggb", "gbrg", "bggr", "grbg")
_PACKINGS = {3: "mipi10", 4: "mipi12"}
_ALIGNED = 32


@dataclass(frozen=True)
class _Block:
    """The raw data in a file: their layout, Bayer order and the name of the mode."""

    layout: Layout
    cfa: str
    mode: str


def recognizes(path: Path, head: bytes) -> bool:
    """Return whether raw data of a Raspberry Pi lie behind a JPEG picture."""
    return has_raw_data(path)


def has_raw_data(path: Path) -> bool:
    """Return whether a file ends in raw data of a Raspberry Pi camera."""
    return _start(path) is not None


def _start(path: Path) -> int | None:
    """Return the position of the raw data, or None."""
    size = os.path.getsize(path)
    with path.open("rb") as file:
        for block in _BLOCKS:
            if size > block:
                file.seek(size - block)
                if file.read(4) == b"BRCM":
                    return size - block
    return None


def _block(path: Path) -> _Block:
    start = _start(path)
    if start is None:
        raise FileError(path, "the file has no raw data of a Raspberry Pi camera")
    with path.open("rb") as file:
        file.seek(start + _FIELDS_AT)
        fields = file.read(struct.calcsize(_FIELDS))
    name, cols, rows, *_, order, kind = struct.unpack(_FIELDS, fields)
    if kind not in _PACKINGS or order >= len(_ORDERS) or min(cols, rows) < 1:
        problem = f"the header of the raw data states {cols} x {rows} pixels of format {kind}, order {order}"
        raise FileError(path, problem, hint="Formats 3 (RAW10) and 4 (RAW12) are supported")
    layout = Layout(cols, rows, _PACKINGS[kind], offset=start + _HEADER_BYTES)
    layout = replace(layout, stride=-(-layout.row_bytes // _ALIGNED) * _ALIGNED)
    return _Block(layout, _ORDERS[order], name.split(b"\0")[0].decode("ascii", "replace"))


def read_headers(path: Path) -> tuple[FrameHeader]:
    """Read the header of the raw data."""
    block = _block(path)
    layout = block.layout
    end, size = layout.offset + layout.frame_bytes, os.path.getsize(path)
    if end > size:
        raise FileError(path, f"is truncated: its raw data end at byte {end}, the file at {size}")
    bits = 10 if layout.numbers == "mipi10" else 12
    metadata = {"read_mode": block.mode} if block.mode else {}
    return (FrameHeader(layout.rows, layout.cols, 16, bits=bits, cfa=cfa_from(block.cfa), metadata=metadata),)


def read_pixels(path: Path, location: FrameLocation | None) -> NDArray[np.uint16]:
    """Read the (rows, cols) digital numbers of the raw data."""
    return headerless.read_pixels(path, FrameLocation("", f"{headerless.LAYOUT}{_block(path).layout}"))
