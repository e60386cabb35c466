"""Shading of fields with drawn falloff."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from photosite.develop.demosaic import demosaic
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measurement import FieldMap, Result
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy, Truth
from photosite.studies.virtual_charts import RGGB
from photosite.studies.virtual_fields import VirtualField, virtual_field
from photosite.studies.virtual_patches import LUMA_WEIGHTS

Array = NDArray[np.float64]

_CORNERS = {"top left": (0, 0), "top right": (0, -1), "bottom left": (-1, 0), "bottom right": (-1, -1)}


def cell_means(light: Callable[[Array, Array], Array], cells: FieldMap) -> Array:
    """Return the means over cells of a function of rows and columns, by Gauss-Legendre quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    row, col = ((at[:, None] + np.diff(at).mean() * nodes / 2).ravel() for at in (cells.row, cells.col))
    values = light(row, col).reshape(cells.row.size, 4, cells.col.size, 4)
    return np.asarray(np.einsum("iajb,a,b->ij", values, weights / 2, weights / 2))


def _truth(field: VirtualField, result: Result) -> Truth:
    cells = {each.part: each for each in result.maps}
    light = {name: cell_means(partial(field.relative, name), cells[name]) for name in "RGB"}
    truth: dict[tuple[str, str], float] = {}
    if "Y" in cells:
        light["Y"] = np.tensordot(LUMA_WEIGHTS, [light[name] for name in "RGB"], 1)
    for name, values in light.items():
        center = values[values.shape[0] // 2, values.shape[1] // 2]
        truth["shading_percent", name] = 100 * (1 - values.min() / values.max())
        truth["shading_stops", name] = float(np.log2(values.max() / values.min()))
        truth["nonuniformity_percent", name] = 100 * values.std() / values.mean()
        truth["corners_percent", name] = 100 * values[[0, 0, -1, -1], [0, -1, 0, -1]].mean() / center
        if name == max(cells, key=("R", "B", "R/G", "B/G", "G", "Y").index):
            truth |= {("corner_percent", part): 100 * values[at] / center for part, at in _CORNERS.items()}
            truth |= {("corner_stops", part): float(np.log2(values[at] / center)) for part, at in _CORNERS.items()}
    for name in "RB":
        ratio = light[name] / light["G"]
        change = ratio / ratio[ratio.shape[0] // 2, ratio.shape[1] // 2] - 1
        truth["color_shading_percent", f"{name}/G"] = 100 * np.abs(change).max()
    return truth


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    field = virtual_field(random, even=number % 4 == 3)
    image = ChartImage((field.electrons,), "electrons", RGGB)
    if number % 8 >= 5:
        levels = np.array([field.level[name] for name in "RGB"])
        image = ChartImage((demosaic(field.electrons, RGGB) / (_WHITE * levels),), "picture", white=1.0)
    return HiddenChart(image, "uniform", partial(_truth, field))


_WHITE = 1.5
"""Signal of white in developed pictures, over the brightest one."""
STUDY = MeasurementStudy(
    _draw,
    "falloff of 0 to 60 % and gradients of up to 10 %, of each channel its own; a quarter without; mosaics, and "
    "pictures developed from them",
)
