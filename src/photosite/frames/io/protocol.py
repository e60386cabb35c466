"""Measurement protocols: a YAML file that states which frames were taken with which settings.

photosite_protocol: 1
name: Nikon D200, dark frames and flat fields
bits: 12                        # optional, if the files do not state it
cfa: rggb                       # likewise; a name or a tile
black_level_dn: 64              # likewise
region: 0:1080,0:1920           # pixels with light; rows, then columns, counted from 0; or "[1:1920,1:1080]"
layout: 3280x2464,packed=mipi10 # how headerless files store their pixels (photosite.frames.layout)
sensor: d200.sensor.yaml        # known properties of the sensor; path relative to the protocol
frames:
  - {kind: dark, exposure: 1/8000, files: dark/*.dng}
  - {kind: light, exposure: 0.04, files: [flat/a.dng, flat/b.dng], photons_per_pixel: 12000}
  - {kind: light, exposure: 1/60, files: iso400/*.dng, gain_setting: 400, temperature_c: 21.5}
  - {kind: dark, files: more/*.nef}     # exposures, gain settings and temperatures from the files' metadata
  - {kind: light, exposure: 1, files: r/*.fits, filter: R}   # or read_mode, binning, part, ... (frames/conditions.py)
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from photosite.errors import FileError, InputError
from photosite.files.writing import atomic_path
from photosite.files.yaml import check_keys, check_version, dump_yaml, line_of, optional_text, read_yaml
from photosite.frames.conditions import CONDITIONS, stated_conditions
from photosite.frames.frame_file import FrameFile, split_selection
from photosite.frames.frame_settings import FrameSettings
from photosite.frames.layout import Layout, parse_layout
from photosite.frames.sections import Section, parse_region
from photosite.values.cfa import NAMED, Cfa, cfa_from
from photosite.values.exposure import format_exposure, parse_exposure

VERSION_KEY = "photosite_protocol"

_KEYS = (VERSION_KEY, "name", "bits", "cfa", "black_level_dn", "region", "layout", "sensor", "frames")
_NUMBERS = ("photons_per_pixel", "gain_setting", "temperature_c")
_FRAME_KEYS = ("kind", "exposure", "files", *_NUMBERS, *CONDITIONS)
_WILDCARDS = frozenset("*?[")


@dataclass(frozen=True)
class ProtocolFrames:
    """Frames that were taken with the same settings.

    Parameters
    ----------
    files
        Paths and glob patterns relative to the protocol.
    settings
        The kind, and the settings that the protocol states; None for those in the files' metadata.
    line
        Line of the protocol, counted from 1.
    conditions
        Conditions that the protocol states, by the names of `photosite.frames.conditions.CONDITIONS`.
    """

    files: tuple[str, ...]
    settings: FrameSettings
    line: int | None = None
    conditions: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Protocol:
    """A measurement protocol.

    Parameters
    ----------
    frames
        Frames by settings.
    name
        Name of the measurement.
    bits, cfa, black_level_dn
        Properties of every frame, if the files do not state them, or None.
    sensor
        Path of a sensor file relative to the protocol, or None.
    region
        Part of the stored images that receives light, if the files do not state it, or None.
    layout
        How headerless files store their pixels, or None.
    """

    frames: tuple[ProtocolFrames, ...]
    name: str | None = None
    bits: int | None = None
    cfa: Cfa | None = None
    black_level_dn: float | None = None
    sensor: str | None = None
    region: Section | None = None
    layout: Layout | None = None

    def frame_files(self, path: Path) -> list[FrameFile]:
        """List the files of the protocol at `path`, with patterns expanded, in its order."""
        return [
            FrameFile(file, frames.settings, path, frames.line, conditions=frames.conditions, selection=selection)
            for frames in self.frames
            for pattern, selection in map(split_selection, frames.files)
            for file in matching_files(path, pattern, frames.line)
        ]


def write_protocol(protocol: Protocol, path: str | PathLike[str]) -> None:
    """Write a protocol; `read_protocol` returns the same one.

    Raises
    ------
    FileError
        If it cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> darks = ProtocolFrames(("dark/*.png",), FrameSettings("dark", 1 / 8000))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_protocol(Protocol((darks,), name="darks", bits=12), f"{folder}/protocol.yaml")
    ...     print(Path(folder, "protocol.yaml").read_text())
    photosite_protocol: 1
    name: darks
    bits: 12
    frames:
    - {kind: dark, exposure: 1/8000, files: dark/*.png}
    """
    content: dict[str, Any] = {VERSION_KEY: 1}
    for key in ("name", "bits", "cfa", "black_level_dn", "region", "layout", "sensor"):
        value = getattr(protocol, key)
        if key in ("region", "layout") and value is not None:
            value = str(value)
        if key == "cfa" and value is not None:
            value = next((name for name, tile in NAMED.items() if tile == value), value)
        if value is not None:
            content[key] = value
    content["frames"] = [_entry(frames) for frames in protocol.frames]
    with atomic_path(path) as temporary:
        temporary.write_text(dump_yaml(content, width=1 << 16), encoding="utf-8")


def _entry(frames: ProtocolFrames) -> dict[str, Any]:
    entry: dict[str, Any] = {"kind": frames.settings.kind}
    if (exposure_s := frames.settings.exposure_s) is not None:
        text = format_exposure(exposure_s)
        entry["exposure"] = text if "/" in text else exposure_s
    entry["files"] = frames.files[0] if len(frames.files) == 1 else frames.files
    numbers = {key: getattr(frames.settings, key) for key in _NUMBERS}
    return entry | {key: value for key, value in numbers.items() if value is not None} | dict(frames.conditions)


def read_protocol(path: str | PathLike[str]) -> Protocol:
    """Read a protocol. It is not checked that its frames exist."""
    file = Path(path)
    data = read_yaml(file, "a protocol")
    check_version(file, data, VERSION_KEY)
    check_keys(file, data, _KEYS, "a protocol")
    frames = data.get("frames")
    if not isinstance(frames, Sequence) or isinstance(frames, str) or not frames:
        raise FileError(file, "frames", line_of(data, "frames"), expected="a list of {kind, exposure, files}")
    black = data.get("black_level_dn")
    if black is not None and (
        isinstance(black, bool) or not isinstance(black, int | float) or not 0 <= black < math.inf
    ):
        line = line_of(data, "black_level_dn")
        raise FileError(file, "black_level_dn", line, value=black, expected="a finite number, 0 or above")
    return Protocol(
        tuple(_frames(file, number, entry, line_of(frames, number)) for number, entry in enumerate(frames)),
        name=optional_text(file, data, "name"),
        bits=_bits(file, data),
        cfa=_cfa(file, data),
        black_level_dn=None if black is None else float(black),
        sensor=optional_text(file, data, "sensor"),
        region=_parsed(file, data, "region", parse_region),
        layout=_parsed(file, data, "layout", parse_layout),
    )


def _frames(file: Path, number: int, entry: Any, line: int | None) -> ProtocolFrames:
    where = f"frames[{number}]"
    if not isinstance(entry, Mapping):
        raise FileError(file, where, line, value=entry, expected="{kind, exposure, files}")
    check_keys(file, entry, _FRAME_KEYS, where)
    for key in ("kind", "files"):
        if entry.get(key) is None:
            raise FileError(file, f"'{key}' is missing", line, where=where)
    patterns = [entry["files"]] if isinstance(entry["files"], str) else entry["files"]
    if not isinstance(patterns, Sequence) or not patterns or not all(isinstance(p, str) and p for p in patterns):
        at = line_of(entry, "files") or line
        raise FileError(file, "files", at, where=where, value=entry["files"], expected="a path, a pattern, or a list")
    try:
        stated = entry.get("exposure")
        exposure_s = stated if stated in (None, 0) else parse_exposure(stated)
        numbers = {name: entry.get(name) for name in _NUMBERS}
        settings = FrameSettings(entry["kind"], exposure_s, **numbers).validated()
    except InputError as error:
        key = "exposure" if error.what == "exposure_s" else error.what
        raise error.within(where).in_file(file, line_of(entry, key) or line) from None
    conditions = stated_conditions({name: entry[name] for name in CONDITIONS if name in entry})
    return ProtocolFrames(tuple(str(pattern) for pattern in patterns), settings, line, conditions)


def matching_files(path: Path, pattern: str, line: int | None) -> list[Path]:
    """Return the files that match a path or pattern relative to the protocol at `path`, without hidden files."""
    literal = path.parent / pattern
    if not _WILDCARDS & set(pattern) or os.path.isfile(literal):
        return [literal]
    relative = Path(pattern)
    base = Path(relative.anchor) if relative.is_absolute() else path.parent
    inside = str(relative.relative_to(relative.anchor)) if relative.is_absolute() else pattern
    # Names with a leading dot are files that are still being written, or notes of a file system.
    found = sorted(p for p in base.glob(inside) if p.is_file() and not p.name.startswith("."))
    if not found:
        raise FileError(path, f"no file matches '{pattern}' in {path.parent}", line)
    return found


def _bits(file: Path, data: Mapping[Any, Any]) -> int | None:
    bits = data.get("bits")
    if bits is not None and (isinstance(bits, bool) or not isinstance(bits, int) or not 1 <= bits <= 16):
        raise FileError(file, "bits", line_of(data, "bits"), value=bits, expected="a whole number from 1 to 16")
    return None if bits is None else int(bits)


def _cfa(file: Path, data: Mapping[Any, Any]) -> Cfa | None:
    if data.get("cfa") is None:
        return None
    try:
        return cfa_from(data["cfa"])
    except InputError as error:
        raise error.in_file(file, line_of(data, "cfa")) from None


T = TypeVar("T")


def _parsed(file: Path, data: Mapping[Any, Any], name: str, parse: Callable[[str], T]) -> T | None:
    if data.get(name) is None:
        return None
    try:
        return parse(str(optional_text(file, data, name)))
    except InputError as error:
        raise error.in_file(file, line_of(data, name)) from None
