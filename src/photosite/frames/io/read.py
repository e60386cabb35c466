"""Frames read: which format a file is in, told by its content, then by its name."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files import png as png_file
from photosite.frames.io import camera_raw, fits, hdf5, png
from photosite.frames.io.camera_raw import read_camera_raw, read_camera_raw_header
from photosite.frames.io.dng import DNG_VERSION
from photosite.frames.io.dng_read import read_dng, read_dng_header
from photosite.frames.io.header import FrameHeader, Place
from photosite.frames.io.tiff import read_tiff_headers, read_tiff_pixels
from photosite.frames.io.tiff_directory import read_directories
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import Cfa, cfa_from

Format = Literal["dng", "tiff", "png", "hdf5", "fits", "camera raw"]

SUFFIXES = frozenset({".dng", ".tif", ".tiff", ".png"}) | hdf5.SUFFIXES | fits.SUFFIXES | camera_raw.SUFFIXES
"""Endings of names that are taken for frames."""

FORMATS = "DNG, camera raw, TIFF, PNG, HDF5 or FITS"

_TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_CAMERA_MAGIC = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"\0MRM", b"FOVb")


def read_raw(
    path: str | PathLike[str],
    *,
    bits: int | None = None,
    cfa: str | Sequence[Sequence[str]] | None = None,
    index: int | None = None,
) -> RawFrame:
    """One raw frame from DNG, camera raw, TIFF, PNG, HDF5 or FITS.

    Parameters
    ----------
    path
        The file.
    bits
        Bits of the converter, for files that do not say: TIFF and PNG of other origin are taken to have as many as
        they store, 8 or 16, and camera raw as many as its white level needs.
    cfa
        The colour filter array (`"rggb"` or its tile), for files that do not say: they are taken as monochrome.
    index
        Which frame of a file that holds several (pages of TIFF, stacks of HDF5 and FITS), counted from 0.

    Raises
    ------
    InputError
        If bits or cfa cannot be.
    FileError
        If the file is missing, truncated, of another kind, contradicts bits or cfa, or holds several frames and
        `index` is not one of theirs.

    Warns
    -----
    PhotositeWarning
        If the file has different black levels for different pixels: a raw frame has one, their mean. If its masked
        border reads otherwise than the black level it states.

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
    file = Path(path)
    if index is None:
        frame, notes = read_frame(file, bits, None if cfa is None else cfa_from(cfa))
    else:
        places = [header.place for header in read_headers(file)]
        if not 0 <= index < len(places):
            raise FileError(path, f"holds {len(places)} frames, counted from 0; there is no frame {index}")
        frame, notes = read_frame(file, bits, None if cfa is None else cfa_from(cfa), places[index])
    for note in notes:
        warnings.warn(f"{path}: {note}", PhotositeWarning, stacklevel=2)
    return frame


def read_frame(
    path: Path, bits: int | None = None, cfa: Cfa | None = None, place: Place | None = None
) -> tuple[RawFrame, tuple[str, ...]]:
    """One raw frame as `read_raw` reads it, and what its reader should know, for the caller to warn of.

    Raises
    ------
    FileError
        As `read_raw`.
    """
    kind = format_of(path)
    if kind == "camera raw":
        return read_camera_raw(path, bits, cfa)
    if kind == "dng":
        return read_dng(path, bits, cfa)
    headers = _headers(path, kind)
    if place is not None:
        headers = tuple(header for header in headers if header.place == place)
    if len(headers) != 1:
        raise FileError(path, f"holds {len(headers)} frames; say which by its index, or open them all with open_frames")
    return headers[0].frame(path, _pixels(path, kind, headers[0].place), bits, cfa), headers[0].notes


def read_pixels(path: Path, place: Place) -> NDArray[np.uint16]:
    """The (rows, cols) digital numbers of one frame of a file that holds several; its header is not read again.

    Raises
    ------
    FileError
        If they cannot be read.
    """
    return _pixels(path, format_of(path), place)


def read_headers(path: Path) -> tuple[FrameHeader, ...]:
    """What a file says of its frames, without their pixels; one header a frame.

    Raises
    ------
    FileError
        If the file is missing, truncated or of another kind.
    """
    return _headers(path, format_of(path))


def _headers(path: Path, kind: Format) -> tuple[FrameHeader, ...]:
    match kind:
        case "hdf5":
            return hdf5.read_hdf5_headers(path)
        case "fits":
            return fits.read_fits_headers(path)
        case "tiff":
            return read_tiff_headers(path)
        case "dng":
            return (read_dng_header(path),)
        case "png":
            return (png.read_png_header(path),)
    return (read_camera_raw_header(path),)


def _pixels(path: Path, kind: Format, place: Place | None) -> NDArray[np.uint16]:
    if kind == "hdf5" and place is not None:
        return hdf5.read_hdf5_pixels(path, place)
    if kind == "fits" and place is not None:
        return fits.read_fits_pixels(path, place)
    if kind == "tiff":
        return read_tiff_pixels(path, place)
    if kind == "png":
        return png.read_png_pixels(path)
    raise FileError(path, f"is now {kind}; it was of another format when it was opened")


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
    if head.startswith(png_file.SIGNATURE):
        return "png"
    if head.startswith(hdf5.SIGNATURE):
        return "hdf5"
    if head.startswith(fits.SIGNATURE):
        return "fits"
    if head.startswith(_CAMERA_MAGIC) or head[4:11] == b"ftypcrx" or head[6:14] == b"HEAPCCDR":
        return "camera raw"
    if head.startswith(_TIFF_MAGIC):
        if head[8:10] == b"CR" or suffix in camera_raw.SUFFIXES:
            return "camera raw"
        return "dng" if DNG_VERSION in read_directories(path)[0].tags else "tiff"
    if head.startswith(b"\xff\xd8\xff"):
        raise FileError(path, f"is a JPEG: a developed picture; a raw frame is {FORMATS}")
    if any(magic.startswith(head) for magic in (*_TIFF_MAGIC, png_file.SIGNATURE, hdf5.SIGNATURE, fits.SIGNATURE)):
        raise FileError(path, f"is truncated: {len(head)} bytes")
    if suffix in camera_raw.SUFFIXES:
        return "camera raw"
    raise FileError(path, f"is not a frame: a raw frame is {FORMATS}")
