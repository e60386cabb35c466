"""Large pictures as PNG, compressed in all threads of the process."""

from __future__ import annotations

import struct
import zlib
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from photosite.engine.threads import parallel_for
from photosite.frames.frame_file import SOFTWARE

_BAND_ROWS = 128
"""Rows compressed at a time, without reference to others."""
_UP = 2
"""Filter type of a row whose bytes are differences from the row above."""
_ADLER = 65521


def encode_png(codes: NDArray[np.unsignedinteger]) -> bytes:
    """Return a PNG of (rows, cols, 3) integers of 8 or 16 bits, sRGB.

    Only runs of equal bytes are compressed, besides the Huffman coding: in noise, a search for longer repetitions finds
    few, and takes most of the time.

    References
    ----------
    ISO/IEC 15948 (PNG); RFC 1950 and 1951 (zlib, deflate).

    Examples
    --------
    >>> from imagecodecs import png_decode
    >>> codes = np.arange(300 * 2 * 3, dtype=np.uint16).reshape(300, 2, 3)
    >>> bool((png_decode(encode_png(codes)) == codes).all())
    True
    """
    rows, cols, _ = codes.shape
    bits = 8 * codes.itemsize
    lines = codes.astype(codes.dtype.newbyteorder(">"), copy=False).reshape(rows, -1).view(np.uint8)
    firsts = range(0, rows, _BAND_ROWS)
    bands = [(b"", 1, 0)] * len(firsts)

    def encode(begin: int, end: int) -> None:
        for n in range(begin, end):
            bands[n] = _band(lines, firsts[n], min(firsts[n] + _BAND_ROWS, rows))

    parallel_for(encode, len(firsts))
    *_, (_, checksum, _) = accumulate(bands, _joined)
    header = struct.pack(">IIBBBBB", cols, rows, bits, 2, 0, 0, 0)  # RGB, deflate, not interlaced
    data = [b"\x78\x01", *(band for band, _, _ in bands), struct.pack(">I", checksum)]
    chunks = [(b"IHDR", header), *((b"IDAT", part) for part in data), (b"IEND", b"")]
    return with_chunks(b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, content) for kind, content in chunks))


def _chunk(kind: bytes, content: bytes) -> bytes:
    checked = zlib.crc32(content, zlib.crc32(kind))
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checked)


_AFTER_HEADER = 33
"""Bytes of the signature and the chunk IHDR."""
_OF_PICTURES = _chunk(b"sRGB", b"\0") + _chunk(b"tEXt", b"Software\0" + SOFTWARE.encode())
"""Colors are sRGB, with perceptual intent; by the software, folders of frames skip the picture."""


def with_chunks(encoded: bytes) -> bytes:
    """Return a PNG with the chunks of developed pictures behind its header."""
    return encoded[:_AFTER_HEADER] + _OF_PICTURES + encoded[_AFTER_HEADER:]


def _band(lines: NDArray[np.uint8], first: int, last: int) -> tuple[bytes, int, int]:
    """Return rows as blocks of a deflate stream, and the checksum and number of the bytes before compression."""
    filtered: NDArray[np.uint8] = np.empty((last - first, 1 + lines.shape[1]), np.uint8)
    filtered[:, 0] = _UP
    filtered[0, 1:] = lines[first] - (lines[first - 1] if first else 0)
    np.subtract(lines[first + 1 : last], lines[first : last - 1], out=filtered[1:, 1:])
    deflate = zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS, 9, zlib.Z_RLE)
    content = deflate.compress(filtered.data) + deflate.flush(
        zlib.Z_FINISH if last == len(lines) else zlib.Z_FULL_FLUSH
    )
    return content, zlib.adler32(filtered.data), filtered.size


def _joined(one: tuple[bytes, int, int], other: tuple[bytes, int, int]) -> tuple[bytes, int, int]:
    """Return no content, the Adler-32 checksum of the bytes of both, and their number."""
    (_, before, size), (_, after, more) = one, other
    low = ((before & 0xFFFF) + (after & 0xFFFF) - 1) % _ADLER
    high = ((before >> 16) + (after >> 16) + more * ((before & 0xFFFF) - 1)) % _ADLER
    return b"", high << 16 | low, size + more
