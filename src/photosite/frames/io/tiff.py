"""Frames in TIFF: gray pages, a frame each, compressed or not; and directories without pixels.

Directories (TIFF 6.0 section 2, BigTIFF, SubIFDs and Exif) are read for listings of many frames and for camera files.
It takes 0.16 s for 1000 frames, tifffile 0.3 s; and it reports tags and image data beyond the end of the file, which
tifffile drops or fills with zeros.
"""

from __future__ import annotations

import logging
import math
import os
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from photosite.errors import FileError, message_of
from photosite.files.small_files import reading
from photosite.files.tiff_pages import bytes_held, decoded
from photosite.frames.frame_file import (
    FrameHeader,
    FrameLocation,
    OwnOutputError,
    describe_frame,
    parse_description,
)
from photosite.frames.raw_frame import RawFrame
from photosite.frames.stored_numbers import NumberKind, StoredNumbers
from photosite.frames.stored_rows import StoredRows
from photosite.values.cfa import Cfa
from photosite.values.exif_time import TIMES, iso_time
from photosite.values.exposure import PER_SECOND

SUB_IFDS, EXIF_IFD = 330, 34665

_LARGEST_VALUE = 1 << 22
"""Bytes; larger values (thumbnails, maker notes) are skipped."""

_TYPES = {
    1: "B", 2: "s", 3: "H", 4: "I", 5: "II", 6: "b", 7: "s", 8: "h", 9: "i", 10: "ii", 11: "f", 12: "d", 13: "I",
    16: "Q", 17: "q", 18: "Q",
}  # fmt: skip
"""Struct code by field type. Text and undefined bytes are kept as bytes."""


@dataclass
class Directory:
    """One image file directory.

    Parameters
    ----------
    order
        Byte order of the file, "<" or ">".
    tags
        Values by tag number: a tuple of numbers (rationals as floats, NaN for x/0), or bytes.
    places
        Positions of the values in the file, in bytes.
    children
        Sub-directories by the tag that points to them.
    offset, pointer
        Positions in the file, in bytes, of the directory and of the number that points to it.
    """

    order: str = "<"
    tags: dict[int, tuple[float, ...] | bytes] = field(default_factory=dict)
    places: dict[int, int] = field(default_factory=dict)
    children: dict[int, list[Directory]] = field(default_factory=dict)
    offset: int = 0
    pointer: int = 0

    def numbers(self, tag: int) -> tuple[Any, ...] | None:
        """Return a tag's values, or None."""
        values = self.tags.get(tag)
        return tuple(values) if values is not None else None

    def number(self, tag: int) -> Any:
        """Return a tag's first value, or None."""
        values = self.numbers(tag)
        return values[0] if values else None

    def text(self, tag: int) -> str | None:
        """Return a tag's text, or None where it is missing, empty or not text."""
        value = self.tags.get(tag)
        if not isinstance(value, bytes):
            return None
        return value.split(b"\0")[0].decode("utf-8", "replace").strip() or None

    def exif(self, tag: int) -> Any:
        """Return a tag's first value from the Exif directory, or from this one (TIFF/EP)."""
        for directory in (*self.children.get(EXIF_IFD, ()), self):
            if (number := directory.number(tag)) is not None:
                return number
        return None

    def exif_text(self, tag: int) -> str | None:
        """Return a tag's text from the Exif directory, or from this one (TIFF/EP)."""
        return next(filter(None, (each.text(tag) for each in (*self.children.get(EXIF_IFD, ()), self))), None)


def read_directories(path: Path, *, strict: bool = True) -> list[Directory]:
    """Read the chain of directories, each with its children.

    Parameters
    ----------
    path
        A TIFF file, or one with the same structure (DNG, NEF, CR2, ARW, ...).
    strict
        Whether a value or image data beyond the end of the file is an error. Files of camera makers break rules.
    """
    with _reader(path, strict) as reader:
        return reader.linked(reader.first, reader.first_pointer) or reader.fail("has no image")


