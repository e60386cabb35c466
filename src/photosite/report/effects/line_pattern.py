"""Rows and columns in the report: their noise from frame to frame, and their fixed offsets and gains."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.parameters import parameter_label
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.page import Block, figure_block, reason_block
from photosite.report.style import BLUE, WIDTH_IN, styled
from photosite.report.tables import estimates_table
from photosite.values.estimate import Estimate

_LINE_NOISE = {
    "row_noise_e": "noise of rows",
    "column_noise_e": "noise of columns",
    "row_offset_e": "offsets of rows",
    "column_offset_e": "offsets of columns",
}

_LINE_GAIN = {"column_gain_percent": "gains of columns"}


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return temporal noise and fixed pattern of rows and columns."""
    names = (*_LINE_NOISE, *_LINE_GAIN)
    estimates = {name: getattr(calibration, name) for name in names}
    blocks: list[Block] = []
    if any(entry.value is not None for entry in estimates.values()):
        noise, gains = ({text: estimates[name] for name, text in part.items()} for part in (_LINE_NOISE, _LINE_GAIN))
        blocks.append(
            figure_block(
                line_pattern_figure(noise, gains),
                "Standard deviations of rows and columns with 95 % intervals",
                "Noise of rows and columns changes from frame to frame; offsets and gains are fixed. Lines are 95 % "
                "intervals; a hollow point is a variance that came out negative, with its upper limit.",
            )
        )
        shown = {(at.label, at.unit): estimates[name] for name in names if (at := parameter_label(name))}
        blocks.append(estimates_table("Rows and columns, standard deviations", shown))
    else:
        blocks.append(reason_block(estimates["row_offset_e"].reason or "the lines were not analyzed"))
    return tuple(blocks)


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
        for fill, which in ((BLUE, values != 0.0), ("white", values == 0.0)):
            if which.any():
                look = {"color": BLUE, "markerfacecolor": fill, "zorder": 3, "clip_on": False}
                axes.plot(values[which], places[which], "o", **look)
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


FIGURE = EffectFigure("Rows, columns and readout channels", 10, _blocks)
