"""Spatial frequency response of a sine Siemens star, by sectors."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.sharpness.crossing import crossing
from photosite.values.estimate import Estimate

Array = NDArray[np.float64]

_STAR_RADIUS = 0.45
"""Of the star, relative to the chart's smaller side."""
_INSIDE = 0.95
"""Part of the radius that is used: the blur of the gray around the star reaches inside its border."""
_MOST_RINGS = 60
_LEAST_WIDTH_PX = 1.5
"""Of a ring in a channel that has every pixel."""
_LEAST_PIXELS = 10
_DIRECTIONS = "horizontal", "falling diagonal", "vertical", "rising diagonal"
"""Directions of the frequency, by the angle of the sector: spokes near the vertical have horizontal frequencies."""


def _measure(image: ChartImage, chart: PlacedChart, *, sectors: Annotated[int, Field(ge=8, le=64)] = 8) -> Result:
    if chart.options["waveform"] != "sine":
        raise InputError("waveform", value=chart.options["waveform"], expected="sine")
    cycles, contrast = int(chart.options["cycles"]), float(chart.options["contrast"])
    modulation = 1.0 if math.isinf(contrast) else (contrast - 1.0) / (contrast + 1.0)
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    for channel in image.channels:
        radius, angle, signal = _polar(image, chart, channel)
        region_pixels = chart.region.shape[0] * chart.region.shape[1]
        # Rings from the Nyquist frequency of the pixels to the border of the star.
        outer = _INSIDE * _STAR_RADIUS * min(chart.scene.shape) / chart.samples_per_pixel
        inner = max(cycles / math.pi, 4.0)
        if inner * 1.2 > outer:
            expected = f"{2.4 * inner:.0f} pixels or more, for {cycles} cycles"
            raise InputError("diameter of the star", value=2 * outer, expected=expected)
        width = _LEAST_WIDTH_PX * math.sqrt(region_pixels / radius.size)
        rings = min(math.ceil(math.log(outer / inner) / math.log1p(width / inner)), _MOST_RINGS)
        edges = np.geomspace(inner, outer, rings + 1)
        ring = np.searchsorted(edges, radius) - 1
        frequency = cycles / (2.0 * math.pi * 0.5 * (edges[1:] + edges[:-1]))
        sector = (np.floor((angle / (2.0 * math.pi) + 0.5 / sectors) * sectors).astype(np.intp)) % sectors
        response, spread = _fitted((ring, rings), (sector, sectors), (radius, angle, signal), cycles)
        response, spread = response / modulation, spread / modulation
        for part, chosen in _groups(sectors).items():
            level, error = _averaged(response[:, chosen], spread[:, chosen])
            name = f"{channel}, {part}" if part else channel
            shown = np.isfinite(level)
            x, y, u = frequency[shown][::-1], level[shown][::-1], error[shown][::-1]
            curves.append(Curve(name, "spatial frequency (cycles/pixel)", "star SFR", x, y, u))
            values["mtf50", name] = Estimate.of(crossing(x, y, u, 0.5), "")
            if not part:
                values["mtf10", name] = Estimate.of(crossing(x, y, u, 0.1), "")
    return Result(values, tuple(curves))


def _polar(image: ChartImage, chart: PlacedChart, channel: str) -> tuple[Array, Array, Array]:
    """Return radius in pixels, angle clockwise from the top in rad, and signal of the channel's pixels of the star."""
    region = chart.region
    plane, mask = image.plane(channel, region)[0], image.mask(channel, region)
    row, col = np.nonzero(mask)
    y, x = row + region.r0 + 0.5, col + region.c0 + 0.5
    at = chart.to_scene(np.column_stack([y, x]))
    down, along = (at[:, axis] - chart.scene.shape[axis] / 2 for axis in range(2))
    radius = np.hypot(down, along) / chart.samples_per_pixel
    return radius, np.arctan2(along, -down) % (2.0 * math.pi), plane[mask]


def _fitted(
    ring_of: tuple[NDArray[np.intp], int],
    sector_of: tuple[NDArray[np.intp], int],
    pixels: tuple[Array, Array, Array],
    cycles: int,
) -> tuple[Array, Array]:
    """Return (rings, sectors) modulations and their standard uncertainties, by least squares of a sine; NaN: no fit."""
    (ring, rings), (sector, sectors) = ring_of, sector_of
    radius, angle, signal = pixels
    used = (ring >= 0) & (ring < rings)
    place = ring[used] * sectors + sector[used]
    size = rings * sectors
    phase, value = cycles * angle[used], signal[used]
    # Slopes along the radius are part of the fit: rings are not thin, and light is uneven.
    middle = np.bincount(place, radius[used], size) / np.maximum(np.bincount(place, minlength=size), 1)
    away, cosine, sine = radius[used] - middle[place], np.cos(phase), np.sin(phase)
    terms = [np.ones_like(phase), cosine, sine, away, away * cosine, away * sine]
    count_of_terms = len(terms)
    normal = np.empty((size, count_of_terms, count_of_terms))
    right = np.empty((size, count_of_terms))
    for i, one in enumerate(terms):
        right[:, i] = np.bincount(place, one * value, size)
        for j, other in enumerate(terms[: i + 1]):
            normal[:, i, j] = normal[:, j, i] = np.bincount(place, one * other, size)
    count = normal[:, 0, 0]
    good = count >= _LEAST_PIXELS
    good[good] = np.linalg.cond(normal[good]) < 1e8
    fit = np.full((size, count_of_terms), np.nan)
    fit[good] = np.linalg.solve(normal[good], right[good][..., None])[..., 0]
    model = sum(fit[place, i] * term for i, term in enumerate(terms))
    rest = np.bincount(place, np.nan_to_num(value - model) ** 2, size)
    variance = rest / np.maximum(count - count_of_terms, 1)
    inverse = np.full(normal.shape, np.nan)
    inverse[good] = np.linalg.inv(normal[good])
    amplitude = np.hypot(fit[:, 1], fit[:, 2])
    error = np.sqrt(variance * 0.5 * (inverse[:, 1, 1] + inverse[:, 2, 2]))
    # Noise adds its variance to the square of the amplitude.
    unbiased = np.sign(amplitude**2 - error**2) * np.sqrt(np.abs(amplitude**2 - error**2))
    shape = (rings, sectors)
    return (unbiased / fit[:, 0]).reshape(shape), (error / fit[:, 0]).reshape(shape)


def _groups(sectors: int) -> dict[str, list[int]]:
    """Return the sectors of all directions, and of each of four."""
    found: dict[str, list[int]] = {"": list(range(sectors))}
    for number in range(sectors):
        found.setdefault(_DIRECTIONS[round(8 * number / sectors) % 4], []).append(number)
    return found


def _averaged(response: Array, spread: Array) -> tuple[Array, Array]:
    """Return means over sectors with their uncertainties; NaN where a sector is missing."""
    return response.mean(axis=1), np.sqrt((spread**2).sum(axis=1)) / response.shape[1]


MEASUREMENT = Measurement(
    title="Spatial frequency response of a star (s-SFR)",
    standard="ISO 12233:2023, sine-based response",
    charts=("siemens-star",),
    measure=_measure,
    quantities={
        "mtf50": Quantity("MTF50", "cycles/pixel", "Frequency at which the modulation is half that of the chart."),
        "mtf10": Quantity(
            "MTF10", "cycles/pixel", "Frequency at which the modulation is a tenth of that of the chart."
        ),
    },
    oracle="lens times pixel transfer function of simulated stars",
    left_out="Linearization by the gray patches beside the star: frames are proportional to light, or sRGB.",
    order=110,
    view="fine",
)
