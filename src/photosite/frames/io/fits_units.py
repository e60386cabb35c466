"""Image units of a FITS file: their keywords, which ones join to the image of a chip, and which are parts of a camera.

Observatories write a unit for each amplifier or chip (NOIRLab's and NOAO's conventions). DETSEC, or CCDSEC of a chip
with a name, is the place of a unit's DATASEC on the detector, in pixels before the binning of CCDSUM. Units whose
places fill a rectangle are the image of one chip, whose amplifiers are readout channels. Other units with a name or
gain of their own are parts, each a setting by itself; units without are repeated frames.

One image may hold several amplifiers with overscan between them. Its own keywords name the pixels of each, TSECyx or
DSECyx, and the overscan, BSECyx, with the row and column of the amplifier or its number (IRAF's quad and CTIO, Apache
Point, Keck), or ESO's DET OUTi states the sizes (`photosite.frames.io.fits_amplifiers`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

from photosite.errors import FileError, InputError
from photosite.frames.io.fits_amplifiers import AmplifierSections, eso_amplifiers, numbered_amplifiers
from photosite.frames.sections import Section, parse_section, section_with_light
from photosite.frames.stored_numbers import NumberKind

_UNSIGNED_ZERO = {8: 0, 16: 1 << 15, 32: 1 << 31}
"""BZERO of unsigned numbers by their bits (FITS 4.0, section 5.2.5)."""

_NO_FRAMES = {"ERR", "DQ", "WHT", "VAR", "UNCERT", "MASK", "CTX", "SAMP", "TIME"}
"""Names of units with uncertainties, flags and weights (Hubble Space Telescope, ccdproc)."""

_CHIP = ("CCDNAME", "CCDNUM", "CCDID", "CCDCHIP", "CHIPID", "DETNAME")
_OF_PARTS = (*_CHIP, "AMPNAME", "AMPID", "AMPSEC", "DETSEC", "CCDSEC", "GAIN", "EGAIN", "RDNOISE")
"""Keywords that differ between the parts of a camera, and not between frames of one."""

_PART_NAME = re.compile(
    r"(?:amp|ccd|chip|det|quad|q|im|channel|chan|ch|ext|tile|sensor|port|tap|seg|segment|s|[a-d])[ _-]?\d*", re.I
)
"""Names of units that are parts: AMP1, im3, CCD_2, B."""


@dataclass(frozen=True)
class Keywords:
    """The keywords of a unit, completed by those of the first unit."""

    path: Path
    own: Any
    first: Any

    def get(self, *names: str) -> Any:
        """Return the first keyword that exists, or None."""
        for header in (self.own,) if self.own is self.first else (self.own, self.first):
            for name in names:
                if (value := header.get(name)) is not None:
                    return value
        return None

    def number(self, *names: str) -> float | None:
        """Return the number of a keyword, or None."""
        value = self.get(*names)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise FileError(self.path, names[0], value=str(value), expected="a finite number")
        return float(value)

    def text(self, name: str) -> str | None:
        """Return the text of a keyword, or None."""
        value = self.get(name)
        return value.strip() or None if isinstance(value, str) else None

    def plain(self, *names: str) -> str | int | float | None:
        """Return the text or number of a keyword, or None."""
        value = self.get(*names)
        if isinstance(value, str):
            return value.strip() or None
        return value if isinstance(value, int | float) and math.isfinite(value) else None

    def section(self, name: str, size: tuple[int, int]) -> Section | None:
        """Return the section of the stored image that a keyword states, or None."""
        text = self.text(name)
        if text is None:
            return None
        try:
            return parse_section(text, size)
        except InputError as error:
            raise FileError(self.path, name, value=text, expected=error.expected) from None


@dataclass(frozen=True)
class Unit:
    """An image unit: its number, (rows, cols) or (frames, rows, cols), and its keywords."""

    number: int
    shape: tuple[int, ...]
    keywords: Keywords

    @property
    def size(self) -> tuple[int, int]:
        """(rows, cols) of the stored image."""
        return self.shape[-2], self.shape[-1]

    @property
    def zero_and_scale(self) -> tuple[float, float]:
        """BZERO and BSCALE."""
        header = self.keywords.own
        return header.get("BZERO", 0), header.get("BSCALE", 1)

    @property
    def numbers(self) -> NumberKind:
        """How the numbers are stored."""
        bits, (zero, scale) = self.keywords.own["BITPIX"], self.zero_and_scale
        if bits < 0 or scale != 1 or zero != int(zero):
            return "float"
        return "unsigned" if zero == _UNSIGNED_ZERO.get(bits) else "signed"

    @property
    def name(self) -> str:
        """EXTNAME, with EXTVER where it is not 1."""
        name, version = self.keywords.own.get("EXTNAME"), self.keywords.own.get("EXTVER", 1)
        return f"{name.strip()}{'' if version == 1 else f',{version}'}" if isinstance(name, str) else ""

    @property
    def light(self) -> Section:
        """The lines with light (IRAF's ccdproc: TRIMSEC is kept, BIASSEC is overscan); all if `problem` is an error."""
        return self._sections[0]

    @property
    def overscan(self) -> Section | None:
        """The overscan of BIASSEC, or of ESO's keywords."""
        return self._sections[1]

    @property
    def problem(self) -> FileError | None:
        """Why the stated sections are not those of the image."""
        return self._sections[2]

    @property
    def amplifiers(self) -> tuple[AmplifierSections, ...]:
        """The amplifiers of which the image holds the pixels, if it states several."""
        return self._amplifiers[0]

    @cached_property
    def _amplifiers(self) -> tuple[tuple[AmplifierSections, ...], FileError | None]:
        try:
            found = numbered_amplifiers(self.keywords.own, self.size) or eso_amplifiers(self.keywords.number, self.size)
        except FileError as error:
            return (), error
        except InputError as error:
            return (), error.in_file(self.keywords.path)
        return found, None

    @cached_property
    def _sections(self) -> tuple[Section, Section | None, FileError | None]:
        whole = Section(0, self.size[0], 0, self.size[1])
        if (problem := self._amplifiers[1]) is not None:
            return whole, None, problem
        try:
            data, trim, bias = (self.keywords.section(name, self.size) for name in ("DATASEC", "TRIMSEC", "BIASSEC"))
            if data is None and trim is None and bias is None:
                data, bias = self._eso_sections()
            return section_with_light(self.size, data, trim, bias), bias, None
        except FileError as error:
            return whole, None, error
        except InputError as error:
            return whole, None, error.in_file(self.keywords.path)

    def _eso_sections(self) -> tuple[Section | None, Section | None]:
        """Return the lines with light and the overscan of ESO's DET OUT1; prescan where there is no overscan."""
        keywords = self.keywords
        before, after = (
            [int(keywords.number(f"ESO DET OUT1 {name}{axis}") or 0) for axis in "YX"] for name in ("PRSC", "OVSC")
        )
        if not any((*before, *after)):
            return None, None
        (rows, cols), (top, left), (bottom, right) = self.size, before, after
        if top + bottom >= rows or left + right >= cols:
            expected = f"less than {cols} columns and {rows} rows"
            raise FileError(keywords.path, "ESO DET OUT1 PRSC and OVSC", value=(*before, *after), expected=expected)
        light = Section(top, rows - bottom, left, cols - right)
        if right or left:
            beside = (cols - right, cols) if right else (0, left)
            return light, Section(light.top, light.bottom, *beside)
        return light, Section(*((rows - bottom, rows) if bottom else (0, top)), light.left, light.right)


@dataclass(frozen=True)
class Part:
    """What an amplifier, or a unit, contributes to an image: its pixels with light, and where these belong."""

    unit: Unit
    source: Section
    target: Section
    overscan: Section | None
    name: str | int


@dataclass(frozen=True)
class JoinedUnits:
    """The image of one chip: its parts."""

    parts: tuple[Part, ...]
    name: str

    @property
    def units(self) -> tuple[Unit, ...]:
        """The units of the parts, each once."""
        return tuple({part.unit.number: part.unit for part in self.parts}.values())

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of the image."""
        return max(part.target.bottom for part in self.parts), max(part.target.right for part in self.parts)


def image_units(path: Path, opened: Any) -> list[Unit]:
    """Return the image units that hold frames."""
    found = [
        image_unit(path, opened, number)
        for number, unit in enumerate(opened)
        if unit.is_image and unit.header.get("NAXIS") and not _is_no_frame(unit.header)
    ]
    if not found:
        raise FileError(path, "the FITS file holds no image")
    return found


def image_unit(path: Path, opened: Any, number: int) -> Unit:
    """Return an image unit, by its number."""
    header = opened[number].header
    return Unit(number, _shape(path, number, header), Keywords(path, header, opened[0].header))


def _is_no_frame(header: Any) -> bool:
    name = header.get("EXTNAME")
    return isinstance(name, str) and name.strip().upper() in _NO_FRAMES


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
    if bits not in (8, 16, 32, 64, -32, -64):
        raise FileError(path, "BITPIX", where=where, value=bits, expected="8, 16, 32, 64, -32 or -64")
    return shape


def are_parts(units: Sequence[Unit]) -> bool:
    """Return whether units are parts of a camera, such as amplifiers, and not repeated frames."""
    if len(units) < 2:
        return False
    if len({unit.size for unit in units}) > 1:
        return True
    for name in _OF_PARTS:
        values = [unit.keywords.own.get(name) for unit in units]
        if None not in values and len(set(values)) > 1:
            return True
    names = [unit.name for unit in units]
    return len(set(names)) == len(names) and all(map(_PART_NAME.fullmatch, names))


def joined_units(units: list[Unit]) -> list[JoinedUnits]:
    """Return the images of chips: units that fill a rectangle of the detector are joined, others stay as they are."""
    images = []
    for name, same in _by_chip(units).items():
        joined = _joined(same, name)
        images += [joined] if joined else [alone(unit) for unit in same]
    return images


def alone(unit: Unit) -> JoinedUnits:
    """Return the image of one unit, joined from its amplifiers if it states several."""
    name, light = unit.name or str(unit.number), unit.light
    if unit.amplifiers:
        return JoinedUnits(tuple(Part(unit, a.source, a.target, a.overscan, a.name) for a in unit.amplifiers), name)
    whole = Section(0, light.shape[0], 0, light.shape[1])
    return JoinedUnits((Part(unit, light, whole, unit.overscan, name),), name)


def _by_chip(units: list[Unit]) -> dict[str, list[Unit]]:
    """Return the units by the name of their chip, where all state one."""
    for keyword in _CHIP:
        names = [unit.keywords.own.get(keyword) for unit in units]
        if None not in names and len(set(names)) < len(names):
            chips: dict[str, list[Unit]] = {}
            for name, unit in zip(names, units, strict=True):
                chips.setdefault(str(name).strip(), []).append(unit)
            return chips
    return {"": units}


def _joined(units: list[Unit], name: str) -> JoinedUnits | None:
    """Return the image that units fill without gap and overlap, or None."""
    if len(units) < 2 or len({unit.shape[:-2] for unit in units}) > 1:
        return None
    for keyword in ("DETSEC", "CCDSEC"):
        places = [_placed(unit, keyword) for unit in units]
        if None in places:
            continue
        sources, targets = zip(*(place for place in places if place is not None), strict=True)
        top, left = min(part.top for part in targets), min(part.left for part in targets)
        bottom, right = max(part.bottom for part in targets), max(part.right for part in targets)
        area = sum(math.prod(part.shape) for part in targets)
        if area == (bottom - top) * (right - left) and not any(a.overlap(b) for a, b in combinations(targets, 2)):
            moved = [Section(p.top - top, p.bottom - top, p.left - left, p.right - left, p.flipped) for p in targets]
            parts = zip(units, sources, moved, strict=True)
            return JoinedUnits(
                tuple(Part(u, source, target, u.overscan, _amplifier_name(u)) for u, source, target in parts), name
            )
    return None


def _amplifier_name(unit: Unit) -> str | int:
    return unit.keywords.own.get("AMPNAME") or unit.name or unit.number


def _placed(unit: Unit, keyword: str) -> tuple[Section, Section] | None:
    """Return the part of a unit with light, and its place on the detector in pixels of the image, or None."""
    text = unit.keywords.own.get(keyword)
    if not isinstance(text, str):
        return None
    try:
        place = parse_section(text)
    except InputError as error:
        raise FileError(unit.keywords.path, keyword, value=text, expected=error.expected) from None
    stated = (unit.keywords.text("CCDSUM") or "").split()
    columns, rows = map(int, stated) if len(stated) == 2 and all(map(str.isdecimal, stated)) else (1, 1)
    parts = [unit.keywords.section(name, unit.size) for name in ("TRIMSEC", "DATASEC")]
    for binning in {(rows, columns): None, (1, 1): None}:  # binned pixels are counted by some programs
        for source in (*parts, Section(0, unit.size[0], 0, unit.size[1])):
            if source is not None and (target := _binned(place, binning, source.shape)) is not None:
                light = unit.light if source.shape == unit.size else source
                return light, _part_of(target, source, light)
    return None


def _binned(place: Section, binning: tuple[int, int], shape: tuple[int, int]) -> Section | None:
    """Return the place of (rows, cols) binned pixels, or None if it is larger or smaller.

    A chip may have pixels that fill no bin: 2048 columns are 682 bins of 3 and 2 columns more.
    """
    begin = []
    for first, length, step, count in zip((place.top, place.left), place.shape, binning, shape, strict=True):
        if abs(count - length / step) >= 1.0:
            return None
        begin.append(first // step if count * step <= length else -(-first // step))
    return Section(begin[0], begin[0] + shape[0], begin[1], begin[1] + shape[1], place.flipped)


def _part_of(target: Section, source: Section, light: Section) -> Section:
    """Return the place of the pixels with light, which are all or some of those of `source`."""
    upside_down, mirrored = target.flipped
    top = target.top + (source.bottom - light.bottom if upside_down else light.top - source.top)
    left = target.left + (source.right - light.right if mirrored else light.left - source.left)
    return Section(top, top + light.shape[0], left, left + light.shape[1], target.flipped)
