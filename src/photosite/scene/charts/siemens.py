"""The Siemens star: every spatial frequency in every direction, increasing towards the centre."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.scene.charts import coverage
from photosite.scene.charts.chart import Chart, Contrast, Samples, between, grey_chart, lit
from photosite.scene.charts.gratings import Waveform
from photosite.values.region import Region

_RADIUS = 0.45
"""Of the star, relative to the field's smaller side."""
_PATCH = 0.07
"""Side of a grey patch in the corners, relative to the field's smaller side: two by two patches clear the star."""
_LEVELS = 16
_LEAST_SIDE = 96
"""Samples of the smaller side that grey patches of 6 samples need."""


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

    At r samples from the centre the frequency is cycles / (2 pi r) per sample.

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
        Sixteen greys in the corners, in equal steps from the star's darkest to its brightest, to linearize the camera's
        response. They need 96 samples or more on the smaller side.
    rows, cols
        Samples. The star's radius is 0.45 of the smaller side; around it is the mean of bright and dark.

    Returns
    -------
    Chart
        A region for each grey patch, "grey 0" to "grey 15".

    Raises
    ------
    InputError
        If an option is invalid.

    Notes
    -----
    ISO 12233:2017, the sine-based star. A sine's mean over a sample is by Gauss-Legendre quadrature, with points as
    dense as its phase changes: the error is below 1e-9, and 1e-3 in the four samples at the centre, where a hundred
    cycles pass. A square wave's error is below 5e-4, as in `edge_star`.

    Examples
    --------
    >>> star = siemens_star(cycles=36, rows=128, cols=128)
    >>> len(star.regions), round(float(star.weights[0, 64, 2]), 6)   # beside the star
    (16, 0.5)
    """
    if patches and min(rows, cols) < _LEAST_SIDE:
        raise InputError(
            "patches", value=patches, expected=f"False with fewer than {_LEAST_SIDE} rows or cols ({rows} x {cols})"
        )
    spokes = _sine(rows, cols, cycles) if waveform == "sine" else coverage.sector_share(rows, cols, cycles, 0.0)
    # A sample cut by the star's border holds its share of spokes, taken as the mean over the whole sample.
    inside = coverage.disc(rows, cols, rows / 2, cols / 2, _RADIUS * min(rows, cols))
    share = 0.5 + inside * (spokes - 0.5)
    regions = _add_greys(share) if patches else ()
    return grey_chart(between(share, contrast), f"Siemens star of {cycles} cycles, {waveform}", regions=regions)


def _add_greys(share: NDArray[np.float64]) -> tuple[Region, ...]:
    """Write the greys into the corners; return their regions, less a border for blur."""
    rows, cols = share.shape
    side = int(_PATCH * min(rows, cols))
    inset = max(1, side // 8)
    regions = []
    for level in range(_LEVELS):
        corner, place = divmod(level, 4)
        down = (place // 2) * side if corner < 2 else rows - 2 * side + (place // 2) * side
        along = (place % 2) * side if corner % 2 == 0 else cols - 2 * side + (place % 2) * side
        share[down : down + side, along : along + side] = level / (_LEVELS - 1)
        regions.append(Region(f"grey {level}", down + inset, down + side - inset, along + inset, along + side - inset))
    return tuple(regions)


def _sine(rows: int, cols: int, cycles: int) -> NDArray[np.float64]:
    """(rows, cols) means of 1/2 + 1/2 cos(cycles * angle), by quadrature with as many points as the phase needs."""
    row = np.arange(rows) + 0.5 - rows / 2
    col = np.arange(cols) + 0.5 - cols / 2
    radius = np.hypot(row[:, None], col[None, :])
    turn = cycles / np.maximum(radius - math.sqrt(0.5), 1e-3)  # phase across a sample, rad, at its inner corner
    mean = np.empty((rows, cols))
    below = 0.0
    for order, most in ((4, 0.5), (6, 1.5), (10, 6.0), (16, 16.0), (48, 80.0), (128, math.inf)):
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
