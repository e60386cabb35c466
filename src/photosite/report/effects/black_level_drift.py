"""Drift of the black level in the report: means of successive dark frames."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.black_level_drift import BlackLevelSeries
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.page import Block, Subheading, figure_block
from photosite.report.style import BLACK, GRAY, line_style, new_figure, styled
from photosite.report.tables import estimates_table
from photosite.values.uncertain import COVERAGE_95

_SERIES = 6  # largest number of series drawn


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the drift of the black level from frame to frame; nothing with too few dark frames."""
    if (found := calibration.black_level_drift) is None:
        return ()
    judged = "beyond chance" if found.significant else "no drift beyond chance"
    entries = {("Standard deviation", "DN"): found.drift_dn, ("Standard deviation", "e⁻"): found.drift_e}
    table = estimates_table(f"1/f drift over {found.frames} frames, noise subtracted: {judged}", entries)
    heading = Subheading("Drift of the black level")
    if not found.significant:
        return heading, table
    figure = figure_block(
        drift_figure(found),
        "Means of successive dark frames less that of their series",
        "Means of successive dark frames, less that of their exposure time; the longest series first, in blue. Gray: "
        "95 % of what the noise of pixels, rows and columns explains.",
    )
    return heading, figure, table


@styled()
def drift_figure(found: BlackLevelSeries) -> Figure:
    """Draw the means of successive dark frames less that of their series; band: 95 % of what noise explains."""
    figure, axes = new_figure(height_in=3.6)
    order = sorted(range(len(found.means_dn)), key=lambda n: -len(found.means_dn[n]))[:_SERIES]
    for position, n in enumerate(order):
        color, marker, line = line_style(position)
        means = found.means_dn[n]
        axes.plot(np.arange(1, len(means) + 1), means, line, color=color, marker=marker, markersize=3.5, linewidth=1.0)
    noise = COVERAGE_95 * found.noise_dn[order[0]]
    axes.axhspan(-noise, noise, color=GRAY, alpha=0.25, linewidth=0, zorder=0)
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    axes.set(xlabel="frame of the series", ylabel="mean less that of the series (DN)")
    return figure


FIGURE = EffectFigure("Dark current", 40, _blocks)
