"""The report of the dark current against temperature."""

from __future__ import annotations

from matplotlib.figure import Figure

from photosite.calibration.dark.temperature import DarkTemperature
from photosite.report.calibration import provenance_blocks, rejected_blocks
from photosite.report.diagnostics import explanations, notices
from photosite.report.numbers import format_number
from photosite.report.page import (
    Block,
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
from photosite.report.plots import draw
from photosite.report.style import legend_above, new_figure, styled
from photosite.report.tables import format_estimate, interval_text

_FOOTER = "Values are estimate ± standard uncertainty (GUM); error bars and bands in figures are 95 % intervals."


def dark_temperature_page(found: DarkTemperature) -> Page:
    """Return the report of a doubling temperature as a page."""
    bases = [one.base for one in found.calibrations if one.base is not None]
    name = bases[0].name if bases else "an image sensor"
    coldest, warmest = found.measured[0][0], found.measured[-1][0]
    frames = sum(one.frame_count for one in found.calibrations)
    lead = (
        f"Doubling temperature of the dark current, from {frames} frames at {len(found.measured)} temperatures, "
        f"{coldest:.1f} to {warmest:.1f} °C."
    )
    drawn = figure_block(
        dark_temperature_figure(found),
        "Dark current against temperature on a logarithmic axis, with the fit",
        "Dark current against temperature, with the fit of one doubling temperature. Bars and band are 95 % intervals.",
    )
    sections = (
        Section("Doubling temperature", (_result_table(found), drawn)),
        Section("Dark current at each temperature", (_points_table(found),)),
        Section("Warnings", (*(notices(found.diagnostics) or _NONE), *explanations(found.diagnostics))),
        Section("Provenance", _provenance(found)),
    )
    return Page(f"Dark current of {name} against temperature", lead, sections, _FOOTER)


@styled()
def dark_temperature_figure(found: DarkTemperature) -> Figure:
    """Draw the dark current against the temperature."""
    figure, axes = new_figure(3.6)
    draw(found, axes)
    legend_above(figure)
    return figure


_NONE = (Paragraph("No problems were found."),)


def _result_table(found: DarkTemperature) -> Table:
    rows = [
        (label, format_estimate(entry), unit, interval_text(entry) or entry.reason or "")
        for label, unit, entry in (
            ("Doubling temperature", "°C", found.doubling_c),
            (f"Dark current at {found.reference_c:.1f} °C", "DN/s", found.dark_current_dn_per_s),
        )
    ]
    fit = f"{format_number(found.chi_square, 3)} / {found.degrees_of_freedom}"
    rows.append(("Scatter about the fit, χ² / degrees of freedom", fit, "", ""))
    titles = columns("Quantity", numeric("Value"), "Unit", "95 % interval")
    return Table(sentence(found.doubling_c.method), titles, tuple(rows))


def _points_table(found: DarkTemperature) -> Table:
    rows = tuple(
        (f"{celsius:.1f}", format_estimate(entry), interval_text(entry), format_number(found.at(celsius), 4))
        for celsius, entry in found.measured
    )
    titles = columns(
        numeric("Temperature (°C)"), numeric("Dark current (DN/s)"), "95 % interval", numeric("Fit (DN/s)")
    )
    return Table("Measured and fitted dark current", titles, rows)


def _provenance(found: DarkTemperature) -> tuple[Block, ...]:
    blocks: list[Block] = []
    for number, one in enumerate(found.calibrations, start=1):
        blocks += [Subheading(one.source), *rejected_blocks(one), *provenance_blocks(one, f"series{number}.frames")]
    return tuple(blocks)