def has_tag(path: Path, tag: int) -> bool:
    """Return whether the first directory of a TIFF file has a tag."""
    with _reader(path, True) as reader:
        if not reader.first:
            reader.fail("has no image")
        start, end = reader.entries(reader.first)
        entries = reader.bytes_at(start, end - start)
        tags = struct.iter_unpack(f"{reader.order}H{18 if reader.big else 10}x", entries)
        return any(found == tag for (found,) in tags)


def read_directory(path: Path, offset: int) -> Directory:
    """Read the one directory at a position that `read_directories` found."""
    with _reader(path, True) as reader:
        return reader.directory(offset)[0]


@contextmanager
def _reader(path: Path, strict: bool) -> Iterator[_Reader]:
    with reading(path), path.open("rb") as file:
        yield _Reader(path, file, strict)


class _Reader:
    def __init__(self, path: Path, file: BinaryIO, strict: bool) -> None:
        self.path, self.file, self.strict = path, file, strict
        self.size = os.fstat(file.fileno()).st_size
        self.seen: set[int] = set()
        head = self.bytes_at(0, 8)
        self.order = {b"II": "<", b"MM": ">"}.get(head[:2], "")
        version = struct.unpack(f"{self.order}H", head[2:4])[0] if self.order else 0
        if version not in (42, 43):
            self.fail("is not a TIFF file")
        self.big = version == 43
        self.first_pointer = 8 if self.big else 4
        (self.first,) = self.numbers_at(self.first_pointer, "Q" if self.big else "I")

    def fail(self, what: str) -> Any:
        raise FileError(self.path, what)

    def bytes_at(self, offset: int, count: int) -> bytes:
        if offset + count > self.size:
            self.fail(f"is truncated: {self.size} bytes, at least {offset + count} expected")
        self.file.seek(offset)
        return self.file.read(count)

    def numbers_at(self, offset: int, codes: str) -> tuple[Any, ...]:
        code = f"{self.order}{codes}"
        return struct.unpack(code, self.bytes_at(offset, struct.calcsize(code)))

    def linked(self, offset: int, pointer: int) -> list[Directory]:
        directories = []
        while offset:
            if offset in self.seen:
                self.fail("is damaged: its directories form a loop")
            self.seen.add(offset)
            directory, offset, next_pointer = self.directory(offset)
            directory.pointer, pointer = pointer, next_pointer
            directories.append(directory)
        return directories

    def directory(self, offset: int) -> tuple[Directory, int, int]:
        """Return a directory, the offset of the next one, and the position of that offset."""
        entry_bytes, link_code = (20, "Q") if self.big else (12, "I")
        start, end = self.entries(offset)
        (link,) = self.numbers_at(end, link_code)
        directory = Directory(self.order, offset=offset)
        table = self.bytes_at(start, end - start)
        for at in range(0, len(table), entry_bytes):
            self.entry(directory, start + at, table[at : at + entry_bytes])
        for tag in (SUB_IFDS, EXIF_IFD):
            offsets = directory.tags.pop(tag, ())
            pointers = range(directory.places.get(tag, 0), self.size, 8 if self.big else 4)
            linked = (self.linked(int(at), pointer) for at, pointer in zip(offsets, pointers, strict=False))
            directory.children[tag] = [child for chain in linked for child in chain]
        if self.strict:
            self.check_image_data(directory)
        return directory, int(link), end

    def entries(self, offset: int) -> tuple[int, int]:
        """Return where the entries of a directory begin and end."""
        count_code, entry_bytes = ("Q", 20) if self.big else ("H", 12)
        (count,) = self.numbers_at(offset, count_code)
        start = offset + struct.calcsize(f"<{count_code}")
        return start, start + count * entry_bytes

    def entry(self, directory: Directory, at: int, stored: bytes) -> None:
        """Add the tag of an entry, whose bytes are stored at a place."""
        tag, kind, count = struct.unpack_from(self.order + ("HHQ" if self.big else "HHI"), stored)
        if kind not in _TYPES:
            return  # TIFF 6.0: readers skip unknown types
        codes = _TYPES[kind]
        length = count * struct.calcsize(f"<{codes}")
        inline, most = (12, 8) if self.big else (8, 4)
        held = length <= most
        where = at + inline if held else struct.unpack_from(self.order + ("Q" if self.big else "I"), stored, inline)[0]
        if where + length > self.size:
            if self.strict:
                self.fail(f"is truncated: tag {tag} ends at byte {where + length}, the file at {self.size}")
            return
        if length > _LARGEST_VALUE:
            return
        directory.places[tag] = where
        content = stored[inline : inline + length] if held else self.bytes_at(where, length)
        if codes == "s":
            directory.tags[tag] = content
            return
        values = struct.unpack(f"{self.order}{count * len(codes)}{codes[0]}", content)
        if len(codes) == 2:
            pairs = zip(values[::2], values[1::2], strict=True)
            values = tuple(top / bottom if bottom else float("nan") for top, bottom in pairs)
        directory.tags[tag] = values

    def check_image_data(self, directory: Directory) -> None:
        for offsets_tag, counts_tag in _SEGMENTS:
            offsets, counts = directory.numbers(offsets_tag), directory.numbers(counts_tag)
            if offsets and (counts is None or len(counts) != len(offsets)):
                self.fail("is damaged: the image data's lengths are missing")
        if (end := image_end(directory)) > self.size:
            self.fail(f"is truncated: image data end at byte {end}, the file at {self.size}")


