"""The global heaps of an HDF5 file, checked before libhdf5 reads them.

Text of variable length, as most programs write attributes, lies there. libhdf5 (2.0.0) walks a heap whose sizes are
damaged in a circle for ever. Format: HDF5 File Format Specification 3.0, III.E.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from photosite.errors import FileError

_SIGNATURE = b"GCOL\x01\0\0\0"
_HEAD = struct.Struct("<HHIQ")
"""Of an object: index, references, reserved, size."""


def check_heaps(path: Path, file: Any, datasets: list[Any]) -> None:
    """Walk every global heap that lies outside the datasets' pixels.

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
        If the sizes in a heap do not add up.
    """
    size = path.stat().st_size
    taken = sorted(place for data in datasets for place in _stored(data, file.userblock_size))
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        begin = 0
        for start, end in [*taken, (size, size)]:
            at = content.find(_SIGNATURE, begin, min(start, size))
            while at >= 0:
                _check_heap(path, content, at, size)
                at = content.find(_SIGNATURE, at + 1, min(start, size))
            begin = max(begin, end)


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
