"""Color filter arrays: which channel a pixel belongs to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

Cfa = tuple[tuple[str, ...], ...]
"""The repeating tile, rows of channel names; `(("M",),)` is a monochrome sensor."""

MONOCHROME: Cfa = (("M",),)

NAMED: dict[str, Cfa] = {
    "mono": MONOCHROME,
    "rggb": (("R", "G"), ("G", "B")),
    "bggr": (("B", "G"), ("G", "R")),
    "gbrg": (("G", "B"), ("R", "G")),
    "grbg": (("G", "R"), ("B", "G")),
}


def cfa_from(tile: str | Sequence[Sequence[str]]) -> Cfa:
    """Return a color filter array from its name (`"rggb"`) or its tile (`"RG/GB"`, `[["R", "G"], ["G", "B"]]`).

    Raises
    ------
    InputError
        If the name is unknown, the rows differ in length, or a channel has no name.

    Examples
    --------
    >>> cfa_from("gbrg")
    (('G', 'B'), ('R', 'G'))
    >>> cfa_from("WG/RW")
    (('W', 'G'), ('R', 'W'))
    """
    listed = tile.split("/") if isinstance(tile, str) and "/" in tile else tile
    if isinstance(listed, str):
        if listed.lower() not in NAMED:
            raise InputError("cfa", value=tile, expected=f"{', '.join(NAMED)}, or a tile such as RRGG/RRGG/GGBB/GGBB")
        return NAMED[listed.lower()]
    rows: Cfa = ()
    if isinstance(listed, Sequence) and all(isinstance(row, Sequence) for row in listed):
        rows = tuple(tuple(str(name) for name in row) for row in listed)
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
    """Return the tile on one line, for messages and tables.

    Examples
    --------
    >>> tile_text(cfa_from("rggb"))
    'RG/GB'
    """
    return "/".join("".join(row) for row in cfa)


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
