"""Pages of TIFF files that tifffile decodes: their number, compression and segments, checked before."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from photosite.errors import FileError

MOST_PAGES = 10_000
_JPEG = 7
_PLANES = 2
"""Planar configuration of planes that follow each other."""
_BYTES_HELD = {
    1: 1,
    5: 2560,  # LZW: 12 bits of a full table repeat its longest entry, 3838 bytes
    _JPEG: 10_000,  # 512 with Huffman codes, more with arithmetic ones
    8: 1032,  # deflate: 2 bits repeat 258 bytes
    32773: 64,  # PackBits: 2 bytes are 128
    32946: 1032,  # deflate, old number
    34925: 7100,  # LZMA: a match of 273 bytes takes 14 decisions of 0.022 bits each
    50000: 32_768,  # Zstandard: a block of 4 bytes is 131 072
}
"""Most bytes of values that a byte in the file can hold, by compression."""
_USUAL_BYTES_HELD = 2000
_LARGEST_UNUSUAL = 1 << 30
"""Bytes of a page whose bytes in the file hold more than usual."""
_START_OF_IMAGE, _START_OF_SCAN, _MARKER = 0xD8, 0xDA, 0xFF
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_LONGEST_HEAD = 1 << 16


def pages_of(path: Path, file: Any) -> list[Any]:
    """Return the pages of an open `tifffile.TiffFile`; damaged ones can form a chain without end."""
    pages = list(islice(file.pages, MOST_PAGES + 1))
    if len(pages) > MOST_PAGES:
        raise FileError(path, "pages", value=f"more than {MOST_PAGES}", expected=f"at most {MOST_PAGES}")
    return pages


def bytes_held(compression: int, stored: int) -> int:
    """Return the most bytes of values that this many bytes in a file can hold.

    This is what the compression can reach; above 1 GiB it is 2000 to a byte, so that a file of some kilobytes cannot
    ask for more memory than that.

    Examples
    --------
    >>> bytes_held(8, 100), bytes_held(50000, 100), bytes_held(50000, 10**6)
    (103200, 3276800, 2000000000)
    """
    most = _BYTES_HELD.get(compression, _USUAL_BYTES_HELD) * stored
    return min(most, max(_LARGEST_UNUSUAL, _USUAL_BYTES_HELD * stored))


def decoded(path: Path, page: Any) -> NDArray[Any]:
    """Return the values of a page.

    Raises
    ------
    FileError
        If its compression is another one than documented, or its strips or tiles would be much larger than what the
        file holds of them. Other exceptions are those of the decoders.
    """
    compression = int(page.compression)
    if compression not in _BYTES_HELD:
        raise FileError(
            path,
            "compression",
            value=str(getattr(page.compression, "name", compression)),
            expected="none, LZW, deflate, PackBits, LZMA, Zstandard or JPEG",
            hint="Save it uncompressed",
        )
    rows, cols = (page.tilelength, page.tilewidth) if page.is_tiled else (page.rowsperstrip, page.imagewidth)
    samples = 1 if int(page.planarconfig) == _PLANES else page.samplesperpixel
    values = (rows if page.is_tiled else min(rows, page.imagelength)) * cols * samples
    stored = max(page.databytecounts, default=0)
    if values * int(page.bitspersample) > 8 * bytes_held(compression, stored):
        raise FileError(path, f"is damaged: {stored} bytes cannot hold a strip or tile of {rows} x {cols} pixels")
    if compression == _JPEG:
        for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
            page.parent.filehandle.seek(offset)
            held = _jpeg_values(page.parent.filehandle.read(min(count, _LONGEST_HEAD)))
            if held > values:
                raise FileError(path, f"is damaged: a JPEG of {held} values in a strip or tile of {values}")
    array: NDArray[Any] = page.asarray()
    return array


def _jpeg_values(head: bytes) -> int:
    """Return rows times columns times components of a JPEG stream; 0 where its header does not state them."""
    at = 0
    while at + 4 <= len(head):
        if head[at] != _MARKER:
            return 0
        marker = head[at + 1]
        if marker in (_START_OF_IMAGE, _MARKER):
            at += 2 - (marker == _MARKER)
            continue
        if marker == _START_OF_SCAN:
            return 0
        if marker in _FRAMES and at + 10 <= len(head):
            rows, cols = (int.from_bytes(head[place : place + 2], "big") for place in (at + 5, at + 7))
            return rows * cols * head[at + 9]
        at += 2 + int.from_bytes(head[at + 2 : at + 4], "big")
    return 0
