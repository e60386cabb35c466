"""Writing pictures: PNG in sRGB, 8 or 16 bits."""

from __future__ import annotations

import struct
import zlib
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.files.atomic import atomic_path

BITS = (8, 16)

_AFTER_HEADER = 33
"""Bytes of the signature and the chunk IHDR."""
_SRGB = struct.pack(">I5sI", 1, b"sRGB\0", zlib.crc32(b"sRGB\0"))
"""The chunk for sRGB, with perceptual intent."""


def save_picture(picture: NDArray[np.float32], path: str | PathLike[str], bits: int = 8) -> None:
    """Write a developed picture as PNG.

    Parameters
    ----------
    picture
        (rows, cols, 3), display sRGB, 0 to 1, from `develop`.
    path
        A name with the suffix .png.
    bits
        Bits per channel, 8 or 16.

    Raises
    ------
    InputError
        If an argument is invalid.
    FileError
        If the file cannot be written.

    References
    ----------
    ISO/IEC 15948, with an sRGB chunk. Pillow has no 16-bit color.

    Examples
    --------
    >>> import tempfile
    >>> from PIL import Image
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_picture(np.full((2, 3, 3), 0.5, np.float32), f"{folder}/gray.png")
    ...     Image.open(f"{folder}/gray.png").getpixel((0, 0))
    (128, 128, 128)
    """
    from imagecodecs import png_encode

    values = np.asarray(picture)
    if values.ndim != 3 or values.shape[2] != 3 or values.size == 0:
        raise InputError("picture", value=values.shape, expected="of shape (rows, cols, 3)")
    if not (values.min() >= 0 and values.max() <= 1):
        raise InputError("picture", value=(float(values.min()), float(values.max())), expected="within 0 to 1")
    if bits not in BITS:
        raise InputError("bits", value=bits, expected="8 or 16")
    target = Path(path)
    if target.suffix.lower() != ".png":
        raise InputError("path", value=target.name, expected="a name with the suffix .png")
    codes = np.rint(values * ((1 << bits) - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    encoded = png_encode(codes, level=3)
    with atomic_path(target) as temporary:
        temporary.write_bytes(encoded[:_AFTER_HEADER] + _SRGB + encoded[_AFTER_HEADER:])
