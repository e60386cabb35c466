"""Rows of a frame whose pixels are stored uncompressed, read from its file a few at a time."""

from __future__ import annotations

import mmap
import os
import weakref
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.engine.file_rows import CAN_READ, read_lines
from photosite.errors import FileError
from photosite.files.small_files import reading


class StoredRows:
    """The rows of a frame in a file that stays open as long as this object exists; any thread may read them.

    Parameters
    ----------
    path
        The file.
    offset
        Position in the file, in bytes, of the first pixel; the others follow without gaps.
    shape
        Rows and columns of the frame, uint16 in the byte order of this machine.

    Raises
    ------
    FileError
        If the file cannot be opened.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.NamedTemporaryFile() as file:
    ...     _ = file.write(np.arange(12, dtype=np.uint16).tobytes())
    ...     file.flush()
    ...     StoredRows(Path(file.name), 0, (3, 4)).take_rows([0, 2])
    array([[ 0,  1,  2,  3],
           [ 8,  9, 10, 11]], dtype=uint16)
    """

    def __init__(self, path: Path, offset: int, shape: tuple[int, int]) -> None:
        self.path, self.shape = path, shape
        self._offset = offset
        with reading(path):
            self._file = os.open(path, os.O_RDONLY)
        weakref.finalize(self, os.close, self._file)

    @property
    def place(self) -> tuple[int, int]:
        """File descriptor, and position of the first pixel in the file."""
        return self._file, self._offset

    def read_rows(self, first: int, out: NDArray[np.uint16]) -> None:
        """Read successive rows into a C-contiguous array (n, cols).

        Raises
        ------
        FileError
            If the file ends before, or cannot be read.
        """
        left = out.data.cast("B")
        place = self._offset + 2 * first * self.shape[1]
        while left:
            try:
                got = os.preadv(self._file, [left], place)
            except OSError as error:
                raise FileError(self.path, f"cannot be read: {error.strerror or error}") from None
            if not got:
                raise FileError(self.path, f"is truncated: it ends at byte {place}, within its image data")
            left, place = left[got:], place + got

    def take_rows(self, rows: Iterable[int]) -> NDArray[np.uint16]:
        """Return some rows (n, cols), which need not be adjacent."""
        wanted = np.fromiter(rows, np.int64)
        out = np.empty((len(wanted), self.shape[1]), np.uint16)
        if CAN_READ and read_lines(self._file, self._offset + 2 * self.shape[1] * wanted, out):
            return out
        for row, line in zip(wanted.tolist(), out, strict=True):
            self.read_rows(row, line)
        return out

    def numbers_at(self, row: NDArray[np.int64], col: NDArray[np.int64]) -> NDArray[np.uint16]:
        """Return the numbers (n,) of some pixels.

        The file is mapped, which takes a fifth of the time of reading their rows.
        """
        size = self.shape[0] * self.shape[1]
        try:
            with mmap.mmap(self._file, self._offset + 2 * size, access=mmap.ACCESS_READ) as mapped:
                numbers = np.frombuffer(mapped, np.uint16, size, self._offset)
                out = np.asarray(numbers[row * self.shape[1] + col])
                del numbers  # the map cannot be closed before
            return out
        except (OSError, ValueError):  # not a file that can be mapped, or truncated
            lines, at = np.unique(row, return_inverse=True)
            return np.asarray(self.take_rows(lines)[at, col])

    def read(self) -> NDArray[np.uint16]:
        """Return the whole frame."""
        out = np.empty(self.shape, np.uint16)
        self.read_rows(0, out)
        return out


class PartRows(StoredRows):
    """Rows of a part of a stored frame."""

    def __init__(self, stored: StoredRows, inside: tuple[slice, slice]) -> None:
        rows, self._cols = inside
        self.path, self.shape = stored.path, (rows.stop - rows.start, self._cols.stop - self._cols.start)
        self._stored, self._first = stored, rows.start

    @property
    def place(self) -> None:  # type: ignore[override]
        """None: the numbers in the file are not those of the frame."""
        return None

    def read_rows(self, first: int, out: NDArray[np.uint16]) -> None:
        """Read successive rows into an array (n, cols)."""
        whole = np.empty((len(out), self._stored.shape[1]), np.uint16)
        self._stored.read_rows(self._first + first, whole)
        out[:] = whole[:, self._cols]

    def take_rows(self, rows: Iterable[int]) -> NDArray[np.uint16]:
        """Return some rows (n, cols), which need not be adjacent."""
        return np.ascontiguousarray(self._stored.take_rows(self._first + row for row in rows)[:, self._cols])
