"""Colour differences between measured and simulated patches."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.report.style import BLUE, GRAY, VERMILION, WIDTH_IN, styled
from photosite.validation.color import ColorComparison

JUST_VISIBLE = 1.0
"""About the smallest CIEDE2000 difference seen between adjacent surfaces; a convention, for orientation."""


@styled()
def color_difference_figure(colors: ColorComparison) -> Figure:
    """CIEDE2000 and CIE 1976 colour difference of each patch.

    Parameters
    ----------
    colors
        The comparison.

    Returns
    -------
    matplotlib.figure.Figure
        A row per patch, in the chart's order from the top; a dotted line at a difference of 1 where it is in reach.
    """
    count = len(colors.names)
    figure = Figure(figsize=(WIDTH_IN, 1.1 + 0.19 * count))
    axes = figure.add_subplot()
    rows = np.arange(count)
    axes.hlines(rows, 0.0, colors.delta_e_76, color="#D0D0D0", linewidth=1.0)
    axes.plot(colors.delta_e_2000, rows, "o", color=BLUE, label="CIEDE2000")
    axes.plot(colors.delta_e_76, rows, "D", color=VERMILION, markerfacecolor="white", label="CIE 1976")
    largest = float(max(colors.delta_e_76.max(), colors.delta_e_2000.max()))
    if largest > 0.5 * JUST_VISIBLE:
        axes.axvline(JUST_VISIBLE, color=GRAY, linestyle=":", linewidth=1.0)
    axes.set_yticks(rows, colors.names)
    axes.set_ylim(count - 0.4, -0.6)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("colour difference (ΔE units)")
    axes.grid(axis="y", visible=False)
    figure.legend(loc="outside upper right", ncols=2)
    return figure
