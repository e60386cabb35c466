"""Figures of rows, columns and readout channels: intervals of their noise, offsets and gains."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.report.style import BLACK, BLUE, WIDTH_IN, styled
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Measured


@styled()
def readout_channels_figure(channels: ReadoutChannels) -> Figure:
    """Draw gain and offset of each readout channel with 95 % intervals, less those of the mean channel."""
    rows, cols = channels.shape
    names = [f"{r + 1}, {c + 1}" if min(rows, cols) > 1 else str(r + c + 1) for r, c in np.ndindex(rows, cols)]
    tables = {
        "gain deviation (%)": (channels.relative_gain, 1.0, 100.0),
        "offset (e⁻)": (channels.offset_e, 0.0, 1.0),
    }
    known = {label: entry for label, entry in tables.items() if entry[0] is not None}
    figure = Figure(figsize=(WIDTH_IN, 3.2))
    panels = figure.subplots(1, len(known), squeeze=False)[0]
    for axes, (label, (table, usual, scale)) in zip(panels, known.items(), strict=True):
        entries = [entry for row in table or () for entry in row]
        shown = [_shifted(entry, usual, scale) for entry in entries]
        _draw_intervals(axes, dict(zip(names, shown, strict=True)), label)
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
        axes.set_xlabel("readout channel" + (" (row, column)" if min(rows, cols) > 1 else ""))
    return figure


def _shifted(entry: Measured, usual: float, scale: float) -> tuple[float, float, float]:
    """Return value and interval less the usual value, scaled."""
    value, low, high = (scale * (number - usual) for number in (entry.value, *entry.interval_95))
    return value, low, high


@styled()
def line_pattern_figure(noise_e: Mapping[str, Estimate], gains_percent: Mapping[str, Estimate]) -> Figure:
    """Draw standard deviations of rows and columns with 95 % intervals: electrons at the top, gains below.

    Estimates by label, those without a value left out. A hollow point at 0 is a negative estimate of a variance; the
    interval then ends at its upper limit.
    """
    panels = {"standard deviation (e⁻)": _intervals(noise_e), "standard deviation (%)": _intervals(gains_percent)}
    known = {label: entries for label, entries in panels.items() if entries}
    heights = [1.0 + len(entries) for entries in known.values()]
    figure = Figure(figsize=(WIDTH_IN, 0.32 * sum(heights) + 0.4 * len(heights)))
    column = figure.subplots(len(known), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, (label, entries) in zip(column, known.items(), strict=True):
        values, low, high = np.array(list(entries.values())).T
        places = np.arange(len(entries), dtype=np.float64)
        axes.hlines(places, low, high, color=BLUE, linewidth=1.4)
        _draw_points(axes, values, places, values != 0.0)
        axes.set_yticks(places, list(entries))
        axes.set_ylim(len(entries) - 0.4, -0.6)
        axes.set_xlim(0.0, 1.06 * max(high))
        axes.set_xlabel(label)
        axes.grid(visible=False, axis="y")
    return figure


def _intervals(estimates: Mapping[str, Estimate]) -> dict[str, tuple[float, float, float]]:
    """Return value and interval of the estimates that have a value, at 0 or above."""
    found = {}
    for label, entry in estimates.items():
        if entry.value is not None and entry.interval_95 is not None:
            found[label] = (max(entry.value, 0.0), *entry.interval_95)
    return found


def _draw_intervals(axes: Axes, entries: Mapping[str, tuple[float, float, float]], label: str) -> None:
    """Draw a point with its interval for each entry."""
    values, low, high = np.array(list(entries.values())).T
    places = np.arange(len(entries), dtype=np.float64)
    axes.vlines(places, low, high, color=BLUE, linewidth=1.4)
    _draw_points(axes, places, values, np.ones(len(values), bool))
    axes.set_xticks(places, list(entries))
    axes.set_xlim(-0.6, len(entries) - 0.4)
    axes.set_ylabel(label)
    axes.grid(visible=False, axis="x")


def _draw_points(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], filled: NDArray[np.bool_]) -> None:
    """Draw points, hollow where they are not filled."""
    for fill, which in ((BLUE, filled), ("white", ~filled)):
        if which.any():
            axes.plot(x[which], y[which], "o", color=BLUE, markerfacecolor=fill, zorder=3, clip_on=False)
