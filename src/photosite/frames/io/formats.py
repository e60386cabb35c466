"""Reading and writing frames: reading detects the format by content, then by suffix; writing follows the suffix."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.small_files import reading
from photosite.files.writing import atomic_path
from photosite.frames.frame_file import (
    WHICH_SENSOR,
    FrameHeader,
    FrameLocation,
    OwnOutputError,
    bits_from,
    check_sensor,
    split_selection,
)
from photosite.frames.io import headerless
from photosite.frames.io.format_table import (
    DEEP_SUFFIXES,
    FORMATS,
    HEAD_BYTES,
    NAMES,
    OME_SUFFIXES,
    WRITTEN_SUFFIXES,
    Format,
    format_to_write,
    is_frame_name,
)
from photosite.frames.layout import Layout, parse_layout
from photosite.frames.raw_frame import MASKED_BORDER, MOST_BITS, OPTICAL_BLACK, Numbers, RawFrame, check_bits
from photosite.frames.sections import Section, lines_around, parse_region
from photosite.frames.stored_numbers import NumberRange, StoredNumbers, conversion_diagnostics, conversion_of
from photosite.frames.stored_rows import StoredRows
from photosite.values.cfa import Cfa, cfa_from, shifted
from photosite.values.region import Border

if TYPE_CHECKING:
    from photosite.sensor.model import Sensor


def raw_files(path: Path) -> list[Path]:
    """Return the raw frames in a folder, by name; a file is returned itself. Raise `FileError` for an empty folder.

    Outputs of photosite that are no frames, such as pictures and maps, are left out.
    """
    if not os.path.isdir(path):
        return [path]
    listed = (f for f in path.iterdir() if is_frame_name(f) and not f.name.startswith("."))
    files = sorted(file for file in listed if not is_own_output(file))
    if not files:
        raise FileError(path, f"has no raw frames ({NAMES})")
    return files


def is_own_output(path: Path) -> bool:
    """Return whether a file is an output of photosite that is no frame: a picture, maps, a noise-free mosaic."""
    if path.suffix.lower() not in (".png", ".h5", ".hdf5", ".tif", ".tiff"):
        return False
    try:
        read_headers(path)
    except OwnOutputError:
        return True
    except FileError:
        return False
    return False


def read_raw(
    path: str | PathLike[str],
    *,
    bits: int | None = None,
    cfa: str | Sequence[Sequence[str]] | None = None,
    index: int | None = None,
    region: str | None = None,
    layout: str | None = None,
    sensor: Sensor | None = None,
) -> RawFrame:
    """Read one raw frame from a file of one of the formats in `photosite.frames.io.format_table`.

    Parameters
    ----------
    path
        The file, or a part of it: `"x.fits[1]"`, `"x.fits[AMP1]"`, `"pages.tif[3]"`, `"x.h5[dark]"`.
    bits
        Bit depth of the converter, for files that do not state it; 17 to 24 for pixels of 32 bits. Default: the 8 or 16
        bits that TIFF and PNG store; as many bits as the white level of camera raw needs.
    cfa
        Color filter array (`"rggb"` or its tile), for files that do not state it. Default: monochrome.
    index
        Index of the frame in a file of several (pages of TIFF, stacks of HDF5 and FITS), counted from 0.
    region
        Part of the stored image that receives light, as in `photosite.frames.open.open_frames`.
    layout
        How the pixels of a headerless file are stored, such as `"3280x2464,packed=mipi10,stride=4128"`
        (`photosite.frames.layout`).
    sensor
        The sensor that took the frame, for bits and mosaic that neither file nor caller states.

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
    name, selection = split_selection(os.fspath(path))
    file = Path(name)
    part = None if region is None else parse_region(region)
    stored = None if layout is None else parse_layout(layout)
    location = None
    headers: tuple[FrameHeader, ...] = ()
    if sensor is not None or index is not None or part is not None or selection is not None or stored is not None:
        headers = select_headers(file, read_headers(file, stored), selection)
    if (selection is not None or stored is not None) and index is None:
        if len(headers) > 1:
            raise _several(path, headers)
        index = 0
    if index is not None:
        if not 0 <= index < len(headers):
            raise FileError(path, "index", value=index, expected=f"0 to {len(headers) - 1}")
        location = headers[index].location
    tile = None if cfa is None else cfa_from(cfa)
    known, bits_of = headers[index or 0] if headers else None, None
    if sensor is not None and known is not None and known.stored_bits is not None:
        if known.bits is None and bits is None:
            bits_of = sensor.name
            bits = sensor.readout.bits
            if bits > known.stored_bits:
                what = f"the file stores {known.stored_bits} bits, but the sensor '{sensor.name}' has {bits}"
                raise FileError(path, what, hint=WHICH_SENSOR)
        tile = tile if known.cfa is not None or tile is not None else sensor.array.cfa
    with bits_from(bits_of):
        frame, notes = read_frame(file, bits, tile, location, has_region=part is not None)
    if sensor is not None and known is not None:
        decoded = known.stored_bits is None
        stated = decoded or known.bits is not None, decoded or known.cfa is not None
        check_sensor(path, sensor, frame.bits, frame.cfa, stated=stated)
    for note in notes:
        warnings.warn(PhotositeWarning(note, where=str(path)), stacklevel=2)
    return frame if part is None else _cropped(frame, part, file, headers[index or 0].border)


