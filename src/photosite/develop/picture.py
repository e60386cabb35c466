"""Pictures written: PNG in sRGB, 8 or 16 bits."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.files.atomic import atomic_path

BITS = (8, 16)

_TRUECOLOUR = 2
_PERCEPTUAL = b"\0"


def save_picture(picture: NDArray[np.float32], path: str | PathLike[str], bits: int = 8) -> None:
    """Write a developed picture as PNG, whole or not at all.

    Parameters
    ----------
    picture
        (rows, cols, 3), display sRGB, 0 to 1, as `develop` gives it.
    path
        A name that ends in .png.
    bits
        8 or 16 a channel.

    Raises
    ------
    InputError
        If the array is not a picture or holds values outside 0 to 1, the name ends otherwise, or the bits are neither.
    FileError
        If the file cannot be written.

    Notes
    -----
    ISO/IEC 15948, with an sRGB chunk. Written here because Pillow has no 16-bit colour.

    Examples
    --------
    >>> import tempfile
    >>> from PIL import Image
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_picture(np.full((2, 3, 3), 0.5, np.float32), f"{folder}/gray.png")
    ...     Image.open(f"{folder}/gray.png").getpixel((0, 0))
    (128, 128, 128)
    """
    values = np.asarray(picture)
    if values.ndim != 3 or values.shape[2] != 3 or values.size == 0:
        raise InputError(f"a picture is (rows, cols, 3), not {values.shape}")
    if not (values.min() >= 0 and values.max() <= 1):
        raise InputError("a picture's values lie from 0 to 1; some do not")
    if bits not in BITS:
        raise InputError(f"a PNG has 8 or 16 bits a channel, not {bits}")
    wanted = Path(path)
    if wanted.suffix.lower() != ".png":
        raise InputError(f"a picture is saved as .png, not as '{wanted.name}'")
    rows, cols, _ = values.shape
    codes = np.rint(values * ((1 << bits) - 1)).astype(np.dtype("u1") if bits == 8 else np.dtype(">u2"))
    # Every scan line begins with the number of its filter; 0 leaves the line as it is.
    lines = np.zeros((rows, 1 + cols * 3 * bits // 8), np.uint8)
    lines[:, 1:] = np.ascontiguousarray(codes).view(np.uint8).reshape(rows, -1)
    header = struct.pack(">IIBBBBB", cols, rows, bits, _TRUECOLOUR, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"sRGB", _PERCEPTUAL), (b"IDAT", zlib.compress(lines.tobytes(), 3)), (b"IEND", b""))
    with atomic_path(wanted) as temporary:
        temporary.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(_framed(chunks)))


def _framed(chunks: tuple[tuple[bytes, bytes], ...]) -> Iterator[bytes]:
    for kind, data in chunks:
        yield struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
