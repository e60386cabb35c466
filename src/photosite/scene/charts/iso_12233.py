"""Resolution targets of ISO 12233: slanted edge, slanted squares, star of edges, and Siemens star."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.scene.charts import coverage
from photosite.scene.charts.chart import Chart, Contrast, Degrees, Samples, between, gray_chart, lit
from photosite.scene.charts.patterns import Waveform
from photosite.values.region import Region

_STRIP = 256
_RADIUS = 0.45
"""Of the Siemens star, relative to the field's smaller side."""
_PATCH = 0.07
"""Side of a gray patch in the corners, relative to the field's smaller side: two by two patches clear the star."""
_LEVELS = 16
_LEAST_HALF, _INNER = 4, 0.6
"""Of a slanted square: half its side in samples, and the part of it that the region inside it has."""
_LEAST_SIDE = 96
"""Samples of the smaller side that gray patches of 6 samples need."""


@lit()
def slanted_edge(
    *,
    angle_deg: Annotated[float, Field(gt=-45, lt=45)] = 5.0,
    contrast: Contrast = 4.0,
    rows: Samples = 400,
    cols: Samples = 400,
) -> Chart:
    """Straight edge (ISO 12233), dark on the left and bright on the right.

    Each sample holds the exact fraction of its area on the bright side.

    Parameters
    ----------
    angle_deg
        Clockwise from the vertical, above -45 and below 45 degrees.
    contrast
        Radiance of the bright side over that of the dark side, above 1; `math.inf` for a black side. ISO 12233 uses 4.
    rows, cols
        Samples.

    Examples
    --------
    >>> edge = slanted_edge(rows=40, cols=60, contrast=10)
    >>> edge.shape, round(float(edge.weights.max() / edge.weights.min()), 4)
    ((40, 60), 10.0)
    """
    slope = math.tan(math.radians(angle_deg))
    # Signed distance (along the row, in samples) of the edge from each sample's left border, at its center row.
    edge_at = cols / 2 - slope * (np.arange(rows, dtype=np.float64) + 0.5 - rows / 2)
    bright = np.empty((rows, cols), np.float32)
    for first in range(0, rows, _STRIP):  # a whole frame of cells in double precision would be large
        offset = edge_at[first : first + _STRIP, None] - np.arange(cols)[None, :]
        bright[first : first + _STRIP] = between(1.0 - coverage.left_of_line(offset, abs(slope)), contrast)
    return gray_chart(bright, f"slanted edge, {angle_deg:g} degrees, contrast {contrast:g} : 1")


