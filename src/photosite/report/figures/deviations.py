"""Estimates against the truth, in standard uncertainties."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from photosite.report.style import BLACK, BLUE, GRAY, WIDTH_IN, styled
from photosite.values.measured import COVERAGE_95


@styled()
def deviations_figure(labels: Sequence[str], deviations: Sequence[float]) -> Figure:
    """How many standard uncertainties each estimate lies from the truth.

    Parameters
    ----------
    labels
        The parameters.
    deviations
        (estimate - truth) / standard uncertainty of each.

    Returns
    -------
    matplotlib.figure.Figure
        A row per parameter; in the band, 1.96 to each side, lie 95 % of the estimates of an honest calibration.
    """
    rows = np.arange(len(labels))
    figure = Figure(figsize=(WIDTH_IN, 1.1 + 0.27 * len(labels)))
    axes = figure.add_subplot()
    axes.axvspan(-COVERAGE_95, COVERAGE_95, color="#E8F1F8", zorder=0)
    for limit in (-COVERAGE_95, COVERAGE_95):
        axes.axvline(limit, color=GRAY, linewidth=0.9, linestyle="--")
    axes.axvline(0.0, color=BLACK, linewidth=0.9)
    axes.hlines(rows, 0.0, np.asarray(deviations), color=BLUE, linewidth=1.4)
    axes.plot(deviations, rows, "o", color=BLUE, markersize=6)
    reach = max(3.0, 1.1 * float(np.max(np.abs(deviations))))
    axes.set_xlim(-reach, reach)
    axes.set_yticks(rows, list(labels))
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.set_xlabel("estimate − truth (standard uncertainties)")
    axes.grid(axis="y", visible=False)
    return figure
