"""The report of a gain series: a table of all settings, the two parts of read noise, the conversion-gain switch."""

from __future__ import annotations

from os import PathLike

from photosite.calibration.gain_series.result import GainSeries, GainStep
from photosite.calibration.parameters import parameter_label
from photosite.report.calibration import provenance_blocks, rejected_blocks, warning_blocks
from photosite.report.figures.gain_series import gain_series_figure
from photosite.report.numbers import format_number
from photosite.report.page import (
    Block,
    Column,
    Notice,
    Page,
    Paragraph,
    Section,
    Subheading,
    Table,
    figure_block,
    sentence,
)
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
"""Parameters shown for each setting."""

_SHORT = dict(zip(SERIES_PARAMETERS, ("Gain", "Read noise", "Read noise", "Black", "Full well", "Range"), strict=True))
"""Short column titles for a table of seven columns."""

FOOTER = "Values are estimate ± standard uncertainty (GUM); error bars and bands in figures are 95 % intervals."


def write_gain_series_report(series: GainSeries, path: str | PathLike[str]) -> None:
    """Write the report of a gain series as a single file.

    Parameters
    ----------
    series
        Result of `calibrate_series`.
    path
        File to write: PDF if the suffix is .pdf, else HTML.

    Raises
    ------
    FileError
        If the file cannot be written. An existing file is then unchanged.
    """
    write_report(gain_series_page(series), path)


def gain_series_page(series: GainSeries) -> Page:
    """Return the report of a gain series as a page."""
    frames = sum(step.calibration.frame_count for step in series.steps)
    lead = (
        f"{frames} dark frames and flat fields at {len(series.steps)} gain settings, {series.settings[0]:g} to "
        f"{series.settings[-1]:g}. Scale of the settings: "
        + {"proportional": "proportional to the gain."}.get(series.scale, f"{series.scale}.")
    )
    name = "an image sensor" if series.steps[0].calibration.base is None else series.steps[0].calibration.base.name
    figure = figure_block(
        gain_series_figure(series),
        "Read noise in electrons and system gain against the gain setting",
        "Above: read noise referred to the input, and its parts before and after the amplifier. Below: system gain, "
        "and the nominal gain of the settings. Error bars and bands are 95 % intervals."
        + (" The blue band marks the conversion-gain switch." if series.switch else ""),
    )
    sections = (
        Section("Settings", (settings_table(series), figure)),
        Section("Read noise before and after the amplifier", (Paragraph(_MODEL), modes_table(series))),
        Section("Conversion gain", switch_blocks(series)),
        Section("Warnings and rejected frames", warning_sections(series)),
        Section("Provenance", provenance_sections(series)),
    )
    return Page(f"Gain series of {name}", lead, sections, FOOTER)


_QUIET = Paragraph("No problems found in the joint analysis.")
_MODEL = (
    "The variance of the read noise in DN is (noise before the amplifier × K)² + (noise after the amplifier)². The "
    "first part is amplified with the signal; the second is independent of the gain. Rounding is subtracted."
)


def warning_sections(series: GainSeries) -> tuple[Block, ...]:
    """Return the warnings of the series, then rejected frames and warnings of each setting."""
    own = {_of_setting(step, text) for step in series.steps for text in step.calibration.warnings}
    together = tuple(Notice(sentence(text), warning=True) for text in series.warnings if text not in own)
    blocks: list[Block] = [*together] if together else [_QUIET]
    for step in series.steps:
        of_it = (*rejected_blocks(step.calibration), *warning_blocks(step.calibration))
        blocks += [Subheading(f"Gain setting {step.setting:g}"), *of_it]
    return tuple(blocks)


def _of_setting(step: GainStep, text: str) -> str:
    """Return a setting's warning as it appears among those of the series."""
    return f"gain setting {step.setting:g}: {text}"


def provenance_sections(series: GainSeries) -> tuple[Block, ...]:
    """Return source, frames and digests of each setting."""
    blocks: list[Block] = []
    for step in series.steps:
        blocks += [Subheading(f"Gain setting {step.setting:g}"), *provenance_blocks(step.calibration)]
    return tuple(blocks)


def settings_table(series: GainSeries) -> Table:
    """Return a table with a row per setting."""
    titles = [f"{_SHORT[name]} ({parameter_label(name).unit})" for name in SERIES_PARAMETERS]
    columns = (Column("Setting", numeric=True), *(Column(title, numeric=True) for title in titles))
    rows = tuple(
        (f"{step.setting:g}", *(format_estimate(getattr(step.calibration, name)) for name in SERIES_PARAMETERS))
        for step in series.steps
    )
    return Table("By gain setting, with standard uncertainties", columns, rows)


def modes_table(series: GainSeries) -> Table:
    """Return a table with a row per conversion gain."""
    rows = []
    for mode in series.modes:
        free = mode.degrees_of_freedom
        fit = "" if free is None or mode.chi_square is None else f"{format_number(mode.chi_square, 3)} / {free}"
        parts = (mode.pre_amplifier_noise_e, mode.post_amplifier_noise_dn)
        texts = [
            format_estimate(part)
            + (f" (< {format_number(part.upper_limit_95, 3)})" if part.upper_limit_95 is not None else "")
            + (f": {part.reason}" if part.reason else "")
            for part in parts
        ]
        rows.append((f"{mode.settings[0]:g} to {mode.settings[-1]:g}", *texts, fit, f"{mode.scatter_percent:.2g}"))
    columns = (
        Column("Settings"),
        Column("Before (e⁻)", numeric=True),
        Column("After (DN)", numeric=True),
        Column("χ² / degrees of freedom", numeric=True),
        Column("Scatter (%)", numeric=True),
    )
    return Table("Noise before and after the amplifier; scatter of the variance beyond sampling", columns, tuple(rows))


def switch_blocks(series: GainSeries) -> tuple[Block, ...]:
    """Return the result of the search for a conversion-gain switch, and the setting of unity gain."""
    return Paragraph(switch_sentence(series)), Paragraph(unity_sentence(series))


def unity_sentence(series: GainSeries) -> str:
    """Return a sentence about the setting of unity gain."""
    unity = series.unity_gain
    if unity.value is None:
        return f"The gain setting of 1 DN per electron is unknown: {unity.reason}."
    return f"The system gain is 1 DN per electron at gain setting {format_estimate(unity)} ({unity.method})."


def switch_sentence(series: GainSeries) -> str:
    """Return a sentence about the conversion-gain switch."""
    switch = series.switch
    if switch is None:
        return "No conversion-gain switch was found among these settings."
    (below, above), (low, high) = switch.between, switch.between_95
    show = "show" if len(switch.seen_in) > 1 else "shows"
    return (
        f"The conversion gain switches between the settings {below:g} and {above:g} (95 %: between {low:g} and "
        f"{high:g}), as {' and '.join(switch.seen_in)} {show} (p = {switch.p_value:.1g}). Ratios above to below: gain "
        f"per unit of setting {format_estimate(switch.gain_ratio)}, noise before the amplifier in electrons "
        f"{format_estimate(switch.read_noise_ratio)}."
    )
