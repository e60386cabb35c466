"""From a list of files with their settings to a frame set: what is checked before a pixel is read."""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from photosite.cfa import MONOCHROME, Cfa
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.frames.frame_set import FrameSet, FrameSource, Kind, ListedFrame, group_frames
from photosite.frames.header import FrameHeader, agreed_bits, agreed_cfa, stated_number
from photosite.frames.read import read_frame, read_header
from photosite.sensor.model import Sensor

Value = TypeVar("Value", bound=object)

STEADY_TEMPERATURE_C = 2.0
"""Range of the stated temperatures from which on a set is warned of: dark current then changes by a fifth."""


@dataclass(frozen=True)
class FileEntry:
    """A frame's file and the setting it was taken under.

    Parameters
    ----------
    path
        The file.
    kind, exposure_s, photons_per_pixel
        As in `FrameGroup`.
    gain_setting, temperature_c
        As in `ListedFrame`; None where the file's own word, if it has one, is to be taken.
    listed_in, line
        Where the file was listed, for messages; None where it was found in a folder.
    """

    path: Path
    kind: Kind
    exposure_s: float
    photons_per_pixel: float | None = None
    listed_in: Path | None = None
    line: int | None = None
    gain_setting: float | None = None
    temperature_c: float | None = None

    def error(self, message: str) -> FileError:
        """An error about the listing, with its line; about the file where nothing lists it."""
        if self.listed_in is None:
            return FileError(self.path, message)
        return FileError(self.listed_in, f"{self.path}: {message}", self.line)


@dataclass(frozen=True)
class Expected:
    """What a descriptor, a protocol or the caller says that all frames share; None where nothing is said."""

    bits: int | None = None
    cfa: Cfa | None = None
    shape: tuple[int, int] | None = None
    black_level_dn: float | None = None
    sensor: Sensor | None = None


def frame_set_of_files(entries: Sequence[FileEntry], source: str, expected: Expected) -> FrameSet:
    """A frame set whose frames are read when asked for. Headers are read here, pixels are not.

    Raises
    ------
    FileError
        If files are missing, listed twice, truncated, or differ in size, bits or mosaic from each other or from what is
        expected.
    """
    _check_all_there(entries)
    _check_none_twice(entries)
    headers = _decoded_where_needed(entries, [read_header(entry.path) for entry in entries])
    _warn_once(entries, headers)
    rows, cols = _common("size", entries, [(h.rows, h.cols) for h in headers], expected.shape)
    bits = _bits(entries, headers, expected)
    cfas = [agreed_cfa(entry.path, h, expected.cfa) for entry, h in zip(entries, headers, strict=True)]
    cfa = _common("colour filter array", entries, cfas, None)
    blacks = {h.black_level_dn for h in headers}
    sensor = expected.sensor
    if sensor is not None and cfa is None:
        cfa = sensor.array.cfa
    _check_sensor(source, sensor, bits, cfa or MONOCHROME)
    listed = [
        ListedFrame(
            entry.kind,
            entry.exposure_s,
            FrameSource(str(entry.path), partial(_read, entry.path, bits, cfa, (rows, cols)), thread_safe=True),
            entry.photons_per_pixel,
            stated_number(entry.path, header, "gain_setting", "iso")
            if entry.gain_setting is None
            else entry.gain_setting,
            stated_number(entry.path, header, "temperature_c") if entry.temperature_c is None else entry.temperature_c,
        )
        for entry, header in zip(entries, headers, strict=True)
    ]
    try:
        groups = group_frames(listed)
    except InputError as error:
        raise FileError(source, str(error)) from None
    stated = expected.black_level_dn
    if stated is None and len(blacks) == 1:
        (stated,) = blacks
    notes = _temperature_notes(listed)
    for note in notes:
        warnings.warn(f"{source}: {note}", PhotositeWarning, stacklevel=4)
    return FrameSet(groups, rows, cols, bits, cfa or MONOCHROME, source, sensor, stated, notes)


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
    if frame.shape != shape:
        raise FileError(path, f"is now {frame.shape}; it was {shape} when the frame set was opened")
    return frame.dn


def _check_all_there(entries: Sequence[FileEntry]) -> None:
    missing = [entry for entry in entries if not entry.path.is_file()]
    if not missing:
        return
    first = missing[0]
    folder = first.path.parent
    if not folder.is_dir():
        reason = f"there is no folder {folder}"
    elif first.path.is_dir():
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
            other = f"{entries[0].path} has {_shown(values[0])}"
            raise entry.error(f"has {what} {_shown(value)}, but {other}; all frames of a set have one {what}")
    return values[0]


def _decoded_where_needed(entries: Sequence[FileEntry], headers: list[FrameHeader]) -> list[FrameHeader]:
    """Camera raw tells bits and mosaic once it is decoded: the first frame's stand for all, which reading checks."""
    unknown = [n for n, header in enumerate(headers) if header.stored_bits is None and header.bits is None]
    if not unknown:
        return headers
    first, notes = read_frame(entries[unknown[0]].path)
    filled = list(headers)
    for n in unknown:
        filled[n] = replace(
            headers[n], bits=first.bits, cfa=first.cfa, black_level_dn=first.black_level_dn, notes=notes
        )
    return filled


def _warn_once(entries: Sequence[FileEntry], headers: Sequence[FrameHeader]) -> None:
    noted = [(entry, header) for entry, header in zip(entries, headers, strict=True) if header.notes]
    if noted:
        entry, header = noted[0]
        others = f" (and {len(noted) - 1} frames more)" if len(noted) > 1 else ""
        warnings.warn(f"{entry.path}: {'; '.join(header.notes)}{others}", PhotositeWarning, stacklevel=5)


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


def _check_sensor(source: str, sensor: Sensor | None, bits: int, cfa: Cfa) -> None:
    if sensor is None:
        return
    if sensor.readout.bits != bits:
        raise FileError(source, f"frames have {bits} bits, the sensor '{sensor.name}' {sensor.readout.bits}")
    if sensor.array.cfa != cfa:
        raise FileError(
            source, f"frames have the mosaic {_shown(cfa)}, the sensor '{sensor.name}' {_shown(sensor.array.cfa)}"
        )
