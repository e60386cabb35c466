"""Digital binning: blocks of pixels of one color added or averaged after the readout."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.binning import mean_offset_dn
from photosite.values.cfa import binned
from photosite.values.choice import check_choice

DigitalBinning = Literal["sum", "mean"]


def bin_frame(raw: RawFrame, factor: int = 2, kind: DigitalBinning = "mean") -> RawFrame:
    """Return a raw frame of blocks of factor x factor pixels, which share a color filter.

    Rows and columns that fill no block are left out. `Sensor.binned` describes the sensor of such frames.

    Parameters
    ----------
    raw
        A monochrome frame, or one of a tile such as quad-rggb, which becomes rggb.
    factor
        Rows and columns of a block.
    kind
        "sum", with the bit depth that it needs, or "mean", rounded, halves up: with four pixels this raises the mean,
        and the black level, by 1/8 DN.

    Raises
    ------
    InputError
        If the pixels of a block have different filters, the frame has no whole block, a sum exceeds 16 bits, or the
        kind is unknown.

    Examples
    --------
    >>> frame = RawFrame(np.arange(8, dtype=np.uint16).reshape(2, 4), bits=12)
    >>> bin_frame(frame, 2, "sum").dn, bin_frame(frame, 2, "mean").dn
    (array([[10, 18]], dtype=uint16), array([[3, 5]], dtype=uint16))
    """
    check_choice("kind", kind, DigitalBinning)
    cfa = binned(raw.cfa, factor)
    rows, cols = (size // factor for size in raw.shape)
    if rows == 0 or cols == 0:
        raise InputError("factor", value=factor, expected=f"at most the rows and columns of the frame, {raw.shape}")
    n = factor**2
    bits = raw.bits + math.ceil(math.log2(n))
    if kind == "sum" and bits > 16:
        raise InputError("bits", value=bits, expected=f"at most 16 for a sum of {n} pixels", hint="Use 'mean'")
    blocks = raw.dn[: rows * factor, : cols * factor].reshape(rows, factor, cols, factor)
    total = blocks.sum(axis=(1, 3), dtype=np.uint32)
    profile = None if raw.noise_profile is None else np.asarray(raw.noise_profile) / n
    if kind == "mean":
        dn, black_dn = (total + n // 2) // n, raw.black_level_dn + mean_offset_dn(n)
        return replace(
            raw, dn=dn.astype(np.uint16), cfa=cfa, black_level_dn=black_dn, noise_profile=profile, captures={}
        )
    return replace(
        raw,
        dn=total.astype(np.uint16),
        captures={},
        bits=bits,
        cfa=cfa,
        black_level_dn=raw.black_level_dn * n,
        white_level_dn=raw.white_level_dn * n,
        noise_profile=profile,
    )
