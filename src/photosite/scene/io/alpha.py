"""Opacity of a plane from a picture: gray values, or a picture's own transparency."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.png import PngFile
from photosite.scene.io.pillow import opened
from photosite.scene.io.png16 import read_deep_png


def read_alpha(path: Path) -> NDArray[np.float32]:
    """(rows, cols) from 0, not there, to 1, opaque.

    Parameters
    ----------
    path
        A picture: gray of 1, 8 or 16 bits, black for 0 and white for 1, in proportion to the codes; or one with a
        channel of transparency, of which that channel is taken.

    Raises
    ------
    FileError
        If it is no picture, damaged, or in colour without transparency.
    """
    try:
        with opened(path) as picture:
            mode = picture.mode
            codes = _codes(path, picture)
    except FileError:
        raise
    except Exception as error:  # Pillow hands on whatever a damaged file makes it stumble over
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileError(path, f"cannot be read as a picture of opacity ({reason[:200]})") from None
    if codes.dtype == np.bool_:
        return codes.astype(np.float32)
    if codes.ndim != 2 or mode in ("P", "F"):
        raise FileError(path, "is in colour; opacity is a gray picture, white where opaque, or transparency")
    white = 255 if codes.dtype == np.uint8 else 65535
    if codes.min() < 0 or codes.max() > white:
        raise FileError(path, f"holds values up to {codes.max()}; opacity is gray of 8 or 16 bits")
    return (codes / np.float32(white)).astype(np.float32)


def _codes(path: Path, picture: Any) -> NDArray[Any]:
    """Of transparency, where the picture has it; else of all that it has."""
    png = PngFile.read(path) if picture.format == "PNG" else None
    if png is None or png.header.bits != 16:
        if png is not None:
            png.check_whole()
        return np.asarray(picture.getchannel("A") if "A" in picture.mode else picture)
    found = read_deep_png(png)
    if found.has_alpha:
        return found.codes[:, :, -1]
    return found.codes[:, :, 0] if found.codes.shape[2] == 1 else found.codes
