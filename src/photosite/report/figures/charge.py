"""Figures of the charge on its way to the output of a CCD: charge that stays behind at the transfers."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.charge_transfer import TransferLoss
from photosite.report.style import BAND, BLACK, BLUE, VERMILION, WIDTH_IN, styled
from photosite.values.uncertain import COVERAGE_95


@styled()
def transfer_figure(found: TransferLoss) -> Figure:
    """Draw the charge behind the last illuminated line: against its signal, and by line at the brightest level."""
    figure = Figure(figsize=(WIDTH_IN, 3.4))
    left, right = figure.subplots(1, 2)
    for name, edge, color, marker in (("rows", found.parallel, BLUE, "o"), ("columns", found.serial, VERMILION, "s")):
        if edge.slope.value is None or edge.slope.interval_95 is None:
            continue
        bars = COVERAGE_95 * edge.uncertainty_dn
        left.errorbar(edge.signal_dn, edge.trailing_dn, bars, fmt=marker, color=color, elinewidth=0.9, label=name)
        x = np.array([0.0, edge.signal_dn.max()])
        left.plot(x, edge.slope.value * x, color=color)
        left.fill_between(x, *(end * x for end in edge.slope.interval_95), color=color, alpha=BAND, linewidth=0)
        right.plot(np.arange(1, edge.lines + 1), 100.0 * edge.profile, marker + "-", color=color)
    for axes in (left, right):
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
    left.set(xlabel="signal of the last illuminated line (DN)", ylabel="charge behind it (DN)")
    right.set(xlabel="line behind the last illuminated one", ylabel="charge over the signal (%)")
    left.legend()
    return figure
