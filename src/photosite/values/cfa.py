"""Color filter arrays: which channel a pixel belongs to."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

Cfa = tuple[tuple[str, ...], ...]
"""The repeating tile, rows of channel names; `(("M",),)` is a monochrome sensor."""

MONOCHROME: Cfa = (("M",),)

_NAME = re.compile(r"[A-Z][a-z0-9]*|[^A-Z\s]")
"""One channel in a row without spaces: a letter, or a capital with the small letters and digits after it."""


def _row(text: str) -> tuple[str, ...]:
    return tuple(text.split() if " " in text else _NAME.findall(text))


def _tile(text: str) -> Cfa:
    return tuple(map(_row, text.split("/")))


NAMED: dict[str, Cfa] = {
    "mono": MONOCHROME,
    "rggb": _tile("RG/GB"),
    "bggr": _tile("BG/GR"),
    "gbrg": _tile("GB/RG"),
    "grbg": _tile("GR/BG"),
    "quad-rggb": _tile("RRGG/RRGG/GGBB/GGBB"),
    "rgbw": _tile("WBWG/BWGW/WGWR/GWRW"),
    "rccb": _tile("RC/CB"),
    "ryycy": _tile("RY/YCy"),
    "rgb-ir": _tile("IrGIrG/GBGR/IrGIrG/GRGB"),
    "x-trans": _tile("GBGGRG/RGRBGB/GBGGRG/GRGGBG/BGBRGR/GRGGBG"),
    "polarization": _tile("P90P45/P135P0"),
    "polarization-rggb": _tile("R90R45G90G45/R135R0G135G0/G90G45B90B45/G135G0B135B0"),
}
"""Tiles by name, with W and C for unfiltered pixels, Y yellow, Cy cyan, Ir infrared; a number is a polarizer's angle.

`quad-rggb` is Sony's Quad Bayer (IMX586). `rgbw` is that of Compton and Hamilton (Kodak, US patent 8 139 130). `rccb`
and `ryycy` are those of automotive sensors (onsemi AR0231, Sony IMX324). `rgb-ir` is that of OmniVision's OV01A1S,
`x-trans` Fujifilm's, `polarization` and `polarization-rggb` those of Sony's IMX250MZR and IMX250MYR.
"""


def cfa_from(tile: str | Sequence[Sequence[str]]) -> Cfa:
    """Return a color filter array from its name (`"rggb"`) or its tile (`"RG/GB"`, `[["R", "G"], ["G", "B"]]`).

    In a tile as text, a capital letter begins a channel, and small letters and digits belong to it: `"RY/YCy"` has the
    channels R, Y and Cy. Other names are separated by spaces.

    Raises
    ------
    InputError
        If the name is unknown, the rows differ in length, or a channel has no name.

    Examples
    --------
    >>> cfa_from("gbrg")
    (('G', 'B'), ('R', 'G'))
    >>> cfa_from("RY/YCy")
    (('R', 'Y'), ('Y', 'Cy'))
    """
    listed: object = tile
    if isinstance(tile, str):
        if "/" not in tile and tile.lower() not in NAMED:
            raise InputError("cfa", value=tile, expected=f"{', '.join(NAMED)}, or a tile such as RRGG/RRGG/GGBB/GGBB")
        listed = _tile(tile) if "/" in tile else NAMED[tile.lower()]
    rows: Cfa = ()
    if isinstance(listed, Sequence) and all(isinstance(row, Sequence) for row in listed):
        rows = tuple(_row(row) if isinstance(row, str) else tuple(str(name) for name in row) for row in listed)
    if not rows or not rows[0] or any(len(row) != len(rows[0]) for row in rows) or not all(map(all, rows)):
        raise InputError("cfa", value=tile, expected="a name, or rows of channel names, all of the same length")
    return rows


def channel_names(cfa: Cfa) -> tuple[str, ...]:
    """Return the channels of the tile, each once, in reading order.

    Examples
    --------
    >>> channel_names(cfa_from("gbrg"))
    ('G', 'B', 'R')
    """
    return tuple(dict.fromkeys(name for row in cfa for name in row))


def plane_names(cfa: Cfa) -> tuple[str, ...]:
    """Return the order of a demosaiced picture's planes: R, G, B, or the tile's reading order for other channels.

    Examples
    --------
    >>> plane_names((("G", "B"), ("R", "G"))), plane_names((("M",),))
    (('R', 'G', 'B'), ('M',))
    """
    names = channel_names(cfa)
    return ("R", "G", "B") if set(names) == {"R", "G", "B"} else names


def tile_text(cfa: Sequence[Sequence[str]]) -> str:
    """Return the tile on one line, as `cfa_from` reads it if it has two rows or more.

    Examples
    --------
    >>> tile_text(cfa_from("rggb")), tile_text((("green", "red"),))
    ('RG/GB', 'green red')
    """
    plain = all(_row("".join(row)) == tuple(row) for row in cfa)
    return "/".join(("" if plain else " ").join(row) for row in cfa)


def tile_name(cfa: Cfa) -> str:
    """Return the tile's name, or the tile as text if it has none.

    Examples
    --------
    >>> tile_name((("R", "G"), ("G", "B"))), tile_name((("R", "W"), ("W", "B")))
    ('rggb', 'RW/WB')
    """
    return next((name for name, tile in NAMED.items() if tile == cfa), tile_text(cfa))


def channel_sites(cfa: Cfa, channel: str) -> tuple[tuple[int, int], ...]:
    """Return a channel's places in the tile: its pixels are `mosaic[r :: len(cfa), c :: len(cfa[0])]` for each (r, c).

    Examples
    --------
    >>> channel_sites(cfa_from("rggb"), "G")
    ((0, 1), (1, 0))
    """
    return tuple((r, c) for r, row in enumerate(cfa) for c, name in enumerate(row) if name == channel)


def channel_mask(cfa: Cfa, channel: str, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Return (rows, cols), true at the channel's pixels.

    Examples
    --------
    >>> int(channel_mask(cfa_from("rggb"), "G", (4, 6)).sum())
    12
    """
    mask = np.zeros(shape, dtype=np.bool_)
    for r, c in channel_sites(cfa, channel):
        mask[r :: len(cfa), c :: len(cfa[0])] = True
    return mask


def shifted(cfa: Cfa, row: int, col: int) -> Cfa:
    """Return the tile of a frame that begins at a row and column of a larger frame.

    Examples
    --------
    >>> shifted(cfa_from("rggb"), 10, 51)
    (('G', 'R'), ('B', 'G'))
    """
    rows, cols = len(cfa), len(cfa[0])
    return tuple(tuple(cfa[(r + row) % rows][(c + col) % cols] for c in range(cols)) for r in range(rows))


def binned(cfa: Cfa, factor: int) -> Cfa:
    """Return the tile of blocks of factor x factor pixels that share a color filter.

    Raises
    ------
    InputError
        If the factor is below 2, or the pixels of a block have different channels.

    Examples
    --------
    >>> tile_name(binned(cfa_from("quad-rggb"), 2))
    'rggb'
    """
    if factor < 2:
        raise InputError("factor", value=factor, expected="2 or more")
    if len(channel_names(cfa)) == 1:
        return ((cfa[0][0],),)
    blocks = tuple(row[::factor] for row in cfa[::factor])
    whole = tuple(tuple(name for name in row for _ in range(factor)) for row in blocks for _ in range(factor))
    if whole != cfa:
        expected = f"a tile of {factor} x {factor} pixels of one color, such as quad-rggb"
        raise InputError("cfa", value=tile_text(cfa), expected=expected)
    return blocks
