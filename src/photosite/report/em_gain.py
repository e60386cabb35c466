"""The report of a multiplication register: gain and excess noise, from two calibrations."""

from __future__ import annotations

from photosite.calibration.effects.em_gain import EmGainResult
from photosite.report.calibration import provenance_blocks, rejected_blocks, warning_blocks
from photosite.report.figures.charge import em_gain_figure
from photosite.report.page import (
    Block,
    Notice,
    Page,
    Paragraph,
    Section,
    Subheading,
    Table,
    columns,
    figure_block,
    numeric,
    sentence,
)
from photosite.report.tables import format_estimate, interval_text

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
    problems: list[Block] = [Notice(sentence(text), warning=True) for text in found.warnings]
    provenance: list[Block] = []
    for label, one, beside in (("Without", unity, "unity"), ("With", multiplied, "multiplied")):
        problems += [Subheading(f"{label} multiplication"), *rejected_blocks(one), *warning_blocks(one)]
        provenance += [Subheading(f"{label} multiplication"), *provenance_blocks(one, f"{beside}.frames")]
    sections = (
        Section("Gain and excess noise", (_table(found), Paragraph(_HOW), drawn)),
        Section("Warnings and rejected frames", tuple(problems)),
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
