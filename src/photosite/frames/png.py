"""Frames in PNG: grey, 8 or 16 bits (ISO/IEC 15948)."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.frames.header import FrameHeader, describe, described
from photosite.frames.raw_frame import RawFrame

SIGNATURE = b"\x89PNG\r\n\x1a\n"

_DENSEST = 1040
"""Bytes to a compressed byte: more than deflate reaches (1032)."""

_AT_ONCE = 1 << 20
"""Bytes decompressed in one go."""

_ADAM7 = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))
"""First row and column, and steps, of the passes of an interlaced picture (ISO/IEC 15948, 8.2)."""

_KEYWORD = b"photosite\0"
_COLOUR_TYPES = {2: "RGB", 3: "a palette", 4: "grey with alpha", 6: "RGB with alpha"}


def write_png(frame: RawFrame, path: Path) -> None:
    """Write the frame as 16-bit grey PNG, its description in a text chunk."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    text = PngInfo()
    text.add_text("photosite", describe(frame))
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
    if len(head) != 13 or not data_bytes:
        raise FileError(path, "is damaged: a PNG file without header or image data")
    cols, rows, bits, colour = struct.unpack(">IIBB", head[:10])
    if colour != 0:
        kind_name = _COLOUR_TYPES.get(colour, f"colour type {colour}")
        raise FileError(path, f"is not a raw frame: it is {kind_name}; a raw frame is one grey number a pixel")
    if bits not in (8, 16) or not rows or not cols:
        raise FileError(path, f"has pixels of {bits} bits, {cols} x {rows}; a raw frame has 8 or 16 bits a pixel")
    if _stored_bytes(rows, cols, bits, bool(head[12])) > _DENSEST * data_bytes:
        raise FileError(path, f"is damaged: {rows} x {cols} pixels cannot come out of {data_bytes} bytes")
    return described(path, text, rows, cols, bits) or FrameHeader(rows, cols, bits)


def read_png_pixels(path: Path) -> NDArray[np.uint16]:
    """The (rows, cols) numbers of a grey PNG file.

    Raises
    ------
    FileError
        If they cannot be decoded.
    """
    from PIL import Image

    _check_whole(path)
    try:
        with Image.open(path, formats=("PNG",)) as image:
            pixels = np.asarray(image)
    # Pillow's decoders raise OSError, SyntaxError, ValueError, struct.error, zlib.error ... for damaged files.
    except Exception as error:
        raise FileError(path, f"cannot be decoded: {' '.join(str(error).split())}") from None
    return np.ascontiguousarray(pixels, dtype=np.uint16)


def _stored_bytes(rows: int, cols: int, bits: int, interlaced: bool) -> int:
    """Bytes of a grey picture before compression: a filter byte a row, in seven passes (Adam7) where interlaced."""
    passes = _ADAM7 if interlaced else ((0, 0, 1, 1),)
    sizes = [(-(-(rows - r) // down), -(-(cols - c) // right)) for r, c, down, right in passes]
    return sum(high * (1 + wide * bits // 8) for high, wide in sizes if high > 0 and wide > 0)


def _check_whole(path: Path) -> None:
    """Every chunk's CRC, and that there are pixels to the end: Pillow fills up with zeros what is missing."""
    try:
        content = memoryview(path.read_bytes())
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    at, head, data = len(SIGNATURE), b"", []
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        end = at + 8 + length
        if end + 4 > len(content) or zlib.crc32(content[at + 4 : end]) != struct.unpack_from(">I", content, end)[0]:
            raise FileError(path, f"is damaged: the chunk at byte {at} does not match its checksum")
        kind = bytes(content[at + 4 : at + 8])
        if kind == b"IHDR":
            head = bytes(content[at + 8 : end])
        elif kind == b"IDAT":
            data.append(content[at + 8 : end])
        at = end + 4
    cols, rows, bits = struct.unpack(">IIB", head[:9]) if len(head) == 13 else (0, 0, 0)
    wanted = _stored_bytes(rows, cols, bits, bool(head[12:13].strip(b"\0")))
    if (stored := _decompressed(path, data, wanted)) < wanted:
        raise FileError(path, f"is damaged: {stored} bytes of image data, {wanted} expected")


def _decompressed(path: Path, data: list[memoryview], enough: int) -> int:
    """Bytes that the image data decompress to, counted up to what is enough."""
    stream, count = zlib.decompressobj(), 0
    try:
        for part in data:
            rest: bytes | memoryview = part
            while rest and not stream.eof and count < enough:
                count += len(stream.decompress(rest, _AT_ONCE))
                rest = stream.unconsumed_tail
        # What is left lies inside the stream.
        while count < enough and not stream.eof and (got := stream.decompress(stream.unconsumed_tail, _AT_ONCE)):
            count += len(got)
    except zlib.error as error:
        raise FileError(path, f"is damaged: its image data cannot be decompressed ({error})") from None
    return count
