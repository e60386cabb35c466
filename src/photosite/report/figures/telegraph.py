"""Blinking pixels: their readings frame by frame, and the two levels that they show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.chip_maps.temporal_noise import Trace
from photosite.report.style import BLUE, ORANGE, WIDTH_IN, styled


@styled()
def telegraph_figure(traces: Sequence[Trace]) -> Figure:
    """A row for each pixel: its readings against the frame, and their histogram beside it.

    Parameters
    ----------
    traces
        One or more.

    Returns
    -------
    matplotlib.figure.Figure
        Dashed: the two levels.
    """
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
    grid[-1][0].set_xlabel("frame")
    grid[-1][1].set_xlabel("frames")
    return figure
