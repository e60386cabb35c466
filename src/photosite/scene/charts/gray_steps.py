"""Chart of gray steps around its middle, for tone and noise."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from photosite.errors import InputError
from photosite.scene.charts.chart import Chart, Samples, gray_chart, lit
from photosite.values.region import Region

_RADIUS, _PATCH = 0.36, 0.8
"""Of the ring of patches over the height, and of a patch over the distance to the next one, on the diagonal."""
_BACKGROUND = 0.18
_MOST_ON_PAPER = 2.0
"""Range of density above which the chart is film."""
_INSET = 0.15
"""Part of a patch at each border that is outside of its region: blur reaches it."""


@lit()
def gray_steps(
    *,
    steps: Annotated[int, Field(ge=4, le=24)] = 12,
    density_range: Annotated[float, Field(gt=0, le=4)] = 1.6,
    rows: Samples = 360,
    cols: Samples = 480,
) -> Chart:
    """Gray squares in a ring on middle gray, whose densities are in equal steps (after ISO 14524 and ISO 15739).

    All patches have one distance from the middle, where lenses are alike. Printed on paper, 1.6 is near the largest
    range of density; on film, for transmitted light, up to 4. Above 2, the chart is film.

    Parameters
    ----------
    steps
        Patches, from 4 to 24. Neighbors are half of the range apart, so that stray light tilts no curve.
    density_range
        Density, the negative decimal logarithm of the reflectance, of the darkest patch over that of the brightest.
    rows, cols
        Samples.

    Returns
    -------
    Chart
        A region for each patch, "density 0.00" for the brightest.

    Examples
    --------
    >>> chart = gray_steps(steps=12)
    >>> chart.regions[0].name, chart.regions[11].name, len(chart.regions)
    ('density 0.00', 'density 1.60', 12)
    """
    size = min(rows, cols)
    side = int(_PATCH * 2.0 * math.pi * _RADIUS * size / steps / math.sqrt(2.0))
    side = min(side, int(2 * (0.5 - _RADIUS) * size) - 2)
    inset = math.ceil(_INSET * side)
    if side - 2 * inset < 4:
        raise InputError("rows", value=rows, expected=f"larger, for {steps} patches")
    pattern = np.full((rows, cols), _BACKGROUND)
    regions = []
    half = (steps + 1) // 2
    for number in range(steps):
        density = density_range * number / (steps - 1)
        # Bright and dark patches alternate along the ring.
        place = 2 * number if number < half else 2 * (number - half) + 1
        angle = 2.0 * math.pi * place / steps
        r = round(0.5 * rows - _RADIUS * size * math.cos(angle) - 0.5 * side)
        c = round(0.5 * cols + _RADIUS * size * math.sin(angle) - 0.5 * side)
        pattern[r : r + side, c : c + side] = 10.0**-density
        region = Region(f"density {density:.2f}", r + inset, r + side - inset, c + inset, c + side - inset)
        regions.append(region)
    name, film = f"{steps} gray steps over a density of {density_range:g}", density_range > _MOST_ON_PAPER
    return gray_chart(pattern, name, regions=tuple(regions), transmissive=film)
