"""Exact shares of samples: how much of each unit square a shape covers.

Coordinates are in samples and run over borders: sample i covers i to i + 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def left_of_line(offset: Array, slope: float) -> Array:
    """Share of a unit square left of a line that crosses its centre row at `offset` and drifts by `slope` per row.

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
    """(rows, cols) share of each sample that a disc covers.

    Parameters
    ----------
    rows, cols
        Samples.
    center_row, center_col, radius
        In samples.

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
        half_chord = np.sqrt(np.maximum(radius**2 - u**2, 0.0))  # u = R but for rounding
        return (u * half_chord + radius**2 * np.arcsin(u / radius)) / 2 + np.pi * radius**2 / 4

    reach = np.sqrt(np.maximum(radius**2 - y**2, 0.0))  # where |u| is below it, s(u) > |y|
    beyond = under_arc(np.minimum(x, -reach)) + under_arc(np.maximum(x, reach)) - under_arc(reach)
    area = under_arc(x) + np.sign(y) * beyond + y * (np.clip(x, -reach, reach) + reach)
    share: Array = np.diff(np.diff(area, axis=0), axis=1)
    return np.clip(share, 0.0, 1.0)  # differences of areas: rounding only, 1e-16 of the disc's


def square_wave(phase: Array, width: float) -> Array:
    """Mean of a square wave of period 1, +1 from 0 to 1/2 and -1 from 1/2 to 1, over `width` periods round a phase.

    Examples
    --------
    >>> square_wave(np.array([0.25, 0.5, 0.75]), 0.5).tolist()
    [1.0, 0.0, -1.0]
    """

    def integral(p: Array) -> Array:
        return 0.5 - np.abs(np.mod(p, 1.0) - 0.5)

    return (integral(phase + width / 2) - integral(phase - width / 2)) / width
