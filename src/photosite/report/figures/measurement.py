"""Figures of measurements of image quality: curves that share their axes, and maps over the frame."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.metrics.measurement import Curve, FieldMap, Result
from photosite.report.style import (
    channel_style,
    draw_band,
    label_log_ticks,
    legend_above,
    line_style,
    new_figure,
    styled,
)
from photosite.values.uncertain import COVERAGE_95

_CHANNELS = ("R", "G", "B", "Y", "M")
_MARKERS = "os^vDP"
_SHORT_NAME = 10
"""Characters of names of which six fit side by side."""
_MOST_NAMED = 12
"""Curves up to which a legend names each."""


def figures_of(result: Result) -> dict[tuple[str, str], list[Curve]]:
    """Return the curves by the labels of their axes: those that share a figure."""
    found: dict[tuple[str, str], list[Curve]] = {}
    for curve in result.curves:
        found.setdefault((curve.x_label, curve.y_label), []).append(curve)
    return found


def draw_curves_of(axes: Axes, curves: list[Curve]) -> Axes:
    """Draw curves with their 95 % bands, points with their 95 % intervals, and return the axes."""
    for position, curve in enumerate(curves):
        is_channel = curve.part in _CHANNELS
        color, _, line = channel_style(curve.part, position) if is_channel else line_style(position)
        if not curve.joined:
            spread = None if curve.standard_uncertainty is None else COVERAGE_95 * curve.standard_uncertainty
            form = _MARKERS[position % len(_MARKERS)]
            axes.errorbar(
                curve.x, curve.y, spread, fmt=form, color=color, label=curve.part or None, markersize=4, elinewidth=0.8
            )
            continue
        axes.plot(curve.x, curve.y, color=color, linestyle=line, label=curve.part or None)
        if curve.standard_uncertainty is not None:
            draw_band(axes, curve.x, curve.y, COVERAGE_95 * curve.standard_uncertainty, color)
    axes.set(xlabel=curves[0].x_label, ylabel=curves[0].y_label)
    if curves[0].x_label.startswith("log "):
        axes.set(xlabel=curves[0].x_label.removeprefix("log "), xscale="log")
        label_log_ticks(axes.xaxis)
    if curves[0].y_label.startswith("log "):
        axes.set(ylabel=curves[0].y_label.removeprefix("log "), yscale="log")
        label_log_ticks(axes.yaxis)
    return axes


def draw_map(axes: Axes, found: FieldMap) -> Axes:
    """Draw a map over the frame with its color bar, and return the axes."""
    steps = [np.diff(places).mean() if places.size > 1 else 1.0 for places in (found.row, found.col)]
    (top, bottom), (left, right) = (
        (places[0] - step / 2, places[-1] + step / 2)
        for places, step in zip((found.row, found.col), steps, strict=True)
    )
    image = axes.imshow(found.values, extent=(left, right, bottom, top), cmap="viridis", aspect="equal")
    axes.set(xlabel=found.axes[1], ylabel=found.axes[0], title=found.part or None)
    axes.grid(visible=False)
    figure = axes.figure
    assert isinstance(figure, Figure)
    figure.colorbar(image, ax=axes, label=found.label)
    return axes


@styled()
def curve_figures(result: Result) -> list[Figure]:
    """Return a figure for each pair of axes."""
    figures = []
    for curves in figures_of(result).values():
        figure, axes = new_figure(3.4)
        draw_curves_of(axes, curves)
        if 1 < len(curves) <= _MOST_NAMED:
            longest = max(len(curve.part) for curve in curves)
            legend_above(figure, columns=6 if longest < _SHORT_NAME else 3)
        figures.append(figure)
    return figures


@styled()
def map_figure(found: FieldMap) -> Figure:
    """Return the figure of a map."""
    figure, axes = new_figure(4.0)
    draw_map(axes, found)
    return figure
