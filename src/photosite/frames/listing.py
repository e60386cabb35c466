"""From a list of files with their settings to a frame set: what is checked before a pixel is read."""

from __future__ import annotations

import difflib
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.frames.by_level import Candidate, told_by_level
from photosite.frames.frame_set import KINDS, FrameSet, FrameSource, Kind, ListedFrame, group_frames
from photosite.frames.io.header import FrameHeader, Place, agreed_bits, agreed_cfa, stated_number
from photosite.frames.io.read import read_frame, read_headers, read_pixels
from photosite.frames.levels import border_note
from photosite.frames.names import NamedSettings, settings_in_names
from photosite.sensor.model import Sensor
from photosite.values.cfa import MONOCHROME, Cfa

Value = TypeVar("Value", bound=object)

EXPOSURE_EXAMPLE = (
    "say it in a protocol.yaml: 'photosite_protocol: 1', then 'frames:' with "
    "'- {kind: dark, exposure: 1/100, files: dark*.png}' and so on"
)

STEADY_TEMPERATURE_C = 2.0
"""Range of the stated temperatures from which on a set is warned of: dark current then changes by a fifth."""


@dataclass(frozen=True)
class FileEntry:
    """A frame's file, and what is said of the setting it was taken under.

    Parameters
    ----------
    path
        The file; one of several frames stands for all of them until `place` says which.
    kind, exposure_s, photons_per_pixel, gain_setting, temperature_c
        As in `ListedFrame`. None where the file's own word is to be taken, or that of the names.
    listed_in, line
        Where the file was listed, for messages; None where it was found in a folder.
    names
        What may be read as `photosite.frames.names` has it, the nearest first: the file's name, its folder's. Empty
        where somebody listed the file.
    place
        Which frame of the file.
    """

    path: Path
    kind: Kind | None
    exposure_s: float | None
    photons_per_pixel: float | None = None
    listed_in: Path | None = None
    line: int | None = None
    gain_setting: float | None = None
    temperature_c: float | None = None
    names: tuple[str, ...] = ()
    place: Place | None = None

    @property
    def name(self) -> str:
        """What to call the frame: its file, and which frame of it."""
        return f"{self.path}{self.place.label}" if self.place else str(self.path)

    def error(self, message: str) -> FileError:
        """An error about the listing, with its line; about the file where nothing lists it."""
        if self.listed_in is None:
            return FileError(self.name, message)
        return FileError(self.listed_in, f"{self.name}: {message}", self.line)


@dataclass(frozen=True)
class Expected:
    """What a descriptor, a protocol or the caller says that all frames share; None where nothing is said."""

    bits: int | None = None
    cfa: Cfa | None = None
    shape: tuple[int, int] | None = None
    black_level_dn: float | None = None
    sensor: Sensor | None = None


def frame_set_of_files(entries: Sequence[FileEntry], source: str, expected: Expected) -> FrameSet:
    """A frame set whose frames are read when asked for. Headers are read here; pixels only where these do not suffice.

    Raises
    ------
    FileError
        If files are missing, listed twice, truncated, or differ in size, bits or mosaic from each other or from what is
        expected.
    """
    _check_all_there(entries)
    _check_none_twice(entries)
    frames, headers = _settled(entries)
    headers, border_notes = _decoded_where_needed(frames, headers)
    _warn_once(frames, headers)
    rows, cols = _common("size", frames, [(h.rows, h.cols) for h in headers], expected.shape)
    bits = _bits(frames, headers, expected)
    cfas = [agreed_cfa(entry.path, h, expected.cfa) for entry, h in zip(frames, headers, strict=True)]
    cfa = _common("colour filter array", frames, cfas, None)
    sensor = expected.sensor
    if sensor is not None and cfa is None:
        cfa = sensor.array.cfa
    _check_sensor(source, sensor, bits, cfa or MONOCHROME)
    sources = [_source(entry, bits, cfa, (rows, cols)) for entry in frames]
    candidates = [Candidate(s, e.gain_setting, e.kind) for s, e in zip(sources, frames, strict=True)]
    kinds, level_notes = told_by_level(candidates, bits)
    listed = [
        ListedFrame(kind, e.exposure_s or 0.0, s, e.photons_per_pixel, e.gain_setting, e.temperature_c)
        for kind, e, s in zip(kinds, frames, sources, strict=True)
    ]
    try:
        groups = group_frames(listed)
    except InputError as error:
        raise FileError(source, str(error)) from None
    notes = (*level_notes, *_exposure_notes(entries, frames, headers), *_temperature_notes(listed), *border_notes)
    for note in notes:
        warnings.warn(f"{source}: {note}", PhotositeWarning, stacklevel=3)
    return FrameSet(
        groups,
        rows,
        cols,
        bits,
        cfa or MONOCHROME,
        source,
        sensor,
        _shared([h.black_level_dn for h in headers]) if expected.black_level_dn is None else expected.black_level_dn,
        (*notes, *_bits_notes(headers, expected)),  # Said with what comes of the frames: it need not matter.
        _shared([h.white_level_dn for h in headers]),
    )


