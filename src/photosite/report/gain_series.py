"""The report of a gain series: every setting in a table, the two parts of read noise, the switch."""

from __future__ import annotations

from os import PathLike

from photosite.calibration.gain_series.result import GainSeries, GainStep
from photosite.calibration.parameters import parameter_label
from photosite.report.blocks import figure_block, sentence
from photosite.report.calibration import provenance_blocks, rejected_blocks, warning_blocks
from photosite.report.figures.gain_series import gain_series_figure
from photosite.report.html import Block, Column, Notice, Page, Paragraph, Section, Subheading, Table
from photosite.report.numbers import format_number
from photosite.report.tables import format_estimate
from photosite.report.write import write_report

SERIES_PARAMETERS = (
    "system_gain_dn_per_e",
    "read_noise_dn",
    "read_noise_e",
    "black_level_dn",
    "saturation_capacity_e",
    "dynamic_range_db",
)
"""What a series shows of each setting; the rest is in the setting's own report."""

_SHORT = dict(zip(SERIES_PARAMETERS, ("Gain", "Read noise", "Read noise", "Black", "Full well", "Range"), strict=True))
"""Column titles; a table of seven columns has no room for long ones."""

FOOTER = "Values are estimate ± one standard uncertainty (GUM); bars and bands in figures are 95 % intervals."


def write_gain_series_report(series: GainSeries, path: str | PathLike[str]) -> None:
    """Write the report of a gain series: one file that needs no other.

    Parameters
    ----------
    series
        What `calibrate_series` gave.
    path
        The file: a PDF where it ends in .pdf, an HTML page otherwise.

    Raises
    ------
    FileError
        If it cannot be written; a file that had the name stays as it was.
    """
    write_report(gain_series_page(series), path)


def gain_series_page(series: GainSeries) -> Page:
    """The report of a gain series as a page, before it is HTML."""
    frames = sum(step.calibration.frame_count for step in series.steps)
    lead = (
        f"{frames} frames of darkness and flat light at {len(series.steps)} gain settings, {series.settings[0]:g} to "
        f"{series.settings[-1]:g}; settings are read as "
        + {"proportional": "proportional to the gain."}.get(series.scale, f"{series.scale}.")
    )
    name = "an image sensor" if series.steps[0].calibration.base is None else series.steps[0].calibration.base.name
    figure = figure_block(
        gain_series_figure(series),
        "Read noise in electrons and system gain against the gain setting",
        "Above: read noise referred to the input, and its parts before and after the amplifier. Below: system gain, "
        "and the gain that the settings stand for. Bars and bands are 95 % intervals."
        + (" The blue band is where the conversion gain switches." if series.switch else ""),
    )
    sections = (
        Section("Settings", (settings_table(series), figure)),
        Section("Read noise before and after the amplifier", (Paragraph(_MODEL), modes_table(series))),
        Section("Conversion gain", switch_blocks(series)),
        Section("Warnings and frames left out", warning_sections(series)),
        Section("Provenance", provenance_sections(series)),
    )
    return Page(f"Gain series of {name}", lead, sections, FOOTER)


_QUIET = Paragraph("Nothing was noticed that spoils what is said of all settings together.")
_MODEL = (
    "The variance of the read noise in DN is (noise before the amplifier × K)² + (noise after it)²: the first is "
    "amplified with the signal, the second is the converter's and does not know the gain. Rounding is taken off."
)


def warning_sections(series: GainSeries) -> tuple[Block, ...]:
    """What is to be known of the series, then of each setting: frames left out and warnings."""
    own = {_of_setting(step, text) for step in series.steps for text in step.calibration.warnings}
    together = tuple(Notice(sentence(text), warning=True) for text in series.warnings if text not in own)
    blocks: list[Block] = [*together] if together else [_QUIET]
    for step in series.steps:
        of_it = (*rejected_blocks(step.calibration), *warning_blocks(step.calibration))
        blocks += [Subheading(f"Gain setting {step.setting:g}"), *of_it]
    return tuple(blocks)


def _of_setting(step: GainStep, text: str) -> str:
    """A setting's warning as it stands among the series'."""
    return f"gain setting {step.setting:g}: {text}"


def provenance_sections(series: GainSeries) -> tuple[Block, ...]:
    """Per setting: what was opened, which frames were used, and their digests."""
    blocks: list[Block] = []
    for step in series.steps:
        blocks += [Subheading(f"Gain setting {step.setting:g}"), *provenance_blocks(step.calibration)]
    return tuple(blocks)


def settings_table(series: GainSeries) -> Table:
    """A row per setting."""
    titles = [f"{_SHORT[name]} ({parameter_label(name).unit})" for name in SERIES_PARAMETERS]
    columns = (Column("Setting", numeric=True), *(Column(title, numeric=True) for title in titles))
    rows = tuple(
        (f"{step.setting:g}", *(format_estimate(getattr(step.calibration, name)) for name in SERIES_PARAMETERS))
        for step in series.steps
    )
    return Table("By gain setting, with standard uncertainties", columns, rows)


def modes_table(series: GainSeries) -> Table:
    """A row per conversion gain."""
    rows = []
    for mode in series.modes:
        free = mode.degrees_of_freedom
        fit = "" if free is None or mode.chi_square is None else f"{format_number(mode.chi_square, 3)} / {free}"
        parts = (mode.pre_amplifier_noise_e, mode.post_amplifier_noise_dn)
        told = [
            format_estimate(part)
            + (f" (< {format_number(part.upper_limit_95, 3)})" if part.upper_limit_95 is not None else "")
            + (f": {part.reason}" if part.reason else "")
            for part in parts
        ]
        rows.append((f"{mode.settings[0]:g} to {mode.settings[-1]:g}", *told, fit, f"{mode.scatter_percent:.2g}"))
    columns = (
        Column("Settings"),
        Column("Before it (e⁻)", numeric=True),
        Column("After it (DN)", numeric=True),
        Column("χ² / freedom", numeric=True),
        Column("Scatter (%)", numeric=True),
    )
    return Table(
        "Noise before and after the amplifier; scatter is the variance's beyond sampling", columns, tuple(rows)
    )


def switch_blocks(series: GainSeries) -> tuple[Block, ...]:
    """Whether the conversion gain switches, and at which setting an electron is one digital number."""
    return Paragraph(switch_sentence(series)), Paragraph(unity_sentence(series))


def unity_sentence(series: GainSeries) -> str:
    """The setting of one digital number per electron, in a sentence."""
    unity = series.unity_gain
    if unity.value is None:
        return f"No gain setting is known to have one digital number per electron: {unity.reason}."
    return f"One digital number is one electron at the gain setting {format_estimate(unity)} ({unity.method})."


def switch_sentence(series: GainSeries) -> str:
    """What was found of a switch, in a sentence."""
    switch = series.switch
    if switch is None:
        return "No switch of the conversion gain was found among these settings."
    (below, above), (low, high) = switch.between, switch.between_95
    show = "show" if len(switch.seen_in) > 1 else "shows"
    return (
        f"The conversion gain switches between the settings {below:g} and {above:g} (95 %: between {low:g} and "
        f"{high:g}), as {' and '.join(switch.seen_in)} {show} (p = {switch.p_value:.1g}). Above over below, gain per "
        f"unit of setting is {format_estimate(switch.gain_ratio)}, noise before the amplifier in electrons "
        f"{format_estimate(switch.read_noise_ratio)}."
    )
