"""The report of a multiplication register: gain and excess noise, from two calibrations."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.em_gain import EmGainResult
from photosite.calibration.result import Calibration
from photosite.report.calibration import provenance_blocks, rejected_blocks, warning_blocks
from photosite.report.diagnostics import explanations, notices
from photosite.report.page import Block, Page, Paragraph, Section, Subheading, Table, columns, figure_block, numeric
from photosite.report.style import BLACK, BLUE, GRAY, VERMILION, WIDTH_IN, label_log_ticks, styled
from photosite.report.tables import format_estimate, interval_text
from photosite.values.uncertain import COVERAGE_95

_FOOTER = "Values are estimate ± standard uncertainty (GUM); error bars in figures are 95 % intervals."


def em_gain_page(found: EmGainResult) -> Page:
    """Return the report of a multiplication register as a page; the result has both calibrations."""
    unity, multiplied = found.unity, found.multiplied
    assert unity is not None
    assert multiplied is not None
    name = "an image sensor" if unity.base is None else unity.base.name
    drawn = figure_block(
        em_gain_figure(found, unity, multiplied),
        "Response and photon transfer without and with multiplication",
        "Left: signal against light; the distance of the lines is the gain. Right: temporal variance against signal. "
        "The slope is K without multiplication, and K times gain times excess noise factor with it. Dotted: the excess "
        "noise of theory. Dashed: none.",
    )
    problems: list[Block] = [*notices(found.diagnostics)]
    every = (*found.diagnostics, *unity.diagnostics, *multiplied.diagnostics)
    provenance: list[Block] = []
    for label, one, beside in (("Without", unity, "unity"), ("With", multiplied, "multiplied")):
        problems += [Subheading(f"{label} multiplication"), *rejected_blocks(one), *warning_blocks(one)]
        provenance += [Subheading(f"{label} multiplication"), *provenance_blocks(one, f"{beside}.frames")]
    sections = (
        Section("Gain and excess noise", (_table(found), Paragraph(_HOW), drawn)),
        Section("Warnings and rejected frames", (*problems, *explanations(every))),
        Section("Provenance", tuple(provenance)),
    )
    lead = f"Gain and excess noise of the register, from {unity.frame_count} frames without and "
    lead += f"{multiplied.frame_count} with multiplication."
    return Page(f"Electron multiplication of {name}", lead, sections, _FOOTER)


_HOW = (
    "Theory: F² = 2 (g − 1) g^(−(N+1)/N) + 1/g for a register of N stages with the gain g (Robbins and Hadwen, IEEE "
    "Trans. Electron Devices 50 (2003) 1227)."
)


def _table(found: EmGainResult) -> Table:
    rows = [
        (label, format_estimate(entry), unit, interval_text(entry), entry.reason or entry.method)
        for label, unit, entry in (
            ("Gain g", "1", found.gain),
            ("Excess noise factor F²", "1", found.excess_noise_factor),
            ("Read noise in front of the register", "e⁻", found.read_noise_e),
        )
    ]
    stages = "a large number of" if found.stated.stages is None else str(found.stated.stages)
    rows.insert(2, ("– of theory", f"{found.theory:.4g}", "1", "", f"with {stages} stages"))
    titles = columns("Quantity", numeric("Value"), "Unit", "95 % interval", "Method")
    return Table("Multiplication register", titles, tuple(rows))


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
