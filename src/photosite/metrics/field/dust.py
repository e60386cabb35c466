"""Dust on the cover glass: soft dark spots on an even field, at a small aperture."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.field.defects import count_estimate, smooth_field
from photosite.metrics.measurement import FieldMap, Measurement, Quantity, Result
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.estimate import Estimate

Array = NDArray[np.float64]

NOISE_HIDES_DUST = DiagnosticKind(
    "noise-hides-dust",
    "note",
    "Noise of the frames is so large that it hides shallow spots.",
    "Only spots that are deeper are counted.",
    "Take more frames: their mean is used.",
    ("spots", "area_percent"),
    "Smallest depth of a spot of five samples across that is counted, in percent.",
)
_SIGMAS = 6.0
"""Depth in standard deviations of the noise of a box from which it is a spot."""
_SCALES = (1, 2, 4, 8, 16)
"""Half sides of the boxes, in tiles of the color filters."""
_CELLS = 8
"""Of the smooth field along the longer side: spots cover less than half of one."""
_QUARTILES_PER_SIGMA = 1.34898
_FILLED = 3
"""How often spots are filled with the smooth field, which is then fitted again."""
_LEAST_SIDE, _MOST_AREA, _LONGEST = 64, 0.1, 0.2
_CLIPPED_FRACTION = 1e-3
_MAP_COLS = 96


def _measure(image: ChartImage, chart: PlacedChart, *, depth_percent: Annotated[float, Field(gt=0)] = 1.0) -> Result:
    from scipy.ndimage import label, uniform_filter

    field, tile = _tiles(image, chart)
    smooth = smooth_field(field, _CELLS)
    change = field / smooth - 1.0
    depth: Array = np.zeros(field.shape)
    spread = {}
    for half in _SCALES:
        side = 2 * half + 1
        if 4 * side > min(field.shape):
            break
        mean = uniform_filter(change, side, mode="nearest")
        # Boxes that do not overlap show the noise of a box, correlated or not.
        low, high = np.percentile(mean[half::side, half::side], [25, 75])
        spread[half] = float(high - low) / _QUARTILES_PER_SIGMA
        limit = max(0.01 * depth_percent, _SIGMAS * spread[half])
        whole = np.s_[side:-side, side:-side]  # the smooth field is less certain at the borders
        depth[whole] = np.maximum(depth[whole], np.where(mean < -limit, -mean, 0.0)[whole])
    marks, number = label(depth > 0, structure=np.ones((3, 3)))
    if (area := float((depth > 0).mean())) > _MOST_AREA:
        hint = "Take frames of an even field"
        raise InputError("part of the field in spots", value=area, expected=f"at most {_MOST_AREA}", hint=hint)
    longest = max((max(np.ptp(at) for at in np.nonzero(marks == spot)) for spot in range(1, number + 1)), default=0)
    if longest > _LONGEST * max(field.shape):
        hint = "Take frames of an even field"
        expected = f"at most {_LONGEST} of the field"
        raise InputError("length of a spot", value=longest / max(field.shape), expected=expected, hint=hint)
    values = {("spots", ""): count_estimate(number), ("deepest_percent", ""): Estimate(reason="there are no spots")}
    dark = np.zeros(field.shape, np.bool_)
    if number:
        for _ in range(_FILLED):  # spots draw the smooth field down
            smooth = smooth_field(np.where(marks > 0, smooth, field), _CELLS)
        change = field / smooth - 1.0
        found = [_spot(change, marks == spot, spread) for spot in range(1, number + 1)]
        value, error = max((each[:2] for each in found), key=lambda pair: pair[0])
        values["deepest_percent", ""] = Estimate(100.0 * value, 100.0 * error)
        for *_, inside in found:
            dark |= inside
    values["area_percent", ""] = Estimate(100.0 * float(dark.mean()))
    diagnostics = []
    hidden = 100.0 * _SIGMAS * spread[_SCALES[1]]
    if hidden > depth_percent:
        text = f"spots of five samples across count from a depth of {hidden:.3g} % on"
        diagnostics.append(NOISE_HIDES_DUST(text, hidden))
    return Result(values, (), (_map(change, chart, tile),), tuple(diagnostics))


def _tiles(image: ChartImage, chart: PlacedChart) -> tuple[Array, tuple[int, int]]:
    """Return the mean of each tile of the color filters, each site over its own mean, and the size of a tile."""
    region = chart.region
    picture = image.origin == "picture"
    height, width = (1, 1) if picture else (len(image.cfa), len(image.cfa[0]))
    plane = image.plane(image.sharp_channel, region)[0]
    rows, cols = plane.shape[0] // height, plane.shape[1] // width
    if min(rows, cols) < _LEAST_SIDE:
        expected = f"{_LEAST_SIDE} or more along each axis"
        raise InputError("tiles of the color filters in the field", value=min(rows, cols), expected=expected)
    clipped = float(((plane >= image.white - image.black) | (plane <= -image.black)).mean())
    if clipped > _CLIPPED_FRACTION and image.origin != "electrons":
        expected = f"at most {_CLIPPED_FRACTION}"
        raise InputError("fraction of pixels at 0 or white", value=clipped, expected=expected)
    sites = plane[: rows * height, : cols * width].reshape(rows, height, cols, width)
    means = sites.mean(axis=(0, 2))
    if (means <= 0).any():
        raise InputError("signal of the field", expected="above 0", hint="Take light frames")
    return np.asarray((sites / means[:, None]).mean(axis=(1, 3))), (height, width)


def _spot(change: Array, marked: NDArray[np.bool_], spread: dict[int, float]) -> tuple[float, float, NDArray[np.bool_]]:
    """Return depth, its standard uncertainty, and the samples of a spot below half of the depth."""
    row, col = np.nonzero(marked)
    weight = np.maximum(-change[row, col], 0.0)
    r, c = (round(float(weight @ at) / max(float(weight.sum()), 1e-300)) for at in (row, col))
    depth = -float(change[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2].mean())
    return depth, spread[1], marked & (change < -0.5 * depth)


def _map(change: Array, chart: PlacedChart, tile: tuple[int, int]) -> FieldMap:
    side = -(-change.shape[1] // _MAP_COLS)
    rows, cols = (n // side for n in change.shape)
    means = change[: rows * side, : cols * side].reshape(rows, side, cols, side).mean(axis=(1, 3))
    row = chart.region.r0 + (np.arange(rows) + 0.5) * side * tile[0]
    col = chart.region.c0 + (np.arange(cols) + 0.5) * side * tile[1]
    return FieldMap("dust", "deviation from the smooth field (%)", row, col, 100.0 * means)


MEASUREMENT = Measurement(
    title="Dust",
    standard="counts of dark spots on a smooth field at a small aperture; no standard prescribes them",
    charts=("uniform",),
    measure=_measure,
    quantities={
        "spots": Quantity("spots", "", "Dark spots deeper than `depth_percent` and than noise."),
        "deepest_percent": Quantity("deepest spot", "%", "Depth of the darkest spot: the 3 x 3 tiles in its middle."),
        "area_percent": Quantity("area", "%", "Part of the field that is darker than half the depth of its spot."),
    },
    oracle="spots put into drawn fields",
    left_out=(
        "Spots wider than a fifteenth of the field count as shading, and those that touch as one. "
        "The outermost samples are left out. Intervals of counts are those of the mean number over fields "
        "(Poisson). Defective pixels that darken their tile by the depth of a spot count as spots."
    ),
    order=315,
    view="field",
    headline=("spots",),
)
