"""Fractions of samples that a shape covers: lines, discs, square waves and the sectors of a star.

Coordinates are in samples, from border to border: sample i covers i to i + 1.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LINES = 16
"""Lines through each sample, along which lengths are exact. Even, so that none passes through the center."""
_CENTER, _CENTER_LINES = 16, 512
"""Side of the central square, where edges of all directions meet in a sample, and the lines there."""


def left_of_line(offset: Array, slope: float) -> Array:
    """Return the fraction of a unit square left of a line at `offset` in its center row, moving by `slope` per row.

    The mean over the square's height of clip(offset + slope s, 0, 1), s in -1/2 .. 1/2: the integral of a ramp.

    Examples
    --------
    >>> left_of_line(np.array([-1.0, 0.25, 0.5]), 1.0)
    array([0.     , 0.28125, 0.5    ])
    """

    def integral(x: Array) -> Array:
        inside = np.clip(x, 0.0, 1.0)
        return inside**2 / 2 + np.maximum(x - 1.0, 0.0)

    if slope == 0.0:
        return np.clip(offset, 0.0, 1.0)
    return (integral(offset + slope / 2) - integral(offset - slope / 2)) / slope


def disc(rows: int, cols: int, center_row: float, center_col: float, radius: float) -> Array:
    """Return the fraction (rows, cols) of each sample that a disc covers; center and radius in samples.

    Notes
    -----
    With H(x, y) the disc's area left of x and above y, a sample holds H(x1, y1) - H(x0, y1) - H(x1, y0) + H(x0, y0).
    H is the integral over u from -R to x of s(u) + clip(y, -s(u), s(u)), s(u) = sqrt(R^2 - u^2).

    Examples
    --------
    >>> disc(4, 4, 2.0, 2.0, 1.0)[1:3, 1:3].round(4).tolist()   # pi / 4
    [[0.7854, 0.7854], [0.7854, 0.7854]]
    """
    x = np.clip(np.arange(cols + 1) - center_col, -radius, radius)[None, :]
    y = np.clip(np.arange(rows + 1) - center_row, -radius, radius)[:, None]

    def under_arc(u: Array) -> Array:
        """Integral of s from -R to u."""
        half_chord = np.sqrt(np.maximum(radius**2 - u**2, 0.0))  # rounding can put |u| above R
        return (u * half_chord + radius**2 * np.arcsin(u / radius)) / 2 + np.pi * radius**2 / 4

    reach = np.sqrt(np.maximum(radius**2 - y**2, 0.0))  # where |u| is below it, s(u) > |y|
    beyond = under_arc(np.minimum(x, -reach)) + under_arc(np.maximum(x, reach)) - under_arc(reach)
    area = under_arc(x) + np.sign(y) * beyond + y * (np.clip(x, -reach, reach) + reach)
    fraction: Array = np.diff(np.diff(area, axis=0), axis=1)
    return np.clip(fraction, 0.0, 1.0)  # clips rounding errors of 1e-16 of the disc's area


def turned_square(shape: tuple[int, int], center: tuple[float, float], half: float, angle: float) -> Array:
    """Return the fraction (rows, cols) of each sample in a square of side 2 `half`, turned clockwise by `angle` rad.

    The angle is above 0 and below pi / 4. The fraction is exact where one side passes through a sample; at the corners
    it is the product of those of two sides, up to 0.1 off.

    Examples
    --------
    >>> round(float(turned_square((12, 12), (6.0, 6.0), 4.0, 0.1).sum()), 3)
    64.002
    """
    rows, cols = (np.arange(size, dtype=np.float64) for size in shape)
    slope, reach = math.tan(angle), half / math.cos(angle)
    across = center[1] - slope * (rows + 0.5 - center[0])
    down = center[0] + slope * (cols + 0.5 - center[1])
    left, right = (left_of_line(across[:, None] + sign * reach - cols, slope) for sign in (-1, 1))
    above, below = (left_of_line((down[:, None] + sign * reach - rows).T, slope) for sign in (-1, 1))
    return np.asarray((right - left) * (below - above))


def square_wave(phase: Array, width: float) -> Array:
    """Return the mean of a square wave over `width` periods around a phase: +1 from 0 to 1/2, -1 from 1/2 to 1.

    Examples
    --------
    >>> square_wave(np.array([0.25, 0.5, 0.75]), 0.5).tolist()
    [1.0, 0.0, -1.0]
    """

    def integral(p: Array) -> Array:
        return 0.5 - np.abs(np.mod(p, 1.0) - 0.5)

    return (integral(phase + width / 2) - integral(phase - width / 2)) / width


def sector_fraction(rows: int, cols: int, cycles: int, angle_deg: float) -> Array:
    """Return the fraction (rows, cols) of each sample in the bright sectors of a star at the field's center.

    The star has `cycles` bright sectors; the first begins at an angle, clockwise from straight up. Bright lengths are
    exact along rows where a sample is more above or below the center than beside it, elsewhere along columns: across
    the edges. A fraction is the mean over 16 such lines in a sample, 512 in the center of the star.

    Examples
    --------
    >>> sector_fraction(2, 2, 2, 0.0).round(6).tolist()   # four quadrants
    [[0.0, 1.0], [1.0, 0.0]]
    """
    angle = math.radians(angle_deg)
    fraction = _fraction(rows, cols, cycles, angle, _LINES)
    r, c = (min(_CENTER - count % 2, count) for count in (rows, cols))
    r0, c0 = (rows - r) // 2, (cols - c) // 2
    fraction[r0 : r0 + r, c0 : c0 + c] = _fraction(r, c, cycles, angle, _CENTER_LINES)
    return fraction


def _fraction(rows: int, cols: int, cycles: int, angle: float, lines: int) -> Array:
    along_rows = _mean_along(rows, cols, cycles, angle, lines, across=False)
    along_cols = _mean_along(cols, rows, cycles, angle, lines, across=True).T
    up = np.abs(np.arange(rows) + 0.5 - rows / 2)[:, None]
    beside = np.abs(np.arange(cols) + 0.5 - cols / 2)[None, :]
    return np.where(up >= beside, along_rows, along_cols)


def _mean_along(count: int, samples: int, cycles: int, angle: float, lines: int, *, across: bool) -> Array:
    """(count, samples) fractions from bright lengths along rows, or with `across` along columns; `lines` in each."""
    place = (np.arange(count * lines) + 0.5) / lines - count / 2
    borders = np.arange(samples + 1) - samples / 2
    far = 2.0 * samples * lines  # outside the field on the line nearest to the center
    lengths = {side: _bright_length(cycles, angle, side, far, across=across) for side in (-1, 1)}
    fraction = np.zeros((count, samples))
    for line, distance in enumerate(place):
        # Coordinates increase to the right along a row, downwards along a column.
        ratio, length = lengths[1 if distance > 0 else -1]
        fraction[line // lines] += abs(distance) * np.diff(np.interp(borders / abs(distance), ratio, length))
    return np.clip(fraction / lines, 0.0, 1.0)  # rounding only


def _bright_length(cycles: int, angle: float, side: int, far: float, *, across: bool) -> tuple[Array, Array]:
    """Bright length along a line at distance 1 from the center, from the foot of its normal: places, and lengths there.

    For a line at another distance, both scale with it.
    """
    edges = angle + np.arange(2 * cycles) * math.pi / cycles
    # (down, right) of a unit step along each edge.
    down, right = -np.cos(edges), np.sin(edges)
    away, along = (right, down) if across else (down, right)
    met = side * away * far > 1.0  # the other edges meet the line outside the field, or never
    places = np.sort(along[met] / np.abs(away[met]))
    places = np.concatenate([[-far], places, [far]])
    middles = np.concatenate([[places[1] - 1.0], (places[1:-2] + places[2:-1]) / 2, [places[-2] + 1.0]])
    down_of, right_of = (middles, float(side)) if across else (float(side), middles)
    turn = (np.arctan2(right_of, -np.asarray(down_of)) - angle) * cycles / (2 * math.pi)
    bright = np.mod(turn, 1.0) < 0.5
    # Summed outwards from 0, so that lengths near the foot keep their digits.
    nodes = np.union1d(places, [0.0])
    state = bright[np.searchsorted(places, (nodes[:-1] + nodes[1:]) / 2) - 1]
    steps = np.where(state, np.diff(nodes), 0.0)
    zero = int(np.searchsorted(nodes, 0.0))
    length = np.zeros(nodes.size)
    length[zero + 1 :] = np.cumsum(steps[zero:])
    length[:zero] = -np.cumsum(steps[:zero][::-1])[::-1]
    return nodes, length