_SEGMENTS = ((273, 279), (324, 325))
"""Tags of the offsets and lengths of strips, and of tiles."""


def image_end(directory: Directory) -> int:
    """Return the byte after the image data of a directory; 0 without them."""
    pairs = [(directory.numbers(offsets), directory.numbers(counts)) for offsets, counts in _SEGMENTS]
    ends = [max(map(sum, zip(offsets, counts, strict=False))) for offsets, counts in pairs if offsets and counts]
    return int(max(ends, default=0))


WIDTH, LENGTH, BITS, COMPRESSION, PHOTOMETRIC, DESCRIPTION = 256, 257, 258, 259, 262, 270
ORIENTATION, SAMPLES, SAMPLE_FORMAT, EXPOSURE_TIME = 274, 277, 339, 33434
NEW_SUBFILE_TYPE, ISO_SPEED, RECOMMENDED_EXPOSURE_INDEX = 254, 34855, 34866
ROWS_PER_STRIP, TILE_WIDTH, TILE_LENGTH = 278, 322, 323
FILL_ORDER, STRIP_OFFSETS, STRIP_COUNTS, TILE_OFFSETS, TILE_COUNTS = 266, 273, 279, 324, 325
_PLACES = (STRIP_OFFSETS, STRIP_COUNTS, TILE_OFFSETS, TILE_COUNTS)
_SIZES = (WIDTH, LENGTH, BITS, SAMPLES, COMPRESSION, ROWS_PER_STRIP, TILE_WIDTH, TILE_LENGTH, FILL_ORDER)

_UNSIGNED, _SIGNED, _FLOAT = "unsigned integers", "signed integers", "floats"
_KINDS = {1: _UNSIGNED, 2: _SIGNED, 3: _FLOAT, 4: _UNSIGNED}
"""By SampleFormat; 4 is undefined."""
_STORED_BITS = {_UNSIGNED: (8, 16, 32), _SIGNED: (8, 16, 32), _FLOAT: (16, 32, 64)}
_CODES: dict[str, tuple[str, NumberKind]] = {
    _UNSIGNED: ("u", "unsigned"),
    _SIGNED: ("i", "signed"),
    _FLOAT: ("f", "float"),
}

