"""Lateral chromatic displacement: how far the red and blue images of dots are from the green ones."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.geometry.dots import Dots, find_dots
from photosite.metrics.measurement import Curve, FieldMap, Measurement, Quantity, Result
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain, combined, correlated

Array = NDArray[np.float64]

SHIFTED_COLORS = DiagnosticKind(
    "shifted-colors",
    "note",
    "All dots of a channel are displaced in the same direction.",
    "The lens is decentered or tilted, or demosaicing shifts a channel. The radial figures do not contain the shift.",
    "None needed; compare raw frames with pictures to tell lens and demosaicing apart.",
    ("displacement_*",),
    "Common displacement, in pixels.",
)
_SHIFT_PX, _SIGNIFICANT = 0.05, 4.0
_HEIGHTS = 101
_POWERS = np.array([1, 3, 5])
_LEAST_HEIGHT = 0.05


def _measure(image: ChartImage, chart: PlacedChart) -> Result:
    channels = tuple(name for name in ("R", "G", "B") if name in image.channels)
    if "G" not in channels or len(channels) < 2:
        raise InputError("channels", value=", ".join(image.channels), expected="G, and R or B")
    dots = find_dots(image, chart, channels)
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    maps: list[FieldMap] = []
    diagnostics: list[Diagnostic] = []
    points = dots.from_center("G")
    height = np.hypot(*points.T)
    heights = np.linspace(0.0, float(height.max()), _HEIGHTS)
    for channel in (name for name in channels if name != "G"):
        part = f"{channel} - G"
        apart = dots.places[channel] - dots.places["G"]
        *terms, down, along = _fit(points, apart)
        curve = [combined(terms, row) for row in heights[:, None] ** _POWERS]
        sizes = np.array([each.value for each in curve])
        spread = np.array([each.standard_uncertainty for each in curve])
        largest = curve[int(np.argmax(np.abs(sizes)))]
        at_dots = [combined(terms, row) for row in height[:, None] ** _POWERS]
        mean = combined(at_dots, [math.copysign(1.0 / len(at_dots), each.value) for each in at_dots])
        values["displacement_px", part] = Estimate.of(largest, "")
        values["displacement_percent", part] = Estimate.of(largest * (100.0 / dots.half_diagonal), "")
        values["displacement_mean_px", part] = Estimate.of(mean, "")
        label = "image height (of half the diagonal)", "radial displacement (pixels)"
        curves.append(Curve(part, *label, heights, sizes, spread))
        maps.append(_map(dots, points, apart, part))
        diagnostics += _shift(part, down, along)
    return Result(values, tuple(curves), tuple(maps), tuple(diagnostics))


def _fit(points: Array, apart: Array) -> tuple[Uncertain, ...]:
    """Return coefficients of the radial displacement r, r^3, r^5, and a common shift down and to the right."""
    even = (points**2).sum(axis=1)[:, None] ** ((_POWERS - 1) // 2)
    parts = [np.hstack([points[:, [axis]] * even, np.tile(np.eye(2)[axis], (len(points), 1))]) for axis in (0, 1)]
    model, measured = np.concatenate(parts), apart.T.ravel()
    found = np.linalg.lstsq(model, measured)[0]
    freedom = measured.size - found.size
    variance = float(((measured - model @ found) ** 2).sum()) / freedom
    return correlated(found, variance * np.linalg.inv(model.T @ model), float(freedom))


def _map(dots: Dots, points: Array, apart: Array, part: str) -> FieldMap:
    height = np.hypot(*points.T)
    outwards = (apart * points).sum(axis=1) / np.maximum(height, _LEAST_HEIGHT)
    values = np.where(height > _LEAST_HEIGHT, outwards, np.nan)
    return FieldMap(part, "radial displacement (pixels)", *dots.grid(values, "G"))


def _shift(part: str, down: Uncertain, along: Uncertain) -> list[Diagnostic]:
    size = math.hypot(down.value, along.value)
    if size < _SHIFT_PX or not (down.beyond(_SIGNIFICANT) or along.beyond(_SIGNIFICANT)):
        return []
    text = f"{part}: all dots are displaced by {down.value:.2g} pixels down and {along.value:.2g} to the right"
    return [SHIFTED_COLORS(text, size)]


MEASUREMENT = Measurement(
    title="Lateral chromatic displacement",
    standard="ISO 19084:2015, radial displacement of color channels",
    charts=("point-grid",),
    measure=_measure,
    quantities={
        "displacement_px": Quantity(
            "largest displacement", "pixels", "Largest radial displacement against green, outwards, up to the last dot."
        ),
        "displacement_percent": Quantity(
            "largest displacement", "% of half the diagonal", "The same, relative to the image height of the corner."
        ),
        "displacement_mean_px": Quantity("mean displacement", "pixels", "Mean of its absolute value over the dots."),
    },
    oracle="drawn dots of each channel in closed form",
    left_out=(
        "The text of the standard was not at hand: definitions follow its published descriptions. The displacement is "
        "a polynomial of the image height with a common shift. Raw frames are measured at the sites of each channel."
    ),
    order=330,
    view="field",
    headline=("displacement_px",),
    figure="curves",
)
