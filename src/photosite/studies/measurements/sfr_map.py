"""Responses over the field, of squares whose edges have blurs of their own."""

from __future__ import annotations

import numpy as np

from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import VirtualSquares, virtual_squares

SIZE = (3, 4)
PARTS = {
    "corners": [(r, c) for r in (0, 2) for c in (0, 3)],
    "field": [(r, c) for r in range(3) for c in range(4)],
}
DIRECTIONS = {"mtf50_vertical": True, "mtf50_horizontal": False}


def mean_mtf50(squares: VirtualSquares, name: str, part: str) -> float:
    """Return the mean over a part of the field of the MTF50 across edges of a direction."""
    return float(np.mean([squares.mtf50(place, DIRECTIONS[name]) for place in PARTS[part]]))


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    squares = virtual_squares(random, SIZE, move=3.0)
    truth = {(name, part): mean_mtf50(squares, name, part) for name in DIRECTIONS for part in PARTS}
    placing = {"chart_options": {"down": SIZE[0], "across": SIZE[1]}}
    return HiddenChart(squares.electrons, "slanted-squares", truth, placing=placing)


STUDY = MeasurementStudy(
    _draw, "blur 0.5 to 1.3 pixels for each edge, squares displaced by up to 3 pixels, 8000 electrons"
)
