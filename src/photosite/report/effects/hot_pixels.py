"""Hot pixels in the report: distribution of the dark current over the pixels."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.hot_pixels import DARK_DISTRIBUTION, DarkDistribution
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.page import Block, Subheading, Table, columns, figure_block, numeric
from photosite.report.style import BAND, BLUE, GRAY, VERMILION, label_log_ticks, legend_above, new_figure, styled
from photosite.report.tables import format_estimate, interval_text
from photosite.values.uncertain import COVERAGE_95


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    found = calibration.dark_distribution
    if found is None:
        return ()
    figure = figure_block(
        dark_distribution_figure(found),
        "Logarithmic histogram of the pixels' dark currents above their median, with the fitted tail",
        "Histogram of the dark currents above the median on logarithmic axes. The dashed line is the limit above which "
        "only hot pixels lie; the curve is their log-normal distribution, fitted there, and its 95 % band of counts.",
    )
    return Subheading("Distribution over the pixels"), dark_distribution_table(found), figure


def dark_distribution_table(found: DarkDistribution) -> Table:
    """Return a table of the distribution of the dark current over the pixels."""
    rows = tuple(
        (label, format_estimate(entry), unit, interval_text(entry), entry.reason or entry.method)
        for (label, unit), entry in zip(DARK_DISTRIBUTION.values(), found.estimates.values(), strict=True)
    )
    titles = columns("Quantity", numeric("Value"), "Unit", "95 % interval", "Method or reason")
    return Table("Distribution of the dark current over the pixels", titles, rows)


@styled()
def dark_distribution_figure(found: DarkDistribution) -> Figure:
    """Draw the histogram of the dark currents above the median on logarithmic axes, and the fitted hot tail."""
    figure, axes = new_figure(3.8)
    axes.stairs(found.count, found.edges_dn_per_s, color=BLUE, fill=True, alpha=0.5, label="pixels")
    axes.axvline(found.limit_dn_per_s - found.center_dn_per_s, color=GRAY, linestyle="--", linewidth=1.0, label="limit")
    if (expected := found.expected()) is not None:
        middle = np.sqrt(found.edges_dn_per_s[1:] * found.edges_dn_per_s[:-1])
        spread = COVERAGE_95 * np.sqrt(expected)
        axes.plot(middle, expected, color=VERMILION, label="hot pixels, fitted")
        low = np.maximum(expected - spread, 1e-3)
        axes.fill_between(middle, low, expected + spread, color=VERMILION, alpha=BAND, linewidth=0)
    axes.set(xscale="log", yscale="log", xlabel="dark current above the median (DN/s)", ylabel="pixels")
    axes.set_ylim(0.5, 2.0 * max(float(found.count.max()), 1.0))
    label_log_ticks(axes.xaxis)
    legend_above(figure)
    return figure


FIGURE = EffectFigure("Dark current", 10, _blocks)
