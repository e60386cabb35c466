"""Figures of the charge on its way to the output of a CCD: what stays behind at the transfers, multiplication."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.charge_transfer import TransferLoss
from photosite.calibration.effects.em_gain import EmGainResult
from photosite.calibration.result import Calibration
from photosite.report.style import BAND, BLACK, BLUE, GRAY, VERMILION, WIDTH_IN, label_log_ticks, legend_above, styled
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
        low, high = edge.slope.interval_95
        left.fill_between(x, low * x, high * x, color=color, alpha=BAND, linewidth=0)
        right.plot(np.arange(1, edge.lines + 1), 100.0 * edge.profile, marker + "-", color=color)
    for axes in (left, right):
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
    left.set(xlabel="signal of the last illuminated line (DN)", ylabel="charge behind it (DN)")
    right.set(xlabel="line behind the last illuminated one", ylabel="charge over the signal (%)")
    legend_above(figure)
    return figure


@styled()
def em_gain_figure(found: EmGainResult, unity: Calibration, multiplied: Calibration) -> Figure:
    """Draw response and photon transfer without and with multiplication, with the lines of gain and excess noise."""
    figure = Figure(figsize=(WIDTH_IN, 3.6))
    axes = figure.subplots(1, 2)
    for kind, panel in zip(("response", "photon_transfer"), axes, strict=True):
        for name, one, color, marker in (
            ("without multiplication", unity, BLUE, "o"),
            ("with multiplication", multiplied, VERMILION, "s"),
        ):
            curve = next(curves[kind] for curves in one.curves.values() if kind in curves)
            take = curve.used & (curve.x > 0) & (curve.y > 0)
            bars = COVERAGE_95 * curve.y_uncertainty[take]
            panel.errorbar(curve.x[take], curve.y[take], bars, fmt=marker, color=color, elinewidth=0.9, label=name)
            panel.plot(curve.x[take], (curve.intercept or 0.0) + (curve.slope or 0.0) * curve.x[take], color=color)
        panel.set(xscale="log", yscale="log", xlabel=curve.x_label, ylabel=curve.y_label)
        label_log_ticks(panel.xaxis)
        label_log_ticks(panel.yaxis)
    if (k := unity.system_gain_dn_per_e.value) is not None and found.gain.value is not None:
        ends = axes[1].get_xlim()
        x = np.geomspace(max(ends[0], 1e-3), ends[1], 50)
        multiplication = k * found.gain.value
        theory = axes[1].plot(x, multiplication * found.theory * x, ":", color=BLACK, label="theory")
        without = axes[1].plot(x, multiplication * x, "--", color=GRAY, label="without excess noise")
        axes[1].legend(handles=[*theory, *without])
    axes[0].legend()
    return figure
