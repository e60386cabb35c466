"""Telegraph noise in the report: blinking pixels frame by frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.chip_maps.temporal_noise import Trace
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.page import Block, figure_block
from photosite.report.style import BLUE, ORANGE, WIDTH_IN, styled

_TRACES = 4  # number of blinking pixels shown frame by frame


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the values of some blinking pixels."""
    chip, temporal = calibration.chip, calibration.temporal
    if chip is None or temporal is None or not len(chip.defects) or not temporal.traces:
        return ()
    return (
        figure_block(
            telegraph_figure(temporal.traces[:_TRACES]),
            "Values of blinking pixels frame by frame, with their two levels and histograms",
            "Blinking pixels (random telegraph noise): values frame by frame, and their histograms. Dashed: the two "
            "levels.",
        ),
    )


@styled()
def telegraph_figure(traces: Sequence[Trace]) -> Figure:
    """Draw a row for each pixel: its values against the frame number, their histogram, and the two levels, dashed."""
    figure = Figure(figsize=(WIDTH_IN, 0.7 + 1.35 * len(traces)))
    grid = figure.subplots(len(traces), 2, sharey="row", squeeze=False, width_ratios=(4, 1))
    for (over_frames, histogram), trace in zip(grid, traces, strict=True):
        frames = np.arange(1, len(trace.dn) + 1)
        over_frames.step(frames, trace.dn, where="mid", color=BLUE, linewidth=0.9)
        over_frames.plot(frames, trace.dn, ".", color=BLUE, markersize=4)
        low, high = float(trace.dn.min()), float(trace.dn.max())
        bins = np.linspace(low - 0.5, high + 0.5, min(int(high - low) + 2, 32))
        histogram.hist(trace.dn, bins, orientation="horizontal", color=BLUE, alpha=0.75)
        for axes in (over_frames, histogram):
            for level in (trace.lower_dn, trace.upper_dn):
                axes.axhline(level, color=ORANGE, linestyle="--", linewidth=1.3, zorder=3)
        over_frames.set_title(f"row {trace.row}, column {trace.col}", loc="left", fontsize=9)
        over_frames.set_ylabel("DN")
        over_frames.margins(x=0.01)
    grid[-1][0].set_xlabel("frame number")
    grid[-1][1].set_xlabel("frames")
    return figure


FIGURE = EffectFigure("Defects", 20, _blocks)
