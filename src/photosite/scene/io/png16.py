"""PNG pictures of 16 bits a channel (ISO/IEC 15948), of which Pillow keeps 8."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled
from photosite.errors import FileError
from photosite.files.png import CHANNELS, PngFile

Bytes = NDArray[np.uint8]

_PALETTE = 3


@dataclass(frozen=True)
class DeepPng:
    """The codes of a picture.

    Parameters
    ----------
    codes
        (rows, cols, channels): grey, or red, green and blue; then opacity, where there is some.
    clear
        The (1 or 3) colour that stands for nothing there; None where none does.
    """

    codes: NDArray[np.uint16]
    clear: NDArray[np.uint16] | None

    @property
    def has_alpha(self) -> bool:
        """Whether the last channel is opacity."""
        return self.codes.shape[2] in (2, 4)

    @property
    def colors(self) -> NDArray[np.uint16]:
        """(rows, cols, 1 or 3): grey, or red, green and blue."""
        return self.codes[:, :, :-1] if self.has_alpha else self.codes

    @property
    def is_opaque(self) -> bool:
        """Whether nothing shows through."""
        if self.has_alpha and self.codes[:, :, -1].min() < np.iinfo(np.uint16).max:
            return False
        return self.clear is None or not (self.colors == self.clear).all(axis=2).any()


def read_deep_png(file: PngFile) -> DeepPng:
    """The codes of a PNG of 16 bits a channel, interlaced or not.

    Raises
    ------
    FileError
        If it is damaged.
    """
    head, path = file.header, file.path
    channels = CHANNELS[head.color_type]
    if head.bits != 16 or head.color_type == _PALETTE:
        raise FileError(path, f"is damaged: colour type {head.color_type} in {head.bits} bits a channel, not 16")
    told = file.chunks.get(b"tRNS")
    if told is not None and len(told) != (2 * channels if channels in (1, 3) else 0):
        raise FileError(path, "is damaged: its transparent colour (tRNS) is not one of its colours")
    plain, at = file.unpacked(), 0
    codes = np.empty((head.rows, head.cols, channels), np.uint16)
    for part in head.passes:
        size = head.row_bytes(part.cols)
        lines = np.frombuffer(plain, np.uint8, part.rows * (1 + size), at).reshape(part.rows, -1)
        values = np.empty((part.rows, size), np.uint8)
        if (bad := _undo_filters(lines, 2 * channels, values)) >= 0:
            row = part.row + bad * part.down
            raise FileError(path, f"is damaged: row {row} has the filter {lines[bad, 0]}, known are 0 to 4")
        codes[part.row :: part.down, part.col :: part.right] = values.view(">u2").reshape(part.rows, part.cols, -1)
        at += lines.size
    return DeepPng(codes, None if told is None else np.frombuffer(told, ">u2").astype(np.uint16))


@compiled()
def _undo_filters(lines: Bytes, step: int, out: Bytes) -> int:
    """Bytes of each row from those of its filter (ISO/IEC 15948, 9.2); the first row whose filter is none, or -1.

    Parameters
    ----------
    lines
        (rows, 1 + bytes): the filter, and what it made.
    step
        Bytes of a pixel.
    out
        (rows, bytes).
    """
    rows, size = out.shape
    none = np.zeros(size, np.uint8)
    for r in range(rows):
        line, row, up = lines[r, 1:], out[r], none if r == 0 else out[r - 1]
        kind = lines[r, 0]
        if kind > 4:
            return r
        if kind in (0, 2):
            for i in range(size):
                row[i] = line[i] + (up[i] if kind == 2 else np.uint8(0))
            continue
        for i in range(step):  # nothing lies to the left
            row[i] = line[i] + (np.uint8(0) if kind == 1 else np.uint8(up[i] >> 1) if kind == 3 else up[i])
        if kind == 1:
            for i in range(step, size):
                row[i] = line[i] + row[i - step]
        elif kind == 3:
            for i in range(step, size):
                row[i] = line[i] + np.uint8((np.int64(row[i - step]) + np.int64(up[i])) >> 1)
        else:
            for i in range(step, size):
                row[i] = line[i] + _paeth(np.int64(row[i - step]), np.int64(up[i]), np.int64(up[i - step]))
    return -1


@compiled(inline=True)
def _paeth(left: np.int64, up: np.int64, corner: np.int64) -> np.uint8:
    """That of the three neighbours which left + up - corner is nearest to; of equal ones the first."""
    to_left, to_up, to_corner = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
    if to_left <= to_up and to_left <= to_corner:
        return np.uint8(left)
    return np.uint8(up) if to_up <= to_corner else np.uint8(corner)
