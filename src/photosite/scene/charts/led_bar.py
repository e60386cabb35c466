"""Lines of lamps of a running light, for exposure times."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from photosite.errors import InputError
from photosite.scene.charts import coverage
from photosite.scene.charts.chart import Chart, Samples, gray_chart, lit
from photosite.values.region import Region


@lit()
def led_bar(
    *,
    lamps: Annotated[int, Field(ge=6, le=200)] = 20,
    lines: Annotated[int, Field(ge=1, le=100)] = 5,
    rows: Samples = 240,
    cols: Samples = 480,
) -> Chart:
    """Lines of round lamps on black, all lit; a running light lights them one after the other, all lines alike.

    Parameters
    ----------
    lamps, lines
        Lamps in a line, and lines.
    rows, cols
        Samples.

    Returns
    -------
    Chart
        A region inside of each lamp: "lamp 1, 1" is the first of the first line.

    Examples
    --------
    >>> chart = led_bar(lamps=10, lines=2)
    >>> len(chart.regions), chart.regions[9].name
    (20, 'lamp 1, 10')
    """
    pitch = min(rows // lines, cols // lamps)
    diameter = pitch * 2 // 3
    if diameter < 8:
        raise InputError("lamps", value=lamps, expected=f"at most {cols // 12} in a line of {cols} samples")
    pattern = np.zeros((rows, cols))
    regions = []
    reach, half = diameter // 2 + 1, diameter // 4
    disc = coverage.disc(2 * reach, 2 * reach, reach, reach, diameter / 2)
    for line in range(lines):
        for lamp in range(lamps):
            r, c = (2 * line + 1) * rows // (2 * lines), (2 * lamp + 1) * cols // (2 * lamps)
            pattern[r - reach : r + reach, c - reach : c + reach] += disc
            regions.append(Region(f"lamp {line + 1}, {lamp + 1}", r - half, r + half, c - half, c + half))
    name = f"{lines} lines of {lamps} lamps"
    return gray_chart(np.clip(pattern, 0.0, 1.0), name, regions=tuple(regions))
