"""A copy of a cube on disk, band after band, for files that can only be read in another order than by rows."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.temporary import TemporaryFolder

Piece = tuple[int, int, NDArray[Any]]
"""First band, first row, and (bands, rows, cols) values."""


def spooled(
    path: Path, pieces: Iterable[Piece], shape: tuple[int, int, int], dtype: np.dtype[Any]
) -> tuple[Path, TemporaryFolder]:
    """Write pieces of a cube (rows, cols, bands) into a file of plain numbers.

    Parameters
    ----------
    path
        The cube's own file, for messages.
    pieces
        Together the whole cube.
    shape, dtype
        Of the cube.

    Returns
    -------
    tuple
        The file, and the temporary folder that it goes with.

    Raises
    ------
    FileError
        If there is no room for it.
    """
    rows, cols, bands = shape
    size = rows * cols * bands * dtype.itemsize
    folder = TemporaryFolder("photosite-cube-")
    try:
        free = shutil.disk_usage(folder.path).free
        if size > free:
            raise FileError(
                path,
                f"is not stored by rows and would be laid out anew in {size / 1e9:.1f} GB; {tempfile.gettempdir()} has "
                f"{free / 1e9:.1f} GB free: set TMPDIR to a larger disk, or store it in chunks of rows",
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
