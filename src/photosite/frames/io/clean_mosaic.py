"""Noise-free mosaics, in 32-bit floats: the clean half of a training pair.

TIFF holds one page, whose ImageDescription is a JSON object with bits, cfa, levels, exposure and metadata. HDF5 holds
the dataset "clean" with the same as attributes. Values are in digital numbers, black level included, as in the frame.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.files.hdf5 import create_hdf5
from photosite.files.writing import atomic_path
from photosite.frames.io.format_table import DEEP_SUFFIXES
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import tile_text


def write_clean_mosaic(dn: NDArray[np.float32], frame: RawFrame, path: Path) -> None:
    """Write a noise-free mosaic with the properties of its noisy frame.

    Parameters
    ----------
    dn
        (rows, cols) float32, digital numbers, as from `photosite.Camera.clean_dn`.
    frame
        A noisy frame of it.
    path
        A name with the suffix .tif, .tiff, .h5 or .hdf5.

    Raises
    ------
    InputError
        If the suffix is another, or the shapes differ.
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import tifffile
    >>> frame = RawFrame(np.full((2, 3), 64, np.uint16), bits=12)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_clean_mosaic(np.full((2, 3), 64.25, np.float32), frame, Path(folder, "clean.tif"))
    ...     print(tifffile.imread(f"{folder}/clean.tif"))
    [[64.25 64.25 64.25]
     [64.25 64.25 64.25]]
    """
    if dn.shape != frame.shape:
        raise InputError("dn", value=dn.shape, expected=f"of the frame's shape {frame.shape}")
    if path.suffix.lower() not in DEEP_SUFFIXES:
        raise InputError("path", value=path.name, expected=f"a name with the suffix {', '.join(DEEP_SUFFIXES)}")
    content = {
        "bits": frame.bits,
        "cfa": tile_text(frame.cfa),
        "black_level_dn": frame.black_level_dn,
        "white_level_dn": frame.white_level_dn,
        "exposure_s": frame.exposure_s,
        **frame.metadata,
    }
    known = {name: value for name, value in content.items() if value is not None}
    values = np.ascontiguousarray(dn, np.float32)
    with atomic_path(path) as temporary:
        if path.suffix.lower().startswith(".t"):
            import tifffile

            text = json.dumps({"photosite_clean": 1, **known}, default=lambda number: number.item())
            tifffile.imwrite(temporary, values, photometric="minisblack", description=text, metadata=None)
        else:
            with create_hdf5(temporary) as file:
                file.create_dataset("clean", data=values).attrs.update(known)
