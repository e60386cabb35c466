"""Chart of light traps for flare: black discs on a white field."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from photosite.errors import InputError
from photosite.scene.charts import coverage
from photosite.scene.charts.chart import Chart, Samples, gray_chart, lit
from photosite.values.region import Region

_DOWN, _ACROSS = 3, 5


@lit()
def flare_traps(*, diameter: Annotated[int, Field(ge=8)] = 20, rows: Samples = 256, cols: Samples = 384) -> Chart:
    """Black discs on a white field, three rows of five (after ISO 18844): light in them is flare.

    Parameters
    ----------
    diameter
        Of the discs, in samples, up to a third of the distance between them.
    rows, cols
        Samples.

    Returns
    -------
    Chart
        Regions "trap 1" to "trap 15", along the rows, and for each "white 1 left" and "white 1 right" beside it.

    Examples
    --------
    >>> chart = flare_traps()
    >>> len(chart.regions), round(1 - float(chart.weights.mean()), 4)   # 15 discs of diameter 20
    (45, 0.0479)
    """
    pitch = min(rows // _DOWN, cols // _ACROSS)
    if 3 * diameter > pitch:
        raise InputError("diameter", value=diameter, expected=f"at most {pitch // 3}, a third of their distance")
    bright = np.ones((rows, cols))
    regions = []
    half = diameter // 4
    for number in range(_DOWN * _ACROSS):
        row, col = divmod(number, _ACROSS)
        r, c = (2 * row + 1) * rows // (2 * _DOWN), (2 * col + 1) * cols // (2 * _ACROSS)
        size = 2 * (diameter // 2 + 1)
        r0, c0 = r - size // 2, c - size // 2
        bright[r0 : r0 + size, c0 : c0 + size] -= coverage.disc(size, size, size / 2, size / 2, diameter / 2)
        for name, at in ((f"trap {number + 1}", c), *_white(number, c, diameter)):
            regions.append(Region(name, r - half, r + half, at - half, at + half))
    name = f"{_DOWN * _ACROSS} light traps of diameter {diameter}"
    return gray_chart(np.maximum(bright, 0.0), name, regions=tuple(regions))


def _white(number: int, col: int, diameter: int) -> tuple[tuple[str, int], tuple[str, int]]:
    return (f"white {number + 1} left", col - diameter), (f"white {number + 1} right", col + diameter)
