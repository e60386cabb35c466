"""Defects of an even field: pixels far from their neighborhood."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import LUMA, ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import FieldMap, Measurement, Quantity, Result
from photosite.values.cfa import MONOCHROME, shifted
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.estimate import Estimate

Array = NDArray[np.float64]

NOISE_HIDES_DEFECTS = DiagnosticKind(
    "noise-hides-defects",
    "note",
    "Noise of the frames is so large that it hides pixels with the smallest deviation of a defect.",
    "Only pixels that deviate more are counted.",
    "Take more frames: their mean is used.",
    ("bright_pixels", "dark_pixels"),
    "Smallest deviation that is counted, in percent.",
)
_FALSE_ALARMS = 1e-3
"""Expected number of pixels that normal noise makes in a frame."""
_MOST_DEFECTS = 0.01
"""Fraction of the pixels; more are structure of the field."""
_QUARTILES_PER_SIGMA = 1.34898
_CELLS, _LEAST_CELL = 16, 8
"""Cells of the smooth field along the longer side, and their least side in pixels of a site of the color filters."""
_MAP_COLS = 96


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    pixel_percent: Annotated[float, Field(gt=0)] = 20.0,
) -> Result:
    region = chart.region
    tile = MONOCHROME if image.origin == "picture" else shifted(image.cfa, region.r0, region.c0)
    height, width = len(tile), len(tile[0])
    tiles = region.shape[0] // height, region.shape[1] // width
    if min(tiles) < 3 * _LEAST_CELL:
        expected = f"{3 * _LEAST_CELL} or more along each axis"
        raise InputError("tiles of the color filters in the field", value=min(tiles), expected=expected)
    pixels = tiles[0] * tiles[1] * height * width
    apart = _sigmas(pixels)
    bright = dark = 0
    least = false_alarms = 0.0
    field: Array = np.zeros(tiles)
    for r, c in np.ndindex(height, width):
        channel = LUMA if image.origin == "picture" else tile[r][c]
        plane = image.plane(channel, region)[0]
        site = plane[r : tiles[0] * height : height, c : tiles[1] * width : width]
        clipped = float(((site >= image.white - image.black) | (site <= -image.black)).mean())
        if clipped > _MOST_DEFECTS:
            expected, hint = f"at most {_MOST_DEFECTS}", "Take frames of an even field below saturation"
            raise InputError(f"fraction of {channel} pixels at 0 or white", value=clipped, expected=expected, hint=hint)
        light = smooth_field(site)
        if light.min() <= 0:
            raise InputError(f"signal of channel {channel}", expected="above 0 everywhere", hint="Take light frames")
        change = site / light - 1.0
        noise = _noise(change) * np.sqrt(np.median(light) / light)
        limit = np.maximum(pixel_percent / 100.0, apart * noise)
        bright, dark = bright + int((change > limit).sum()), dark + int((change < -limit).sum())
        least = max(least, float(limit.max()))
        if noise.min() > 0:
            false_alarms += float(_outside(limit / noise).sum())
        field += np.where(np.abs(change) > limit, 0.0, change) / (height * width)
    if bright + dark > _MOST_DEFECTS * pixels:
        what, hint = "fraction of pixels far from a smooth field", "Take frames of an even field"
        raise InputError(what, value=(bright + dark) / pixels, expected=f"at most {_MOST_DEFECTS}", hint=hint)
    values = {
        ("bright_pixels", ""): count_estimate(bright),
        ("dark_pixels", ""): count_estimate(dark),
        ("smallest_pixel_percent", ""): Estimate(100.0 * least),
        ("false_alarms", ""): Estimate(false_alarms),
    }
    diagnostics = []
    if least > pixel_percent / 100.0:
        text = f"pixels count from a deviation of {100 * least:.3g} % on; smaller ones may be noise"
        diagnostics.append(NOISE_HIDES_DEFECTS(text, 100.0 * least))
    return Result(values, (), (_map(field, region.r0, region.c0, (height, width)),), tuple(diagnostics))


def _sigmas(pixels: int) -> float:
    """Return the distance in standard deviations that noise exceeds in `_FALSE_ALARMS` of all pixels."""
    from scipy.special import ndtri

    return float(-ndtri(0.5 * _FALSE_ALARMS / pixels))


def _outside(sigmas: Array) -> Array:
    from scipy.special import erfc

    return np.asarray(erfc(sigmas / math.sqrt(2.0)))


def _noise(values: Array) -> float:
    low, high = np.percentile(values, [25, 75])
    return float(high - low) / _QUARTILES_PER_SIGMA


def smooth_field(site: Array, across: int = _CELLS) -> Array:
    """Return the smooth field: a cubic spline through the medians of cells, `across` along the longer side."""
    from scipy.interpolate import RectBivariateSpline

    side = max(_LEAST_CELL, max(site.shape) // across)
    rows, cols = (n // side for n in site.shape)
    cells = site[: rows * side, : cols * side].reshape(rows, side, cols, side)
    medians = np.median(cells.swapaxes(1, 2).reshape(rows, cols, -1), axis=-1)
    medians = _continued(_continued(medians).T).T
    # The middle of a cell has a 24th of the second differences less than the cell.
    bends = [np.diff(np.pad(medians, 1, mode="reflect", reflect_type="odd"), 2, k) for k in (0, 1)]
    medians = medians - (bends[0][:, 1:-1] + bends[1][1:-1]) / 24.0
    y, x = ((np.arange(-1, n + 1) + 0.5) * side for n in (rows, cols))
    spline = RectBivariateSpline(y, x, medians, kx=3, ky=3)
    return np.asarray(spline(np.arange(site.shape[0]) + 0.5, np.arange(site.shape[1]) + 0.5))


def _continued(cells: Array) -> Array:
    """Return cells with a row more at either end, along parabolas."""
    first, last = (3.0 * a - 3.0 * b + c for a, b, c in (cells[:3], cells[:-4:-1]))
    return np.vstack([first, cells, last])


def count_estimate(number: int) -> Estimate:
    """Return a count with the interval of the mean of a Poisson distribution (Garwood, Biometrika 28 (1936) 437)."""
    from scipy.special import chdtri

    low = 0.5 * float(chdtri(2 * number, 0.975)) if number else 0.0
    return Estimate(float(number), math.sqrt(number), interval_95=(low, 0.5 * float(chdtri(2 * number + 2, 0.025))))


def _map(field: Array, top: int, left: int, tile: tuple[int, int]) -> FieldMap:
    side = -(-field.shape[1] // _MAP_COLS)
    rows, cols = (n // side for n in field.shape)
    means = field[: rows * side, : cols * side].reshape(rows, side, cols, side).mean(axis=(1, 3))
    row, col = top + (np.arange(rows) + 0.5) * side * tile[0], left + (np.arange(cols) + 0.5) * side * tile[1]
    return FieldMap("", "deviation from the smooth field (%)", row, col, 100.0 * means)


MEASUREMENT = Measurement(
    title="Defective pixels",
    standard="counts of outliers from a smooth field; no standard prescribes them",
    charts=("uniform",),
    measure=_measure,
    quantities={
        "bright_pixels": Quantity("bright pixels", "", "Pixels above the smooth field by `pixel_percent` and noise."),
        "dark_pixels": Quantity("dark pixels", "", "Pixels below the smooth field by `pixel_percent` and noise."),
        "smallest_pixel_percent": Quantity(
            "smallest deviation", "%", "Deviation from which pixels are counted everywhere in the field."
        ),
        "false_alarms": Quantity("false alarms", "pixels", "Expected number of pixels that normal noise makes."),
    },
    oracle="pixels put into drawn fields",
    left_out=(
        "Intervals of counts are those of the mean number over chips (Poisson). In pictures interpolation spreads "
        "defective pixels. Spots of dust are counted by `dust`."
    ),
    order=310,
    view="field",
    headline=("bright_pixels", "dark_pixels"),
)