_GRAY = {1: "black is zero", 32803: "CFA", 34892: "linear raw"}
_COLOR = {0: "inverted (white is zero)", 2: "RGB", 3: "a palette", 5: "CMYK", 6: "YCbCr", 8: "CIE L*a*b*"}


def write(frame: RawFrame, path: Path) -> None:
    """Write the frame as uncompressed TIFF of 16 or 32 bits, its description in ImageDescription."""
    import tifffile

    tifffile.imwrite(
        path, frame.dn, photometric="minisblack", description=describe_frame(frame), metadata=None, software="photosite"
    )


def write_ome(frame: RawFrame, path: Path) -> None:
    """Write the frame as OME-TIFF: exposure time and bit depth in OME-XML, photosite's description as an annotation."""
    import tifffile

    metadata: dict[str, Any] = {
        "axes": "YX",
        "SignificantBits": frame.bits,
        "MapAnnotation": {"Namespace": "photosite", "Value": {"frame": describe_frame(frame)}},
    }
    if frame.exposure_s is not None:
        metadata["Plane"] = {"ExposureTime": frame.exposure_s, "ExposureTimeUnit": "s"}
    tifffile.imwrite(path, frame.dn, photometric="minisblack", ome=True, metadata=metadata, software="photosite")


_OME_DESCRIPTION = re.compile(r'<M K="frame">(.*?)</M>', re.DOTALL)


def _description(page: Directory) -> str:
    """Return photosite's description of a page, in plain or in OME-XML, or another program's."""
    text = page.text(DESCRIPTION) or ""
    found = _OME_DESCRIPTION.search(text) if text.startswith("<?xml") else None
    if found is None:
        return text
    from html import unescape

    return unescape(found[1])


_PLANE = re.compile(r"<(?:\w+:)?Plane\b[^>]*>")
_OME_EXPOSURE = re.compile(r'\bExposureTime="([0-9.eE+-]{1,20})"')
_OME_UNIT = re.compile(r'\bExposureTimeUnit="(\w{1,4})"')
_OME_BITS = re.compile(r'<(?:\w+:)?Pixels\b[^>]*\bSignificantBits="(\d{1,2})"')
_MICRO_MANAGER, _MICRO_MANAGER_MS = 51123, re.compile(r'"Exposure-ms":\s*"?([0-9.eE+-]{1,20})')


def _microscope_exposures(first: Directory, count: int) -> list[float | None]:
    """Return the exposure time of each of the pages of a microscope's file: those of OME-XML, or Micro-Manager's."""
    text = first.text(DESCRIPTION) or ""
    if "<OME" in text[:_HEAD_OF_XML]:
        found = []
        for plane in _PLANE.findall(text):
            time, unit = _OME_EXPOSURE.search(plane), _OME_UNIT.search(plane)
            per_second = PER_SECOND.get(unit[1] if unit else "s")
            found.append(None if time is None or per_second is None else _positive(time[1], per_second))
        if len(set(found)) == 1:
            return [found[0]] * count
        if len(found) == count:
            return found
    stated = _MICRO_MANAGER_MS.search(first.text(_MICRO_MANAGER) or "")
    return [_positive(stated[1], 1000) if stated else None] * count


_HEAD_OF_XML = 4096


def _positive(text: str, per_second: float) -> float | None:
    """Return a time in seconds; None for what is no number above 0."""
    try:
        value = float(text) / per_second
    except ValueError:
        return None
    return value if 0.0 < value < math.inf else None


def _significant_bits(text: str, stored_bits: int) -> int | None:
    """Return the bit depth that OME-XML states; the number of stored bits says nothing."""
    found = _OME_BITS.search(text) if "<OME" in text[:_HEAD_OF_XML] else None
    return int(found[1]) if found and 0 < int(found[1]) < stored_bits else None