@lit()
def slanted_squares(
    *,
    down: Annotated[int, Field(ge=2, le=64)] = 5,
    across: Annotated[int, Field(ge=2, le=64)] = 7,
    angle_deg: Annotated[float, Field(ge=1, le=15)] = 5.0,
    side: Annotated[float, Field(ge=0.2, le=0.6)] = 0.5,
    contrast: Contrast = 4.0,
    rows: Samples = 400,
    cols: Samples = 560,
) -> Chart:
    """Dark squares on a bright field, each turned by a few degrees: edges for a map of the response over the field.

    Each sample holds the exact fraction of its area in a square, but for the samples at the corners of squares.

    Parameters
    ----------
    down, across
        Squares along the columns and along the rows, evenly over the field.
    angle_deg
        Clockwise rotation of the squares, from 1 to 15 degrees.
    side
        Side of a square over the smaller of the distances between squares.
    contrast
        Radiance of bright over that of dark, above 1; `math.inf` for black. ISO 12233 uses 4.
    rows, cols
        Samples.

    Returns
    -------
    Chart
        A region inside each square, "square 1" at the top left to the last at the bottom right, along the rows.

    Examples
    --------
    >>> squares = slanted_squares(down=2, across=3, rows=80, cols=120)
    >>> len(squares.regions), round(float((1 - squares.weights).sum() / 0.75))   # 6 squares of 20 by 20 samples
    (6, 2400)
    """
    pitch = rows / down, cols / across
    half = 0.5 * side * min(pitch)
    if half < _LEAST_HALF:
        expected = f"{2 * _LEAST_HALF} samples or more ({rows} x {cols})"
        raise InputError("side of the squares", value=2 * half, expected=expected)
    bright = np.ones((rows, cols), np.float32)
    inner = int(_INNER * half)
    regions = []
    for number in range(down * across):
        row, col = (pitch[0] * (number // across + 0.5), pitch[1] * (number % across + 0.5))
        reach = math.ceil(half * (1.0 + math.tan(math.radians(angle_deg)))) + 1
        r0, c0 = max(int(row) - reach, 0), max(int(col) - reach, 0)
        part = bright[r0 : int(row) + reach + 1, c0 : int(col) + reach + 1]
        inside = coverage.turned_square(part.shape, (row - r0, col - c0), half, math.radians(angle_deg))
        part[:] = between(1.0 - inside, contrast)
        y, x = round(row), round(col)
        regions.append(Region(f"square {number + 1}", y - inner, y + inner, x - inner, x + inner))
    name = f"{down} x {across} squares, turned by {angle_deg:g} degrees, contrast {contrast:g} : 1"
    return gray_chart(bright, name, regions=tuple(regions))


@lit()
def edge_star(
    *,
    cycles: Annotated[int, Field(ge=1, le=32)] = 4,
    angle_deg: Degrees = 5.0,
    contrast: Contrast = 4.0,
    rows: Samples = 400,
    cols: Samples = 400,
) -> Chart:
    """Star of edges in many directions (ISO 12233): bright and dark sectors in turn.

    Four cycles turned by 5 degrees have edges 5 degrees from the vertical, the horizontal and both diagonals.

    Parameters
    ----------
    cycles
        Bright sectors, and as many dark ones, from 1 to 32; see `siemens_star` for more.
    angle_deg
        Clockwise rotation of the star; at 0 an edge is vertical and the sector to the right of its top is bright.
    contrast
        Radiance of bright over that of dark, above 1; `math.inf` for black. ISO 12233 uses 4.
    rows, cols
        Samples.

    Notes
    -----
    A sample's fraction is the mean of 16 lines across it, each exact: the error is up to 5e-4 where an edge cuts a
    sample's corner (`photosite.scene.charts.coverage.sector_fraction`).

    Examples
    --------
    >>> star = edge_star(contrast=float("inf"), angle_deg=0, cycles=2, rows=4, cols=4)   # four quadrants
    >>> star.weights[0, 0].tolist()
    [0.0, 0.0, 1.0, 1.0]
    """
    name = f"star of {2 * cycles} edges, turned by {angle_deg:g} degrees, contrast {contrast:g} : 1"
    return gray_chart(between(coverage.sector_fraction(rows, cols, cycles, angle_deg), contrast), name)


@lit()
def siemens_star(
    *,
    cycles: Annotated[int, Field(ge=1, le=1024)] = 144,
    waveform: Waveform = "sine",
    contrast: Contrast = math.inf,
    patches: bool = True,
    rows: Samples = 512,
    cols: Samples = 512,
) -> Chart:
    """Siemens star (ISO 12233's s-SFR star).

    At r samples from the center the frequency is cycles / (2 pi r) per sample.

    Parameters
    ----------
    cycles
        Around the circle, from 1 to 1024; ISO 12233 uses 144.
    waveform
        "sine", whose modulation is all that a camera changes, or "square".
    contrast
        Radiance of the brightest over that of the darkest, above 1; `math.inf` for full modulation. A sine of contrast
        c has the modulation (c - 1) / (c + 1).
    patches
        Sixteen grays in the corners, in equal steps from the star's darkest to its brightest, to linearize the camera's
        response. They need 96 samples or more on the smaller side.
    rows, cols
        Samples. The star's radius is 0.45 of the smaller side; around it is the mean of bright and dark.

    Returns
    -------
    Chart
        A region for each gray patch, "gray 0" to "gray 15".

    Notes
    -----
    ISO 12233:2017, the sine-based star. A sine's mean over a sample is by Gauss-Legendre quadrature, with points as
    dense as its phase changes: the error is below 1e-9, and 1e-3 in the four samples at the center, where a hundred
    cycles pass. A square wave's error is below 5e-4, as in `edge_star`.

    Examples
    --------
    >>> star = siemens_star(cycles=36, rows=128, cols=128)
    >>> len(star.regions), round(float(star.weights[0, 64, 2]), 6)   # beside the star
    (16, 0.5)
    """
    if patches and min(rows, cols) < _LEAST_SIDE:
        expected = f"False with fewer than {_LEAST_SIDE} rows or cols ({rows} x {cols})"
        raise InputError("patches", value=patches, expected=expected)
    spokes = _sine(rows, cols, cycles) if waveform == "sine" else coverage.sector_fraction(rows, cols, cycles, 0.0)
    # A sample cut by the star's border holds its fraction of spokes, taken as the mean over the whole sample.
    inside = coverage.disc(rows, cols, rows / 2, cols / 2, _RADIUS * min(rows, cols))
    fraction = 0.5 + inside * (spokes - 0.5)
    regions = _add_grays(fraction) if patches else ()
    return gray_chart(between(fraction, contrast), f"Siemens star of {cycles} cycles, {waveform}", regions=regions)


def _add_grays(fraction: NDArray[np.float64]) -> tuple[Region, ...]:
    """Write the grays into the corners; return their regions, less a border for blur."""
    rows, cols = fraction.shape
    side = int(_PATCH * min(rows, cols))
    inset = max(1, side // 8)
    regions = []
    for level in range(_LEVELS):
        corner, place = divmod(level, 4)
        down = (place // 2) * side if corner < 2 else rows - 2 * side + (place // 2) * side
        along = (place % 2) * side if corner % 2 == 0 else cols - 2 * side + (place % 2) * side
        fraction[down : down + side, along : along + side] = level / (_LEVELS - 1)
        regions.append(Region(f"gray {level}", down + inset, down + side - inset, along + inset, along + side - inset))
    return tuple(regions)


def _sine(rows: int, cols: int, cycles: int) -> NDArray[np.float64]:
    """(rows, cols) means of 1/2 + 1/2 cos(cycles * angle) in the star, 1/2 beside it."""
    quarter = _quarter_of_sine(rows, cols, cycles)
    top = np.hstack([quarter, quarter[:, : cols // 2][:, ::-1]])
    mirrored = top[: rows // 2][::-1]
    return np.vstack([top, 1 - mirrored if cycles % 2 else mirrored])


def _quarter_of_sine(rows: int, cols: int, cycles: int) -> NDArray[np.float64]:
    """The upper left quarter, by quadrature with as many points as the phase needs."""
    row = np.arange((rows + 1) // 2) + 0.5 - rows / 2
    col = np.arange((cols + 1) // 2) + 0.5 - cols / 2
    radius = np.hypot(row[:, None], col[None, :])
    # Phase across a sample, rad, at its inner corner; the angle itself bends as that of eight cycles.
    turn = max(cycles, 8) / np.maximum(radius - math.sqrt(0.5), 1e-3)
    turn[radius > _RADIUS * min(rows, cols) + 1] = math.inf
    mean = np.full(radius.shape, 0.5)
    below = 0.0
    orders = (2, 0.04), (3, 0.3), (4, 0.5), (6, 1.5), (10, 6.0), (16, 16.0), (48, 80.0), (128, 1e7)
    for order, most in orders:
        here = np.nonzero((turn > below) & (turn <= most))
        below = most
        nodes, weights = np.polynomial.legendre.leggauss(order)
        total = np.zeros(here[0].size)
        for dy, weight_y in zip(nodes / 2, weights / 2, strict=True):
            for dx, weight_x in zip(nodes / 2, weights / 2, strict=True):
                angle = np.arctan2(col[here[1]] + dx, row[here[0]] + dy)
                total += weight_y * weight_x * np.cos(cycles * angle)
        mean[here] = 0.5 + 0.5 * total
    return mean
