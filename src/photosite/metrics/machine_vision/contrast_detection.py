"""Contrast detection probability: how often two pixels show the contrast of the surfaces that they see."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.tone.gray_patches import GRAY_CHARTS, gray_patches
from photosite.values.estimate import Estimate
from photosite.values.uncertain import COVERAGE_95, Uncertain

Array = NDArray[np.float64]

_MOST_PIXELS = 4096
"""Pixels of a patch and frame that are compared."""


def _measure(image: ChartImage, chart: PlacedChart, *, tolerance: Annotated[float, Field(gt=0, lt=1)] = 0.5) -> Result:
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    places = {patch.name: patch for patch in chart.patches}
    for channel in image.channels:
        patches = [patch for patch in gray_patches(image, chart, channel) if patch.luminance > 0]
        rows = []
        for dark, bright in pairwise(patches):
            contrast = bright.luminance / dark.luminance - 1.0
            if contrast <= 0:
                continue
            one, other = (_sampled(image.pixels(places[each.name], channel)) for each in (dark, bright))
            found = _probability(one, other, contrast, tolerance)
            estimate = Estimate.of(found, "", interval_95=_interval(found))
            values["probability", f"{channel}, {dark.name} and {bright.name}"] = estimate
            rows.append((dark.luminance, found.value, found.standard_uncertainty))
        if not rows:
            raise InputError("gray patches of different luminance", value=len(patches), expected="two or more")
        x, y, spread = np.array(rows).T
        unit = "cd/m2" if chart.known_light else "relative to a perfect diffuser"
        label = f"log luminance of the darker patch ({unit})"
        curves.append(Curve(channel, label, "contrast detection probability", x, y, spread))
    return Result(values, tuple(curves))


def _sampled(values: Array) -> Array:
    """Return pixels of all frames, of an even part of the patch."""
    step = -(-values.shape[1] // _MOST_PIXELS)
    return values[:, ::step].ravel()


def _probability(dark: Array, bright: Array, contrast: float, tolerance: float) -> Uncertain:
    """Return the part of all pairs whose contrast is within a tolerance of that of the surfaces.

    The uncertainty is that of a U-statistic of two samples, from its projections on each.
    """
    low, high = (1.0 + contrast * (1.0 + side * tolerance) for side in (-1.0, 1.0))
    ordered = np.sort(bright)
    inside = np.searchsorted(ordered, high * dark, "right") - np.searchsorted(ordered, low * dark, "left")
    by_dark = np.where(dark > 0, np.maximum(inside, 0), 0) / bright.size
    ordered = np.sort(dark[dark > 0])
    inside = np.searchsorted(ordered, bright / low, "right") - np.searchsorted(ordered, bright / high, "left")
    by_bright = np.maximum(inside, 0) / dark.size
    variance = float(by_dark.var(ddof=1)) / dark.size + float(by_bright.var(ddof=1)) / bright.size
    return Uncertain.of(float(by_dark.mean()), math.sqrt(variance))


def _interval(found: Uncertain) -> tuple[float, float]:
    """Return the 95 % interval within 0 and 1."""
    half = COVERAGE_95 * found.standard_uncertainty
    return max(found.value - half, 0.0), min(found.value + half, 1.0)


MEASUREMENT = Measurement(
    title="Contrast transfer accuracy (CTA, formerly contrast detection probability, CDP)",
    standard="IEEE P2020, as published by Geese, Seger and Paolillo, Electronic Imaging (2018)",
    charts=GRAY_CHARTS,
    measure=_measure,
    quantities={
        "probability": Quantity(
            "CTA (CDP)",
            "",
            "Part of the pairs of pixels whose contrast is within the tolerance of that of their patches.",
        ),
    },
    oracle="probability of Gaussian signals in closed form",
    left_out=(
        "Pairs are neighbors in luminance on the chart, single pixels. Contrast is the ratio of luminances less 1; its "
        "tolerance is 50 % by default."
    ),
    order=400,
)
