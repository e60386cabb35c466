"""EMVA 1288 descriptor files: which frames of a measurement are where.

A text file, a command a line: `v version`, `n bits width height`, `b exposure_ns photons` and `d exposure_ns` open a
series of light and dark frames, `i path` names a frame of the series, `#` starts a comment. Paths are relative to the
descriptor and use backslashes. The format is that of the EMVA 1288 reference data and implementation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath

from photosite.errors import FileError
from photosite.frames.frame_set import Kind
from photosite.frames.listing import FileEntry

_NS_PER_S = 1e9
_WANTED = {"v": "v version", "n": "n bits width height", "b": "b exposure_ns photons", "d": "d exposure_ns"}


@dataclass
class Descriptor:
    """What an EMVA 1288 descriptor says.

    Parameters
    ----------
    version
        The standard's release that the file names, or None.
    bits, rows, cols
        Of every frame.
    entries
        The frames, in the file's order.
    """

    version: str | None = None
    bits: int = 0
    rows: int = 0
    cols: int = 0
    entries: list[FileEntry] = field(default_factory=list)


def looks_like_descriptor(path: Path) -> bool:
    """Whether the file's first line that is no comment is a descriptor's `v` or `n`."""
    try:
        with path.open("rb") as file:
            for line in file.read(65536).removeprefix(b"\xef\xbb\xbf").splitlines():
                words = line.split()
                if words and not words[0].startswith(b"#"):
                    return words[0].lower() in (b"v", b"n")
    except OSError:
        return False
    return False


def read_descriptor(path: Path) -> Descriptor:
    """An EMVA 1288 descriptor.

    Raises
    ------
    FileError
        If the file cannot be read, or a line is not as the format has it; with the line.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")  # an author's name in a comment, mostly
    parser = _Parser(path)
    for number, line in enumerate(text.splitlines(), start=1):
        if (words := line.strip()) and not words.startswith("#"):
            parser.line(number, words)
    parser.close_series()
    descriptor = parser.descriptor
    if not descriptor.bits:
        raise FileError(path, "lacks its line 'n bits width height'")
    if not descriptor.entries:
        raise FileError(path, "names no frames: expected 'b' and 'd' lines with 'i path' lines after them")
    return descriptor


class _Parser:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.descriptor = Descriptor()
        self.series: tuple[Kind, float, float, int] | None = None
        self.series_frames = 0

    def line(self, number: int, text: str) -> None:
        command, _, rest = text.replace("\t", " ").partition(" ")
        command, rest = command.lower(), rest.strip()
        handlers: dict[str, Callable[[int, str], None]] = {
            "v": self.version,
            "n": self.size,
            "b": self.light,
            "d": self.dark,
            "i": self.frame,
        }
        if command not in handlers:
            raise FileError(self.path, f"unknown command '{command}'; known are: {', '.join(handlers)}", number)
        if not rest:
            raise FileError(self.path, f"expected '{_WANTED.get(command, 'i path')}', got '{text}'", number)
        handlers[command](number, rest)

    def version(self, number: int, rest: str) -> None:
        self.descriptor.version = rest

    def size(self, number: int, rest: str) -> None:
        if self.descriptor.bits:
            raise FileError(self.path, "a second 'n bits width height'; a descriptor has one", number)
        bits, cols, rows = self.numbers(number, "n", rest, 3)
        if not (bits.is_integer() and cols.is_integer() and rows.is_integer()) or rows < 1 or cols < 1:
            raise FileError(self.path, f"bits, width and height are whole numbers above 0, not '{rest}'", number)
        if not 1 <= bits <= 16:
            raise FileError(self.path, f"frames of 1 to 16 bits are read, not {bits:g}", number)
        self.descriptor.bits, self.descriptor.cols, self.descriptor.rows = int(bits), int(cols), int(rows)

    def light(self, number: int, rest: str) -> None:
        exposure_ns, photons = self.numbers(number, "b", rest, 2)
        self.open_series(number, "light", exposure_ns, photons)

    def dark(self, number: int, rest: str) -> None:
        (exposure_ns,) = self.numbers(number, "d", rest, 1)
        self.open_series(number, "dark", exposure_ns, 0.0)

    def open_series(self, number: int, kind: Kind, exposure_ns: float, photons: float) -> None:
        self.close_series()
        if exposure_ns <= 0:
            raise FileError(self.path, f"an exposure is ns above 0, not {exposure_ns:g}", number)
        if photons < 0:
            raise FileError(self.path, f"photons cannot be {photons:g}", number)
        # Division rounds once: 125000 ns is the same number as 1/8000 s.
        self.series, self.series_frames = (kind, exposure_ns / _NS_PER_S, photons, number), 0

    def close_series(self) -> None:
        if self.series is not None and self.series_frames == 0:
            raise FileError(self.path, "a series without a frame: expected 'i path' after it", self.series[3])

    def frame(self, number: int, rest: str) -> None:
        if self.series is None:
            raise FileError(self.path, "a frame before any 'b' or 'd' line", number)
        kind, exposure_s, photons, _ = self.series
        written = Path(rest) if rest.startswith("/") else Path(*PureWindowsPath(rest).parts)
        entry = FileEntry(self.path.parent / written, kind, exposure_s, photons, self.path, number)
        self.descriptor.entries.append(entry)
        self.series_frames += 1

    def numbers(self, number: int, command: str, rest: str, count: int) -> list[float]:
        try:
            # Some cameras' tools write decimal commas.
            values = [float(word.replace(",", ".")) for word in rest.split()]
        except ValueError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            raise FileError(self.path, f"expected '{_WANTED[command]}', got '{command} {rest}'", number)
        return values
