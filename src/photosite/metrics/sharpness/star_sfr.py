"""Spatial frequency response of a sine Siemens star, by sectors."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.sharpness.crossing import crossing
from photosite.values.cfa import channel_sites
from photosite.values.estimate import Estimate
from photosite.values.region import Region

Array = NDArray[np.float64]

_STAR_RADIUS = 0.45
"""Of the star, relative to the chart's smaller side."""
_INSIDE = 0.95
"""Part of the radius that is used: the blur of the gray around the star reaches inside its border."""
_MOST_RINGS = 60
_LEAST_WIDTH_PX = 1.5
"""Of a ring in a channel that has every pixel."""
_LEAST_PIXELS = 10
_OUTER, _LEAST_SIGMAS = 5, 5.0
"""Rings of the lowest frequencies, one of which must show the star, and its response in standard uncertainties."""
_CLIPPED_FRACTION = 1e-3
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
        # Rings from the Nyquist frequency of the pixels to the border of the star.
        outer = _INSIDE * _STAR_RADIUS * min(chart.scene.shape) / chart.samples_per_pixel
        inner = max(cycles / math.pi, 4.0)
        if inner * 1.2 > outer:
            expected = f"{2.4 * inner:.0f} pixels or more, for {cycles} cycles"
            raise InputError("diameter of the star", value=2 * outer, expected=expected)
        width = _LEAST_WIDTH_PX / math.sqrt(image.density(channel))
        rings = min(math.ceil(math.log(outer / inner) / math.log1p(width / inner)), _MOST_RINGS)
        edges = np.geomspace(inner, outer, rings + 1)
        cells = _Cells(edges, sectors, cycles)
        response, spread, radius = _fitted(_sums(image, chart, channel, cells), cells)
        response, spread = response / modulation, spread / modulation
        signal = image.plane(channel, chart.region)[0][image.mask(channel, chart.region)]
        full = float((signal >= image.white - image.black).mean())
        if full > _CLIPPED_FRACTION:
            raise InputError(f"fraction of saturated {channel} pixels", value=full, expected="at most 0.001")
        level, error = _averaged(response, spread)
        shows = level > _LEAST_SIGMAS * error
        if not shows[np.flatnonzero(np.isfinite(level))[-_OUTER:]].any():
            hint = "Check the chart, its corners and the focus"
            raise InputError("signal of the star", expected="above its noise at the lowest frequencies", hint=hint)
        for part, chosen in _groups(sectors).items():
            level, error = _averaged(response[:, chosen], spread[:, chosen])
            level = _without_width(level)
            name = f"{channel}, {part}" if part else channel
            shown = np.isfinite(level)
            frequency = cycles / (2.0 * math.pi * radius[:, chosen].mean(axis=1))
            x, y, u = frequency[shown][::-1], level[shown][::-1], error[shown][::-1]
            curves.append(Curve(name, "spatial frequency (cycles/pixel)", "star SFR", x, y, u))
            values["mtf50", name] = Estimate.of(crossing(x, y, u, 0.5), "")
            if not part:
                values["mtf10", name] = Estimate.of(crossing(x, y, u, 0.1), "")
    return Result(values, tuple(curves))


@dataclass(frozen=True, eq=False)
class _Cells:
    """Rings between radii in pixels, in sectors, and the cycles around the circle."""

    edges: Array
    sectors: int
    cycles: int

    @property
    def middle(self) -> Array:
        """(cells,) radii, about which slopes along the radius are fitted."""
        return np.repeat(0.5 * (self.edges[1:] + self.edges[:-1]), self.sectors)


