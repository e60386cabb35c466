"""Amplifiers whose pixels lie side by side in one FITS image, with the overscan of each between them or at the borders.

- TSECyx, DSECyx, BSECyx, ASECyx: pixels without bad lines, all pixels, overscan and all of amplifier column x in row y,
  as of CTIO's Arcon and IRAF's quad, or with the number (Keck) or letter (CFHT) of the amplifier. AMPLIST names those
  that were read, filled up with 0. Where TSEC is the place in the trimmed image, it lies outside DSEC, and is not
  needed. DATASECA, BIASSECA and TRIMSECA are the same (DECam). TRIMSEC holds for all amplifiers where it has pixels of
  each.
- ESO DET OUTi: port X, Y on the chip, NX, NY pixels, PRSCX, OVSCX, PRSCY, OVSCY lines before and behind them as they
  are read, from the port inwards. Ports on the right are read from the right, and upper ones from above.

Pixels are in the place in which the chip has them: rows and columns between amplifiers are taken out, and nothing is
turned.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

from photosite.errors import InputError
from photosite.frames.sections import Section, parse_section


@dataclass(frozen=True)
class AmplifierSections:
    """An amplifier of an image: its pixels with light, their place in the joined image, and its overscan."""

    name: str
    source: Section
    target: Section
    overscan: Section | None


def numbered_amplifiers(header: Mapping[str, Any], size: tuple[int, int]) -> tuple[AmplifierSections, ...]:
    """Return the amplifiers of TSEC or DSEC, and BSEC of the same number or letter; none if fewer than two are stated.

    Raises
    ------
    InputError
        If a section is invalid, amplifiers of AMPLIST have none, or the pixels do not fill a rectangle.

    Examples
    --------
    >>> header = {"DSEC11": "[1:8,1:4]", "BSEC11": "[9:10,1:4]", "DSEC12": "[13:20,1:4]", "BSEC12": "[11:12,1:4]"}
    >>> [(each.name, str(each.target), str(each.overscan)) for each in numbered_amplifiers(header, (4, 20))]
    [('11', '[1:8,1:4]', '[9:10,1:4]'), ('12', '[9:16,1:4]', '[11:12,1:4]')]
    """
    listed = str(header.get("AMPLIST") or "").replace(",", " ").upper().split()
    stated = {named[1] for name in header if (named := _NUMBERED.fullmatch(name))}
    names = [name for name in listed if name.strip("0")] or sorted(stated, key=lambda name: (len(name), name))
    if len(names) < 2 or not stated:
        return ()

    def section(kind: str, name: str) -> Section | None:
        for keyword in (f"{kind}SEC{name}", f"{_LONG[kind]}SEC{name}"):
            text = header.get(keyword)
            if not isinstance(text, str) or not text.strip():
                continue
            try:
                return parse_section(text, size)
            except InputError as error:
                raise InputError(keyword, value=text, expected=error.expected) from None
        return None

    data = {name: section("D", name) for name in names}
    # The place in a trimmed image may begin anywhere; it says nothing about this image.
    trimmed = {name: section("T", name) for name in names if _within(header.get(f"TSEC{name}"), data[name], size)}
    chosen = trimmed if len(trimmed) == len(names) else data
    found: list[tuple[str, Section, Section | None]] = []
    for name in names:
        source, overscan = chosen[name], section("B", name)
        if source is None:
            expected = "the section of an amplifier that AMPLIST names"
            raise InputError(f"DSEC{name}", value=header.get(f"DSEC{name}"), expected=expected)
        if overscan is not None and overscan.overlap(source):
            raise InputError(f"BSEC{name}", value=str(overscan), expected=f"outside {source}, the pixels with light")
        found.append((name, Section(source.top, source.bottom, source.left, source.right), overscan))
    return _placed(_trimmed(found, header.get("TRIMSEC"), size))


_NUMBERED = re.compile(r"(?:[TD]SEC|DATASEC|TRIMSEC)(\d{1,2}|[A-H])")
_LONG = {"T": "TRIM", "D": "DATA", "B": "BIAS"}


def _trimmed(
    found: list[tuple[str, Section, Section | None]], trim: Any, size: tuple[int, int]
) -> list[tuple[str, Section, Section | None]]:
    """Return the amplifiers without the lines outside TRIMSEC, where it lies within them and has pixels of each."""
    sources = [source for _, source, _ in found]
    top, left = min(s.top for s in sources), min(s.left for s in sources)
    whole = Section(top, max(s.bottom for s in sources), left, max(s.right for s in sources))
    if not _within(trim, whole, size):
        return found
    result = []
    for name, source, overscan in found:
        if (part := source.overlap(parse_section(trim, size))) is None:
            return found
        if overscan is not None and overscan.top <= source.top and overscan.bottom >= source.bottom:
            overscan = Section(part.top, part.bottom, overscan.left, overscan.right)
        elif overscan is not None and overscan.left <= source.left and overscan.right >= source.right:
            overscan = Section(overscan.top, overscan.bottom, part.left, part.right)
        result.append((name, part, overscan))
    return result


def _within(text: Any, data: Section | None, size: tuple[int, int]) -> bool:
    """Return whether a section is one of the image, and within another."""
    try:
        found = parse_section(str(text), size)
    except InputError:
        return False
    return data is None or found.overlap(data) == Section(found.top, found.bottom, found.left, found.right)


def eso_amplifiers(number: Callable[[str], float | None], size: tuple[int, int]) -> tuple[AmplifierSections, ...]:
    """Return the amplifiers of ESO's DET OUTi; none for a single output, or outputs whose ports are not stated.

    `number` returns the number of a keyword, or None.

    Raises
    ------
    InputError
        If outputs with prescan or overscan do not fill the image.
    """
    count = int(number("ESO DET OUTPUTS") or 1)
    if not 2 <= count <= _MOST_OUTPUTS:
        return ()
    ports = [{key: int(number(f"ESO DET OUT{n} {key}") or 0) for key in _OF_OUTPUT} for n in range(1, count + 1)]
    scanned = any(port[name + axis] for port in ports for name, axis in product(("PRSC", "OVSC"), "XY"))
    lines: list[dict[int, _OutputLines] | None] = [
        _lines(ports, axis, length) for axis, length in zip("YX", size, strict=True)
    ]
    down, across = lines
    if down is None or across is None or len({(port["Y"], port["X"]) for port in ports}) < count:
        if not scanned:
            return ()
        what = "ESO DET OUT NX, NY, PRSC and OVSC"
        raise InputError(
            what, value=[tuple(port.values()) for port in ports], expected=f"sizes that add up to {size[1]} x {size[0]}"
        )
    found: list[tuple[str, Section, Section | None]] = []
    for n, port in enumerate(ports, 1):
        y, x = down[port["Y"]], across[port["X"]]
        source = Section(*y.light, *x.light)
        overscan = Section(*y.light, *x.dark) if x.dark else Section(*y.dark, *x.light) if y.dark else None
        found.append((f"OUT{n}", source, overscan))
    return _placed(found)


_MOST_OUTPUTS = 64
_OF_OUTPUT = ("X", "Y", "NX", "NY", "PRSCX", "OVSCX", "PRSCY", "OVSCY")


@dataclass(frozen=True)
class _OutputLines:
    """The rows or columns of an output: those with light, and those of the overscan, else of the prescan."""

    light: tuple[int, int]
    dark: tuple[int, int] | None


def _lines(ports: list[dict[str, int]], axis: str, length: int) -> dict[int, _OutputLines] | None:
    """Return the lines of each port on an axis; None if they do not fill it, or more than two ports lie on it."""
    found: dict[int, _OutputLines] = {}
    begin, places = 0, sorted({port[axis] for port in ports})
    for place in places:
        sizes = {tuple(port[name + axis] for name in ("PRSC", "N", "OVSC")) for port in ports if port[axis] == place}
        if len(sizes) > 1 or len(places) > 2 or min(next(iter(sizes))) < 0:
            return None
        (before, pixels, behind), mirrored = sizes.pop(), len(places) == 2 and place == places[1]
        first, last = (behind, before) if mirrored else (before, behind)
        low, light, high = begin, begin + first, begin + first + pixels
        begin = high + last
        after, ahead = ((low, light), (high, begin)) if mirrored else ((high, begin), (low, light))
        found[place] = _OutputLines((light, high), after if behind else ahead if before else None)
    return found if begin == length and min(line.light[1] - line.light[0] for line in found.values()) > 0 else None


def _placed(found: list[tuple[str, Section, Section | None]]) -> tuple[AmplifierSections, ...]:
    """Return amplifiers with the place of their pixels in the joined image, without what lies between them."""
    sources = [source for _, source, _ in found]
    rows, cols = (_joined({(s.top, s.bottom) for s in sources}), _joined({(s.left, s.right) for s in sources}))
    if (
        rows is None
        or cols is None
        or len(set(map(str, sources))) < len(sources)
        or len(rows) * len(cols) != len(found)
    ):
        expected = "rows and columns of amplifiers that fill a rectangle"
        raise InputError("pixels of the amplifiers", value=", ".join(map(str, sources)), expected=expected)
    return tuple(
        AmplifierSections(name, s, Section(*rows[s.top, s.bottom], *cols[s.left, s.right]), overscan)
        for name, s, overscan in found
    )


def _joined(ranges: set[tuple[int, int]]) -> dict[tuple[int, int], tuple[int, int]] | None:
    """Return where ranges of lines lie without what is between them; None if they overlap."""
    placed: dict[tuple[int, int], tuple[int, int]] = {}
    end, begin = 0, 0
    for first, last in sorted(ranges):
        if first < end:
            return None
        placed[first, last] = begin, begin + last - first
        begin, end = begin + last - first, last
    return placed