def read_headers(path: Path) -> tuple[FrameHeader, ...]:
    """Read the headers of a TIFF file's frames, one a page; thumbnails, and color pages beside gray ones, are skipped.

    A page without its own exposure time or metadata takes those of the first page.
    """
    every = _full_size_pages(path)
    gray = [(number, page) for number, page in enumerate(every) if _is_gray(page)]
    numbers, pages = zip(*(gray or enumerate(every)), strict=True)
    first = _header(path, pages[0], None)
    exposures: list[float | None] = [None]
    if first.exposure_s is None:
        exposures = _microscope_exposures(pages[0], len(pages))
        first = replace(first, exposure_s=exposures[0])
    if len(every) == 1:
        _check_not_hidden(path, pages[0])
        return (replace(first, first_pixel=_first_pixel(pages[0], first)),)
    headers = [first, *(_header(path, page, first) for page in pages[1:])]
    if len(set(exposures)) > 1:
        headers = [replace(header, exposure_s=own) for header, own in zip(headers, exposures, strict=True)]
    return tuple(
        replace(header, location=FrameLocation(f"[{number}]", page.offset, names=(str(number),)))
        for number, page, header in zip(numbers, pages, headers, strict=True)
    )


def _full_size_pages(path: Path) -> list[Directory]:
    pages = [page for page in read_directories(path) if not int(page.number(NEW_SUBFILE_TYPE) or 0) & 1]
    if not pages:
        raise FileError(path, "has no full-size page, only thumbnails")
    return pages


def _is_gray(page: Directory) -> bool:
    return (page.number(SAMPLES) or 1) == 1 and page.number(PHOTOMETRIC) in _GRAY


def check_part(path: Path, name: str) -> None:
    """Raise `FileError` if a name is the number of a page that is no frame."""
    pages = _full_size_pages(path)
    if name.isdecimal() and int(name) < len(pages):
        checked_size(path, pages[int(name)], 32)


def _header(path: Path, page: Directory, first: FrameHeader | None) -> FrameHeader:
    rows, cols, stored_bits = checked_size(path, page, 32)
    _, numbers = _code(page)
    if numbers == "float":
        stored_bits = 16
    if (own := parse_description(path, _description(page), rows, cols, stored_bits)) is not None:
        return own
    if (page.text(DESCRIPTION) or "").startswith('{"photosite_clean"'):
        raise OwnOutputError(path, "a noise-free mosaic")
    exposure_s, metadata = exposure_of(page), camera_settings(page)
    if first is None:
        bits = _significant_bits(page.text(DESCRIPTION) or "", stored_bits)
        return FrameHeader(rows, cols, stored_bits, bits, exposure_s=exposure_s, metadata=metadata, numbers=numbers)
    return replace(
        first,
        numbers=numbers,
        rows=rows,
        cols=cols,
        stored_bits=stored_bits,
        exposure_s=exposure_s or first.exposure_s,
        metadata={**first.metadata, **metadata},
    )


def _code(page: Directory) -> tuple[str, NumberKind]:
    """Return NumPy's code of the stored numbers, and their kind."""
    return _CODES[_KINDS[page.number(SAMPLE_FORMAT) or 1]]


def _check_not_hidden(path: Path, page: Directory) -> None:
    """ImageJ writes stacks above 4 GB as one page, followed by the other frames without directories."""
    found = re.match(r"ImageJ=.*?^images=(\d+)", page.text(DESCRIPTION) or "", re.DOTALL | re.MULTILINE)
    if found and int(found[1]) > 1:
        what = f"is an ImageJ stack of {found[1]} frames in one page, which is not supported"
        raise FileError(path, what, hint="Save it as an image sequence")


def camera_settings(page: Directory) -> dict[str, Any]:
    """Return maker, model, ISO, orientation and time from Exif or TIFF/EP, under their names in `RawFrame.metadata`.

    The orientation is that of the upright picture; pixels of a frame stay in the order in which they are stored.
    Exif keeps ISO in 16 bits; higher values are in RecommendedExposureIndex (CIPA DC-008, 4.6.6).
    """
    iso = page.exif(ISO_SPEED)
    if iso == 65535:
        iso = page.exif(RECOMMENDED_EXPOSURE_INDEX) or iso
    orientation = page.number(ORIENTATION)
    found = {"make": page.text(271), "model": page.text(272), "iso": iso or None}
    found["orientation"] = int(orientation) if orientation in range(2, 9) else None
    times = (iso_time(*map(page.exif_text, tags)) for tags in TIMES)
    found["date_time"] = next(filter(None, times), None)
    return {name: value for name, value in found.items() if value is not None}