def _several(path: str | PathLike[str], headers: Sequence[FrameHeader]) -> FileError:
    name = split_selection(os.fspath(path))[0]
    hint = f"Name one of them: {Path(name).name}[{headers[0].names[-1]}]"
    return FileError(path, f"the file holds {len(headers)} frames", hint=hint)


def _cropped(frame: RawFrame, region: Section, path: Path, border: Border | None) -> RawFrame:
    top, bottom, left, right = lines_around(region, frame.shape, border, path)
    inside = slice(top, frame.shape[0] - bottom), slice(left, frame.shape[1] - right)
    metadata = {name: value for name, value in frame.metadata.items() if name != OPTICAL_BLACK}
    return replace(frame, dn=frame.dn[inside].copy(), cfa=shifted(frame.cfa, top, left), metadata=metadata, captures={})


def read_frame(
    path: Path,
    bits: int | None = None,
    cfa: Cfa | None = None,
    location: FrameLocation | None = None,
    *,
    has_region: bool = False,
) -> tuple[RawFrame, tuple[str, ...]]:
    """Read one raw frame, as `read_raw` does, and return the notes for warnings with it.

    With `has_region`, the caller crops the frame, and stated lines with light that are wrong do not matter.
    """
    module: Any = headerless
    if location is not None and str(location.part).startswith(headerless.LAYOUT):
        headers = read_headers(path, parse_layout(str(location.part).removeprefix(headerless.LAYOUT)))
    else:
        module = detect_format(path).load()
        if hasattr(module, "read_frame"):
            frame, notes = module.read_frame(path, bits, cfa)
            return frame, notes
        headers = module.read_headers(path)
    if location is not None:
        headers = tuple(header for header in headers if header.location == location)
    if len(headers) != 1:
        raise _several(path, headers)
    if not has_region:
        headers[0].check_sections(path)
    return _read_described(path, module, headers[0], bits, cfa)


def read_numbers(path: Path, format: Format, header: FrameHeader, bits: int, cfa: Cfa | None) -> Numbers:
    """Read the digital numbers of the only frame in a file as `read_frame` does, with its known format and header."""
    module = format.load()
    if not hasattr(module, "read_pixels"):
        return read_frame(path, bits, cfa)[0].dn
    header.check_sections(path)
    return _read_described(path, module, header, bits, cfa)[0].dn


def _read_described(
    path: Path, module: Any, header: FrameHeader, bits: int | None, cfa: Cfa | None
) -> tuple[RawFrame, tuple[str, ...]]:
    if header.overscan and header.black_level_dn is None:
        level = float(np.mean(module.overscan_levels(path, header.location)))
        header = replace(header, black_level_dn=level, metadata={**header.metadata, MASKED_BORDER: level})
    stored = module.read_pixels(path, header.location)
    found = number_range(path, stored, header, bits)
    if found is None:
        return header.to_frame(path, stored, bits, cfa), header.notes
    conversion = conversion_of(found, header.numbers, bits, header.stored_bits)
    notes = tuple(entry.text for entry in conversion_diagnostics(conversion, found, bits))
    if conversion.added:
        header = replace(header, black_level_dn=(header.black_level_dn or 0.0) + conversion.added)
    dn = conversion.apply(path, stored)
    return header.to_frame(path, dn, conversion.bits(bits, found), cfa), (*header.notes, *notes)


def number_range(
    path: str | PathLike[str], stored: StoredNumbers, header: FrameHeader, bits: int | None
) -> NumberRange | None:
    """Return the range of numbers that may need a conversion: signed ones, floats, more bits than are stated."""
    if header.numbers == "unsigned" and (bits is None or header.bits is not None or header.stored_bits in (None, bits)):
        return None
    return NumberRange.of(path, stored)


def overscan_levels(path: Path, location: FrameLocation | None) -> tuple[float, ...]:
    """Return the levels of the overscan of a frame, by amplifier."""
    levels: tuple[float, ...] = detect_format(path).load().overscan_levels(path, location)
    return levels


def read_leveled(path: Path, location: FrameLocation | None, levels: tuple[float, ...], most: int) -> StoredNumbers:
    """Read the stored numbers of one frame, shifted to the overscan levels of another one."""
    numbers: StoredNumbers = detect_format(path).load().read_pixels(path, location, levels, most)
    return numbers


def read_bordered(path: Path, bits: int, cfa: Cfa | None) -> tuple[Numbers, NDArray[np.float64]]:
    """Read the digital numbers of a frame with a masked border, and the means of the lines of the border."""
    frame, _, means = detect_format(path).load().read_bordered(path, bits, cfa)
    return frame.dn, means


