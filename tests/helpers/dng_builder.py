"""DNG files of other programs, built byte by byte."""

from __future__ import annotations

import struct

import numpy as np

BYTE, ASCII, SHORT, LONG, RATIONAL, SRATIONAL, DOUBLE = 1, 2, 3, 4, 5, 10, 12
CODES = {BYTE: "B", SHORT: "H", LONG: "I", RATIONAL: "I", SRATIONAL: "i", DOUBLE: "d"}

MATRIX_D65 = [0.84, -0.22, -0.08, -0.41, 1.25, 0.17, -0.06, 0.18, 0.66]
MATRIX_A = [0.9, -0.3, -0.1, -0.5, 1.3, 0.2, -0.1, 0.2, 0.5]


class Tiff:
    """A TIFF file built block by block, directories after the data that they point to."""

    def __init__(self, order: str) -> None:
        self.order = order
        self.data = bytearray((b"II*\0" if order == "<" else b"MM\0*") + bytes(4))

    def put(self, block: bytes) -> int:
        self.data += bytes(len(self.data) % 2)
        self.data += block
        return len(self.data) - len(block)

    def directory(self, tags: dict[int, tuple[int, object]]) -> int:
        entries = []
        for tag, (kind, values) in sorted(tags.items()):
            if kind == ASCII:
                block, count = values.encode() + b"\0", len(values) + 1
            else:
                block = struct.pack(f"{self.order}{len(values)}{CODES[kind]}", *values)
                count = len(values) // (2 if kind in (RATIONAL, SRATIONAL) else 1)
            field = block.ljust(4, b"\0") if len(block) <= 4 else struct.pack(f"{self.order}I", self.put(block))
            entries.append(struct.pack(f"{self.order}HHI", tag, kind, count) + field)
        return self.put(struct.pack(f"{self.order}H", len(entries)) + b"".join(entries) + bytes(4))

    def finish(self, first: int) -> bytes:
        self.data[4:8] = struct.pack(f"{self.order}I", first)
        return bytes(self.data)


def packed_12_bit(dn: np.ndarray) -> bytes:
    first, second = dn[:, ::2].astype(np.uint16), dn[:, 1::2].astype(np.uint16)
    return np.stack([first >> 4, (first & 15) << 4 | second >> 8, second & 255], axis=-1).astype(np.uint8).tobytes()


def ratios(values) -> list[int]:
    return [part for value in values for part in (round(value * 10000), 10000)]


def hand_made_dng(dn: np.ndarray, *, order="<", area=None, top=(), raw=(), exif=True, pixels=None) -> bytes:
    """A preview in the first directory, the 12-bit packed mosaic in a SubIFD, exposure in Exif.

    `pixels` are other bytes of the mosaic than packed ones.
    """
    file = Tiff(order)
    rows, cols = dn.shape
    pixels = packed_12_bit(dn) if pixels is None else pixels
    raw_tags = {
        254: (LONG, [0]),
        256: (LONG, [cols]),
        257: (LONG, [rows]),
        258: (SHORT, [12]),
        259: (SHORT, [1]),
        262: (SHORT, [32803]),
        273: (LONG, [file.put(pixels)]),
        277: (SHORT, [1]),
        278: (LONG, [rows]),
        279: (LONG, [len(pixels)]),
        33421: (SHORT, [2, 2]),
        33422: (BYTE, [2, 1, 1, 0]),
        50713: (SHORT, [2, 2]),
        50714: (RATIONAL, [128, 2, 65, 1, 66, 1, 68, 1]),
        50717: (LONG, [4000]),
        50829: (LONG, area or [0, 0, rows, cols]),
        51041: (DOUBLE, [1e-4, 1e-7, 2e-4, 2e-7, 3e-4, 3e-7]),
    } | dict(raw)
    top_tags = {
        254: (LONG, [1]),
        256: (LONG, [8]),
        257: (LONG, [8]),
        258: (SHORT, [8, 8, 8]),
        259: (SHORT, [1]),
        262: (SHORT, [2]),
        271: (ASCII, "Maker"),
        272: (ASCII, "Model 1"),
        273: (LONG, [file.put(bytes(192))]),
        277: (SHORT, [3]),
        278: (LONG, [8]),
        279: (LONG, [192]),
        330: (LONG, [file.directory({tag: entry for tag, entry in raw_tags.items() if entry})]),
        50706: (BYTE, [1, 4, 0, 0]),
        50708: (ASCII, "Maker Model 1"),
        50721: (SRATIONAL, ratios(MATRIX_A)),
        50722: (SRATIONAL, ratios(MATRIX_D65)),
        50778: (SHORT, [17]),
        50779: (SHORT, [21]),
    } | dict(top)
    if exif:
        top_tags[34665] = (LONG, [file.directory({33434: (RATIONAL, [1, 60]), 34855: (SHORT, [800])})])
    return file.finish(file.directory({tag: entry for tag, entry in top_tags.items() if entry}))
