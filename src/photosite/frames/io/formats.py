"""All file formats of frames: reading detects the format by content, then by suffix; writing follows the suffix."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Literal

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.hdf5 import SIGNATURE as HDF5_SIGNATURE
from photosite.files.small_files import reading
from photosite.files.writing import atomic_path
from photosite.frames.frame_file import FrameHeader, FrameLocation
from photosite.frames.io import camera_raw, fits, hdf5, png
from photosite.frames.io.camera_raw import read_camera_raw, read_camera_raw_header
from photosite.frames.io.dng import DNG_VERSION, read_dng, read_dng_header, write_dng
from photosite.frames.io.hdf5 import write_hdf5
from photosite.frames.io.png import write_png
from photosite.frames.io.tiff import (
    has_tag,
    open_tiff_rows,
    read_tiff_headers,
    read_tiff_pixels,
    write_tiff,
)
from photosite.frames.raw_frame import MOST_BITS, Numbers, RawFrame, check_bits
from photosite.frames.stored_rows import StoredRows
from photosite.values.cfa import Cfa, cfa_from

Format = Literal["dng", "tiff", "png", "hdf5", "fits", "camera raw"]

SUFFIXES = frozenset({".dng", ".tif", ".tiff", ".png"}) | hdf5.SUFFIXES | fits.SUFFIXES | camera_raw.SUFFIXES
"""Suffixes of files that are taken for frames."""

FORMATS = "DNG, camera raw, TIFF, PNG, HDF5 or FITS"

_SIGNATURES: dict[Format, bytes] = {"png": png.SIGNATURE, "hdf5": HDF5_SIGNATURE, "fits": fits.SIGNATURE}
_TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_CAMERA_MAGIC = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"\0MRM", b"FOVb")


def raw_files(path: Path) -> list[Path]:
    """Return the raw frames in a folder, by name; a file is returned itself. Raise `FileError` if there are none."""
    if not os.path.isdir(path):
        return [path]
    files = sorted(f for f in path.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith("."))
    if not files:
        raise FileError(path, f"has no raw frames ({FORMATS})")
    return files


def read_raw(
    path: str | PathLike[str],
    *,
    bits: int | None = None,
    cfa: str | Sequence[Sequence[str]] | None = None,
    index: int | None = None,
) -> RawFrame:
    """Read one raw frame from DNG, camera raw, TIFF, PNG, HDF5 or FITS.

    Parameters
    ----------
    path
        The file.
    bits
        Bit depth of the converter, for files that do not state it; 17 to 24 for pixels of 32 bits. Default: the 8 or 16
        bits that TIFF and PNG store; as many bits as the white level of camera raw needs.
    cfa
        Color filter array (`"rggb"` or its tile), for files that do not state it. Default: monochrome.
    index
        Index of the frame in a file of several (pages of TIFF, stacks of HDF5 and FITS), counted from 0.

    Raises
    ------
    InputError
        If bits or cfa are invalid.
    FileError
        If the file is missing, truncated, of another format or contradicts bits or cfa, or if it holds several frames
        and `index` is missing or out of range.

    Warns
    -----
    PhotositeWarning
        If the file states different black levels for different pixels (their mean is used), or its masked border
        contradicts the stated black level.

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
    check_bits(bits, MOST_BITS)
    file = Path(path)
    location = None
    if index is not None:
        headers = read_headers(file)
        if not 0 <= index < len(headers):
            raise FileError(path, "index", value=index, expected=f"0 to {len(headers) - 1}")
        location = headers[index].location
    frame, notes = read_frame(file, bits, None if cfa is None else cfa_from(cfa), location)
    for note in notes:
        warnings.warn(PhotositeWarning(note, where=str(path)), stacklevel=2)
    return frame


def read_frame(
    path: Path, bits: int | None = None, cfa: Cfa | None = None, location: FrameLocation | None = None
) -> tuple[RawFrame, tuple[str, ...]]:
    """Read one raw frame, as `read_raw` does, and return the notes for warnings with it."""
    kind = detect_format(path)
    if kind == "camera raw":
        return read_camera_raw(path, bits, cfa)
    if kind == "dng":
        return read_dng(path, bits, cfa)
    headers = _headers(path, kind)
    if location is not None:
        headers = tuple(header for header in headers if header.location == location)
    if len(headers) != 1:
        problem = f"the file holds {len(headers)} frames"
        raise FileError(path, problem, hint="Pass {index}, or open the file with open_frames", arguments={"index": 0})
    header = headers[0]
    return header.to_frame(path, _pixels(path, kind, header.location), bits, cfa), header.notes


