"""Ghosts of a light source: its image in the lens surfaces, mirrored at the middle of the frame."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import FieldMap, Measurement, Quantity, Result
from photosite.values.estimate import Estimate
from photosite.values.region import Region
from photosite.values.uncertain import Uncertain, correlated

Array = NDArray[np.float64]

_INNER, _GAP, _REACH = 0.75, 1.5, 3.5
"""Radii over that of the ghost: up to which it is measured, and between which the light beside it is."""
_LEAST_PIXELS = 20
_LEAST_SIGMAS = 20.0
_CLIPPED_FRACTION = 1e-3
_MOST_PERCENT = 50.0
"""Light at the mirrored place over that of the source; more where the image shows no source."""
_MOST_BLURRED = 0.2
"""Light beside the source over that of the source."""
_CELLS = 60


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    size: Annotated[float, Field(gt=0)] = 1.0,
    source_signal: Annotated[float, Field(gt=0)] | None = None,
) -> Result:
    if not chart.patches:
        raise InputError("source", expected="in the frame")
    patch = chart.patches[0]
    middle = np.array([patch.r0 + patch.r1, patch.c0 + patch.c1]) / 2
    region, diameter = chart.scene.regions[0], float(chart.options["diameter"])
    radius = 0.25 * diameter * sum((patch.r1 - patch.r0, patch.c1 - patch.c0)) / (region.r1 - region.r0)
    ghost = np.array(image.shape) - middle
    reach = _REACH * size * radius
    if math.dist(middle, ghost) < reach + 2.0 * radius:
        raise InputError("source", expected="farther from the middle of the frame than its ghost is wide")
    if (ghost < reach).any() or (ghost > np.array(image.shape) - reach).any():
        raise InputError("source", expected=f"{reach:.0f} pixels or more from the borders of the frame")
    values: dict[tuple[str, str], Estimate] = {}
    maps: list[FieldMap] = []
    for channel in image.channels:
        source = _source(image, chart, channel) if source_signal is None else Uncertain(source_signal)
        _check_sharp(image, channel, middle, radius, source.value)
        excess, beside = _excess(image, channel, ghost, size * radius)
        if (beside + excess).value > 0.01 * _MOST_PERCENT * source.value:
            hint = "Check the chart, its corners and the exposure"
            raise InputError("light at the mirrored place", expected="below half of that of the source", hint=hint)
        values["ghost_percent", channel] = Estimate.of(excess / source * 100.0, "")
        values["glare_percent", channel] = Estimate.of(beside / source * 100.0, "")
        maps.append(_map(image, channel, middle, radius, source.value))
    return Result(values, (), tuple(maps), outlines=(_circle(middle, radius), _circle(ghost, size * radius)))


def _source(image: ChartImage, chart: PlacedChart, channel: str) -> Uncertain:
    patch = chart.patches[0]
    pixels = image.pixels(patch, channel).mean(axis=0)
    if pixels.size < _LEAST_PIXELS:
        raise InputError(f"{channel} pixels of the source", value=pixels.size, expected=f"{_LEAST_PIXELS} or more")
    if (clipped := image.saturated_fraction(patch, channel)) > _CLIPPED_FRACTION:
        hint = "Expose less, or set ghost.source_signal to its signal at this exposure"
        raise InputError("saturated fraction of the source", value=clipped, expected="at most 0.001", hint=hint)
    source = Uncertain.of(float(pixels.mean()), float(pixels.std(ddof=1)) / math.sqrt(pixels.size))
    if source.value <= 0 or not source.beyond(_LEAST_SIGMAS):
        raise InputError("signal of the source", expected="above its noise", hint="Expose more")
    return source


def _check_sharp(image: ChartImage, channel: str, middle: Array, radius: float, source: float) -> None:
    (r0, c0), (r1, c1) = (np.clip(middle + side * 2.0 * radius, 0, image.shape).round().astype(int) for side in (-1, 1))
    box = Region("source", int(r0), int(r1), int(c0), int(c1))
    mask = image.mask(channel, box)
    row, col = np.nonzero(mask)
    beside = np.hypot(row + 0.5 + r0 - middle[0], col + 0.5 + c0 - middle[1]) > _GAP * radius
    if image.plane(channel, box)[0][mask][beside].mean() > _MOST_BLURRED * source:
        hint = "Check the focus, the chart and its corners"
        raise InputError("light beside the source", expected="below a fifth of that of the source", hint=hint)


def _excess(image: ChartImage, channel: str, middle: Array, radius: float) -> tuple[Uncertain, Uncertain]:
    """Return the mean light of a ghost above that beside it, a plane, and the light beside it."""
    reach = _REACH * radius
    (r0, c0), (r1, c1) = np.floor(middle - reach).astype(int), np.ceil(middle + reach).astype(int)
    box = Region("ghost", int(r0), int(r1), int(c0), int(c1))
    row, col = (each + 0.5 for each in np.nonzero(image.mask(channel, box)))
    y, x = row + r0 - middle[0], col + c0 - middle[1]
    distance = np.hypot(y, x)
    inside = distance < _INNER * radius
    used = inside | ((distance > _GAP * radius) & (distance < reach))
    if inside.sum() < _LEAST_PIXELS:
        raise InputError(f"{channel} pixels of the ghost", value=int(inside.sum()), expected=f"{_LEAST_PIXELS} or more")
    value = image.plane(channel, box)[0][np.nonzero(image.mask(channel, box))]
    model = np.stack([inside, np.ones_like(y), y / reach, x / reach], axis=1)[used].astype(np.float64)
    inverse = np.linalg.inv(model.T @ model)
    found = inverse @ (model.T @ value[used])
    rest = value[used] - model @ found
    # Noise grows with the light: the covariance takes it from the residuals.
    covariance = inverse @ (model.T @ (rest[:, None] ** 2 * model)) @ inverse
    excess, beside = correlated(found, covariance)[:2]
    return excess, beside


def _map(image: ChartImage, channel: str, middle: Array, radius: float, source: float) -> FieldMap:
    """Return the light over that of the source, without the source and its surroundings."""
    rows, cols = image.shape
    plane, _ = image.plane(channel)
    mask = image.mask(channel, Region("frame", 0, rows, 0, cols))
    side = -(-max(rows, cols) // _CELLS)
    down, along = (np.arange(0, size, side) for size in (rows, cols))
    total, count = (
        np.add.reduceat(np.add.reduceat(each, down, axis=0), along, axis=1)
        for each in (np.where(mask, plane, 0.0), mask.astype(np.float64))
    )
    values = np.divide(100.0 * total, count * source, out=np.full_like(total, np.nan), where=count > 0)
    row, col = (
        np.asarray(0.5 * (each + np.minimum(each + side, size)), np.float64)
        for each, size in zip((down, along), (rows, cols), strict=True)
    )
    values[np.hypot(row[:, None] - middle[0], col - middle[1]) < 2.0 * radius + side] = np.nan
    return FieldMap(channel, "light over that of the source (%)", row, col, values)


def _circle(middle: Array, radius: float) -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    return middle + radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)


MEASUREMENT = Measurement(
    title="Ghost of a light source",
    standard="no standard; ISO 18844 leaves ghosts out",
    charts=("light-source",),
    measure=_measure,
    quantities={
        "ghost_percent": Quantity(
            "ghost level",
            "%",
            "Mean light within 3/4 of the radius of the source, mirrored at the middle of the frame, above a plane "
            "around it, over that of the source.",
        ),
        "glare_percent": Quantity(
            "glare beside the ghost", "%", "Light around the mirrored place over that of the source."
        ),
    },
    oracle="ghosts and glare drawn into frames; veiling glare of a simulated lens",
    left_out=(
        "Ghosts elsewhere, which the map shows, and an axis of the lens away from the middle of the frame. A ghost has "
        "the source's size times `size`; a larger one adds to the light around it. Noise of pixels is taken as "
        "independent."
    ),
    order=345,
    view="field",
    headline=("ghost_percent",),
    figure="map",
)
