"""Slanted edges: one, and a star of them."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from photosite.scene.charts import coverage
from photosite.scene.charts.chart import Chart, Contrast, Degrees, Samples, between, grey_chart, lit

_STRIP = 256


@lit()
def slanted_edge(
    *,
    angle_deg: Annotated[float, Field(gt=-45, lt=45)] = 5.0,
    contrast: Contrast = 4.0,
    rows: Samples = 400,
    cols: Samples = 400,
) -> Chart:
    """Straight edge (ISO 12233), dark on the left and bright on the right.

    Each sample holds the exact share of its area on the bright side.

    Parameters
    ----------
    angle_deg
        Clockwise from the vertical, above -45 and below 45 degrees.
    contrast
        Radiance of the bright side over that of the dark side, above 1; `math.inf` for a black side. ISO 12233 uses 4.
    rows, cols
        Samples.

    Raises
    ------
    InputError
        If an option is invalid.

    Examples
    --------
    >>> edge = slanted_edge(rows=40, cols=60, contrast=10)
    >>> edge.shape, round(float(edge.weights.max() / edge.weights.min()), 4)
    ((40, 60), 10.0)
    """
    slope = math.tan(math.radians(angle_deg))
    # Signed distance (along the row, in samples) of the edge from each sample's left border, at its centre row.
    edge_at = cols / 2 - slope * (np.arange(rows, dtype=np.float64) + 0.5 - rows / 2)
    bright = np.empty((rows, cols), np.float32)
    for first in range(0, rows, _STRIP):  # a whole frame of cells in double precision would be large
        offset = edge_at[first : first + _STRIP, None] - np.arange(cols)[None, :]
        bright[first : first + _STRIP] = between(1.0 - coverage.left_of_line(offset, abs(slope)), contrast)
    return grey_chart(bright, f"slanted edge, {angle_deg:g} degrees, contrast {contrast:g} : 1")


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

    Raises
    ------
    InputError
        If an option is invalid.

    Notes
    -----
    A sample's share is the mean of 16 lines across it, each of them exact: the error is up to 5e-4 where an edge cuts
    a sample's corner (`photosite.scene.charts.coverage.sector_share`).

    Examples
    --------
    >>> star = edge_star(contrast=float("inf"), angle_deg=0, cycles=2, rows=4, cols=4)   # four quadrants
    >>> star.weights[0, 0].tolist()
    [0.0, 0.0, 1.0, 1.0]
    """
    name = f"star of {2 * cycles} edges, turned by {angle_deg:g} degrees, contrast {contrast:g} : 1"
    return grey_chart(between(coverage.sector_share(rows, cols, cycles, angle_deg), contrast), name)