def read_pixels(path: Path, location: FrameLocation | None) -> StoredNumbers:
    """Read the (rows, cols) stored numbers of one frame, without its header."""
    if location is not None and str(location.part).startswith(headerless.LAYOUT):
        return headerless.read_pixels(path, location)
    kind = detect_format(path)
    if not hasattr(kind.load(), "read_pixels"):
        raise FileError(path, f"the file is now {kind.name}; it had another format when it was opened")
    numbers: StoredNumbers = kind.load().read_pixels(path, location)
    return numbers


def read_whole(path: Path, location: FrameLocation | None = None) -> StoredNumbers:
    """Read the stored numbers of a frame with its border, which `FrameHeader.border` states."""
    numbers: StoredNumbers = detect_format(path).load().read_whole(path, location)
    return numbers


def open_stored_rows(
    path: Path, location: FrameLocation | None, bits: int | None, cfa: Cfa | None, format: Format | None = None
) -> StoredRows | None:
    """Open a frame to read some rows at a time; None where its pixels are not stored as they are.

    The header is checked as by `read_frame`, but not the numbers against the bit depth. `format` is that of the file,
    if it is known.
    """
    format = format or detect_format(path)
    open_rows = getattr(format.load(), "open_rows", None) if hasattr(os, "preadv") else None
    return None if open_rows is None else open_rows(path, location, bits, cfa)


def read_headers(path: Path, layout: Layout | None = None) -> tuple[FrameHeader, ...]:
    """Read the headers of all frames in a file, without pixels; of a headerless file by its layout."""
    if layout is not None:
        return headerless.read_headers(path, layout)
    headers: tuple[FrameHeader, ...] = detect_format(path).load().read_headers(path)
    return headers


def select_headers(path: Path, headers: tuple[FrameHeader, ...], selection: str | None) -> tuple[FrameHeader, ...]:
    """Return the headers of the frames that a text names.

    It is the number of a unit or page ("1"), with the number of a frame in it ("1,3"), the name of a unit ("AMP1") or
    of a dataset ("/dark").

    Raises
    ------
    FileError
        If the file has no such part, or the part is no frame.
    """
    if selection is None:
        return headers
    wanted = re.sub(r"\s*,\s*", ",", selection.strip().strip("/")).casefold()
    found = tuple(header for header in headers if wanted in map(str.casefold, header.names))
    if not found:
        if (check := getattr(detect_format(path).load(), "check_part", None)) is not None:
            check(path, wanted)
        names = list(dict.fromkeys(name for header in headers for name in header.names))
        shown = ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
        raise FileError(f"{path}[{selection}]", "the file has no such part", hint=f"Its parts are {shown}")
    return found


_MOST_NAMES = 12


def detect_format(path: Path) -> Format:
    """Return the format of a file."""
    if os.path.isdir(path):
        raise FileError(path, "the path is a folder", hint="read_raw reads one frame, open_frames a folder")
    with reading(path), path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head:
        raise FileError(path, "the file is empty")
    for format in FORMATS:
        if format.recognizes(path, head):
            return format
    if head.startswith(b"\xff\xd8\xff"):
        raise FileError(path, "the file is a JPEG, a developed picture", hint=f"A raw frame is {NAMES}")
    if any(signature.startswith(head) for format in FORMATS for signature in format.signatures):
        raise FileError(path, f"the file is truncated: {len(head)} bytes")
    for format in FORMATS:
        if format.by_suffix and path.suffix.lower() in format.suffixes:
            return format
    hint = f"A raw frame is {NAMES}"
    if path.suffix.lower() in headerless.SUFFIXES:
        what = "the file is not a frame, or a headerless one"
        if guess := headerless.guess_text(path):
            arguments = {"layout": guess.split(" or ")[0]}
            raise FileError(path, f"{what}; its size is that of {guess}", hint="Pass {layout}", arguments=arguments)
        hint = f"Pass columns, rows and numbers of a headerless one: {{layout}}. Other frames are {NAMES}"
        raise FileError(path, what, hint=hint, arguments={"layout": headerless.EXAMPLE})
    raise FileError(path, "the file is not a frame", hint=hint)


def check_holds(path: Path, bits: int, cfa: Cfa | None = None) -> None:
    """Raise `InputError` if a file of this suffix does not hold the bit depth or the color filter array."""
    format = format_to_write(path.suffix)
    if format is None:
        raise InputError("path", value=path.name, expected=f"a name with the suffix {', '.join(WRITTEN_SUFFIXES)}")
    if bits > 16 and bits > format.most_bits:
        deep = ", ".join(DEEP_SUFFIXES)
        hint = f"Write {deep}, or compand the numbers: captures.combination.companding of the sensor file"
        raise InputError("bits", where=path.name, value=bits, expected="at most 16", hint=hint)
    if cfa is not None and (check_cfa := getattr(format.load(), "check_cfa", None)) is not None:
        check_cfa(cfa)


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
    check_holds(target, frame.bits)
    format = format_to_write(target.suffix)
    assert format is not None
    module = format.load()
    is_ome = target.name.lower().endswith(OME_SUFFIXES)
    with atomic_path(target) as temporary:
        (module.write_ome if is_ome else module.write)(frame, temporary)
