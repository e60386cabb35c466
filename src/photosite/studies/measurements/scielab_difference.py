"""Pictures of a ColorChecker with errors of its colors and noise, against other pictures of the same camera."""

from __future__ import annotations

from dataclasses import dataclass
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
_NAME = "scielab-difference"
_OPTIONS = VIEWING | {"match_exposure": False}
_CAMERAS, _OTHERS = 12, 24
"""Cameras, and pictures of each whose mean is the truth: noise is seen, and adds to it. The error of the mean of 24
widens the scatter of the charts by 2 %."""
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


@dataclass(frozen=True)
class _Camera:
    """A clean picture with its noise, and the true values: means over other pictures."""

    clean: Array
    noise: Array
    truth: dict[tuple[str, str], float]


@cache
def _camera(number: int) -> _Camera:
    random = np.random.default_rng([number, *_NAME.encode()])
    clean = picture_of(reference_xyz() * (1.0 + random.normal(0.0, 0.05, (24, 3))))
    noise = random.uniform(0.005, 0.03) * np.sqrt(clean.clip(0.01))
    known = [
        measure(clean + noise * random.standard_normal(clean.shape), "macbeth", only=[_NAME], options={_NAME: _OPTIONS})
        for _ in range(_OTHERS)
    ]
    values = [each[_NAME] for each in known]
    return _Camera(clean, noise, {key: float(np.mean([each[key].value for each in values])) for key in values[0]})


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    camera = _camera(number % _CAMERAS)
    picture = camera.clean + camera.noise * random.standard_normal(camera.clean.shape)
    return HiddenChart(picture, "macbeth", camera.truth, _OPTIONS)


STUDY = MeasurementStudy(_draw, "twelve cameras: colors that are off by 5 %, noise of 0.5 to 3 % of white")
