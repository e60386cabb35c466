"""Frames read: which format a file is in, told by its content, then by its name."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Literal

from photosite.cfa import Cfa, cfa_from
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.frames import camera_raw
from photosite.frames.camera_raw import read_camera_raw, read_camera_raw_header
from photosite.frames.dng import DNG_VERSION
from photosite.frames.dng_read import read_dng_header, read_dng_pixels
from photosite.frames.header import FrameHeader
from photosite.frames.png import SIGNATURE, read_png_header, read_png_pixels
from photosite.frames.raw_frame import RawFrame
from photosite.frames.tiff import read_tiff_header, read_tiff_pixels
from photosite.frames.tiff_directory import read_directories

Format = Literal["dng", "tiff", "png", "camera raw"]

SUFFIXES = frozenset({".dng", ".tif", ".tiff", ".png"}) | camera_raw.SUFFIXES
"""Endings of names that are taken for frames."""

_TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_CAMERA_MAGIC = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"\0MRM", b"FOVb")
_PIXELS = {
    "dng": (read_dng_header, read_dng_pixels),
    "tiff": (read_tiff_header, read_tiff_pixels),
    "png": (read_png_header, read_png_pixels),
}


def read_raw(
    path: str | PathLike[str], *, bits: int | None = None, cfa: str | Sequence[Sequence[str]] | None = None
) -> RawFrame:
    """One raw frame from DNG, camera raw, TIFF or PNG.

    Parameters
    ----------
    path
        The file.
    bits
        Bits of the converter, for files that do not say: TIFF and PNG of other origin are taken to have as many as
        they store, 8 or 16, and camera raw as many as its white level needs.
    cfa
        The colour filter array (`"rggb"` or its tile), for files that do not say: they are taken as monochrome.

    Raises
    ------
    InputError
        If bits or cfa cannot be.
    FileError
        If the file is missing, truncated, of another kind, or contradicts bits or cfa.

    Warns
    -----
    PhotositeWarning
        If the file has different black levels for different pixels: a raw frame has one, their mean.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     RawFrame(np.full((2, 3), 64, np.uint16), bits=12, cfa=cfa_from("rggb")).save(f"{folder}/a.png")
    ...     frame = read_raw(f"{folder}/a.png")
    >>> frame.bits, frame.shape, frame.channels
    (12, (2, 3), ('R', 'G', 'B'))
    """
    if bits is not None and not 1 <= bits <= 16:
        raise InputError(f"a raw frame has 1 to 16 bits, not {bits}")
    frame, notes = read_frame(Path(path), bits, None if cfa is None else cfa_from(cfa))
    for note in notes:
        warnings.warn(f"{path}: {note}", PhotositeWarning, stacklevel=2)
    return frame


def read_frame(path: Path, bits: int | None = None, cfa: Cfa | None = None) -> tuple[RawFrame, tuple[str, ...]]:
    """One raw frame as `read_raw` reads it, and what its reader should know, for the caller to warn of.

    Raises
    ------
    FileError
        As `read_raw`.
    """
    kind = format_of(path)
    if kind == "camera raw":
        return read_camera_raw(path, bits, cfa)
    header_of, pixels_of = _PIXELS[kind]
    header = header_of(path)
    return header.frame(path, pixels_of(path), bits, cfa), header.notes


def read_header(path: Path) -> FrameHeader:
    """What a file says of its frame, without its pixels.

    Raises
    ------
    FileError
        If the file is missing, truncated or of another kind.
    """
    kind = format_of(path)
    return read_camera_raw_header(path) if kind == "camera raw" else _PIXELS[kind][0](path)


def format_of(path: Path) -> Format:
    """The format of a file.

    Raises
    ------
    FileError
        If the file is missing, empty, a folder, or in none of the formats.
    """
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except FileNotFoundError:
        raise FileError(path, "there is no such file") from None
    except IsADirectoryError:
        raise FileError(path, "is a folder; read_raw reads one frame, open_frames a folder") from None
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    if not head:
        raise FileError(path, "is empty")
    suffix = path.suffix.lower()
    if head.startswith(SIGNATURE):
        return "png"
    if head.startswith(_CAMERA_MAGIC) or head[4:11] == b"ftypcrx" or head[6:14] == b"HEAPCCDR":
        return "camera raw"
    if head.startswith(_TIFF_MAGIC):
        if head[8:10] == b"CR" or suffix in camera_raw.SUFFIXES:
            return "camera raw"
        return "dng" if DNG_VERSION in read_directories(path)[0].tags else "tiff"
    if head.startswith(b"\xff\xd8\xff"):
        raise FileError(path, "is a JPEG: a developed picture; a raw frame is DNG, camera raw, TIFF or PNG")
    if SIGNATURE.startswith(head) or any(magic.startswith(head) for magic in _TIFF_MAGIC):
        raise FileError(path, f"is truncated: {len(head)} bytes")
    if suffix in camera_raw.SUFFIXES:
        return "camera raw"
    raise FileError(path, "is not a frame: a raw frame is DNG, camera raw, TIFF or PNG")