def _shared(values: Sequence[float | None]) -> float | None:
    """The value that all state, or None."""
    return values[0] if len(set(values)) == 1 else None


def _settled(entries: Sequence[FileEntry]) -> tuple[list[FileEntry], list[FrameHeader]]:
    """An entry for each frame of the files, its gaps filled by the files' own words and by names; and the headers."""
    frames: list[FileEntry] = []
    headers: list[FrameHeader] = []
    for entry in entries:
        for header in read_headers(entry.path):
            frames.append(_filled(replace(entry, place=header.place), header))
            headers.append(header)
    return frames, headers


def _filled(entry: FileEntry, header: FrameHeader) -> FileEntry:
    path, inside = Path(entry.name), entry.place.part if entry.place else ""
    parts = inside.split("/")[::-1] if isinstance(inside, str) else []
    named = settings_in_names(path, (*parts, *entry.names)) if entry.names else NamedSettings()
    exposure_s = _first(entry.exposure_s, header.exposure_s, named.exposure_s)
    if exposure_s is None:
        raise entry.error(f"does not state its exposure{', nor does its name' * bool(entry.names)}; {EXPOSURE_EXAMPLE}")
    return replace(
        entry,
        kind=entry.kind or _stated_kind(entry, header) or named.kind,
        exposure_s=exposure_s,
        photons_per_pixel=_first(
            entry.photons_per_pixel, stated_number(path, header, "photons_per_pixel") if entry.names else None
        ),
        gain_setting=_first(entry.gain_setting, stated_number(path, header, "gain_setting", "iso"), named.gain_setting),
        temperature_c=_first(entry.temperature_c, stated_number(path, header, "temperature_c"), named.temperature_c),
    )


def _first(*values: float | None) -> float | None:
    return next((value for value in values if value is not None), None)


def _stated_kind(entry: FileEntry, header: FrameHeader) -> Kind | None:
    stated = header.metadata.get("kind")
    if stated is None:
        return None
    for kind in KINDS:
        if stated == kind:
            return kind
    raise entry.error(f"states the kind {stated!r}; a frame is dark or light")


def _source(entry: FileEntry, bits: int, cfa: Cfa | None, shape: tuple[int, int]) -> FrameSource:
    if entry.place is None:
        read = partial(_read, entry.path, bits, cfa, shape)
    else:
        read = partial(_read_place, entry.path, entry.place, bits, shape)
    return FrameSource(entry.name, read, thread_safe=True)


def _exposure_notes(
    entries: Sequence[FileEntry], frames: Sequence[FileEntry], headers: Sequence[FrameHeader]
) -> tuple[str, ...]:
    """A line where the exposure taken is not the one that the file states."""
    other = [
        (entry, header.exposure_s)
        for entry, header in zip(frames, headers, strict=True)
        if header.exposure_s and entry.exposure_s and not 1 / 1.2 < entry.exposure_s / header.exposure_s < 1.2
    ]
    if not other:
        return ()
    entry, stated = other[0]
    return (
        f"{len(other)} files state another exposure than the one listed, {entry.name} for one {stated:g} s for "
        f"{entry.exposure_s:g} s; what is listed was taken, so check its unit",
    )


def _temperature_notes(listed: Sequence[ListedFrame]) -> tuple[str, ...]:
    stated = [frame.temperature_c for frame in listed if frame.temperature_c is not None]
    if not stated or max(stated) - min(stated) <= STEADY_TEMPERATURE_C:
        return ()
    return (
        f"the sensor's temperature went from {min(stated):g} to {max(stated):g} degrees Celsius; dark current doubles "
        f"about every 7, so what is said of it holds for a mean of them",
    )


def _read(path: Path, bits: int, cfa: Cfa | None, shape: tuple[int, int]) -> NDArray[np.uint16]:
    frame, _ = read_frame(path, bits, cfa)
    return _as_before(str(path), frame.dn, shape)


def _read_place(path: Path, place: Place, bits: int, shape: tuple[int, int]) -> NDArray[np.uint16]:
    dn = _as_before(f"{path}{place.label}", read_pixels(path, place), shape)
    if bits < 16 and (highest := int(dn.max())) >= 1 << bits:
        raise FileError(f"{path}{place.label}", f"holds {highest} DN, which {bits} bits cannot; correct the bits")
    return dn


def _as_before(name: str, dn: NDArray[np.uint16], shape: tuple[int, int]) -> NDArray[np.uint16]:
    if dn.shape != shape:
        raise FileError(name, f"is now {dn.shape}; it was {shape} when the frame set was opened")
    return dn


def _check_all_there(entries: Sequence[FileEntry]) -> None:
    # os.path says no to names that no file can have; pathlib lets their errors through.
    missing = [entry for entry in entries if not os.path.isfile(entry.path)]
    if not missing:
        return
    first = missing[0]
    folder = first.path.parent
    if not os.path.isdir(folder):
        reason = f"there is no folder {folder}"
    elif os.path.isdir(first.path):
        reason = "is a folder, not a frame"
    else:
        close = difflib.get_close_matches(first.path.name, [p.name for p in folder.iterdir()], n=1, cutoff=0.8)
        same = [p.name for p in folder.iterdir() if p.name.lower() == first.path.name.lower()]
        there = same or close
        reason = "there is no such file" + (f" (there is a '{there[0]}')" if there else "")
    others = f"; {len(missing) - 1} more of {len(entries)} are missing" if len(missing) > 1 else ""
    raise first.error(reason + others)


