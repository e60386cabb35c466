"""Frames in FITS (version 4.0), also compressed by gzip or as tiles, read by astropy: the extra `fits`.

Every image unit is a frame, or a stack if it has three axes; units of one chip are joined, units of
others are its parts (`photosite.frames.io.fits_units`). Unsigned numbers are stored minus BZERO, 2^15 or 2^31, as FITS
requires. Keywords: EXPTIME or EXPOSURE (seconds), GAIN, ISO or ISOSPEED, CCD-TEMP or SET-TEMP (degrees Celsius),
IMAGETYP (words as in file names: "Dark Frame"), BAYERPAT with XBAYROFF, YBAYROFF and ROWORDER, and `_CONDITIONS`.
The frame is the common part of DATASEC and TRIMSEC without BIASSEC, or without ESO's prescan and overscan, or the
joined pixels of the amplifiers that the image states. Rows are in the order in which they are stored.
"""

from __future__ import annotations

import gzip
import io
import math
import re
import warnings
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import FileError, InputError, message_of
from photosite.files.small_files import reading
from photosite.frames.conditions import cooled
from photosite.frames.covered_lines import shifted_down
from photosite.frames.frame_file import FrameHeader, FrameLocation, describe_frame, parse_description
from photosite.frames.frame_settings import kinds_in_name
from photosite.frames.io.fits_units import (
    JoinedUnits,
    Keywords,
    Part,
    Unit,
    alone,
    are_parts,
    image_unit,
    image_units,
    joined_units,
)
from photosite.frames.raw_frame import RawFrame
from photosite.frames.sections import Section
from photosite.frames.stored_numbers import StoredNumbers
from photosite.values.cfa import Cfa, cfa_from, shifted
from photosite.values.region import Region

_BLOCK, _MOST_BLOCKS, _END = 2880, 1000, b"END     "
"""Bytes of a block, blocks of a header, its last keyword; astropy reads on until it finds that."""


_GZIP = b"\x1f\x8b"


def recognizes(path: Path, head: bytes) -> bool:
    """Return whether a file with these first bytes is FITS; one that gzip compressed is decompressed for that."""
    if not head.startswith(_GZIP):
        return True
    try:
        with gzip.open(path) as stream:
            return stream.read(9) == b"SIMPLE  ="
    except (OSError, EOFError, zlib.error):
        return False


def write(frame: RawFrame, path: Path) -> None:
    """Write the frame as FITS of 16 or 32 bits, unsigned by BZERO, with what it states in the usual keywords.

    EGAIN is that of the frame's noise profile, the mean of its channels. RDNOISE is the metadata read_noise_e: the dark
    noise of the profile also has DSNU and shot noise of the dark current. The keyword PHOTOSIT has photosite's
    description, which keeps all fields.
    """
    with _astropy(path):
        from astropy.io import fits

        unit = fits.PrimaryHDU(np.ascontiguousarray(frame.dn))
        for name, value, comment in _cards(frame):
            unit.header[name] = (value, comment)
        unit.header[_OWN] = describe_frame(frame)
        with path.open("wb") as file:
            unit.writeto(file)


_OWN = "PHOTOSIT"


def _cards(frame: RawFrame) -> Iterator[tuple[str, str | int | float, str]]:
    """Yield keyword, value and comment of what a frame states."""
    stated = frame.metadata
    yield "BUNIT", "adu", "unit of the pixels, DN"
    yield "DATAMIN", 0, "[adu]"
    yield "DATAMAX", (1 << frame.bits) - 1, "[adu] largest number of the converter"
    yield "SATURATE", frame.white_level_dn, "[adu] white level"
    yield "BLKLEVEL", frame.black_level_dn, "[adu] black level"
    if frame.exposure_s is not None:
        yield "EXPTIME", frame.exposure_s, "[s] exposure time"
    pattern = "".join("".join(row) for row in frame.cfa)
    if len(frame.cfa) == 2 and len(pattern) == 4 and set(pattern) <= set("RGB"):
        yield "BAYERPAT", pattern, "color filters at the first stored pixels"
        yield "XBAYROFF", 0, ""
        yield "YBAYROFF", 0, ""
        yield "ROWORDER", "TOP-DOWN", "the first stored row is the top one"
    if frame.noise_profile is not None:
        span = frame.white_level_dn - frame.black_level_dn
        yield "EGAIN", 1.0 / (float(np.asarray(frame.noise_profile)[:, 0].mean()) * span), "[electron/adu] gain"
    if isinstance(noise := stated.get("read_noise_e"), float):
        yield "RDNOISE", noise, "[electron] temporal read noise"
    names = {"gain_setting": "GAIN", "temperature_c": "CCD-TEMP", "camera": "INSTRUME", "kind": "IMAGETYP"}
    for name, keyword in names.items():
        value = stated.get(name)
        if isinstance(value, str):
            value = value.encode("ascii", "replace").decode()[:60]
        if value is not None:
            yield keyword, value if isinstance(value, str) else float(value), ""


