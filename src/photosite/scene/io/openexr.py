"""The OpenEXR library as photosite uses it: heads, rows of channels, and rows into a new file; every fault in one line.

The library's present interface (`OpenEXR.File`) reads and writes whole parts. Its older one (`InputFile`, `OutputFile`)
goes by scan lines, of the first part only: what is large is read and written through that.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.atomic import atomic_path

SIGNATURE = b"\x76\x2f\x31\x01"
LARGEST_HALF = 65504.0

_MOST_VALUES_PER_BYTE = 2000
"""Of a file: deflate packs zeros a thousand to one, and a value has two bytes or four."""
_LARGEST_PART_BYTES = 4 << 30
"""Of a part that the library can only read as a whole."""


@dataclass(frozen=True, eq=False)
class ExrPart:
    """A picture in a file, before its values are read.

    Parameters
    ----------
    path
        The file.
    index
        Of the part in it.
    rows, cols
        Of the data window, which is all that has values.
    first_row
        Of the data window.
    channels
        Their names, in the file's order.
    attributes
        Of the part.
    parts
        In the file.
    """

    path: Path
    index: int
    rows: int
    cols: int
    first_row: int
    channels: tuple[str, ...]
    attributes: Mapping[str, Any]
    parts: int

    def text(self, name: str) -> str | None:
        """An attribute that is text, or None."""
        value = self.attributes.get(name)
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        return value.strip() if isinstance(value, str) and value.strip() else None

    def number(self, name: str) -> float | None:
        """An attribute that is a number above 0, or None; text counts: it holds more digits than a float."""
        try:
            value = float(self.attributes.get(name, "nan"))
        except (TypeError, ValueError):
            return None
        return value if np.isfinite(value) and value > 0 else None

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """(first row, (channels, n, cols) values) of all rows in order.

        Raises
        ------
        FileError
            If the file is truncated or damaged, or a part that is not the first is larger than 4 GiB.
        """
        if self.index == 0:
            yield from self._rows_of_first_part(names, rows)
            return
        values = self._whole(names)
        for first in range(0, self.rows, rows):
            yield first, values[:, first : first + rows]

    def _rows_of_first_part(self, names: Sequence[str], rows: int) -> Iterator[tuple[int, NDArray[np.float32]]]:
        library = openexr(self.path)
        import Imath

        kind = Imath.PixelType(Imath.PixelType.FLOAT)
        with library_errors(self.path):
            file = library.InputFile(os.fspath(self.path))
            complete = file.isComplete()
        try:
            if not complete:
                raise FileError(self.path, _TRUNCATED)
            for first in range(0, self.rows, rows):
                count = min(rows, self.rows - first)
                top = self.first_row + first
                with library_errors(self.path):
                    parts = file.channels(list(names), kind, top, top + count - 1)
                yield first, np.stack([np.frombuffer(part, np.float32).reshape(count, self.cols) for part in parts])
        finally:
            file.close()

    def _whole(self, names: Sequence[str]) -> NDArray[np.float32]:
        size = 4 * self.rows * self.cols * len(self.channels)
        if size > _LARGEST_PART_BYTES:
            raise FileError(
                self.path,
                f"holds its picture in part {self.index + 1}, which must be read as a whole and takes {size / 1e9:.0f} "
                "GB; write it as the first part",
            )
        with library_errors(self.path):
            file = openexr(self.path).File(os.fspath(self.path), separate_channels=True)
        # A part whose values could not be read is left out of the list, with a note on standard error alone.
        if len(file.parts) < self.parts:
            raise FileError(self.path, _TRUNCATED)
        channels = file.channels(self.index)
        return np.stack([np.asarray(channels[name].pixels, np.float32) for name in names])


def parts_of(path: Path) -> tuple[ExrPart, ...]:
    """The parts of a file.

    Raises
    ------
    FileError
        If it is no OpenEXR file or a damaged one, or the extra is missing.
    """
    library = openexr(path)
    try:
        with path.open("rb") as file:
            head = file.read(len(SIGNATURE))
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    if head != SIGNATURE:
        raise FileError(path, "is no OpenEXR file: it does not begin like one; was it renamed?")
    with library_errors(path):
        heads = [part.header for part in library.File(os.fspath(path), header_only=True).parts]
    if not heads:
        raise FileError(path, "is a damaged OpenEXR file: it has no parts; copy or render it again")
    with library_errors(path):  # text that is no UTF-8, attributes of the wrong type
        return tuple(_part(path, index, head, len(heads)) for index, head in enumerate(heads))


def _part(path: Path, index: int, head: Mapping[str, Any], parts: int) -> ExrPart:
    if "deep" in str(head.get("type", "")):
        raise FileError(path, "holds deep samples, several at different depths in a pixel; flatten it")
    if not np.isclose(float(head.get("pixelAspectRatio", 1.0)), 1.0, rtol=1e-3):
        raise FileError(path, f"has pixels that are not square ({head['pixelAspectRatio']:g} : 1); resample it")
    channels = head["channels"]
    if any(channel.xSampling != 1 or channel.ySampling != 1 for channel in channels):
        raise FileError(path, "has channels with fewer samples than the others (chroma); write all at full size")
    (left, top), (right, bottom) = (np.asarray(corner).tolist() for corner in head["dataWindow"])
    names = tuple(channel.name for channel in channels)
    rows, cols = bottom - top + 1, right - left + 1
    if rows * cols * max(len(names), 1) > _MOST_VALUES_PER_BYTE * path.stat().st_size:
        raise FileError(
            path,
            f"is a damaged OpenEXR file: {rows} x {cols} samples of {len(names)} channels do not fit into its bytes",
        )
    return ExrPart(path, index, rows, cols, top, names, dict(head), parts)


def write_rows(
    path: Path,
    shape: tuple[int, int],
    channels: Sequence[str],
    blocks: Iterator[NDArray[np.float32]],
    *,
    half: bool,
    attributes: Mapping[str, str],
) -> None:
    """Write a file of one part, some rows at a time.

    Parameters
    ----------
    path
        The file; it appears whole or not at all.
    shape
        (rows, cols).
    channels
        Their names.
    blocks
        (channels, n, cols) values of the rows in order.
    half
        Store 16-bit floats instead of 32-bit ones.
    attributes
        Text of the head.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    library = openexr(path)
    import Imath

    kind = np.float16 if half else np.float32
    stored = Imath.Channel(Imath.PixelType(Imath.PixelType.HALF if half else Imath.PixelType.FLOAT))
    head = library.Header(shape[1], shape[0])
    head["channels"] = dict.fromkeys(channels, stored)
    head["compression"] = Imath.Compression(Imath.Compression.ZIP_COMPRESSION)
    head |= {name: value.encode() for name, value in attributes.items()}
    with atomic_path(path) as temporary:
        with library_errors(path, writing=True):
            file = library.OutputFile(os.fspath(temporary), head)
        try:
            for block in blocks:
                rows = {name: plane.astype(kind).tobytes() for name, plane in zip(channels, block, strict=True)}
                with library_errors(path, writing=True):
                    file.writePixels(rows, block.shape[1])
        finally:
            file.close()


def openexr(path: Path) -> Any:
    """The library.

    Raises
    ------
    FileError
        If it is not installed.
    """
    try:
        import OpenEXR
    except ImportError:
        raise FileError(
            path, "is OpenEXR, which needs the extra 'spectral': pip install 'photosite[spectral]'"
        ) from None
    return OpenEXR


_TRUNCATED = "is a truncated OpenEXR file: not all of its rows were written; copy or render it again"


@contextmanager
def library_errors(path: Path, *, writing: bool = False) -> Iterator[None]:
    """What the library says of a file, as one line: an error of it becomes a `FileError`.

    Of a damaged file it also writes a line per row to standard error from within, and prints warnings; for the time of
    a call that goes nowhere.
    """
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        with redirect_stdout(io.StringIO()):
            yield
    except (RuntimeError, OSError, ValueError, TypeError, KeyError) as error:
        reason = " ".join(str(error).replace(os.fspath(path), "it").split())[:120]
        if writing:
            raise FileError(path, f"cannot be written: {reason}") from None
        raise FileError(path, f"is a damaged or truncated OpenEXR file ({reason}); copy or render it again") from None
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
