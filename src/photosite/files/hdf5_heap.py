"""The global heaps of an HDF5 file, checked before libhdf5 reads them.

Text of variable length, as most programs write attributes, lies there. libhdf5 (2.0.0) walks a heap whose sizes are
damaged in a circle for ever. Format: HDF5 File Format Specification 3.0, III.E.
"""

from __future__ import annotations

import math
import mmap
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from photosite.errors import FileError

_SIGNATURE = b"GCOL\x01\0\0\0"
_TEXT_TYPE = re.compile(rb"\x19\x01.\x00\x10\x00\x00\x00([\x10\x13])...\x01\x00\x00\x00", re.DOTALL)
"""Text of variable length: of whole numbers or of text, of one byte each."""

_HEAD = struct.Struct("<HHIQ")
"""Of an object: index, references, reserved, size."""


def check_heaps(path: Path, file: Any, datasets: list[Any]) -> None:
    """Walk every global heap that lies outside the datasets' pixels, and look at what kind attributes are of.

    Parameters
    ----------
    path
        The file.
    file
        It, opened by h5py.
    datasets
        All of its datasets; their attributes are not read here.

    Raises
    ------
    FileError
        If the sizes in a heap do not add up, or an attribute is a list of variable length.
    """
    _check_kinds(path, file)
    size = path.stat().st_size
    taken = sorted(place for data in datasets for place in _stored(data, file.userblock_size))
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        begin = 0
        for start, end in [*taken, (size, size)]:
            at = content.find(_SIGNATURE, begin, min(start, size))
            while at >= 0:
                _check_heap(path, content, at, size)
                at = content.find(_SIGNATURE, at + 1, min(start, size))
            _check_lengths(path, content[begin : max(begin, min(start, size))], size)
            begin = max(begin, end)


def _check_kinds(path: Path, file: Any) -> None:
    """No attribute is a list of variable length, but of references, as netCDF has them: nobody writes one here.

    Damage makes text to such lists, and libhdf5 then reads from wherever its bytes point.
    """
    from h5py import h5t

    items: list[Any] = [file]
    file.visititems(lambda _, item: items.append(item))
    for item in items:
        for name in item.attrs:
            kind = item.attrs.get_id(name).get_type()
            if isinstance(kind, h5t.TypeVlenID) and kind.get_super().get_class() != h5t.REFERENCE:
                raise FileError(
                    path, f"is damaged, or has a list of variable length as attribute '{name}', which is not read"
                )


def _check_lengths(path: Path, part: bytes, size: int) -> None:
    """No attribute says that its text is longer than the file: libhdf5 makes room for that much before it looks.

    An attribute of text is a message of version 1 to 3 (specification IV.A.2.m): name, datatype (variable length of
    16 bytes, IV.A.2.d), dataspace, and for each text its length and its place in a heap.
    """
    for match in _TEXT_TYPE.finditer(part):
        at, type_bytes = match.start(), 20 if match[1] == b"\x10" else 16
        for name_bytes in range(2, 256):
            for version, before, pad in ((1, 8, 8), (2, 8, 1), (3, 9, 1)):
                head = at - before - -(-name_bytes // pad) * pad
                if head < 0 or part[head] != version:
                    continue
                said = struct.unpack_from("<HHH", part, head + 2)
                if said[:2] == (name_bytes, type_bytes):
                    space = at + -(-type_bytes // pad) * pad
                    _check_texts(path, part, (space, space + -(-said[2] // pad) * pad), size)


def _check_texts(path: Path, part: bytes, places: tuple[int, int], size: int) -> None:
    """The lengths that follow a dataspace; `places` are its first byte and that of what follows."""
    space, texts = places
    if texts > len(part) or space + 2 > len(part) or part[space] not in (1, 2):
        return
    rank, first = part[space + 1], space + (8 if part[space] == 1 else 4)
    if first + 8 * rank > texts:
        return
    count = math.prod(struct.unpack_from(f"<{rank}Q", part, first))
    for at in range(texts, min(texts + 16 * count, len(part) - 3), 16):
        (length,) = struct.unpack_from("<I", part, at)
        if length > size:
            raise FileError(path, f"is damaged: an attribute's text has {length} bytes, and the file {size}")


def _stored(data: Any, base: int) -> Iterator[tuple[int, int]]:
    """Where a dataset's numbers lie: first byte, and the one after the last."""
    if data.chunks is None:
        if (offset := data.id.get_offset()) is not None:
            yield offset, offset + data.id.get_storage_size()
        return
    chunks: list[tuple[int, int]] = []
    data.id.chunk_iter(lambda info: chunks.append((base + info.byte_offset, base + info.byte_offset + info.size)))
    yield from chunks


def _check_heap(path: Path, content: mmap.mmap, at: int, size: int) -> None:
    (length,) = struct.unpack_from("<Q", content, at + 8) if at + 16 <= size else (0,)
    end, here = at + length, at + 16
    if length < 16 or end > size:
        raise FileError(path, f"is damaged or truncated: its text at byte {at} ends beyond the file")
    while here + _HEAD.size <= end:
        index, _, _, bytes_here = _HEAD.unpack_from(content, here)
        if index == 0:  # what is free, to the end; its size counts its own head
            if bytes_here != end - here:
                break
            return
        here += _HEAD.size + -(-bytes_here // 8) * 8
    if here != end and not 0 < end - here < _HEAD.size:
        raise FileError(path, f"is damaged: the text at byte {at} does not add up to its size")
