"""What is inside a PNG file (ISO/IEC 15948): chunks with their check sums, and the size of its pixels unpacked.

Pillow fills up with zeros what is missing of a picture; here it is counted.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from photosite.errors import FileError

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""By colour type: grey, red green blue, a palette's numbers, grey with opacity, colour with opacity."""

_ADAM7 = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))
"""First row and column, and steps, of the passes of an interlaced picture (ISO/IEC 15948, 8.2)."""

_DENSEST = 1040
"""Bytes to a compressed byte: more than deflate reaches (1032)."""

_AT_ONCE = 1 << 20
"""Bytes decompressed in one go where they are only counted."""


@dataclass(frozen=True)
class Pass:
    """A picture's pixels `[row :: down, col :: right]`, of which there are rows x cols."""

    row: int
    col: int
    down: int
    right: int
    rows: int
    cols: int


@dataclass(frozen=True)
class PngHeader:
    """The chunk IHDR.

    Examples
    --------
    >>> head = PngHeader.parse("a.png", struct.pack(">IIBBBBB", 4, 3, 16, 2, 0, 0, 0))
    >>> head.rows, head.pixel_bits, head.stored_bytes
    (3, 48, 75)
    """

    rows: int
    cols: int
    bits: int
    color_type: int
    interlaced: bool

    @classmethod
    def parse(cls, path: str | PathLike[str], content: bytes) -> PngHeader:
        """From the chunk's content.

        Raises
        ------
        FileError
            If no PNG has such a one.
        """
        if len(content) != 13:
            raise FileError(path, "is damaged: a PNG file without a header")
        cols, rows, bits, color, method, filters, interlaced = struct.unpack(">IIBBBBB", content)
        known = color in CHANNELS and bits in (1, 2, 4, 8, 16) and not method and not filters and interlaced < 2
        if not (known and rows and cols):
            raise FileError(path, f"is damaged: no PNG has the header {content.hex(' ')}")
        return cls(rows, cols, bits, color, bool(interlaced))

    @property
    def pixel_bits(self) -> int:
        """Of a pixel with all its channels."""
        return self.bits * CHANNELS[self.color_type]

    @property
    def passes(self) -> tuple[Pass, ...]:
        """One, or the seven of an interlaced picture, without those that are empty."""
        found = (
            Pass(r, c, down, right, -(-(self.rows - r) // down), -(-(self.cols - c) // right))
            for r, c, down, right in (_ADAM7 if self.interlaced else ((0, 0, 1, 1),))
        )
        return tuple(part for part in found if part.rows > 0 and part.cols > 0)

    def row_bytes(self, cols: int) -> int:
        """Of so many pixels, without the filter before them."""
        return -(-cols * self.pixel_bits // 8)

    @property
    def stored_bytes(self) -> int:
        """Of the whole picture before compression: a filter byte a row, and the pixels."""
        return sum(part.rows * (1 + self.row_bytes(part.cols)) for part in self.passes)

    def check_density(self, path: str | PathLike[str], compressed: int) -> None:
        """Refuse more pixels than come out of so many bytes.

        Raises
        ------
        FileError
            If there are.
        """
        if self.stored_bytes > _DENSEST * compressed:
            raise FileError(path, f"is damaged: {self.rows} x {self.cols} pixels cannot come out of {compressed} bytes")


@dataclass(frozen=True)
class PngFile:
    """A file whose check sums were right."""

    path: Path
    header: PngHeader
    chunks: dict[bytes, bytes]
    """The last of each kind, but for the pixels."""
    data: tuple[memoryview, ...]
    """The pixels, compressed."""

    @classmethod
    def read(cls, path: str | PathLike[str]) -> PngFile:
        """All of a file.

        Raises
        ------
        FileError
            If it is truncated, or a check sum is wrong.
        """
        others: dict[bytes, bytes] = {}
        data: list[memoryview] = []
        for kind, content in _chunks(Path(path)):
            if kind == b"IDAT":
                data.append(content)
            else:
                others[kind] = bytes(content)
        header = PngHeader.parse(path, others.get(b"IHDR", b""))
        header.check_density(path, sum(map(len, data)))
        return cls(Path(path), header, others, tuple(data))

    def unpacked(self) -> bytes:
        """The `stored_bytes` of the picture.

        Raises
        ------
        FileError
            If the file has fewer, or they cannot be decompressed.
        """
        try:
            plain = zlib.decompressobj().decompress(b"".join(self.data), self.header.stored_bytes)
        except zlib.error as error:
            raise self._spoilt(error) from None
        self._check_count(len(plain))
        return plain

    def check_whole(self) -> None:
        """Count the bytes of the picture without keeping them.

        Raises
        ------
        FileError
            As `unpacked`.
        """
        stream, count, wanted = zlib.decompressobj(), 0, self.header.stored_bytes
        try:
            for part in self.data:
                rest: bytes | memoryview = part
                while rest and not stream.eof and count < wanted:
                    count += len(stream.decompress(rest, _AT_ONCE))
                    rest = stream.unconsumed_tail
            # What is left lies inside the stream.
            while count < wanted and not stream.eof and (got := stream.decompress(stream.unconsumed_tail, _AT_ONCE)):
                count += len(got)
        except zlib.error as error:
            raise self._spoilt(error) from None
        self._check_count(count)

    def _check_count(self, count: int) -> None:
        if count < self.header.stored_bytes:
            raise FileError(self.path, f"is damaged: {count} bytes of image data, {self.header.stored_bytes} expected")

    def _spoilt(self, error: zlib.error) -> FileError:
        return FileError(self.path, f"is damaged: its image data cannot be decompressed ({error})")


def _chunks(path: Path) -> Iterator[tuple[bytes, memoryview]]:
    """Kind and content of each chunk up to the last, check sums compared."""
    try:
        content = memoryview(path.read_bytes())
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    at, kind = len(SIGNATURE), b""
    while kind != b"IEND":
        if at + 12 > len(content):
            raise FileError(path, f"is truncated: it ends after {len(content)} bytes, in the middle of the picture")
        (length,) = struct.unpack_from(">I", content, at)
        end = at + 8 + length
        if end + 4 > len(content) or zlib.crc32(content[at + 4 : end]) != struct.unpack_from(">I", content, end)[0]:
            raise FileError(path, f"is damaged: the chunk at byte {at} does not match its checksum")
        kind = bytes(content[at + 4 : at + 8])
        yield kind, content[at + 8 : end]
        at = end + 4
