"""EMVA 1288 descriptor files: the list of the frames of a measurement.

A text file with one command per line: `v version`, `n bits width height`, `b exposure_ns photons` and `d exposure_ns`
begin a series of light and dark frames, `i path` names a frame of the series, `#` starts a comment. Paths are relative
to the descriptor and use backslashes. The format is that of the EMVA 1288 reference data and implementation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path, PureWindowsPath
from typing import Literal

from photosite.errors import FileError, InputError
from photosite.files.small_files import read_small
from photosite.files.writing import atomic_folder
from photosite.frames.frame_file import FrameFile, SetProperties
from photosite.frames.frame_set import FrameSet, gain_settings_text
from photosite.frames.frame_settings import FrameSettings, Kind
from photosite.frames.raw_frame import RawFrame

DESCRIPTOR_NAME = "EMVA1288_Data.txt"

EMVA_FRAMES_LOSS = "not in a descriptor: color filter array, black level, gain setting, temperature and the sensor file"

_NS_PER_S = 1e9
_LARGEST_BYTES = 1 << 24
_FORMS = {
    form[0]: form for form in ("v version", "n bits width height", "b exposure_ns photons", "d exposure_ns", "i path")
}


def looks_like_descriptor(path: Path) -> bool:
    """Return whether the file's first command is a descriptor's `v` or `n`."""
    try:
        with path.open("rb") as file:
            for line in file.read(65536).removeprefix(b"\xef\xbb\xbf").splitlines():
                words = line.split()
                if words and not words[0].startswith(b"#"):
                    return words[0].lower() in (b"v", b"n")
    except OSError:
        return False
    return False


def read_descriptor(path: Path) -> tuple[list[FrameFile], SetProperties]:
    """Return the frames of a descriptor, and their bit depth and size. It is not checked that the frames exist."""
    size: tuple[int, int, int] | None = None
    files: list[FrameFile] = []
    settings: FrameSettings | None = None
    series_line, series_frames = 0, 1
    for number, command, rest in (*_commands(path), (0, "end", "")):
        if command in ("b", "d", "end"):
            if series_frames == 0:
                raise FileError(path, "the series has no frames", series_line, hint="Write 'i path' after it")
            series_line, series_frames = number, 0
        match command:
            case "n":
                if size is not None:
                    raise FileError(path, "there is a second line 'n bits width height'", number, hint="Remove one")
                size = _size(path, number, rest)
            case "b":
                exposure_ns, photons = _numbers(path, number, "b", rest, 2)
                settings = _settings(path, number, "light", exposure_ns, photons)
            case "d":
                (exposure_ns,) = _numbers(path, number, "d", rest, 1)
                settings = _settings(path, number, "dark", exposure_ns, 0.0)
            case "i":
                if settings is None:
                    raise FileError(path, "the frame comes before any 'b' or 'd' line", number)
                relative = Path(rest) if rest.startswith("/") else Path(*PureWindowsPath(rest).parts)
                files.append(FrameFile(path.parent / relative, settings, path, number))
                series_frames += 1
    if size is None:
        raise FileError(path, "the line 'n bits width height' is missing")
    if not files:
        raise FileError(path, "there are no frames", hint="Write 'b' and 'd' lines with 'i path' lines after them")
    bits, cols, rows = size
    return files, SetProperties(bits, shape=(rows, cols))


def _commands(path: Path) -> Iterator[tuple[int, str, str]]:
    """Yield line number, command and its arguments."""
    content = read_small(path, "an EMVA 1288 descriptor", _LARGEST_BYTES)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")  # mostly an author's name in a comment
    for number, line in enumerate(text.splitlines(), start=1):
        if not (line := line.strip()) or line.startswith("#"):
            continue
        command, _, rest = line.replace("\t", " ").partition(" ")
        command, rest = command.lower(), rest.strip()
        if command not in _FORMS:
            raise FileError(path, "the command", number, value=command, expected=f"one of {', '.join(_FORMS)}")
        if not rest:
            raise FileError(path, "the line", number, value=line, expected=f"'{_FORMS[command]}'")
        yield number, command, rest


def _size(path: Path, number: int, rest: str) -> tuple[int, int, int]:
    bits, cols, rows = _numbers(path, number, "n", rest, 3)
    if not (bits.is_integer() and cols.is_integer() and rows.is_integer()) or rows < 1 or cols < 1:
        raise FileError(path, "bits, width and height", number, value=rest, expected="whole numbers above 0")
    if not 1 <= bits <= 16:
        raise FileError(path, "bits", number, value=int(bits), expected="1 to 16")
    return int(bits), int(cols), int(rows)


def _settings(path: Path, number: int, kind: Kind, exposure_ns: float, photons: float) -> FrameSettings:
    try:
        # Division rounds once: 125000 ns is the same number as 1/8000 s.
        return FrameSettings(kind, exposure_ns / _NS_PER_S, photons).validated()
    except InputError as error:
        raise error.in_file(path, number) from None


def _numbers(path: Path, number: int, command: str, rest: str, count: int) -> list[float]:
    try:
        values = [float(word.replace(",", ".")) for word in rest.split()]  # some cameras' tools write decimal commas
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise FileError(path, "the line", number, value=f"{command} {rest}", expected=f"'{_FORMS[command]}'")
    return values


def write_descriptor(
    frames: FrameSet,
    folder: str | PathLike[str],
    *,
    suffix: Literal[".png", ".tif"] = ".png",
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a measurement as an EMVA 1288 descriptor with 16-bit frames.

    Parameters
    ----------
    frames
        The measurement, with one gain setting; its light frames must state their photons per pixel.
    folder
        A folder that does not exist or is empty; it receives EMVA1288_Data.txt and images/.
    suffix
        Format of the frames.
    progress
        Called with (frames written, frames to write).

    Returns
    -------
    Path
        The descriptor.

    Raises
    ------
    InputError
        If a light group does not state its photons, or there are several gain settings.
    FileError
        If the folder cannot be written, or a frame cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from photosite.frames.frame_set import FrameSet
    >>> dark = np.full((2, 3), 64, np.uint16)
    >>> frames = FrameSet.from_arrays([("dark", 0.1, dark, 0.0), ("light", 0.1, 2 * dark, 500.0)], bits=12)
    >>> with tempfile.TemporaryDirectory() as place:
    ...     print(write_descriptor(frames, f"{place}/set").read_text())
    v 4.0
    n 12 3 2
    d 100000000.0
    i images\\d0_0000.png
    b 100000000.0 500.0
    i images\\b1_0000.png
    """
    if len(frames.gain_settings) > 1:
        raise InputError(
            f"the frames have several gain settings ({gain_settings_text(frames)}), a descriptor has one",
            hint="Choose one, with frames.at_gain(...) or {gain_setting}",
            arguments={"gain_setting": frames.gain_settings[-1]},
        )
    for group in frames.of_kind("light"):
        if group.photons_per_pixel is None:
            problem = f"the light frames at {group.exposure_s:g} s do not state their photons per pixel"
            raise InputError(problem, hint="Write photons_per_pixel in the protocol")
    lines = ["v 4.0", f"n {frames.bits} {frames.cols} {frames.rows}"]
    done = 0
    with atomic_folder(folder) as place:
        (place / "images").mkdir()
        for number, group in enumerate(frames.groups):
            command, photons = ("d", "") if group.kind == "dark" else ("b", f" {group.photons_per_pixel!r}")
            lines.append(f"{command} {_nanoseconds(group.exposure_s)!r}{photons}")
            for index, dn in enumerate(group):
                name = f"{command}{number}_{index:04d}{suffix}"
                RawFrame(dn, frames.bits, frames.cfa, exposure_s=group.exposure_s).save(place / "images" / name)
                lines.append(f"i images\\{name}")
                done += 1
                if progress is not None:
                    progress(done, frames.frame_count)
        (place / DESCRIPTOR_NAME).write_text("\n".join(lines) + "\n", encoding="ascii")
    return Path(folder) / DESCRIPTOR_NAME


def _nanoseconds(exposure_s: float) -> float:
    """Return nanoseconds that are read back as the same seconds, if such a number exists."""
    exact = exposure_s * _NS_PER_S
    return next((ns for ns in (round(exact, 3), exact) if ns / _NS_PER_S == exposure_s), exact)
