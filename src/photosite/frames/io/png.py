"""Frames in PNG: grey, 8 or 16 bits (ISO/IEC 15948)."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.png import SIGNATURE, PngFile, PngHeader
from photosite.frames.io.description import describe_frame, parse_description
from photosite.frames.io.frame_header import FrameHeader
from photosite.frames.raw_frame import RawFrame

_KEYWORD = b"photosite\0"
_COLOUR_TYPES = {2: "RGB", 3: "a palette", 4: "grey with alpha", 6: "RGB with alpha"}


def write_png(frame: RawFrame, path: Path) -> None:
    """Write the frame as 16-bit grey PNG, its description in a text chunk."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    text = PngInfo()
    text.add_text("photosite", describe_frame(frame))
    # Noise does not compress: level 1 is as small as level 9 to a few percent and many times faster.
    Image.fromarray(np.ascontiguousarray(frame.dn)).save(path, format="PNG", pnginfo=text, compress_level=1)


def read_png_header(path: Path) -> FrameHeader:
    """What a PNG file says of its frame; the whole chain of chunks is walked, none decoded.

    Raises
    ------
    FileError
        If the file is truncated or damaged, or its pixels are not grey of 8 or 16 bits.
    """
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            at, head, text, data_bytes = len(SIGNATURE), b"", "", 0
            while True:
                file.seek(at)
                lead = file.read(8)
                length, kind = struct.unpack(">I4s", lead) if len(lead) == 8 else (0, b"")
                at += 12 + length
                if not kind or at > size:
                    raise FileError(path, f"is truncated: its last chunk is not whole in {size} bytes")
                if kind == b"IHDR":
                    head = file.read(length)
                elif kind == b"tEXt" and file.read(len(_KEYWORD)) == _KEYWORD:
                    text = file.read(length - len(_KEYWORD)).decode("latin-1")
                elif kind == b"IDAT":
                    data_bytes += length
                elif kind == b"IEND":
                    break
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    found = PngHeader.parse(path, head)
    if found.color_type != 0:
        kind_name = _COLOUR_TYPES[found.color_type]
        raise FileError(path, f"is not a raw frame: it is {kind_name}; a raw frame is one grey number a pixel")
    if found.bits not in (8, 16):
        raise FileError(path, f"has pixels of {found.bits} bits; a raw frame has 8 or 16 bits a pixel")
    found.check_density(path, data_bytes)
    rows, cols, bits = found.rows, found.cols, found.bits
    return parse_description(path, text, rows, cols, bits) or FrameHeader(rows, cols, bits)


def read_png_pixels(path: Path) -> NDArray[np.uint16]:
    """The (rows, cols) numbers of a grey PNG file.

    Raises
    ------
    FileError
        If they cannot be decoded.
    """
    from PIL import Image

    PngFile.read(path).check_whole()  # Pillow fills up with zeros what is missing
    try:
        with Image.open(path, formats=("PNG",)) as image:
            pixels = np.asarray(image)
    # Pillow's decoders raise OSError, SyntaxError, ValueError, struct.error, zlib.error ... for damaged files.
    except Exception as error:
        raise FileError(path, f"cannot be decoded: {' '.join(str(error).split())}") from None
    return np.ascontiguousarray(pixels, dtype=np.uint16)
