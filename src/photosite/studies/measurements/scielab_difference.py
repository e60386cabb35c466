"""Pictures of a ColorChecker with errors of its colors and noise, against other pictures of the same camera."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import SRGB_FROM_XYZ, adaptation_to_d65
from photosite.metrics.chart_image import chart_image
from photosite.metrics.charts.placed_chart import PlacedChart, placed_chart
from photosite.metrics.measure import measure
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy

Array = NDArray[np.float64]

SHAPE = (396, 588)
VIEWING = {"pitch_mm": 0.3, "distance_mm": 350.0}
_OTHERS = 8
"""Pictures whose mean is the truth: noise is seen, and adds to it."""
_GAP = 4
"""Samples around the region of a patch that have its color."""


@cache
def viewed_chart() -> PlacedChart:
    """Return the chart that fills the picture."""
    return placed_chart(chart_image(np.ones(SHAPE)), "macbeth")


def reference_xyz() -> Array:
    """Return the (24, 3) colors of the chart under D65."""
    chart = viewed_chart()
    return np.asarray(chart.patch_xyz @ adaptation_to_d65(chart.white_xyz).T)


def picture_of(xyz: Array) -> Array:
    """Return the linear picture of a chart whose patches have these colors, black between them."""
    chart = viewed_chart()
    y, x = chart.to_scene_grid(*(np.arange(size, dtype=np.float64) + 0.5 for size in SHAPE))
    image = np.zeros((*SHAPE, 3))
    for region, color in zip(chart.scene.regions, xyz, strict=True):
        inside = (y > region.r0 - _GAP) & (y < region.r1 + _GAP) & (x > region.c0 - _GAP) & (x < region.c1 + _GAP)
        image[inside] = color
    return np.asarray(image @ SRGB_FROM_XYZ.T)


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    off = random.normal(0.0, 0.05, (24, 3))
    clean = picture_of(reference_xyz() * (1.0 + off))
    noise = random.uniform(0.005, 0.03) * np.sqrt(clean.clip(0.01))
    first, *others = (clean + noise * random.standard_normal(clean.shape) for _ in range(_OTHERS + 1))
    options = VIEWING | {"match_exposure": False}
    name = "scielab-difference"
    known = [measure(each, "macbeth", only=[name], options={name: options})[name] for each in others]
    truth = {key: float(np.mean([each[key].value for each in known])) for key in known[0]}
    return HiddenChart(first, "macbeth", truth, options)


STUDY = MeasurementStudy(_draw, "colors that are off by 5 %, noise of 0.5 to 3 % of white")
