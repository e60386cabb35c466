"""A light source on a dark field, for ghosts."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from photosite.errors import InputError
from photosite.scene.charts import coverage
from photosite.scene.charts.chart import Chart, Contrast, Samples, gray_chart, lit
from photosite.values.region import Region

Fraction = Annotated[float, Field(ge=0, le=1)]


@lit()
def light_source(
    *,
    down: Fraction = 0.3,
    across: Fraction = 0.3,
    diameter: Annotated[int, Field(ge=8)] = 38,
    contrast: Contrast = 10000.0,
    rows: Samples = 256,
    cols: Samples = 384,
) -> Chart:
    """Bright disc on a dark field, away from the middle: light elsewhere is glare, and ghosts are its images.

    Parameters
    ----------
    down, across
        Place of the disc, as parts of the height and width.
    diameter
        Of the disc, in samples; by default more than 1 % of the field, so that automatic exposures do not saturate it.
    contrast
        Radiance of the disc over that of the field; `math.inf` for a black field.
    rows, cols
        Samples.

    Returns
    -------
    Chart
        The region "source", a square inside of the disc with half of its diameter as side.

    Examples
    --------
    >>> chart = light_source()
    >>> chart.regions[0].r0, chart.regions[0].c1
    (68, 124)
    """
    r, c = round(down * rows), round(across * cols)
    reach = diameter // 2 + 1
    if min(r, c, rows - r, cols - c) < reach:
        raise InputError("down, across", value=(down, across), expected=f"{reach} samples or more from the borders")
    part = np.zeros((rows, cols))
    part[r - reach : r + reach, c - reach : c + reach] = coverage.disc(2 * reach, 2 * reach, reach, reach, diameter / 2)
    half = diameter // 4
    region = Region("source", r - half, r + half, c - half, c + half)
    dark = 1.0 / contrast
    name = f"light source of diameter {diameter}"
    return gray_chart(np.clip(dark + (1.0 - dark) * part, 0.0, 1.0), name, regions=(region,), transmissive=True)
