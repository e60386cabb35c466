"""Frames in FITS (version 4.0), read by astropy, which is asked for only here: `pip install 'photosite[fits]'`.

Every image unit of 8 or 16 bits is a frame, or a stack where it has three axes. Numbers above 32767 are stored as FITS
has them, less BZERO = 32768. Read are EXPTIME or EXPOSURE (seconds), GAIN, ISO or ISOSPEED, CCD-TEMP (degrees Celsius),
IMAGETYP (words as in file names: "Dark Frame", "Flat Field"), BAYERPAT with XBAYROFF and YBAYROFF. Rows are in the
order in which they are stored.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.frames.io.header import FrameHeader, Place
from photosite.frames.names import kinds_named
from photosite.values.cfa import Cfa, cfa_from, shifted

SIGNATURE = b"SIMPLE  ="
SUFFIXES = frozenset({".fits", ".fit", ".fts"})

_UNSIGNED_ZERO = 32768


def read_fits_headers(path: Path) -> tuple[FrameHeader, ...]:
    """What a FITS file says of its frames, unit after unit.

    Raises
    ------
    FileError
        If it is truncated, holds no images of 8 or 16 bits, a keyword says what cannot be, or astropy is not there.
    """
    found: list[tuple[int, tuple[int, ...], FrameHeader]] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # astropy's: what matters of them is an error below
        with _opened(path) as units:
            size = path.stat().st_size
            for number, unit in enumerate(units):
                place = unit.fileinfo()
                if (end := place["datLoc"] + place["datSpan"]) > size:
                    raise FileError(path, f"is truncated: unit {number} ends at byte {end}, the file at {size}")
                if unit.is_image and unit.header.get("NAXIS"):
                    shape = _checked_shape(path, number, unit.header)
                    found.append((number, shape, _header(path, shape, _Keywords(path, unit.header, units[0].header))))
    if not found:
        raise FileError(path, "is FITS without an image")
    alone = len(found) == 1 and len(found[0][1]) == 2
    return tuple(
        replace(header, place=Place("" if alone else f"[{number}, {index}]", number, index))
        for number, shape, header in found
        for index in range(shape[0] if len(shape) == 3 else 1)
    )


def read_fits_pixels(path: Path, place: Place) -> NDArray[np.uint16]:
    """The (rows, cols) numbers of one frame.

    Raises
    ------
    FileError
        If they cannot be read, or some are below 0.
    """
    with _opened(path) as units:
        unit = units[place.part]
        zero = int(unit.header.get("BZERO", 0))  # before the data are asked for, which may change the header
        stored = np.asarray(unit.section[place.index] if unit.header["NAXIS"] == 3 else unit.data)
        dn = stored.astype(np.int32) + zero
    if dn.min() < 0:
        raise FileError(path, f"holds {int(dn.min())}; the numbers of a raw frame are 0 or above")
    return np.ascontiguousarray(dn, dtype=np.uint16)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        from astropy.io import fits
    except ImportError:
        raise FileError(path, "is FITS, read with astropy, which is missing: pip install 'photosite[fits]'") from None
    try:
        with fits.open(path, mode="readonly", memmap=False, do_not_scale_image_data=True) as units:
            yield units
    except FileError:
        raise
    # astropy hands on what it stumbles over: OSError, ValueError, TypeError, KeyError, VerifyError ...
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileError(path, f"cannot be read as FITS ({reason}); is it truncated?") from None


def _checked_shape(path: Path, number: int, header: Any) -> tuple[int, ...]:
    """(rows, cols) or (frames, rows, cols) of an image unit that can hold raw frames."""
    axes, bits = int(header["NAXIS"]), header.get("BITPIX")
    shape = tuple(int(header[f"NAXIS{axis}"]) for axis in range(axes, 0, -1))
    if axes not in (2, 3) or min(shape) < 1:
        raise FileError(path, f"unit {number} is {shape}; a frame is (rows, cols), a stack (frames, rows, cols)")
    if axes == 3 and shape[0] in (3, 4):
        planes = f"unit {number} has {shape[0]} planes, as a picture in colour has"
        raise FileError(path, f"{planes}; write {shape[0]} raw frames as a unit each")
    zero, scale = header.get("BZERO", 0), header.get("BSCALE", 1)
    if bits not in (8, 16) or scale != 1 or zero not in ((0,) if bits == 8 else (0, _UNSIGNED_ZERO)):
        kind = f"BITPIX {bits}, BZERO {zero}, BSCALE {scale}"
        raise FileError(path, f"unit {number} has {kind}; raw frames are 8 or 16 bits with BZERO 0 or {_UNSIGNED_ZERO}")
    return shape


@dataclass(frozen=True)
class _Keywords:
    """A unit's keywords, and the first unit's for what it lacks."""

    path: Path
    own: Any
    first: Any

    def get(self, *names: str) -> Any:
        """The first of these that is there, or None."""
        for header in (self.own, self.first):
            for name in names:
                if (value := header.get(name)) is not None:
                    return value
        return None

    def number(self, *names: str) -> float | None:
        """As `get`, a number."""
        value = self.get(*names)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise FileError(self.path, f"says {names[0]} = {str(value)!r}, which is no number")
        return float(value)

    def text(self, name: str) -> str | None:
        """As `get`, in words."""
        value = self.get(name)
        return value.strip() or None if isinstance(value, str) else None


def _header(path: Path, shape: tuple[int, ...], keywords: _Keywords) -> FrameHeader:
    image_type = keywords.text("IMAGETYP")
    kinds = kinds_named(image_type or "")
    metadata = {
        "gain_setting": keywords.number("ISO", "ISOSPEED", "GAIN"),
        "temperature_c": keywords.number("CCD-TEMP"),
        "camera": keywords.text("INSTRUME"),
        "kind": kinds.pop() if len(kinds) == 1 else None,
        "image_type": image_type,
    }
    return FrameHeader(
        shape[-2],
        shape[-1],
        int(keywords.own["BITPIX"]),
        cfa=_cfa(path, keywords),
        exposure_s=keywords.number("EXPTIME", "EXPOSURE"),
        metadata=MappingProxyType({name: value for name, value in metadata.items() if value is not None}),
    )


def _cfa(path: Path, keywords: _Keywords) -> Cfa | None:
    pattern = keywords.text("BAYERPAT")
    if pattern is None:
        return None
    try:
        tile = cfa_from(pattern)
    except InputError as error:
        raise FileError(path, f"says BAYERPAT = '{pattern}': {error}") from None
    return shifted(tile, int(keywords.number("YBAYROFF") or 0), int(keywords.number("XBAYROFF") or 0))