def exposure_of(page: Directory) -> float | None:
    """Return the exposure time in seconds from Exif or TIFF/EP, or None where none above 0 is stated."""
    exposure_s = page.exif(EXPOSURE_TIME)
    return float(exposure_s) if exposure_s is not None and 0 < exposure_s < float("inf") else None


def checked_size(path: Path, page: Directory, most_bits: int = 16) -> tuple[int, int, int]:
    """Return rows, columns and stored bits of a page, checked before any pixel is decoded."""
    _check_whole_numbers(path, page)
    rows, cols = page.number(LENGTH), page.number(WIDTH)
    bits = page.number(BITS) or 1
    samples = page.number(SAMPLES) or 1
    photometric = page.number(PHOTOMETRIC)
    if not rows or not cols:
        raise FileError(path, "is damaged: its page has no width or height")
    if not _is_gray(page):
        kind = _COLOR.get(photometric, f"photometric interpretation {photometric}")
        if samples != 1:
            kind += f" with {samples} samples a pixel"
        raise FileError(path, "pixels", value=kind, expected="gray in a raw frame, one value a pixel")
    kind = _KINDS.get(page.number(SAMPLE_FORMAT) or 1, "complex numbers")
    if bits not in _STORED_BITS.get(kind, ()) or (most_bits == 16 and (kind != _UNSIGNED or bits > 16)):
        expected = "unsigned integers of 8 or 16 bits in a raw frame"
        if most_bits > 16:
            expected = "integers of 8, 16 or 32 bits, or floats of 16, 32 or 64 bits, in a raw frame"
        raise FileError(path, "pixels", value=f"{kind} of {bits} bits", expected=expected, hint="Convert the file")
    counts = page.numbers(STRIP_COUNTS) or page.numbers(TILE_COUNTS)
    if counts is None or (page.numbers(STRIP_OFFSETS) or page.numbers(TILE_OFFSETS)) is None:
        raise FileError(path, "is damaged: its page has no image data")
    if page.number(COMPRESSION) in (None, 1) and sum(counts) < rows * cols * bits // 8:
        raise FileError(path, f"is damaged: {sum(counts)} bytes of image data, {rows * cols * bits // 8} expected")
    if len(counts) != (segments := _segments(page, rows, cols)):
        raise FileError(
            path, f"is damaged: {rows} x {cols} pixels need {segments} strips or tiles, the file has {len(counts)}"
        )
    if rows * cols * bits // 8 > bytes_held(page.number(COMPRESSION) or 1, sum(counts)):
        raise FileError(path, f"is damaged: {sum(counts)} bytes cannot hold {rows} x {cols} pixels")
    return int(rows), int(cols), int(bits)


def _check_whole_numbers(path: Path, page: Directory) -> None:
    for tag in (*_SIZES, *_PLACES):
        for number in page.numbers(tag) or ():
            if not isinstance(number, int) or number < 0:
                raise FileError(path, f"tag {tag}", value=number, expected="a whole number of 0 or more")


