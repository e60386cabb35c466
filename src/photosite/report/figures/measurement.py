"""Figures of measurements of image quality: curves that share their axes, and maps over the frame."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.metrics.measurement import Curve, FieldMap, Result
from photosite.report.style import (
    BLACK,
    GRAY,
    channel_style,
    draw_band,
    label_log_ticks,
    legend_above,
    line_style,
    new_figure,
    styled,
)
from photosite.values.uncertain import COVERAGE_95

_Drawn = TypeVar("_Drawn", Curve, FieldMap)

_CHANNELS = ("R", "G", "B", "Y", "M")
_MARKERS = "os^vDP"
_SHORT_NAME = 10
"""Characters of names of which six fit side by side."""
_MOST_NAMED = 12
"""Curves up to which a legend names each."""
_SMALL_IN = (3.6, 2.7)
_MOST_SMALL = 6
"""Curves up to which a small figure shows all."""
_LABEL = 28
"""Characters in a line of the label of a small figure's axis."""


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
        if curve.ends is not None:
            _draw_difference(axes, curve, curve.color or color, named=position == 0)
            continue
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


def _draw_difference(axes: Axes, curve: Curve, color: str, *, named: bool) -> None:
    """Draw a line from a filled point to a hollow one; the first curve names both in the legend."""
    first, last = curve.ends if named and curve.ends is not None else (None, None)
    axes.plot(curve.x, curve.y, color=GRAY, linewidth=0.8)
    axes.plot(curve.x[:1], curve.y[:1], "o", color=color, markeredgecolor=GRAY, markersize=5, label=first)
    axes.plot(curve.x[-1:], curve.y[-1:], "x", color=BLACK, markersize=4, label=last)


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
    return [_curve_figure(curves, new_figure(3.4)) for curves in figures_of(result).values()]


def _curve_figure(curves: list[Curve], new: tuple[Figure, Axes], small: bool = False) -> Figure:
    figure, axes = new
    draw_curves_of(axes, curves)
    if curves[0].ends is not None:
        legend_above(figure)
    elif 1 < len(curves) <= _MOST_NAMED:
        longest = max(len(curve.part) for curve in curves)
        few, many = (2, 4) if small else (3, 6)
        legend_above(figure, columns=many if longest < (_SHORT_NAME // 2 if small else _SHORT_NAME) else few)
    return figure


@styled()
def map_figure(found: FieldMap) -> Figure:
    """Return the figure of a map."""
    figure, axes = new_figure(4.0)
    draw_map(axes, found)
    return figure


@styled()
def small_figure(result: Result, channel: str) -> Figure | None:
    """Return the figure of the first page of a report, of one channel where there are many curves; None without one."""
    kind = "" if result.measurement is None else result.measurement.figure
    figure = Figure(figsize=_SMALL_IN)
    if kind == "map" and result.maps:
        draw_map(figure.subplots(), of_channel(result.maps, channel)[0])
    elif kind == "curves" and result.curves:
        curves = next(iter(figures_of(result).values()))
        named = len(curves) <= _MOST_SMALL or curves[0].ends is not None
        curves = curves if named else list(of_channel(curves, channel))
        axes = figure.subplots()
        _curve_figure(curves, (figure, axes), small=True)
        if axes.get_yscale() == "linear" and (shown := _certain(curves)) is not None:
            axes.set_ylim(*shown)
            _cut(axes, *shown)
    else:
        return None
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        axis.set_label_text(fill(axis.get_label_text(), _LABEL))
    return figure


def _cut(axes: Axes, low: float, high: float) -> None:
    """Cut lines and bands at the limits of the axis: fpdf2 does not clip drawings."""
    for line in axes.get_lines():
        y = np.asarray(line.get_ydata(), dtype=np.float64)
        line.set_ydata(np.where((y < low) | (y > high), np.nan, y))
    for band in axes.collections:
        for path in band.get_paths():
            path.vertices[:, 1] = np.clip(path.vertices[:, 1], low, high)  # type: ignore[index]


def _certain(curves: list[Curve]) -> tuple[float, float] | None:
    """Return limits of an axis that leave out values hidden by noise; None where these are few, or most."""
    y = np.concatenate([curve.y for curve in curves])
    spreads = [np.zeros_like(curve.y) if (u := curve.standard_uncertainty) is None else u for curve in curves]
    certain = y[np.isfinite(y) & (np.concatenate(spreads) < _CERTAIN * np.nanpercentile(np.abs(y), 75))]
    if not y.size / 2 < certain.size < y.size:
        return None
    margin = 0.1 * float(np.ptp(certain))
    return float(certain.min()) - margin, float(certain.max()) + margin


_CERTAIN = 0.1


def of_channel(found: Sequence[_Drawn], channel: str) -> Sequence[_Drawn]:
    """Return the curves or maps of a channel, or all if none is."""
    return [each for each in found if each.part.partition(", ")[0] == channel] or found