_TERMS = 6
"""1, cosine, sine, and each of them times the distance from the middle of the ring."""
_BLOCK_ROWS = 64


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums over the pixels of each cell: of products of terms, of terms and signal, of the squared signal."""

    normal: Array
    right: Array
    square: Array
    level: float  # subtracted from the signal
    shape: tuple[int, int]  # rings and sectors


def _sums(image: ChartImage, chart: PlacedChart, channel: str, cells: _Cells) -> _Sums:
    """Return the sums of a channel, by blocks of rows, on two threads."""
    region = chart.region
    plane, tile = image.plane(channel, region)
    tile = ((channel,),) if image.origin == "picture" else tile
    height, width = len(tile), len(tile[0])
    block = _BLOCK_ROWS * height
    blocks = [
        (slice(first + r, min(first + block, len(plane)), height), slice(c, None, width))
        for r, c in channel_sites(tile, channel)
        for first in range(0, len(plane), block)
    ]
    level = float(plane[blocks[0]].mean())

    def of_block(where: tuple[slice, slice]) -> Array:
        row, col = (np.arange(size, dtype=np.float64)[part] + first + 0.5 for part, size, first in _axes(where, region))
        return _block_sums(chart, row, col, plane[where] - level, cells)

    with ThreadPoolExecutor(2) as threads:
        total: Array = np.sum(list(threads.map(of_block, blocks)), axis=0)
    size = cells.middle.size
    moments, rest = total[:15].reshape(3, 5, size), total[15:]
    normal = np.empty((size, _TERMS, _TERMS))
    for i in range(_TERMS):
        for j in range(_TERMS):
            (by, one), (too, other) = divmod(i, 3), divmod(j, 3)
            normal[:, i, j] = _product(moments[by + too], one, other)
    shape = cells.edges.size - 1, cells.sectors
    return _Sums(normal, rest[:_TERMS].T, rest[_TERMS], level, shape)


def _axes(where: tuple[slice, slice], region: Region) -> list[tuple[slice, int, int]]:
    return list(zip(where, region.shape, (region.r0, region.c0), strict=True))


def _product(moments: Array, one: int, other: int) -> Array:
    """Return the sums of a product of two of 1, cosine and sine, from those of 1, c, s, c c and c s."""
    place = {(0, 0): 0, (0, 1): 1, (0, 2): 2, (1, 1): 3, (1, 2): 4}
    low, high = min(one, other), max(one, other)
    return np.asarray(moments[0] - moments[3] if low == 2 else moments[place[low, high]])


def _block_sums(chart: PlacedChart, row: Array, col: Array, signal: Array, cells: _Cells) -> Array:
    """Return (22, cells) sums over a block of pixels."""
    scene_row, scene_col = chart.to_scene_grid(row, col)
    down, along = scene_row - chart.scene.shape[0] / 2, scene_col - chart.scene.shape[1] / 2
    radius = np.hypot(down, along) * (1.0 / chart.samples_per_pixel)
    used = (radius > cells.edges[0]) & (radius <= cells.edges[-1])
    radius, value = radius[used], signal[used]
    angle = np.arctan2(along[used], -down[used])  # clockwise from the top
    ring = np.searchsorted(cells.edges, radius) - 1
    sector = np.floor((angle / (2.0 * math.pi) + 0.5 / cells.sectors) * cells.sectors).astype(np.intp) % cells.sectors
    place = ring * cells.sectors + sector
    size = cells.middle.size
    away = radius - cells.middle[place]
    phase = cells.cycles * angle
    cosine, sine = np.cos(phase), np.sin(phase)
    found = np.empty((15 + _TERMS + 1, size))
    parts = (None, cosine, sine, cosine * cosine, cosine * sine)
    powers = (None, away, away * away)
    for k, power in enumerate(powers):
        for number, part in enumerate(parts):
            weight = power if part is None else part if power is None else part * power
            found[5 * k + number] = np.bincount(place, weight, size)
    for k, weighted in enumerate((value, value * away)):
        for number, part in enumerate((None, cosine, sine)):
            weight = weighted if part is None else weighted * part
            found[15 + 3 * k + number] = np.bincount(place, weight, size)
    found[15 + _TERMS] = np.bincount(place, value * value, size)
    return found


def _fitted(sums: _Sums, cells: _Cells) -> tuple[Array, Array, Array]:
    """Return (rings, sectors) modulations, their standard uncertainties and radii, by least squares of a sine.

    They are NaN where there is no fit. Slopes along the radius are part of it: rings are not thin, and light is uneven.
    The modulation is that at the mean radius of the pixels, which is not the middle of the ring.
    """
    count = sums.normal[:, 0, 0]
    mean = sums.normal[:, 0, 3] / np.maximum(count, 1)
    moved = np.tile(np.eye(_TERMS), (count.size, 1, 1))
    for term in range(3):
        moved[:, 3 + term, term] = -mean
    normal = moved @ sums.normal @ moved.swapaxes(1, 2)
    right = (moved @ sums.right[..., None])[..., 0]
    good = count >= _LEAST_PIXELS
    good[good] = np.linalg.cond(normal[good]) < 1e8
    fit = np.full((count.size, _TERMS), np.nan)
    fit[good] = np.linalg.solve(normal[good], right[good][..., None])[..., 0]
    variance = np.maximum(sums.square - (fit * right).sum(axis=1), 0.0) / np.maximum(count - _TERMS, 1)
    inverse = np.full(normal.shape, np.nan)
    inverse[good] = np.linalg.inv(normal[good])
    amplitude = np.hypot(fit[:, 1], fit[:, 2])
    error = np.sqrt(variance * 0.5 * (inverse[:, 1, 1] + inverse[:, 2, 2]))
    # Noise adds its variance to the square of the amplitude.
    unbiased = np.sign(amplitude**2 - error**2) * np.sqrt(np.abs(amplitude**2 - error**2))
    level = fit[:, 0] + sums.level
    found = unbiased / level, error / level, cells.middle + mean
    return tuple(each.reshape(sums.shape) for each in found)  # type: ignore[return-value]


def _groups(sectors: int) -> dict[str, list[int]]:
    """Return the sectors of all directions, and of each of four."""
    found: dict[str, list[int]] = {"": list(range(sectors))}
    for number in range(sectors):
        found.setdefault(_DIRECTIONS[round(8 * number / sectors) % 4], []).append(number)
    return found


def _averaged(response: Array, spread: Array) -> tuple[Array, Array]:
    """Return means over sectors with their uncertainties; NaN where a sector is missing."""
    return response.mean(axis=1), np.sqrt((spread**2).sum(axis=1)) / response.shape[1]


def _without_width(level: Array) -> Array:
    """Return modulations in the middle of rings, from means over their widths: a 24th of second differences less."""
    found = level.copy()
    bend = np.diff(level, 2) / 24.0
    found[1:-1] -= np.where(np.isfinite(bend), bend, 0.0)
    return found


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
    headline=("mtf50",),
    figure="curves",
)