def read_headers(path: Path) -> tuple[FrameHeader, ...]:
    """Read the headers of all frames in a FITS file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # astropy's; the relevant ones are errors below
        with _open_fits(path) as opened:
            size = math.inf if _is_gzip(path) else path.stat().st_size  # a short one is an error of `_open_fits`
            for number, unit in enumerate(opened):
                place = unit.fileinfo()
                if (end := place["datLoc"] + place["datSpan"]) > size:
                    problem = f"the file is truncated: unit {number} ends at byte {end}, the file at {size}"
                    raise FileError(path, problem)
            units = image_units(path, opened)
            images = joined_units(units)
            return tuple(header for image in images for header in _headers(image, units, images))


def _headers(image: JoinedUnits, units: list[Unit], images: list[JoinedUnits]) -> Iterator[FrameHeader]:
    """Yield the header of each frame of a stack."""
    first = image.units[0]
    header = _header(image)
    parts = {"part": image.name} if len(images) > 1 and are_parts(units) else {}
    single = len(images) == 1 and len(first.shape) == 2
    number = "+".join(str(unit.number) for unit in image.units)
    for index in range(first.shape[0] if len(first.shape) == 3 else 1):
        names = (number, f"{number},{index}", *((image.name,) if image.name else ()))
        label = "" if single else f"[{number}, {index}]"
        part = first.number if len(image.units) == 1 else number
        location = FrameLocation(label, part, index, names)
        yield replace(header, location=location, metadata={**header.metadata, **parts})


def read_pixels(
    path: Path, location: FrameLocation, levels: Sequence[float] | None = None, most: int | None = None
) -> StoredNumbers:
    """Read the (rows, cols) digital numbers of one frame.

    With the overscan levels of another frame, the numbers are shifted by whole numbers to its levels. Numbers at 0 and
    at the largest one, `most`, stay.
    """
    with _open_fits(path) as opened:
        image = _image(path, opened, location)
        parts: list[Any] = []
        for number, (part, dn) in enumerate(_stored_parts(image, opened, location.index)):
            shift = 0 if levels is None else round(_level(part.overscan, dn) - levels[number])
            parts.append(shifted_down(dn[part.source.slices], shift, most))
        if len(parts) == 1:
            single: StoredNumbers = np.ascontiguousarray(parts[0])
            return single
        out: Any = np.zeros(image.shape, np.result_type(*parts))
        for dn, target in zip(parts, (part.target for part in image.parts), strict=True):
            rows, cols = (slice(None, None, -1 if flip else None) for flip in target.flipped)
            out[target.slices] = dn[rows, cols]
        return out  # type: ignore[no-any-return]


def _stored_parts(image: JoinedUnits, opened: Any, index: int) -> Iterator[tuple[Part, StoredNumbers]]:
    """Yield each part of an image with all numbers of its unit, which are read once."""
    for _, same in groupby(image.parts, key=lambda part: part.unit.number):
        parts = list(same)
        dn = _stored_numbers(parts[0].unit, opened, index)
        for part in parts:
            yield part, dn


def _image(path: Path, opened: Any, location: FrameLocation) -> JoinedUnits:
    if isinstance(location.part, int):
        return alone(image_unit(path, opened, location.part))
    first = int(location.part.partition("+")[0])
    return next(image for image in joined_units(image_units(path, opened)) if image.units[0].number == first)


_LEAST_LINES = 5


def _level(overscan: Section | None, dn: StoredNumbers) -> float:
    """Return the level of the overscan; of five lines or more, the median of their means.

    The first lines after the pixels with light have charge that these left behind.
    """
    if overscan is None:
        return 0.0
    part = dn[overscan.slices].astype(np.float64)
    means = part.mean(axis=0 if overscan.shape[0] >= overscan.shape[1] else 1)
    return float(np.median(means) if len(means) >= _LEAST_LINES else means.mean())


def read_whole(path: Path, location: FrameLocation) -> StoredNumbers:
    """Read the digital numbers of a frame with those around the lines with light."""
    with _open_fits(path) as opened:
        return _stored_numbers(image_unit(path, opened, int(location.part)), opened, location.index)


def overscan_levels(path: Path, location: FrameLocation) -> tuple[float, ...]:
    """Return the level of the overscan of each part of a frame."""
    with _open_fits(path) as opened:
        image = _image(path, opened, location)
        return tuple(_level(part.overscan, dn) for part, dn in _stored_parts(image, opened, location.index))


def _stored_numbers(unit: Unit, opened: Any, index: int) -> StoredNumbers:
    """Read all numbers of a frame of a unit, with BZERO and BSCALE."""
    numbers, (zero, scale) = unit.numbers, unit.zero_and_scale  # reading the data can change the header
    image = opened[unit.number]
    stored = np.asarray(image.section[index] if len(unit.shape) == 3 else image.data)
    bits = 8 * stored.dtype.itemsize
    if numbers == "float":
        plain = (zero, scale) == (0, 1)
        floats: Any = stored.astype(stored.dtype.newbyteorder("=") if plain else np.float64)
        return floats if plain else floats * scale + zero  # type: ignore[no-any-return]
    dn: Any = stored.astype(np.int64 if bits >= 32 else np.int32) + int(zero)
    if numbers == "signed":
        return dn  # type: ignore[no-any-return]
    return np.ascontiguousarray(dn, np.uint32) if bits == 32 else np.ascontiguousarray(dn, np.uint16)


@contextmanager
def _astropy(path: Path) -> Iterator[None]:
    try:
        yield
    except ImportError:
        hint = "Run pip install '.[fits]' in the clone"
        raise FileError(path, "FITS needs astropy, which is missing", hint=hint) from None


@contextmanager
def _open_fits(path: Path) -> Iterator[Any]:
    with _astropy(path):
        from astropy.io import fits
    try:
        with reading(path), _open_stream(path) as file:
            if not _begins_header(file, 0):
                raise FileError(path, "the FITS header has no end", hint="Check that the file is complete")
        options = {"mode": "readonly", "memmap": False, "do_not_scale_image_data": True}
        with _open_units(path, _end_of_units(path)) as content, fits.open(content, **options) as units:
            yield units
    except FileError:
        raise
    # Damaged files make astropy raise OSError, ValueError, TypeError, KeyError, VerifyError ...
    except Exception as error:
        raise FileError(
            path, f"the file cannot be read as FITS ({message_of(error)})", hint="It may be truncated"
        ) from None


def _is_gzip(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_GZIP)) == _GZIP


def _open_stream(path: Path) -> io.BufferedIOBase:
    return gzip.open(path) if _is_gzip(path) else path.open("rb")


def _open_units(path: Path, end: int) -> io.RawIOBase | io.BufferedIOBase:
    """Open a file up to the end of its last unit: astropy reads on, and takes what follows for headers."""
    if not _is_gzip(path):
        return _Beginning(path, end)
    with gzip.open(path) as stream:
        content = stream.read(end)
    if len(content) < end:
        raise FileError(path, f"the file is truncated: it holds {len(content)} of {end} bytes")
    return io.BytesIO(content)


class _Beginning(io.FileIO):
    """A file that ends earlier."""

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
    with _open_stream(path) as file:
        while _begins_header(file, end):
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


def _begins_header(file: io.BufferedIOBase, offset: int) -> bool:
    """Return whether a header of reasonable length begins at an offset."""
    file.seek(offset)
    for _ in range(_MOST_BLOCKS):
        block = file.read(_BLOCK)
        if _END in (block[at : at + len(_END)] for at in range(0, len(block), 80)):
            return True
        if len(block) < _BLOCK:
            return False
    return False


_CONDITIONS = {
    "camera": ("INSTRUME", "CAMERA"),
    "serial_number": ("SERIALNO", "CAMSN", "CAMERAID", "CAMID", "DETSERNO"),
    "read_mode": ("READOUTM", "READMODE"),
    "offset_setting": ("OFFSET", "BLKLEVEL"),
    "set_temperature_c": ("SET-TEMP", "SETTEMP"),
    "filter": ("FILTER", "FILTERS", "FILTNAME"),
}
"""Keywords of the conditions by which settings differ; each program has its own."""


def _header(image: JoinedUnits) -> FrameHeader:
    unit = image.units[0]
    keywords = unit.keywords
    stored_bits = 16 if unit.numbers == "float" else min(int(keywords.own["BITPIX"]), 32)
    if (own := parse_description(keywords.path, keywords.text(_OWN) or "", *image.shape, stored_bits)) is not None:
        return own
    image_type = next(filter(None, map(keywords.text, _IMAGE_TYPES)), None)
    kinds = kinds_in_name(_SYNONYMS.sub("dark", image_type or ""))
    joined = len(image.parts) > 1
    border = unit.light.border(unit.size)
    gains = {each.keywords.number("ISO", "ISOSPEED", "GAIN") for each in image.units}
    metadata = {
        "gain_setting": gains.pop() if len(gains) == 1 else None,
        "temperature_c": keywords.number("CCD-TEMP", "SET-TEMP"),
        "kind": kinds.pop() if len(kinds) == 1 else None,
        "image_type": image_type,
        "binning": _binning(keywords),
        "subframe": _subframe(unit.size, keywords),
        "date_time": keywords.text("DATE-OBS"),
        **{name: keywords.plain(*names) for name, names in _CONDITIONS.items()},
    }
    if keywords.get("CCD-TEMP") is None and not cooled(metadata["set_temperature_c"]):
        del metadata["temperature_c"]
    return FrameHeader(
        *image.shape,
        stored_bits,
        numbers=unit.numbers,
        cfa=None if joined else _cfa(unit),
        exposure_s=keywords.number("EXPTIME", "EXPOSURE"),
        metadata={name: value for name, value in metadata.items() if value is not None},
        border=border if any(border) and not joined else None,
        overscan=all(part.overscan is not None for part in image.parts),
        problem=None if joined else unit.problem,
        amplifiers=_amplifiers(image) if joined else (),
    )


_IMAGE_TYPES = ("IMAGETYP", "OBSTYPE", "ESO DPR TYPE", "FRAME")
"""Keywords of the kind of a frame: most cameras; NOIRLab, Las Cumbres; ESO; SBIG."""
_SYNONYMS = re.compile(r"\bzero\b|dark[ _-]flats?|flat[ _-]darks?", re.IGNORECASE)
"""IRAF calls a bias frame zero; dark frames of the exposure time of flat fields are dark flats."""


def _amplifiers(image: JoinedUnits) -> tuple[Region, ...]:
    """Return the place of each amplifier in the image, by its name, or by the number of its unit."""
    names = [part.name for part in image.parts]
    if len(set(names)) < len(names):
        names = [part.unit.number for part in image.parts]
    places = [part.target for part in image.parts]
    return tuple(
        Region(str(name).strip(), place.top, place.bottom, place.left, place.right)
        for name, place in zip(names, places, strict=True)
    )


def _binning(keywords: Keywords) -> str | None:
    """Return columns x rows of XBINNING and YBINNING, or of IRAF's CCDSUM."""
    stated = (keywords.text("CCDSUM") or "").split()
    numbers = stated if len(stated) == 2 else [keywords.plain("XBINNING"), keywords.plain("YBINNING")]
    return (
        None
        if None in numbers
        else "x".join(f"{number:g}" if isinstance(number, float) else str(number) for number in numbers)
    )


def _subframe(size: tuple[int, int], keywords: Keywords) -> str | None:
    """Return the columns and rows of the image with their first ones, XORGSUBF and YORGSUBF."""
    first = keywords.plain("XORGSUBF"), keywords.plain("YORGSUBF")
    return None if None in first else f"{size[1]}x{size[0]}+{first[0]}+{first[1]}"


def _cfa(unit: Unit) -> Cfa | None:
    """Return the tile at the first pixel with light; BAYERPAT describes the upright picture."""
    keywords, light = unit.keywords, unit.light
    pattern = keywords.text("BAYERPAT")
    if pattern is None:
        return None
    try:
        tile = cfa_from(pattern)
    except InputError as error:
        raise error.within("BAYERPAT").in_file(keywords.path) from None
    down, right = int(keywords.number("YBAYROFF") or 0), int(keywords.number("XBAYROFF") or 0)
    if (keywords.text("ROWORDER") or "").upper() == "BOTTOM-UP":  # the last stored row is the top one
        tile, down = tile[::-1], -down - unit.size[0] % len(tile)
    return shifted(tile, down + light.top, right + light.left)
