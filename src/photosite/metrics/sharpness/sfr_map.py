"""Spatial frequency response over the field, from the edges of slanted squares."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, FieldMap, Measurement, Quantity, Result
from photosite.metrics.sharpness.edge_sfr import EdgeOptions, measured_edge
from photosite.metrics.sharpness.seen_squares import SeenSquare, seen_squares
from photosite.metrics.sharpness.slanted_edge import SlantedEdge
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.region import Region
from photosite.values.uncertain import Missing, Uncertain

Array = NDArray[np.float64]

EDGES_LEFT_OUT = DiagnosticKind(
    "edges-left-out",
    "note",
    "Some edges of the chart were not measured.",
    "The map has gaps, and means are those of the other edges.",
    "Check focus, light and exposure at these places; the report shows the chart.",
    ("mtf50*",),
    "Number of edges.",
)
_FROM_CORNER = 0.15
"""Part of an edge at either end that is left out: other edges are near."""
_FROM_EDGE = 0.38
"""Distance from an edge that is used at most, over the side of the square."""
_MARGIN_PX = 6.0
_LEVEL = 0.5


@dataclass(frozen=True, eq=False)
class _FieldEdge:
    """An edge, its square, its center relative to the middle of the frame in half diagonals, its region and MTF50."""

    square: SeenSquare
    vertical: bool
    at: Array
    region: Region
    edge: SlantedEdge
    mtf50: Uncertain


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    channel: str = "",
    order: Annotated[int, Field(ge=1, le=5)] = 3,
    reach_px: Annotated[float, Field(ge=8)] = 24.0,
) -> Result:
    channel = channel or image.sharp_channel
    image.check_channel(channel)
    squares = seen_squares(image, chart)
    options = EdgeOptions(order=order, reach_px=reach_px)
    found: list[_FieldEdge | InputError] = []
    for square, number in itertools.product(squares, range(4)):
        try:
            found.append(_field_edge(image, channel, square, number, options))
        except InputError as error:
            found.append(error)
    edges = [each for each in found if isinstance(each, _FieldEdge)]
    reasons = [str(each) for each in found if not isinstance(each, _FieldEdge)]
    if len(reasons) > len(edges):
        raise InputError("edges measured", value=len(edges), expected="most of them", hint=reasons[0])
    diagnostics: list[Diagnostic] = []
    if reasons:
        text = f"{len(reasons)} of {len(found)} edges were not measured; the first: {reasons[0]}"
        diagnostics.append(EDGES_LEFT_OUT(text, float(len(reasons))))
    outlines = tuple(np.array(each.region.corners, dtype=np.float64) for each in edges)
    return Result(_values(edges), tuple(_curves(edges)), tuple(_maps(edges)), tuple(diagnostics), outlines)


def _field_edge(image: ChartImage, channel: str, square: SeenSquare, number: int, options: EdgeOptions) -> _FieldEdge:
    start, end = square.corners[number], square.corners[(number + 1) % 4]
    length = float(np.hypot(*(end - start)))
    vertical = abs(end[0] - start[0]) > abs(end[1] - start[1])
    start, end = start + _FROM_CORNER * (end - start), end - _FROM_CORNER * (end - start)
    away = min(options.reach_px + _MARGIN_PX, _FROM_EDGE * length) * np.array((0, 1) if vertical else (1, 0))
    low, high = np.minimum(start, end) - away, np.maximum(start, end) + away
    tile = np.array((1, 1) if image.origin == "picture" else (len(image.cfa), len(image.cfa[0])))
    (r0, c0), (r1, c1) = (np.floor(low / tile) * tile).astype(int), np.ceil(high).astype(int)
    inside = r0 >= 0 and c0 >= 0 and r1 <= image.shape[0] and c1 <= image.shape[1]
    if not inside:
        raise InputError("surroundings of the edge", expected="inside the frame")
    region = Region("edge", int(r0), int(r1), int(c0), int(c1))
    edge = measured_edge(image, region, channel, options)[0]
    if (mtf50 := edge.crossing(_LEVEL)) is None:
        raise InputError("response", value=float(edge.mtf.min()), expected=f"below {_LEVEL} up to 1 cycle/pixel")
    middle = 0.5 * np.array(image.shape)
    at = (0.5 * (start + end) - middle) / float(np.hypot(*middle))
    return _FieldEdge(square, vertical, at, region, edge, mtf50)


def _mean(edges: Iterable[_FieldEdge]) -> Uncertain | Missing:
    """Return the mean MTF50 of edges, whose noise is independent."""
    found = [each.mtf50 for each in edges]
    if not found:
        return Missing("none of its edges was measured")
    spread = math.sqrt(sum(each.standard_uncertainty**2 for each in found)) / len(found)
    return Uncertain.of(float(np.mean([each.value for each in found])), spread)


def _values(edges: list[_FieldEdge]) -> dict[tuple[str, str], Estimate]:
    """Return means in the center, in the corners and of all edges, their ratio, and the fit of the astigmatism."""
    heights: dict[tuple[int, int], float] = {}
    for each in edges:
        heights.setdefault(each.square.place, float(np.hypot(*each.at)))
    center = min(heights, key=lambda place: heights[place])
    rows, cols = zip(*heights, strict=True)
    corners = {(r, c) for r in (min(rows), max(rows)) for c in (min(cols), max(cols))}
    values: dict[tuple[str, str], Estimate] = {}
    means: dict[str, Uncertain | Missing] = {}
    parts = {"center": {center}, "corners": corners, "field": set(heights)}
    for part, places in parts.items():
        there = [each for each in edges if each.square.place in places]
        means[part] = _mean(there)
        values["mtf50", part] = Estimate.of(means[part], "")
        for name, vertical in (("mtf50_vertical", True), ("mtf50_horizontal", False)):
            values[name, part] = Estimate.of(_mean(each for each in there if each.vertical == vertical), "")
    one, other = means["center"], means["corners"]
    ratio = one if isinstance(one, Missing) else other if isinstance(other, Missing) else other / one
    values["corner_ratio", ""] = Estimate.of(ratio, "")
    astigmatism, direction = _anisotropy(edges)
    values["astigmatism_percent", ""] = Estimate.of(astigmatism, "")
    values["direction_percent", ""] = Estimate.of(direction, "")
    return values


def _anisotropy(edges: list[_FieldEdge]) -> tuple[Uncertain | Missing, Uncertain | Missing]:
    """Return the relative difference of MTF50 along and across the radius at the corner, and that of the axes.

    The logarithms of MTF50 differ by a (x^2 - y^2) + b between vertical and horizontal edges, x and y in half
    diagonals: astigmatism grows with the square of the image height. Where edges scatter about that by more than
    noise, the intervals grow by as much.
    """
    by_square: dict[tuple[int, int], dict[bool, list[_FieldEdge]]] = {}
    for each in edges:
        by_square.setdefault(each.square.place, {}).setdefault(each.vertical, []).append(each)
    pairs = [(each[True], each[False]) for each in by_square.values() if len(each) == 2]
    if len(pairs) < 4:
        few = Missing("fewer than four squares have edges of both directions")
        return few, few
    y, spread, x = [], [], []
    for one, other in pairs:
        means = [_mean(each) for each in (one, other)]
        up, flat = (each for each in means if not isinstance(each, Missing))
        y.append(math.log(up.value / flat.value))
        spread.append(math.hypot(up.relative, flat.relative))
        at = np.mean([each.at for each in (*one, *other)], axis=0)
        x.append((at[1] ** 2 - at[0] ** 2, 1.0))
    model, u = np.array(x), np.array(spread)
    covariance = np.linalg.inv(model.T @ (model / u[:, None] ** 2))
    fit = covariance @ (model.T @ (np.array(y) / u**2))
    misfit = float((((np.array(y) - model @ fit) / u) ** 2).sum()) / (len(y) - 2)
    errors = np.sqrt(np.diag(covariance) * max(misfit, 1.0))
    found = [Uncertain.of(100.0 * float(value), 100.0 * float(error)) for value, error in zip(fit, errors, strict=True)]
    return found[0], found[1]


_HEIGHT = "image height (of half the diagonal)"


def _curves(edges: list[_FieldEdge]) -> list[Curve]:
    """Return MTF50 over the image height of edges of either direction."""
    found = []
    for part, vertical in (("vertical edges", True), ("horizontal edges", False)):
        there = sorted(
            (each for each in edges if each.vertical == vertical), key=lambda each: float(np.hypot(*each.at))
        )
        height = np.array([np.hypot(*each.at) for each in there])
        mtf50 = np.array([each.mtf50.value for each in there])
        spread = np.array([each.mtf50.standard_uncertainty for each in there])
        found.append(Curve(part, _HEIGHT, "MTF50 (cycles/pixel)", height, mtf50, spread, joined=False))
    return found


def _maps(edges: list[_FieldEdge]) -> list[FieldMap]:
    """Return MTF50 of the squares: of all edges, and of those of either direction."""
    places = np.array([each.square.place for each in edges])
    first, last = places.min(axis=0), places.max(axis=0)
    lines = []
    for axis in (0, 1):
        centers = np.array([each.square.center[axis] for each in edges])
        lines.append([float(centers[places[:, axis] == n].mean()) for n in range(first[axis], last[axis] + 1)])
    maps = []
    for part, kinds in (("all edges", (True, False)), ("vertical edges", (True,)), ("horizontal edges", (False,))):
        values = np.full(tuple(last - first + 1), np.nan)
        for r, c in {each.square.place for each in edges}:
            there = [each for each in edges if each.square.place == (r, c) and each.vertical in kinds]
            if not isinstance(mean := _mean(there), Missing):
                values[r - first[0], c - first[1]] = mean.value
        maps.append(FieldMap(part, "MTF50 (cycles/pixel)", np.array(lines[0]), np.array(lines[1]), values))
    return maps


_UNIT = "cycles/pixel"
MEASUREMENT = Measurement(
    title="Spatial frequency response over the field",
    standard="ISO 12233:2023, edge-based response at many places",
    charts=("slanted-squares",),
    measure=_measure,
    quantities={
        "mtf50": Quantity("MTF50", _UNIT, "Mean of the edges of the middle square, the corner ones, or all."),
        "mtf50_vertical": Quantity("MTF50, vertical edges", _UNIT, "The same of vertical edges: along the rows."),
        "mtf50_horizontal": Quantity("MTF50, horizontal edges", _UNIT, "The same of horizontal edges."),
        "corner_ratio": Quantity("corners over center", "", "MTF50 of the corner squares over that of the middle one."),
        "astigmatism_percent": Quantity(
            "astigmatism",
            "%",
            "Relative difference of MTF50 along and across the radius at half the diagonal; it grows with its square.",
        ),
        "direction_percent": Quantity(
            "difference of directions", "%", "Relative difference of MTF50 of vertical and horizontal edges everywhere."
        ),
    },
    oracle="point spreads that change over the field, times the pixel",
    left_out="One channel: green, luma or the option `channel`. `edge-sfr` gives the curve of one edge.",
    order=105,
    view="field",
    headline=("mtf50", "corner_ratio"),
    figure="map",
)