def read_pixels(path: Path, location: FrameLocation) -> Numbers:
    """Read the (rows, cols) digital numbers of one frame of a file of several, without its header."""
    return _pixels(path, detect_format(path), location)


def open_stored_rows(
    path: Path, location: FrameLocation | None, bits: int | None, cfa: Cfa | None
) -> StoredRows | None:
    """Open a frame to read some rows at a time; None where its pixels are not stored as they are.

    The header is checked as by `read_frame`, but not the numbers against the bit depth.
    """
    if not hasattr(os, "preadv") or detect_format(path) != "tiff":
        return None
    return open_tiff_rows(path, location, bits, cfa)


def read_headers(path: Path) -> tuple[FrameHeader, ...]:
    """Read the headers of all frames in a file, without pixels."""
    return _headers(path, detect_format(path))


def _headers(path: Path, kind: Format) -> tuple[FrameHeader, ...]:
    match kind:
        case "hdf5":
            return hdf5.read_hdf5_headers(path)
        case "fits":
            return fits.read_fits_headers(path)
        case "tiff":
            return read_tiff_headers(path)
    read = {"dng": read_dng_header, "png": png.read_png_header, "camera raw": read_camera_raw_header}
    return (read[kind](path),)


def _pixels(path: Path, kind: Format, location: FrameLocation | None) -> Numbers:
    if kind == "hdf5" and location is not None:
        return hdf5.read_hdf5_pixels(path, location)
    if kind == "fits" and location is not None:
        return fits.read_fits_pixels(path, location)
    if kind == "tiff":
        return read_tiff_pixels(path, location)
    if kind == "png":
        return png.read_png_pixels(path)
    raise FileError(path, f"the file is now {kind}; it had another format when it was opened")


def detect_format(path: Path) -> Format:
    """Return the format of a file."""
    if os.path.isdir(path):
        raise FileError(path, "the path is a folder", hint="read_raw reads one frame, open_frames a folder")
    with reading(path), path.open("rb") as file:
        head = file.read(16)
    if not head:
        raise FileError(path, "the file is empty")
    suffix = path.suffix.lower()
    for kind, signature in _SIGNATURES.items():
        if head.startswith(signature):
            return kind
    if head.startswith(_CAMERA_MAGIC) or head[4:11] == b"ftypcrx" or head[6:14] == b"HEAPCCDR":
        return "camera raw"
    if head.startswith(_TIFF_MAGIC):
        if head[8:10] == b"CR" or suffix in camera_raw.SUFFIXES:
            return "camera raw"
        return "dng" if has_tag(path, DNG_VERSION) else "tiff"
    if head.startswith(b"\xff\xd8\xff"):
        raise FileError(path, "the file is a JPEG, a developed picture", hint=f"A raw frame is {FORMATS}")
    if any(magic.startswith(head) for magic in (*_TIFF_MAGIC, *_SIGNATURES.values())):
        raise FileError(path, f"the file is truncated: {len(head)} bytes")
    if suffix in camera_raw.SUFFIXES:
        return "camera raw"
    raise FileError(path, "the file is not a frame", hint=f"A raw frame is {FORMATS}")


_WRITERS = {
    ".dng": write_dng,
    ".tif": write_tiff,
    ".tiff": write_tiff,
    ".png": write_png,
    ".h5": write_hdf5,
    ".hdf5": write_hdf5,
}
_DEEP = (".tif", ".tiff", ".h5", ".hdf5")
"""Suffixes of files that hold more than 16 bits."""


def check_holds(path: Path, bits: int) -> None:
    """Raise `InputError` if a file of this suffix does not hold the bit depth."""
    if bits > 16 and path.suffix.lower() not in _DEEP:
        hint = f"Write {', '.join(_DEEP)}, or compand the numbers: captures.combination.companding of the sensor file"
        raise InputError("bits", where=path.name, value=bits, expected="at most 16", hint=hint)


def write_raw(frame: RawFrame, path: str | PathLike[str]) -> None:
    """Write a raw frame in the format of the suffix, as `RawFrame.save`.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from photosite.frames.io.formats import read_raw
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
    check_holds(target, frame.bits)
    with atomic_path(target) as temporary:
        writer(frame, temporary)
