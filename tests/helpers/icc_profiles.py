"""ICC profiles of red, green and blue, written tag by tag."""

from __future__ import annotations

import struct

COLORANTS = {
    "sRGB": (0.43607, 0.22249, 0.01392, 0.38515, 0.71687, 0.09708, 0.14307, 0.06061, 0.71410),
    "Display P3": (0.51512, 0.24120, -0.00105, 0.29198, 0.69225, 0.04189, 0.15710, 0.06657, 0.78407),
    "Adobe RGB": (0.60974, 0.31111, 0.01947, 0.20528, 0.62567, 0.06087, 0.14919, 0.06322, 0.74457),
    "ProPhoto RGB": (0.79767, 0.28804, 0.0, 0.13519, 0.71188, 0.0, 0.03134, 0.00009, 0.82491),
    "BT.2020": (0.67346, 0.27904, -0.00193, 0.16566, 0.67534, 0.02998, 0.12505, 0.04561, 0.79684),
}
"""X, Y, Z of red, green and blue in the makers' profiles (HP and Microsoft, Apple, Adobe, Kodak)."""


def fixed(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(65536 * value) for value in values))


CURVES = {
    "sRGB": b"para\0\0\0\0\0\3\0\0" + fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045),
    "Adobe RGB": b"curv\0\0\0\0" + struct.pack(">IH", 1, 563),
    "ProPhoto RGB": b"curv\0\0\0\0" + struct.pack(">IH", 1, 461),
    "BT.2020": b"para\0\0\0\0\0\3\0\0" + fixed(1 / 0.45, 1 / 1.0993, 0.0993 / 1.0993, 1 / 4.5, 0.0812),
    "linear": b"curv\0\0\0\0\0\0\0\0",
    "linear, of gamma 1": b"para\0\0\0\0\0\0\0\0" + fixed(1.0),
    "gamma 2.2": b"para\0\0\0\0\0\0\0\0" + fixed(2.2),
}


def written(
    name: str = "of no space",
    colorants: str = "sRGB",
    curve: str | bytes = "sRGB",
    extra: dict[bytes, bytes] | None = None,
    without: bytes | None = None,
) -> bytes:
    """Return a profile of version 4: description, colorants, curves and other tags; without tags of one ending."""
    values = COLORANTS[colorants]
    light = CURVES[curve] if isinstance(curve, str) else curve
    text = name.encode("utf-16-be")
    tags = {b"desc": b"mluc\0\0\0\0" + struct.pack(">II4sII", 1, 12, b"enUS", len(text), 28) + text}
    tags[b"wtpt"] = b"XYZ \0\0\0\0" + fixed(0.9642, 1.0, 0.8249)
    for k, letter in enumerate((b"r", b"g", b"b")):
        tags[letter + b"XYZ"] = b"XYZ \0\0\0\0" + fixed(*values[3 * k : 3 * k + 3])
        tags[letter + b"TRC"] = light
    tags |= extra or {}
    if without is not None:
        tags = {tag: content for tag, content in tags.items() if not tag.endswith(without)}
    at, table, body = 132 + 12 * len(tags), b"", b""
    for tag, content in tags.items():
        table += struct.pack(">4sII", tag, at + len(body), len(content))
        body += content + bytes(-len(content) % 4)
    head = bytearray(128)
    head[0:24] = struct.pack(">I4sI4s4s4s", at + len(body), b"none", 0x04200000, b"mntr", b"RGB ", b"XYZ ")
    head[36:40] = b"acsp"
    head[68:80] = fixed(0.9642, 1.0, 0.8249)
    return bytes(head) + struct.pack(">I", len(tags)) + table + body
