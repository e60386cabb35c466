"""Measurement protocols: a YAML file that says which frames were taken how.

photosite_protocol: 1
name: Nikon D200, darks and flats
bits: 12                        # where the files do not say
cfa: rggb                       # likewise; a name or a tile
black_level_dn: 64              # likewise
sensor: d200.sensor.yaml        # what is known beforehand; relative to the protocol
frames:
  - {kind: dark, exposure: 1/8000, files: dark/*.dng}
  - {kind: light, exposure: 0.04, files: [flat/a.dng, flat/b.dng], photons_per_pixel: 12000}
  - {kind: light, exposure: 1/60, files: iso400/*.dng, gain_setting: 400, temperature_c: 21.5}
  - {kind: dark, files: more/*.nef}     # exposures, gain settings and temperatures as the files state them
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.errors import FileError, InputError
from photosite.files.atomic import atomic_path
from photosite.files.yaml import check_keys, line_of, optional_text, read_yaml
from photosite.frames.frame_set import ABSOLUTE_ZERO_C, KINDS, Kind
from photosite.frames.listing import FileEntry
from photosite.values.cfa import NAMED, Cfa, cfa_from
from photosite.values.exposure import format_exposure, parse_exposure

VERSION_KEY = "photosite_protocol"

_KEYS = (VERSION_KEY, "name", "bits", "cfa", "black_level_dn", "sensor", "frames")
_SETTINGS = ("photons_per_pixel", "gain_setting", "temperature_c")
_FRAME_KEYS = ("kind", "exposure", "files", *_SETTINGS)
_GLOB = frozenset("*?[")


@dataclass(frozen=True)
class ProtocolFrames:
    """Frames that were taken under one setting.

    Parameters
    ----------
    kind
        "dark" or "light".
    exposure_s
        Exposure time, or None: what the files say.
    files
        Paths and glob patterns relative to the protocol.
    photons_per_pixel
        Mean photons that fell on a pixel, or None.
    line
        Where the protocol says so, counted from 1.
    gain_setting
        The camera's gain as it was set (ISO, or in any unit, the same throughout), or None: what the files say.
    temperature_c
        Temperature of the sensor in degrees Celsius, or None: what the files say.
    """

    kind: Kind
    exposure_s: float | None
    files: tuple[str, ...]
    photons_per_pixel: float | None = None
    line: int | None = None
    gain_setting: float | None = None
    temperature_c: float | None = None


@dataclass(frozen=True)
class Protocol:
    """A measurement protocol.

    Parameters
    ----------
    frames
        What was taken.
    name
        What the measurement is called.
    bits, cfa, black_level_dn
        Of every frame, where the files do not say; None where the protocol does not either.
    sensor
        Path of a sensor file relative to the protocol, or None.
    """

    frames: tuple[ProtocolFrames, ...]
    name: str | None = None
    bits: int | None = None
    cfa: Cfa | None = None
    black_level_dn: float | None = None
    sensor: str | None = None


def write_protocol(protocol: Protocol, path: str | PathLike[str]) -> None:
    """Write a protocol, whole or not at all; `read_protocol` gives the same one back.

    Raises
    ------
    FileError
        If it cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> protocol = Protocol((ProtocolFrames("dark", 1 / 8000, ("dark/*.png",)),), name="darks", bits=12)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_protocol(protocol, f"{folder}/protocol.yaml")
    ...     print(Path(folder, "protocol.yaml").read_text())
    photosite_protocol: 1
    name: darks
    bits: 12
    frames:
    - {kind: dark, exposure: 1/8000, files: dark/*.png}
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    def in_flow(node: CommentedMap | CommentedSeq) -> CommentedMap | CommentedSeq:
        node.fa.set_flow_style()
        return node

    content: dict[str, Any] = {VERSION_KEY: 1}
    for key in ("name", "bits"):
        if getattr(protocol, key) is not None:
            content[key] = getattr(protocol, key)
    if protocol.cfa is not None:
        named = [name for name, tile in NAMED.items() if tile == protocol.cfa]
        content["cfa"] = named[0] if named else in_flow(CommentedSeq([list(row) for row in protocol.cfa]))
    for key in ("black_level_dn", "sensor"):
        if getattr(protocol, key) is not None:
            content[key] = getattr(protocol, key)
    content["frames"] = []
    for frames in protocol.frames:
        entry = CommentedMap(kind=frames.kind)
        if frames.exposure_s is not None:
            text = format_exposure(frames.exposure_s)
            entry["exposure"] = text if "/" in text else frames.exposure_s
        entry["files"] = frames.files[0] if len(frames.files) == 1 else in_flow(CommentedSeq(frames.files))
        for key in _SETTINGS:
            if getattr(frames, key) is not None:
                entry[key] = getattr(frames, key)
        content["frames"].append(in_flow(entry))
    yaml = YAML()
    yaml.width = 1 << 16
    out = io.StringIO()
    yaml.dump(content, out)
    with atomic_path(path) as temporary:
        temporary.write_text(out.getvalue(), encoding="utf-8")


def read_protocol(path: str | PathLike[str]) -> Protocol:
    """A protocol from its file. The frames' files are not looked for.

    Raises
    ------
    FileError
        If the file cannot be read, is not YAML, or does not describe a protocol; with the line.
    """
    file = Path(path)
    data = read_yaml(file, "a protocol")
    if not isinstance(data, Mapping) or data.get(VERSION_KEY) != 1:
        said = data.get(VERSION_KEY) if isinstance(data, Mapping) else None
        message = f"expected '{VERSION_KEY}: 1' (the file format's version), got {said!r}"
        raise FileError(file, message, line_of(data, VERSION_KEY))
    check_keys(file, data, _KEYS, "a protocol")
    frames = data.get("frames")
    if not isinstance(frames, Sequence) or isinstance(frames, str) or not frames:
        raise FileError(file, "'frames' is a list of {kind, exposure, files}", line_of(data, "frames"))
    return Protocol(
        tuple(_frames(file, entry, line_of(frames, number)) for number, entry in enumerate(frames)),
        name=optional_text(file, data, "name"),
        bits=stated_bits(file, data),
        cfa=stated_cfa(file, data),
        black_level_dn=_not_negative(file, data, "black_level_dn", line_of(data, "black_level_dn")),
        sensor=optional_text(file, data, "sensor"),
    )


def file_entries(protocol: Protocol, path: Path) -> list[FileEntry]:
    """The protocol's files, patterns resolved, in its order.

    Raises
    ------
    FileError
        If a pattern matches no file; with the line.
    """
    entries = []
    for frames in protocol.frames:
        for pattern in frames.files:
            for found in matching_files(path, pattern, frames.line):
                entries.append(
                    FileEntry(
                        found,
                        frames.kind,
                        frames.exposure_s,
                        frames.photons_per_pixel,
                        path,
                        frames.line,
                        frames.gain_setting,
                        frames.temperature_c,
                    )
                )
    return entries


def matching_files(path: Path, pattern: str, line: int | None) -> list[Path]:
    """The files that a path or pattern stands for, relative to the protocol at `path`; hidden ones left out.

    Raises
    ------
    FileError
        If a pattern matches none; with the line.
    """
    literal = path.parent / pattern
    if not _GLOB & set(pattern) or os.path.isfile(literal):
        return [literal]
    relative = Path(pattern)
    base = Path(relative.anchor) if relative.is_absolute() else path.parent
    inside = str(relative.relative_to(relative.anchor)) if relative.is_absolute() else pattern
    # A name with a dot in front is hidden: a file still being written, a file system's own note.
    found = sorted(p for p in base.glob(inside) if p.is_file() and not p.name.startswith("."))
    if not found:
        raise FileError(path, f"no file matches '{pattern}' in {path.parent}", line)
    return found


def _frames(file: Path, entry: Any, line: int | None) -> ProtocolFrames:
    if not isinstance(entry, Mapping):
        raise FileError(file, f"an entry of 'frames' is {{kind, exposure, files}}, not {entry!r}", line)
    check_keys(file, entry, _FRAME_KEYS, "an entry of 'frames'")
    for key in ("kind", "files"):
        if entry.get(key) is None:
            raise FileError(file, f"an entry of 'frames' lacks '{key}'", line)
    kind = entry["kind"]
    if kind not in KINDS:
        raise FileError(file, f"'kind' is {' or '.join(KINDS)}, not '{kind}'", line_of(entry, "kind") or line)
    exposure_s = _exposure_s(file, entry, line)
    files = entry["files"]
    patterns = [files] if isinstance(files, str) else files
    if (
        not isinstance(patterns, Sequence)
        or not patterns
        or not all(isinstance(pattern, str) and pattern for pattern in patterns)
    ):
        raise FileError(file, f"'files' is a path, a pattern or a list of them, not {files!r}", line_of(entry, "files"))
    return ProtocolFrames(
        kind,
        exposure_s,
        tuple(str(pattern) for pattern in patterns),
        _not_negative(file, entry, "photons_per_pixel", line_of(entry, "photons_per_pixel") or line),
        line,
        _not_negative(file, entry, "gain_setting", line_of(entry, "gain_setting") or line),
        _number(file, entry, "temperature_c", line_of(entry, "temperature_c") or line, ABSOLUTE_ZERO_C),
    )


def _exposure_s(file: Path, entry: Mapping[Any, Any], line: int | None) -> float | None:
    exposure = entry.get("exposure")
    if exposure is None:
        return None
    try:
        if isinstance(exposure, bool) or not isinstance(exposure, str | int | float):
            raise InputError(f"an exposure time is seconds, such as 0.005 or 1/8000, not {exposure!r}")
        return parse_exposure(exposure)
    except InputError as error:
        raise FileError(file, str(error), line_of(entry, "exposure") or line) from None


def _not_negative(file: Path, data: Mapping[Any, Any], key: str, line: int | None) -> float | None:
    return _number(file, data, key, line, 0.0)


def _number(file: Path, data: Mapping[Any, Any], key: str, line: int | None, lowest: float) -> float | None:
    value = data.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not lowest <= value < math.inf:
        raise FileError(file, f"'{key}' is a number, {lowest:g} or above, not {value!r}", line)
    return float(value)


def stated_bits(file: Path, data: Mapping[Any, Any]) -> int | None:
    """The bits that a protocol states, or None; `FileError` with the line where they cannot be."""
    bits = data.get("bits")
    if bits is not None and (isinstance(bits, bool) or not isinstance(bits, int) or not 1 <= bits <= 16):
        raise FileError(file, f"'bits' is a whole number from 1 to 16, not {bits!r}", line_of(data, "bits"))
    return None if bits is None else int(bits)


def stated_cfa(file: Path, data: Mapping[Any, Any]) -> Cfa | None:
    """The colour filter array that a protocol states, or None; `FileError` with the line where it cannot be."""
    if data.get("cfa") is None:
        return None
    try:
        return cfa_from(data["cfa"])
    except (InputError, TypeError) as error:
        raise FileError(file, f"'cfa': {error}", line_of(data, "cfa")) from None
