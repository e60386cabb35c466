"""Frames in FITS (version 4.0), read by astropy: the extra `fits`.

Every image unit of 8, 16 or 32 bits is a frame, or a stack if it has three axes. Unsigned numbers are stored minus
BZERO, 2^15 or 2^31, as FITS requires. Keywords: EXPTIME or EXPOSURE (seconds), GAIN, ISO or ISOSPEED, CCD-TEMP or
SET-TEMP (degrees Celsius), IMAGETYP (words as in file names: "Dark Frame", "Flat Field"), BAYERPAT with XBAYROFF,
YBAYROFF and ROWORDER. The frame is the common part of DATASEC and TRIMSEC without BIASSEC. Rows are in the order in
which they are stored.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import FileError, InputError, message_of
from photosite.files.small_files import reading
from photosite.frames.frame_file import FrameHeader, FrameLocation
from photosite.frames.frame_settings import kinds_in_name
from photosite.frames.raw_frame import Numbers
from photosite.frames.sections import Section, parse_section, section_with_light
from photosite.values.cfa import Cfa, cfa_from, shifted

_BLOCK, _MOST_BLOCKS, _END = 2880, 1000, b"END     "
"""Bytes of a block, blocks of a header, its last keyword; astropy reads on until it finds that."""

_ZEROS = {8: (0,), 16: (0, 1 << 15), 32: (0, 1 << 31)}
"""BZERO of the numbers by their bits: signed, unsigned."""


def read_headers(path: Path) -> tuple[FrameHeader, ...]:
    """Read the headers of all frames in a FITS file."""
    found: list[tuple[int, tuple[int, ...], FrameHeader]] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # astropy's; the relevant ones are errors below
        with _open_fits(path) as units:
            size = path.stat().st_size
            for number, unit in enumerate(units):
                place = unit.fileinfo()
                if (end := place["datLoc"] + place["datSpan"]) > size:
                    problem = f"the file is truncated: unit {number} ends at byte {end}, the file at {size}"
                    raise FileError(path, problem)
                if unit.is_image and unit.header.get("NAXIS"):
                    shape = _shape(path, number, unit.header)
                    found.append((number, shape, _header(path, shape, _Keywords(path, unit.header, units[0].header))))
    if not found:
        raise FileError(path, "the FITS file holds no image")
    single = len(found) == 1 and len(found[0][1]) == 2
    return tuple(
        replace(header, location=FrameLocation("" if single else f"[{number}, {index}]", number, index))
        for number, shape, header in found
        for index in range(shape[0] if len(shape) == 3 else 1)
    )


def read_pixels(path: Path, location: FrameLocation) -> Numbers:
    """Read the (rows, cols) digital numbers of one frame."""
    dn, header = _stored_numbers(path, location)
    light = _light(path, dn.shape, header)
    return dn if light.shape == dn.shape else np.ascontiguousarray(dn[light.slices])


def read_whole(path: Path, location: FrameLocation) -> Numbers:
    """Read the digital numbers of a frame with those around the lines with light."""
    return _stored_numbers(path, location)[0]


def overscan_level(path: Path, location: FrameLocation) -> float:
    """Return the mean of the pixels of BIASSEC."""
    dn, header = _stored_numbers(path, location)
    overscan = _section(path, dn.shape, header, "BIASSEC")
    return float(dn[overscan.slices].mean()) if overscan else 0.0


def _stored_numbers(path: Path, location: FrameLocation) -> tuple[Numbers, _Keywords]:
    """Read all digital numbers of a frame, with the keywords of its unit."""
    with _open_fits(path) as units:
        unit = units[location.part]
        keywords = _Keywords(path, unit.header.copy(), units[0].header.copy())
        zero = int(unit.header.get("BZERO", 0))  # reading the data can change the header
        stored = np.asarray(unit.section[location.index] if unit.header["NAXIS"] == 3 else unit.data)
        dn = stored.astype(np.int64 if unit.header["BITPIX"] == 32 else np.int32) + zero
        deep = unit.header["BITPIX"] == 32
    if dn.min() < 0:
        raise FileError(path, "dn", value=int(dn.min()), expected="0 or above")
    return np.ascontiguousarray(dn, np.uint32 if deep else np.uint16), keywords


@contextmanager
def _open_fits(path: Path) -> Iterator[Any]:
    try:
        from astropy.io import fits
    except ImportError:
        hint = "Run pip install '.[fits]' in the clone"
        raise FileError(path, "FITS needs astropy, which is missing", hint=hint) from None
    if not _begins_header(path, 0):
        raise FileError(path, "the FITS header has no end", hint="Check that the file is complete")
    try:
        options = {"mode": "readonly", "memmap": False, "do_not_scale_image_data": True}
        with _Beginning(path, _end_of_units(path)) as file, fits.open(file, **options) as units:
            yield units
    except FileError:
        raise
    # Damaged files make astropy raise OSError, ValueError, TypeError, KeyError, VerifyError ...
    except Exception as error:
        raise FileError(
            path, f"the file cannot be read as FITS ({message_of(error)})", hint="It may be truncated"
        ) from None


class _Beginning(io.FileIO):
    """A file up to the end of its last unit: astropy reads on, and takes what follows for headers."""

    def __init__(self, path: Path, end: int) -> None:
        super().__init__(path)
        self._end = end

    def read(self, size: int | None = -1) -> bytes:
        """Read bytes before the end."""
        left = max(self._end - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left)) or b""


def _end_of_units(path: Path) -> int:
    """Return the offset at which the last unit's data end, by the headers (FITS 4.0, section 4.4.1)."""
    from astropy.io import fits

    end = 0
    with path.open("rb") as file:
        while _begins_header(path, end):
            file.seek(end)
            header = fits.Header.fromfile(file)
            axes = [int(header[f"NAXIS{axis}"]) for axis in range(1, int(header["NAXIS"]) + 1)]
            if axes and axes[0] == 0 and header.get("GROUPS"):
                axes = axes[1:]
            values = header.get("GCOUNT", 1) * (header.get("PCOUNT", 0) + math.prod(axes)) if axes else 0
            size = abs(int(header["BITPIX"])) // 8 * int(values)
            if size < 0:
                raise ValueError("a unit has a negative size")
            end = file.tell() + -(-size // _BLOCK) * _BLOCK
    return end


def _begins_header(path: Path, offset: int) -> bool:
    """Return whether a header of reasonable length begins at an offset."""
    with reading(path), path.open("rb", buffering=0) as file:
        file.seek(offset)
        for _ in range(_MOST_BLOCKS):
            block = file.read(_BLOCK)
            if _END in (block[at : at + len(_END)] for at in range(0, len(block), 80)):
                return True
            if len(block) < _BLOCK:
                return False
    return False


def _shape(path: Path, number: int, header: Any) -> tuple[int, ...]:
    """Return (rows, cols) or (frames, rows, cols) of an image unit that can hold raw frames."""
    where = f"unit {number}"
    axes, bits = int(header["NAXIS"]), header.get("BITPIX")
    shape = tuple(int(header[f"NAXIS{axis}"]) for axis in range(axes, 0, -1))
    if axes not in (2, 3) or min(shape) < 1:
        raise FileError(path, "shape", where=where, value=shape, expected="(rows, cols) or (frames, rows, cols)")
    if axes == 3 and shape[0] in (3, 4):
        problem = f"{shape[0]} planes are those of a color picture"
        raise FileError(path, problem, where=where, hint=f"Write {shape[0]} raw frames as one unit each")
    zero, scale = header.get("BZERO", 0), header.get("BSCALE", 1)
    if bits not in _ZEROS or scale != 1 or zero not in _ZEROS[bits]:
        found = f"BITPIX {bits}, BZERO {zero}, BSCALE {scale}"
        expected = "8, 16 or 32 bits with BZERO 0, 2^15 or 2^31 and BSCALE 1"
        raise FileError(path, "pixels", where=where, value=found, expected=expected)
    return shape


@dataclass(frozen=True)
class _Keywords:
    """The keywords of a unit, completed by those of the first unit."""

    path: Path
    own: Any
    first: Any

    def get(self, *names: str) -> Any:
        """Return the first keyword that exists, or None."""
        for header in (self.own, self.first):
            for name in names:
                if (value := header.get(name)) is not None:
                    return value
        return None

    def number(self, *names: str) -> float | None:
        value = self.get(*names)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise FileError(self.path, names[0], value=str(value), expected="a finite number")
        return float(value)

    def text(self, name: str) -> str | None:
        value = self.get(name)
        return value.strip() or None if isinstance(value, str) else None


def _header(path: Path, shape: tuple[int, ...], keywords: _Keywords) -> FrameHeader:
    image_type = keywords.text("IMAGETYP")
    kinds = kinds_in_name(image_type or "")
    size = shape[-2], shape[-1]
    light = _light(path, size, keywords)
    border = light.border(size)
    metadata = {
        "gain_setting": keywords.number("ISO", "ISOSPEED", "GAIN"),
        "temperature_c": keywords.number("CCD-TEMP", "SET-TEMP"),
        "camera": keywords.text("INSTRUME"),
        "kind": kinds.pop() if len(kinds) == 1 else None,
        "image_type": image_type,
    }
    return FrameHeader(
        *light.shape,
        int(keywords.own["BITPIX"]),
        cfa=_cfa(path, size[0], light, keywords),
        exposure_s=keywords.number("EXPTIME", "EXPOSURE"),
        metadata={name: value for name, value in metadata.items() if value is not None},
        border=border if any(border) else None,
        overscan=keywords.text("BIASSEC") is not None,
    )


def _light(path: Path, size: tuple[int, int], keywords: _Keywords) -> Section:
    """Return the lines with light (IRAF's ccdproc: TRIMSEC is kept, BIASSEC is overscan)."""
    found = (_section(path, size, keywords, name) for name in ("DATASEC", "TRIMSEC", "BIASSEC"))
    try:
        return section_with_light(size, *found)
    except InputError as error:
        raise error.in_file(path) from None


def _section(path: Path, size: tuple[int, int], keywords: _Keywords, name: str) -> Section | None:
    """Return a section of the stored image that a keyword states, or None."""
    text = keywords.text(name)
    if text is None:
        return None
    try:
        return parse_section(text, size)
    except InputError as error:
        raise FileError(path, name, value=text, expected=error.expected) from None


def _cfa(path: Path, rows: int, light: Section, keywords: _Keywords) -> Cfa | None:
    """Return the tile at the first pixel with light; BAYERPAT describes the upright picture."""
    pattern = keywords.text("BAYERPAT")
    if pattern is None:
        return None
    try:
        tile = cfa_from(pattern)
    except InputError as error:
        raise error.within("BAYERPAT").in_file(path) from None
    down, right = int(keywords.number("YBAYROFF") or 0), int(keywords.number("XBAYROFF") or 0)
    if (keywords.text("ROWORDER") or "").upper() == "BOTTOM-UP":  # the last stored row is the top one
        tile, down = tile[::-1], -down - rows % len(tile)
    return shifted(tile, down + light.top, right + light.left)
