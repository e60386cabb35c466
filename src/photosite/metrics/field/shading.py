"""Shading of an even field: falloff of luminance towards corners, and change of color over the frame."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.color.colorimetry import XYZ_FROM_SRGB, lab
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.field.cells import Cells, field_cells
from photosite.metrics.measurement import Curve, FieldMap, Measurement, Quantity, Result
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain, combined, correlated

Array = NDArray[np.float64]

NOT_EVEN = DiagnosticKind(
    "structured-field",
    "warning",
    "Neighboring cells of the field differ by more than a smooth field with noise does.",
    "The frames may show an object, dust, reflections or uneven light, which count as shading.",
    "Take frames of an evenly lit surface out of focus, or of an integrating sphere.",
    ("shading_*", "corner_*", "color_shading_*"),
    "Root mean square step between neighbors, without that of a smooth field, over the mean.",
)
_STRUCTURE = 0.02
_RINGS = 12


def _measure(image: ChartImage, chart: PlacedChart, *, cells: Annotated[int, Field(ge=3, le=101)] = 21) -> Result:
    region = chart.region
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    maps: list[FieldMap] = []
    diagnostics: list[Diagnostic] = []
    found = {channel: field_cells(image, region, channel, cells) for channel in image.channels}
    for channel, field in found.items():
        shading = _ends_ratio(field)
        values["shading_percent", channel] = Estimate.of((shading - 1.0) * -100.0, "")
        values["shading_stops", channel] = Estimate.of(_stops(shading) * -1.0, "")
        values["nonuniformity_percent", channel] = _spread(field)
        values["corners_percent", channel] = Estimate.of(combined(_corners(field), [25.0] * 4), "")
        curves.append(_profile(field, image, channel))
        relative = 100.0 * field.mean / field.smooth[field.center]
        maps.append(FieldMap(channel, "signal relative to the center (%)", field.row, field.col, relative))
        if (structure := _structure(field)) > _STRUCTURE:
            text = f"channel {channel}: neighboring cells differ by {100 * structure:.2g} % of the mean"
            diagnostics.append(NOT_EVEN(f"{text} more than in a smooth field", structure))
    for corner, ratio in zip(_CORNERS, _corners(found[image.sharp_channel]), strict=True):
        values["corner_percent", corner] = Estimate.of(ratio * 100.0, "")
        values["corner_stops", corner] = Estimate.of(_stops(ratio), "")
    for one in ("R", "B"):
        if one in found and "G" in found:
            quotient = _ratio(found[one], found["G"])
            values["color_shading_percent", f"{one}/G"] = _largest_change(quotient)
            relative = 100.0 * quotient.mean / quotient.smooth[quotient.center]
            label = "ratio relative to the center (%)"
            maps.append(FieldMap(f"{one}/G", label, quotient.row, quotient.col, relative))
    if image.origin == "picture":
        values["color_shading_delta_c", ""] = _chroma_difference(*(found[channel] for channel in "RGB"))
    return Result(values, tuple(curves), tuple(maps), tuple(diagnostics))


_CORNERS = ("top left", "top right", "bottom left", "bottom right")


def _ends_ratio(field: Cells) -> Uncertain:
    """Return the darkest cell over the brightest, chosen by one half of the pixels and measured by the other.

    The largest of several noisy means is too large; the mean of a cell chosen by other pixels is not.
    """
    found, cells = [], []
    for chosen, measured in ((0, 1), (1, 0)):
        ends = [int(np.argmin(field.smooth_halves[chosen])), int(np.argmax(field.smooth_halves[chosen]))]
        low, high = _values(field, measured, ends)
        found.append(low / high)
        cells.append(ends)
    return _mean_of_halves(found[0], found[1], same=cells[0] == cells[1])


def _values(field: Cells, half: int, places: list[int]) -> tuple[Uncertain, ...]:
    """Return the smoothed means of cells by one half of the pixels."""
    return correlated(field.smooth_halves[half][places], 2.0 * field.covariance[np.ix_(places, places)])


def _mean_of_halves(one: Uncertain, other: Uncertain, *, same: bool) -> Uncertain:
    """Return the mean of two values; those of different cells are correlated, because noise chose the cells."""
    mean = (one + other) * 0.5
    if same:
        return mean
    return Uncertain.of(mean.value, 0.5 * (one.standard_uncertainty + other.standard_uncertainty))


def _stops(ratio: Uncertain) -> Uncertain:
    return ratio.apply(math.log2, lambda x: 1.0 / (math.log(2.0) * x))


def _corners(field: Cells) -> list[Uncertain]:
    """Return the signals of the corner cells over that of the center."""
    rows, cols = field.shape
    places = np.array([0, cols - 1, (rows - 1) * cols, rows * cols - 1, field.center])
    *corners, center = correlated(field.smooth[places], field.covariance[np.ix_(places, places)])
    return [corner / center for corner in corners]


def _spread(field: Cells) -> Estimate:
    """Return the standard deviation over the field in percent of its mean, without noise."""
    one, other = field.smooth_halves
    mean = float(field.smooth.mean())
    covariance = float(np.mean((one - one.mean()) * (other - other.mean())))
    noise = float(2.0 * np.trace(field.covariance)) / one.size
    apart = field.smooth - mean
    # The product of two halves: 2 apart . error / cells, and the product of the errors.
    signal = 4.0 * float(apart @ field.covariance @ apart) / one.size**2
    product = float(((2.0 * field.covariance) ** 2).sum()) / one.size**2
    spread = math.sqrt(signal + product) if noise > 0 else 0.0
    return Estimate.of_variance(Uncertain.of(covariance, spread), "", Uncertain(100.0 / mean))


def _ratio(one: Cells, other: Cells) -> Cells:
    ratio = one.mean / other.mean
    # To first order in the noise: the ratio of noisy parts is too large on average.
    parts = ratio[..., None] + (one.parts - ratio[..., None] * other.parts) / other.mean[..., None]
    return Cells(one.row, one.col, parts, ratio**2 * (1.0 / one.mean + 1.0 / other.mean))


def _largest_change(ratio: Cells) -> Estimate:
    """Return the largest change against the center in percent, up or down."""
    found, cells = [], []
    for chosen, measured in ((0, 1), (1, 0)):
        change = ratio.smooth_halves[chosen] / ratio.smooth_halves[chosen][ratio.center] - 1.0
        far = int(np.argmax(np.abs(change)))
        there, center = _values(ratio, measured, [far, ratio.center])
        found.append((there / center - 1.0) * math.copysign(100.0, change[far]))
        cells.append(far)
    whole = 100.0 * float(np.abs(ratio.smooth / ratio.smooth[ratio.center] - 1.0).max())
    return _largest(_mean_of_halves(found[0], found[1], same=cells[0] == cells[1]), whole)


def _largest(crossed: Uncertain, whole: float) -> Estimate:
    """Return the estimate of a largest value, from cells chosen by one half, and by all pixels.

    The former is too small where noise chooses another cell than the largest, the latter too large.
    """
    low, high = crossed.interval_95
    return Estimate.of(crossed, "", interval_95=(low, max(whole - crossed.value, 0.0) + high))


def _chroma_difference(red: Cells, green: Cells, blue: Cells) -> Estimate:
    """Return the largest distance from the center in the plane of a* and b*."""
    colors = lab(np.stack([red.parts, green.parts, blue.parts], axis=-1) @ XYZ_FROM_SRGB.T)
    # L*, a* and b* are roots of third order: their variance is that of signals to the power -4/3 times the signal.
    noise = green.mean ** (-1.0 / 3.0)
    center = green.center
    planes = [Cells(green.row, green.col, colors[..., k], noise) for k in (1, 2)]
    found, cells = [], []
    for chosen, measured in ((0, 1), (1, 0)):
        a, b = (plane.smooth_halves[chosen] - plane.smooth_halves[chosen][center] for plane in planes)
        far = int(np.argmax(np.hypot(a, b)))
        turn = math.atan2(b[far], a[far])
        along = math.cos(turn) * colors[..., 1] + math.sin(turn) * colors[..., 2]
        plane = Cells(green.row, green.col, along, noise)
        there, middle = _values(plane, measured, [far, center])
        found.append(there - middle)
        cells.append(far)
    a, b = (plane.smooth - plane.smooth[center] for plane in planes)
    return _largest(_mean_of_halves(found[0], found[1], same=cells[0] == cells[1]), float(np.hypot(a, b).max()))


def _structure(field: Cells) -> float:
    """Return the root mean square of second differences beyond those of the smooth field and noise, over the mean."""
    rest = field.mean - field.smooth.reshape(field.shape)
    if np.array_equal(field.smoother, np.eye(field.mean.size)):
        second = [np.diff(field.mean, 2, axis=axis) / math.sqrt(6.0) for axis in (0, 1)]
        rest = np.concatenate([each.ravel() for each in second])
    excess = float(np.mean(rest**2)) - float(field.variance.mean())
    return math.sqrt(max(excess, 0.0)) / float(field.mean.mean())


def _profile(field: Cells, image: ChartImage, channel: str) -> Curve:
    """Return the signal relative to the center over rings of image height."""
    rows, cols = image.shape
    height = np.hypot(field.row[:, None] - rows / 2, field.col - cols / 2).ravel() / math.hypot(rows / 2, cols / 2)
    ring = np.minimum((height / height.max() * _RINGS).astype(int), _RINGS - 1)
    rings = np.array([(ring == k) / (ring == k).sum() for k in np.unique(ring)])
    center = field.smooth[field.center]
    relative = rings @ field.mean.ravel() / center
    variance = rings**2 @ field.variance.ravel() / center**2
    center_part = field.covariance[field.center, field.center] / center**2
    spread = np.sqrt(variance + relative**2 * center_part)
    label = "image height (of half the diagonal)", "signal relative to the center (%)"
    return Curve(channel, *label, rings @ height, 100.0 * relative, 100.0 * spread)


MEASUREMENT = Measurement(
    title="Shading of luminance and color",
    standard="ISO 17957:2015, luminance and color shading",
    charts=("uniform",),
    measure=_measure,
    quantities={
        "shading_percent": Quantity("shading", "%", "Brightest cell less the darkest, over the brightest."),
        "shading_stops": Quantity("shading", "f-stops", "Binary logarithm of the brightest cell over the darkest."),
        "nonuniformity_percent": Quantity(
            "nonuniformity", "%", "Standard deviation of the cells over their mean, without noise."
        ),
        "corners_percent": Quantity("mean of corners", "%", "Mean of the four corner cells over the center."),
        "corner_percent": Quantity("corner", "%", "Corner cell over the center, of luminance or green."),
        "corner_stops": Quantity("corner", "f-stops", "Binary logarithm of the corner cell over the center."),
        "color_shading_percent": Quantity(
            "color shading", "%", "Largest change of the ratio of two channels against the center, up or down."
        ),
        "color_shading_delta_c": Quantity(
            "color shading", "delta C", "Largest distance from the center in the plane of CIELAB a* and b*."
        ),
    },
    oracle="relative illumination put into the lens of a simulated camera; drawn fields in closed form",
    left_out=(
        "The text of the standard was not at hand: definitions follow its published descriptions. Cells are smoothed "
        "by the polynomial that noise allows, so that their extremes are not those of noise."
    ),
    order=300,
    view="field",
    headline=("shading_percent", "color_shading_percent"),
    figure="map",
)
