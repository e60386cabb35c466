"""Shares of samples that the bright sectors of a star cover.

Angles run clockwise from straight up. The star's centre is the middle of the field.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LINES = 16
"""Lines through each sample, along which lengths are exact. Even, so that none runs through the centre."""

_CENTRE, _CENTRE_LINES = 16, 512
"""Side of the square in the middle, where edges of all directions meet in a sample, and the lines there."""


def sector_share(rows: int, cols: int, cycles: int, angle_deg: float) -> Array:
    """(rows, cols) share of each sample in the bright sectors, `cycles` of them, the first one clockwise of an angle.

    Where a sample lies more above or below the centre than beside it, bright lengths are taken along rows, which run
    across the edges there, exactly; elsewhere along columns. What is not exact is the mean over 16 such lines a sample,
    512 in the middle of the star.

    Examples
    --------
    >>> sector_share(2, 2, 2, 0.0).round(6).tolist()   # four quadrants
    [[0.0, 1.0], [1.0, 0.0]]
    """
    angle = math.radians(angle_deg)
    share = _share(rows, cols, cycles, angle, _LINES)
    r, c = (min(_CENTRE - count % 2, count) for count in (rows, cols))
    r0, c0 = (rows - r) // 2, (cols - c) // 2
    share[r0 : r0 + r, c0 : c0 + c] = _share(r, c, cycles, angle, _CENTRE_LINES)
    return share


def _share(rows: int, cols: int, cycles: int, angle: float, lines: int) -> Array:
    along_rows = _mean_along(rows, cols, cycles, angle, lines, across=False)
    along_cols = _mean_along(cols, rows, cycles, angle, lines, across=True).T
    up = np.abs(np.arange(rows) + 0.5 - rows / 2)[:, None]
    beside = np.abs(np.arange(cols) + 0.5 - cols / 2)[None, :]
    return np.where(up >= beside, along_rows, along_cols)


def _mean_along(count: int, samples: int, cycles: int, angle: float, lines: int, *, across: bool) -> Array:
    """(count, samples) shares by lengths along rows, or, across, along columns; `lines` of them in each."""
    place = (np.arange(count * lines) + 0.5) / lines - count / 2
    borders = np.arange(samples + 1) - samples / 2
    far = 2.0 * samples * lines  # beyond the field on the line nearest to the centre
    lengths = {side: _bright_length(cycles, angle, side, far, across=across) for side in (-1, 1)}
    share = np.zeros((count, samples))
    for line, distance in enumerate(place):
        # Along a row coordinates grow to the right, along a column downwards.
        ratio, length = lengths[1 if distance > 0 else -1]
        share[line // lines] += abs(distance) * np.diff(np.interp(borders / abs(distance), ratio, length))
    return np.clip(share / lines, 0.0, 1.0)  # rounding only


def _bright_length(cycles: int, angle: float, side: int, far: float, *, across: bool) -> tuple[Array, Array]:
    """Bright length along a line at distance 1 from the centre, from the foot of its normal: places, and lengths there.

    A line at another distance is the same, scaled: sectors are.
    """
    edges = angle + np.arange(2 * cycles) * math.pi / cycles
    # (down, right) of a unit step along each edge.
    down, right = -np.cos(edges), np.sin(edges)
    away, along = (right, down) if across else (down, right)
    met = side * away * far > 1.0  # the others never meet the line, or beyond the field
    places = np.sort(along[met] / np.abs(away[met]))
    places = np.concatenate([[-far], places, [far]])
    middles = np.concatenate([[places[1] - 1.0], (places[1:-2] + places[2:-1]) / 2, [places[-2] + 1.0]])
    down_of, right_of = (middles, float(side)) if across else (float(side), middles)
    turn = (np.arctan2(right_of, -np.asarray(down_of)) - angle) * cycles / (2 * math.pi)
    bright = np.mod(turn, 1.0) < 0.5
    # From 0 outwards on either side, so that lengths near the foot do not lose digits to the far ends.
    nodes = np.union1d(places, [0.0])
    state = bright[np.searchsorted(places, (nodes[:-1] + nodes[1:]) / 2) - 1]
    steps = np.where(state, np.diff(nodes), 0.0)
    zero = int(np.searchsorted(nodes, 0.0))
    length = np.zeros(nodes.size)
    length[zero + 1 :] = np.cumsum(steps[zero:])
    length[:zero] = -np.cumsum(steps[:zero][::-1])[::-1]
    return nodes, length
