"""Blooming in the report: charge in the columns beside overflowing hot pixels."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.blooming import BloomingResult
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.page import Block, Paragraph, Subheading, figure_block, reason_block, sentence
from photosite.report.style import BAND, BLUE, legend_above, new_figure, styled
from photosite.report.tables import format_estimate, interval_text
from photosite.values.uncertain import COVERAGE_95


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    found = calibration.blooming
    if found is None:
        return ()
    if found.kept.value is None:
        return Subheading("Blooming"), reason_block(found.kept.reason or "")
    text = f"Share of the overflow that reaches the column: {format_estimate(found.kept)}, {interval_text(found.kept)}"
    figure = figure_block(
        blooming_figure(found),
        "Charge in the columns beside overflowing hot pixels against their overflow",
        "Charge in the column beside each hot pixel that overflows in the longest dark frames, against its overflow. "
        "The slope is the share that an anti-blooming drain leaves. Bars are 95 % of the sums without overflow.",
    )
    return Subheading("Blooming"), Paragraph(sentence(text)), figure


@styled()
def blooming_figure(found: BloomingResult) -> Figure:
    """Draw the charge beside overflowing pixels against their overflow, and the fitted share."""
    figure, axes = new_figure(3.4)
    bars = COVERAGE_95 * found.uncertainty_dn
    axes.errorbar(found.overflow_dn, found.column_dn, bars, fmt="o", color=BLUE, elinewidth=0.9, label="hot pixels")
    if found.kept.value is not None and found.kept.interval_95 is not None:
        x = np.array([0.0, float(found.overflow_dn.max())])
        axes.plot(x, found.kept.value * x, color=BLUE, label="share that reaches the column, with 95 % band")
        low, high = found.kept.interval_95
        axes.fill_between(x, low * x, high * x, color=BLUE, alpha=BAND, linewidth=0)
    axes.set(xlabel="overflow (DN)", ylabel="charge beside it in the column (DN)")
    legend_above(figure)
    return figure


FIGURE = EffectFigure("Dark current", 20, _blocks)
