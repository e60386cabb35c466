"""Contrast detection probability: how often two pixels show the contrast of the surfaces that they see."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.special import ndtri

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.tone.gray_patches import GRAY_CHARTS, GrayPatch, gray_patches
from photosite.values.estimate import Estimate
from photosite.values.uncertain import COVERAGE_95, Missing, Uncertain, Value, correlated

Array = NDArray[np.float64]

_MOST_PIXELS = 4096
"""Pixels of a patch and frame that are compared."""
_LEAST_CONTRAST = 0.05
"""Of a pair: charts repeat patches, whose luminances differ by less."""
_FEW_PIXELS = 5.0
"""Expected number of pixels, of those that show the contrast or of the others, below which they are too few for a
variance."""


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 0.5,
    detected: Annotated[float, Field(gt=0, lt=1)] = 0.5,
) -> Result:
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    places = {patch.name: patch for patch in chart.patches}
    for channel in image.channels:
        patches = [patch for patch in gray_patches(image, chart, channel) if patch.luminance > 0 and not patch.uneven]
        pairs = list(pairwise(_distinct(patches)))
        pixels = {patch.name: _sampled(image.pixels(places[patch.name], channel)) for patch in patches}
        rows = []
        shown: list[tuple[float, Uncertain]] = []
        for (dark, bright), found in zip(pairs, _probabilities(pairs, pixels, tolerance), strict=True):
            count = min(pixels[dark.name].size, pixels[bright.name].size)
            estimate = Estimate.of(found, "", interval_95=_interval(found, count))
            values["probability", f"{channel}, {dark.name} and {bright.name}"] = estimate
            rows.append((dark.luminance, found.value, found.standard_uncertainty))
            if not bright.clipped:
                shown.append((dark.luminance, found))
        if not rows:
            raise InputError("gray patches of different luminance", value=len(patches), expected="two or more")
        values["dynamic_range_db", channel] = Estimate.of(_range_db(image, patches, shown, detected), "")
        x, y, spread = np.array(rows).T
        unit = "cd/m2" if chart.known_light else "relative to a perfect diffuser"
        label = f"log luminance of the darker patch ({unit})"
        curves.append(Curve(channel, label, "contrast detection probability", x, y, spread))
    return Result(values, tuple(curves))


def _distinct(patches: list[GrayPatch]) -> list[GrayPatch]:
    """Return the patches, dark to bright, of which each is brighter than the one before it."""
    kept = patches[:1]
    for patch in patches[1:]:
        if patch.luminance > (1.0 + _LEAST_CONTRAST) * kept[-1].luminance:
            kept.append(patch)
    return kept


def _sampled(values: Array) -> Array:
    """Return pixels of all frames, of an even part of the patch."""
    step = -(-values.shape[1] // _MOST_PIXELS)
    return values[:, ::step].ravel()


def _probabilities(
    pairs: list[tuple[GrayPatch, GrayPatch]], pixels: dict[str, Array], tolerance: float
) -> list[Uncertain]:
    """Return for each pair of patches the part of the pixels' pairs that has its contrast within a tolerance.

    The uncertainty is that of a U-statistic of two samples, from its projections on each. Neighbors share a patch.
    """
    values = []
    projections: dict[str, dict[int, Array]] = {}
    for number, (dark, bright) in enumerate(pairs):
        contrast = bright.luminance / dark.luminance - 1.0
        by_dark, by_bright = _projections(pixels[dark.name], pixels[bright.name], contrast, tolerance)
        values.append(Uncertain(float(by_dark.mean())))
        projections.setdefault(dark.name, {})[number] = by_dark
        projections.setdefault(bright.name, {})[number] = by_bright
    for each in projections.values():
        covariance = np.atleast_2d(np.cov(np.stack(list(each.values())))) / next(iter(each.values())).size
        for number, change in zip(each, correlated(np.zeros(len(each)), covariance), strict=True):
            values[number] = values[number] + change
    return values


def _projections(dark: Array, bright: Array, contrast: float, tolerance: float) -> tuple[Array, Array]:
    """Return for each dark pixel the part of the bright ones with a contrast within the tolerance, and the reverse."""
    low, high = (1.0 + contrast * (1.0 + side * tolerance) for side in (-1.0, 1.0))
    ordered = np.sort(bright)
    inside = np.searchsorted(ordered, high * dark, "right") - np.searchsorted(ordered, low * dark, "left")
    by_dark = np.where(dark > 0, np.maximum(inside, 0), 0) / bright.size
    ordered = np.sort(dark[dark > 0])
    inside = np.searchsorted(ordered, bright / low, "right") - np.searchsorted(ordered, bright / high, "left")
    return by_dark, np.maximum(inside, 0) / dark.size


def _range_db(
    image: ChartImage, patches: list[GrayPatch], shown: list[tuple[float, Uncertain]], detected: float
) -> Value:
    """Return the luminance at saturation over the lowest from which on all pairs reach a probability, in dB.

    Between two pairs the logarithm of the standard score follows a line over that of the luminance: the score is
    proportional to the signal over its noise.
    """
    clear = [patch for patch in patches if not patch.clipped]
    if math.isinf(image.white):
        return Missing("the image has no level of saturation")
    below = next((number for number in reversed(range(len(shown))) if shown[number][1].value < detected), None)
    if below is None:
        return Missing(f"all pairs of patches reach a probability of {detected:g}")
    if below == len(shown) - 1:
        return Missing(f"the brightest patches do not reach a probability of {detected:g}")
    (dark, one), (bright, other) = shown[below : below + 2]
    if one.value <= 0.0 or other.value >= 1.0:
        return Missing("pairs of patches are too far apart in luminance")
    score = math.log(_score(detected))
    low, high = (each.apply(lambda p: math.log(_score(p)), _slope) for each in (one, other))
    part = (low - score) / (low - high)
    brightest = clear[-1]
    saturation = (image.white - image.black) / brightest.mean * (brightest.luminance / dark)
    return saturation.decibel(20.0) - part * (20.0 * math.log10(bright / dark))


def _score(probability: float) -> float:
    """Return how many standard deviations a normal variable is within, of a probability."""
    return float(ndtri(0.5 * (1.0 + probability)))


def _slope(probability: float) -> float:
    """Return the derivative of the logarithm of the score."""
    score = _score(probability)
    return 0.5 * math.sqrt(2.0 * math.pi) * math.exp(0.5 * score**2) / score


def _interval(found: Uncertain, pixels: int) -> tuple[float, float]:
    """Return the 95 % interval of Wilson, J. Am. Stat. Assoc. 22 (1927) 209, within 0 and 1.

    The number of independent pairs is that with the same variance. Where a few pixels decide, they do not show the
    variance, and the number is that of the pixels, its least (Hoeffding, Ann. Math. Stat. 19 (1948) 293).
    """
    p, variance = found.value, found.standard_uncertainty**2
    few = min(p, 1.0 - p) * pixels < _FEW_PIXELS
    count = float(pixels) if few or variance == 0.0 else p * (1.0 - p) / variance
    square = COVERAGE_95**2 / count
    half = math.sqrt(square * (p * (1.0 - p) + 0.25 * square))
    low, high = ((p + 0.5 * square + side * half) / (1.0 + square) for side in (-1.0, 1.0))
    return low, high


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
        "dynamic_range_db": Quantity(
            "dynamic range by CTA",
            "dB",
            "Luminance at saturation over the lowest from which on all pairs of patches reach a probability of "
            "`detected`; dips of combined captures end it.",
        ),
    },
    oracle="probability of Gaussian signals in closed form",
    left_out=(
        "Pairs are neighbors in luminance on the chart whose contrast is above 5 %, single pixels. Contrast is the "
        "ratio of luminances less 1; its tolerance is 50 % by default. The standard's text was not at hand: the "
        "probability of `detected` is a choice."
    ),
    order=400,
    headline=("dynamic_range_db",),
    figure="curves",
)
