"""Pictures opened by Pillow, large ones too.

Pillow refuses what is large; here it is refused what is large and cannot come out of so small a file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from photosite.errors import FileError
from photosite.files.png import SIGNATURE

_PLAIN_PIXELS = 100_000_000
"""Not more than these are read from a file however small."""
_DENSEST = 1100
"""Pixels to a byte of the file, of larger pictures: more than a PNG of 8 bits reaches (1032), and a JPEG (512)."""
_MOST_PIXELS = 4_000_000_000


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A file's picture, as Pillow has it.

    Raises
    ------
    FileError
        If it says that it has more pixels than can be in it, or than 4 gigapixels.
    Exception
        Whatever Pillow raises of a damaged file.
    """
    from PIL import Image, JpegImagePlugin, PngImagePlugin, TiffImagePlugin

    kinds: dict[bytes, Callable[[Path], Any]] = {
        SIGNATURE: PngImagePlugin.PngImageFile,
        b"\xff\xd8\xff": JpegImagePlugin.JpegImageFile,
        b"II*\0": TiffImagePlugin.TiffImageFile,
        b"MM\0*": TiffImagePlugin.TiffImageFile,
    }
    head = _head(path)
    kind = next((kind for start, kind in kinds.items() if head.startswith(start)), Image.open)
    with kind(path) as picture:
        check_size(path, picture.height, picture.width)
        yield picture


def starts_as_png(path: Path) -> bool:
    """Whether a file's first bytes are those of PNG.

    Raises
    ------
    FileError
        If it is empty or cannot be read.
    """
    return _head(path) == SIGNATURE


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            head = file.read(len(SIGNATURE))
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    if not head:
        raise FileError(path, "is empty")
    return head


def check_size(path: Path, rows: int, cols: int) -> None:
    """Refuse a picture that is too large for its file.

    Raises
    ------
    FileError
        As `opened` does.
    """
    pixels, size = rows * cols, path.stat().st_size
    if pixels > _MOST_PIXELS:
        raise FileError(path, f"says that it has {rows} x {cols} pixels; pictures of up to 4 gigapixels are read")
    if pixels > max(_PLAIN_PIXELS, _DENSEST * size):
        raise FileError(
            path,
            f"says that it has {rows} x {cols} pixels, in {size} bytes; above 100 megapixels a picture has "
            f"{_DENSEST} pixels a byte at most",
        )
