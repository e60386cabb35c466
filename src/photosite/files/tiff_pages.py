"""Pages of TIFF files that tifffile decodes: their number, compression and segments, checked before."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from photosite.errors import FileError

MOST_PAGES = 10_000
HIGHEST_COMPRESSION = 10_000
"""Values to a compressed byte; LZW and deflate reach less."""

_JPEG = 7
_PLANES = 2
"""Planar configuration of planes that follow each other."""
_COMPRESSIONS = (1, 5, _JPEG, 8, 32773, 32946, 34925, 50000)
"""None, LZW, JPEG, deflate, PackBits, deflate (old), LZMA, Zstandard."""
_START_OF_IMAGE, _START_OF_SCAN, _MARKER = 0xD8, 0xDA, 0xFF
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_LONGEST_HEAD = 1 << 16


def pages_of(path: Path, file: Any) -> list[Any]:
    """Return the pages of an open `tifffile.TiffFile`; damaged ones can form a chain without end."""
    pages = list(islice(file.pages, MOST_PAGES + 1))
    if len(pages) > MOST_PAGES:
        raise FileError(path, "pages", value=f"more than {MOST_PAGES}", expected=f"at most {MOST_PAGES}")
    return pages


def decoded(path: Path, page: Any) -> NDArray[Any]:
    """Return the values of a page.

    Raises
    ------
    FileError
        If its compression is another one than documented, or its strips or tiles would be much larger than what the
        file holds of them. Other exceptions are those of the decoders.
    """
    compression = int(page.compression)
    if compression not in _COMPRESSIONS:
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
    if values > HIGHEST_COMPRESSION * stored:
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
