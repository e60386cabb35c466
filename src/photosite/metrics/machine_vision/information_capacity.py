"""Shannon information capacity and noise-equivalent quanta, from an edge and the noise beside it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.plane_fit import without_plane
from photosite.metrics.sharpness.edge_region import check_blur, check_edge, edge_region
from photosite.metrics.sharpness.slanted_edge import SlantedEdge, slanted_edge_mtf
from photosite.values.cfa import MONOCHROME
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain

Array = NDArray[np.float64]

_ORDER, _REACH_PX = 5, 32.0
"""As for the response of edges."""
_WINDOW_BANDWIDTH = 1.22
"""Equivalent noise bandwidth of the edge's window, over the inverse of its width: errors within it are alike."""
_CLEAR_OF_EDGE_PX = 12.0
_UNIFORM = 12.0
"""Range over the variance of a uniform distribution, squared."""
_LEAST_PIXELS = 200


def _measure(image: ChartImage, chart: PlacedChart) -> Result:
    region = edge_region(image, chart.region, _REACH_PX)
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    for channel in image.channels:
        plane, tile = image.plane(channel, region)
        mask = image.mask(channel, region)
        check_edge(image, plane, mask, channel)
        name = channel if tile != MONOCHROME else None
        edge = slanted_edge_mtf(plane, channel=name, cfa=tile, order=_ORDER, reach_px=_REACH_PX)
        check_blur(edge, _REACH_PX)
        (dark, dark_noise), (bright, bright_noise) = sides_of_edge(plane, mask, edge)
        # The noise of one frame: the mean of several has its fraction.
        noise = (dark_noise + bright_noise) * (0.5 * len(image.frames))
        if noise.value <= 0:
            raise InputError("noise beside the edge", value=noise.value, expected="above 0")
        density = noise / image.density(channel)  # variance per unit area of frequencies, of one channel's sites
        frequency, response = edge.frequency_cycles_per_pixel, edge.mtf
        shown = frequency <= 0.5
        f, mtf, spread = frequency[shown], response[shown], edge.standard_uncertainty[shown]
        power = (bright - dark) * (bright - dark) * (1.0 / _UNIFORM)
        values["capacity", channel] = Estimate.of(_capacity(f, mtf, spread, power / density), "")
        level = (bright + dark) * 0.5
        neq = level.value**2 * mtf**2 / density.value
        relative = np.hypot(2.0 * spread / np.maximum(mtf, 1e-9), density.relative)
        label = "noise-equivalent quanta (per pixel)"
        curves.append(Curve(channel, "spatial frequency (cycles/pixel)", label, f, neq, neq * relative))
        zero = (level * level) / density
        values["neq_zero", channel] = Estimate.of(zero, "")
    return Result(values, tuple(curves))


def sides_of_edge(plane: Array, mask: NDArray[np.bool_], edge: SlantedEdge) -> list[tuple[Uncertain, Uncertain]]:
    """Return mean and variance of the pixels on the dark and on the bright side, after a plane is fitted to them."""
    row, col = np.nonzero(mask)
    across, line = (col, row) if edge.direction == "vertical" else (row, col)
    at = np.interp(line + 0.5, np.arange(edge.edge_position.size) + 0.5, edge.edge_position)
    distance = across + 0.5 - at
    found = []
    for side in (distance < -_CLEAR_OF_EDGE_PX, distance > _CLEAR_OF_EDGE_PX):
        count = int(side.sum())
        if count < _LEAST_PIXELS:
            expected = f"{_LEAST_PIXELS} or more"
            raise InputError("pixels beside the edge", value=count, expected=expected, hint="Take a wider region")
        values = plane[row[side], col[side]]
        rest = without_plane(values, row[side], col[side])
        variance = float(rest @ rest) / (count - 3)
        mean = Uncertain.of(float(values.mean()), math.sqrt(variance / count))
        found.append((mean, Uncertain.of_variance(variance, variance * math.sqrt(2.0 / (count - 3)))))
    return sorted(found, key=lambda each: each[0].value)


def alike_frequencies(frequency: Array) -> float:
    """Return the number of neighboring frequencies whose errors are alike."""
    return max(_WINDOW_BANDWIDTH / (2.0 * _REACH_PX) / float(frequency[1] - frequency[0]), 1.0)


def _capacity(frequency: Array, mtf: Array, spread: Array, ratio: Uncertain) -> Uncertain:
    """Return the integral of log2(1 + ratio mtf^2) over all directions up to Nyquist, in bits per pixel.

    The mean over directions of a square of frequencies is that of the disc that it holds.
    """
    weight = 2.0 * math.pi * frequency * np.gradient(frequency)
    weight[[0, -1]] *= 0.5
    # Noise adds its variance to the square of the response, in phase and out of phase.
    square = mtf**2 - 2.0 * spread**2
    inside = np.maximum(1.0 + ratio.value * square, 0.5)
    value = float(weight @ np.log2(inside))
    slope = float(weight @ (square / inside)) / math.log(2.0)
    error = weight * 2.0 * ratio.value * mtf * spread / inside / math.log(2.0)
    return (
        Uncertain.of(value, math.sqrt(alike_frequencies(frequency) * float(error @ error)))
        + (ratio - ratio.value) * slope
    )


MEASUREMENT = Measurement(
    title="Information capacity",
    standard="Koren, Electronic Imaging (2020): Shannon capacity from slanted edges; NEQ as in IEC 62220-1",
    charts=("slanted-edge",),
    measure=_measure,
    quantities={
        "capacity": Quantity(
            "information capacity",
            "bits/pixel",
            "Integral of log2(1 + signal power / noise power) over the disc of frequencies up to 0.5 cycles/pixel, for "
            "signals that are uniform between the two sides of the edge.",
        ),
        "neq_zero": Quantity("NEQ at zero frequency", "", "Square of the mean signal over the density of the noise."),
    },
    oracle="closed forms of a known blur and white noise",
    left_out="The noise is taken as white; noise-reduction raises the result without adding information.",
    order=410,
    view="fine",
    headline=("capacity",),
)
