"""Companded frames that state their table: piecewise linear, from linear to companded numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame

COMPANDING = "companding"
"""Metadata: knees of the table of companded numbers, linear:companded, as in `0:0 2048:1024 65535:4095`."""


def companding_text(linear_dn: Sequence[float], companded_dn: Sequence[float]) -> str:
    """Return the metadata that state a table.

    Examples
    --------
    >>> companding_text((0, 1024, 65535), (0, 1024, 4095))
    '0:0 1024:1024 65535:4095'
    """
    knees = zip(linear_dn, companded_dn, strict=True)
    return " ".join(f"{round(linear)}:{round(companded)}" for linear, companded in knees)


def decompanded(raw: RawFrame) -> RawFrame:
    """Return a frame with the linear numbers of its stated table, rounded; other frames unchanged.

    Raises
    ------
    InputError
        If the metadata state a table that is invalid.

    Examples
    --------
    >>> stated = {"companding": "0:0 1024:1024 65535:4095"}
    >>> raw = RawFrame(np.array([[1000, 4095]], np.uint16), bits=12, metadata=stated)
    >>> decompanded(raw).dn.tolist(), decompanded(raw).bits
    ([[1000, 65535]], 16)
    """
    text = raw.metadata.get(COMPANDING)
    if text is None:
        return raw
    try:
        linear, companded = np.array([[int(number) for number in knee.split(":")] for knee in str(text).split()]).T
    except ValueError:
        expected = "knees of linear:companded numbers, as in 0:0 2048:1024 65535:4095"
        raise InputError(COMPANDING, where="metadata", value=text, expected=expected) from None
    if min(np.diff(linear).min(initial=1), np.diff(companded).min(initial=1)) <= 0 or linear[-1] >= 1 << 24:
        raise InputError(COMPANDING, where="metadata", value=text, expected="ascending, up to 24 bits")
    bits = int(linear[-1]).bit_length()
    levels = np.interp([raw.black_level_dn, raw.white_level_dn], companded, linear)
    return replace(
        raw,
        dn=np.rint(np.interp(raw.dn, companded, linear)).astype(np.uint16 if bits <= 16 else np.uint32),
        bits=bits,
        black_level_dn=float(levels[0]),
        white_level_dn=math.floor(levels[1]),  # numbers are rounded
        metadata={name: value for name, value in raw.metadata.items() if name != COMPANDING},
    )
