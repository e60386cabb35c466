"""Writing frames: the format follows the suffix."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from photosite.errors import InputError
from photosite.files.atomic import atomic_path
from photosite.frames.io.dng import write_dng
from photosite.frames.io.hdf5 import write_hdf5
from photosite.frames.io.png import write_png
from photosite.frames.io.tiff import write_tiff
from photosite.frames.raw_frame import RawFrame

_WRITERS = {
    ".dng": write_dng,
    ".tif": write_tiff,
    ".tiff": write_tiff,
    ".png": write_png,
    ".h5": write_hdf5,
    ".hdf5": write_hdf5,
}


def write_raw(frame: RawFrame, path: str | PathLike[str]) -> None:
    """Write a raw frame in the format of the suffix, as `RawFrame.save`.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from photosite.frames.io.read import read_raw
    >>> frame = RawFrame(np.full((24, 32), 64, np.uint16), bits=12, exposure_s=1 / 8000)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_raw(frame, f"{folder}/dark.dng")
    ...     read_raw(f"{folder}/dark.dng").exposure_s
    0.000125
    """
    target = Path(path)
    writer = _WRITERS.get(target.suffix.lower())
    if writer is None:
        raise InputError("path", value=target.name, expected=f"a name with the suffix {', '.join(_WRITERS)}")
    with atomic_path(target) as temporary:
        writer(frame, temporary)