def _segments(page: Directory, rows: int, cols: int) -> int:
    """Return the number of strips or tiles that the page needs."""
    if page.numbers(STRIP_OFFSETS):
        return -(-rows // max(int(page.number(ROWS_PER_STRIP) or rows), 1))
    high, wide = (max(int(page.number(tag) or 0), 1) for tag in (TILE_LENGTH, TILE_WIDTH))
    return -(-rows // high) * -(-cols // wide)


def read_pixels(path: Path, location: FrameLocation | None = None) -> StoredNumbers:
    """Read the (rows, cols) values of a TIFF file's page; without a location, of the first page."""
    page = read_directories(path)[0] if location is None else read_directory(path, int(location.part))
    rows, cols, bits = checked_size(path, page, 32)
    if _in_strips(page):
        return _stored_pixels(path, page, (rows, cols), bits)
    import tifffile

    tifffile.logger().setLevel(logging.CRITICAL)  # damage is reported here
    try:
        with tifffile.TiffFile(path) as file:
            file.filehandle.seek(page.offset)
            pixels = decoded(path, tifffile.TiffPage(file, 0))
    except FileError:
        raise
    except Exception as error:  # the decoders' own exceptions, which depend on the compression
        raise FileError(path, f"cannot be decoded ({message_of(error)})", hint="Save it uncompressed") from None
    if pixels.shape != (rows, cols):
        raise FileError(path, f"is damaged: it decodes to {pixels.shape} pixels, its tags state {rows} x {cols}")
    if pixels.dtype.kind != "u":
        return np.ascontiguousarray(pixels)
    return np.ascontiguousarray(pixels, np.uint32) if bits == 32 else np.ascontiguousarray(pixels, np.uint16)


def open_rows(path: Path, location: FrameLocation | None, bits: int | None, cfa: Cfa | None) -> StoredRows | None:
    """Open a page as `read_pixels` finds it, after a check of its header, to read some rows at a time.

    None unless its pixels are stored without gaps, in 16 bits and the byte order of this machine.
    """
    pages = read_directories(path) if location is None else [read_directory(path, int(location.part))]
    header = _header(path, pages[0], None)
    first_pixel = _first_pixel(pages[0], header)
    if len(pages) > 1 or first_pixel is None:
        return None
    header.resolve_bits(path, bits)
    header.resolve_cfa(path, cfa)
    return StoredRows(path, first_pixel, (header.rows, header.cols))


def _first_pixel(page: Directory, header: FrameHeader) -> int | None:
    """Return `FrameHeader.first_pixel` of a page."""
    native = np.dtype(f"{page.order}u2") == np.uint16
    if header.stored_bits != 16 or header.numbers != "unsigned" or not native or not _in_strips(page):
        return None
    offsets, counts = page.numbers(STRIP_OFFSETS) or (), page.numbers(STRIP_COUNTS) or ()
    if any(at + count != then for at, count, then in zip(offsets, counts, offsets[1:], strict=False)):
        return None
    return int(offsets[0])


def _in_strips(page: Directory) -> bool:
    """Return whether the pixels are stored in strips as they are."""
    return (
        page.number(COMPRESSION) in (None, 1)
        and bool(page.number(STRIP_OFFSETS))
        and (page.number(FILL_ORDER) in (None, 1))
    )


def _stored_pixels(path: Path, page: Directory, shape: tuple[int, int], bits: int) -> StoredNumbers:
    """Read uncompressed strips straight into the array, unbuffered: one copy."""
    strips = zip(page.numbers(STRIP_OFFSETS) or (), page.numbers(STRIP_COUNTS) or (), strict=True)
    code, _ = _code(page)
    stored = np.empty(shape, dtype=f"{page.order}{code}{bits // 8}")
    wanted, done = stored.nbytes, 0
    buffer = stored.view(np.uint8).reshape(-1)
    with reading(path), path.open("rb", buffering=0) as file:
        for offset, count in strips:
            end = min(done + int(count), wanted)
            file.seek(offset)
            while done < end and (got := file.readinto(buffer[done:end].data)):
                done += got
    if done < wanted:
        raise FileError(path, f"is truncated: {done} bytes of image data, {wanted} expected")
    if code != "u":
        return stored.astype(stored.dtype.newbyteorder("="), copy=False)
    return stored.astype(np.uint32, copy=False) if bits == 32 else stored.astype(np.uint16, copy=False)