def _check_none_twice(entries: Sequence[FileEntry]) -> None:
    """A frame counted twice makes noise look smaller than it is."""
    first: dict[Path, FileEntry] = {}
    for entry in entries:
        before = first.setdefault(entry.path.resolve(), entry)
        if before is not entry:
            place = f"line {before.line}" if before.line is not None else str(before.path)
            raise entry.error(f"is listed twice, first at {place}; a repeated frame would hide noise, so remove one")


def _common(what: str, entries: Sequence[FileEntry], values: Sequence[Value], expected: Value | None) -> Value:
    """The value that all frames share."""
    for entry, value in zip(entries, values, strict=True):
        if expected is not None and value != expected:
            raise entry.error(f"has {what} {_shown(value)}, where {_shown(expected)} is said")
        if value != values[0]:
            other = f"{entries[0].name} has {_shown(values[0])}"
            raise entry.error(f"has {what} {_shown(value)}, but {other}; all frames of a set have one {what}")
    return values[0]


def _decoded_where_needed(
    entries: Sequence[FileEntry], headers: list[FrameHeader]
) -> tuple[list[FrameHeader], tuple[str, ...]]:
    """Headers filled with what shows once a frame is decoded, and what its masked border shows.

    Camera raw tells bits and mosaic then, and a masked border its level: one frame, the first dark one if there is one,
    stands for all. Reading checks bits and mosaic of the others.
    """
    unknown = [n for n, header in enumerate(headers) if header.stored_bits is None and header.bits is None]
    masked = [n for n, header in enumerate(headers) if header.masked_border]
    if not unknown and not masked:
        return headers, ()
    one = next((n for n in unknown or masked if entries[n].kind == "dark"), (unknown or masked)[0])
    frame, notes = read_frame(entries[one].path)
    filled = list(headers)
    for n in unknown:
        filled[n] = replace(
            headers[n],
            bits=frame.bits,
            cfa=frame.cfa,
            black_level_dn=frame.black_level_dn,
            white_level_dn=frame.white_level_dn,
            notes=notes,
        )
    for n in masked:
        if headers[n].black_level_dn is None:
            filled[n] = replace(headers[n], black_level_dn=frame.black_level_dn)
    # What a camera leaves out of the visible area need not be masked; in the dark that does not matter.
    border = border_note(frame) if not unknown or entries[one].kind == "dark" else ()
    return filled, tuple(f"{entries[one].name}: {note}" for note in border)


def _warn_once(entries: Sequence[FileEntry], headers: Sequence[FrameHeader]) -> None:
    noted = [(entry, header) for entry, header in zip(entries, headers, strict=True) if header.notes]
    if noted:
        entry, header = noted[0]
        others = f" (and {len(noted) - 1} frames more)" if len(noted) > 1 else ""
        warnings.warn(f"{entry.name}: {'; '.join(header.notes)}{others}", PhotositeWarning, stacklevel=4)


def _shown(value: Any) -> str:
    match value:
        case None:
            return "none stated"
        case (int(), int()):
            return f"{value[0]} x {value[1]}"
        case (tuple(), *_):
            return "/".join("".join(map(str, row)) for row in value)
    return str(value)


def _bits(entries: Sequence[FileEntry], headers: Sequence[FrameHeader], expected: Expected) -> int:
    said = expected.bits
    if said is None and expected.sensor is not None and all(header.bits is None for header in headers):
        said = expected.sensor.readout.bits
    return _common("bits", entries, [agreed_bits(e.path, h, said) for e, h in zip(entries, headers, strict=True)], None)


def _bits_notes(headers: Sequence[FrameHeader], expected: Expected) -> tuple[str, ...]:
    """A line where nobody says the converter's bits and files have room for more than most converters have."""
    assumed = [header.stored_bits for header in headers if header.bits is None]
    if not assumed or assumed[0] is None or assumed[0] <= 8 or expected.bits is not None or expected.sensor is not None:
        return ()
    return (
        f"no bits are stated: those that the files store were assumed, {assumed[0]}, with the top at "
        f"{(1 << assumed[0]) - 1} DN; if the converter has fewer, state them: saturation depends on it",
    )


def _check_sensor(source: str, sensor: Sensor | None, bits: int, cfa: Cfa) -> None:
    if sensor is None:
        return
    if sensor.readout.bits != bits:
        raise FileError(source, f"frames have {bits} bits, the sensor '{sensor.name}' {sensor.readout.bits}")
    if sensor.array.cfa != cfa:
        raise FileError(
            source, f"frames have the mosaic {_shown(cfa)}, the sensor '{sensor.name}' {_shown(sensor.array.cfa)}"
        )
