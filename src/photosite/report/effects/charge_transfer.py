"""Charge transfer in the report: the inefficiency, and the charge behind the last illuminated lines."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.charge_transfer import TransferLoss
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.page import Block, Table, columns, figure_block, numeric, reason_block
from photosite.report.style import BAND, BLACK, BLUE, VERMILION, WIDTH_IN, legend_above, styled
from photosite.report.tables import format_estimate, interval_text
from photosite.values.uncertain import COVERAGE_95


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the charge transfer inefficiency of a CCD, and the charge behind the illuminated lines."""
    found = calibration.charge_transfer
    if found is None:
        return ()
    rows, reasons = [], []
    for label, edge in (("Parallel, along the columns", found.parallel), ("Serial, along the rows", found.serial)):
        entry = edge.inefficiency
        if entry.value is None:
            reasons.append(reason_block(f"{label}: {entry.reason}"))
        else:
            rows.append((label, format_estimate(entry), interval_text(entry), str(edge.transfers), entry.method))
    titles = columns("Direction", numeric("Inefficiency"), "95 % interval", numeric("Transfers"), "Method")
    table = (Table("Charge transfer inefficiency: share that stays behind at a transfer", titles, tuple(rows)),)
    return (*(table if rows else ()), *_transfer_figure(found), *reasons)


def _transfer_figure(found: TransferLoss) -> tuple[Block, ...]:
    if all(edge.slope.value is None for edge in (found.parallel, found.serial)):
        return ()
    return (
        figure_block(
            transfer_figure(found),
            "Charge behind the last illuminated line against its signal, and by line",
            "Extended pixel edge response. Left: charge behind the last illuminated row and column, less that of dark "
            "frames, against the signal of that line; the slope is the inefficiency times the transfers. Bars and "
            "bands are 95 % intervals. Right: where this charge arrives, at the brightest level.",
        ),
    )


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
        low, high = edge.slope.interval_95
        left.fill_between(x, low * x, high * x, color=color, alpha=BAND, linewidth=0)
        right.plot(np.arange(1, edge.lines + 1), 100.0 * edge.profile, marker + "-", color=color)
    for axes in (left, right):
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
    left.set(xlabel="signal of the last illuminated line (DN)", ylabel="charge behind it (DN)")
    right.set(xlabel="line behind the last illuminated one", ylabel="charge over the signal (%)")
    legend_above(figure)
    return figure


FIGURE = EffectFigure("Charge transfer", 10, _blocks)
