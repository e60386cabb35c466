"""Temporary files, removed when they are closed or no longer referenced."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError

Piece = tuple[int, int, NDArray[Any]]
"""First band, first row, and values (bands, rows, cols)."""


class TemporaryFolder:
    """A new folder at `path`, in the system's place for temporary files (`TMPDIR`).

    Examples
    --------
    >>> folder = TemporaryFolder("photosite-")
    >>> folder.path.is_dir(), folder.close(), folder.path.exists()
    (True, None, False)
    """

    def __init__(self, prefix: str) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=prefix))
        self._end = weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)

    def close(self) -> None:
        """Remove the folder and its contents; a second call does nothing."""
        self._end()


def write_bands(
    path: Path, pieces: Iterable[Piece], shape: tuple[int, int, int], dtype: np.dtype[Any]
) -> tuple[Path, TemporaryFolder]:
    """Copy a cube that cannot be read by rows into a temporary file of plain numbers, band after band.

    Parameters
    ----------
    path
        The cube's own file, for messages.
    pieces
        The whole cube in pieces.
    shape, dtype
        Of the cube; (rows, cols, bands).

    Returns
    -------
    Path, TemporaryFolder
        The file, and the folder that removes it.
    """
    rows, cols, bands = shape
    size = rows * cols * bands * dtype.itemsize
    folder = TemporaryFolder("photosite-cube-")
    try:
        free = shutil.disk_usage(folder.path).free
        if size > free:
            raise FileError(
                path,
                f"needs a temporary copy of {size / 1e9:.1f} GB, and {tempfile.gettempdir()} has {free / 1e9:.1f} GB "
                "free",
                hint="Set TMPDIR to a larger disk, or store the cube in chunks of rows",
            )
        file = folder.path / "cube"
        with file.open("wb") as stream:
            for band, row, values in pieces:
                for k, plane in enumerate(values):
                    stream.seek(((band + k) * rows + row) * cols * dtype.itemsize)
                    stream.write(np.ascontiguousarray(plane, dtype).data)
            stream.truncate(size)
    except BaseException:
        folder.close()
        raise
    return file, folder
