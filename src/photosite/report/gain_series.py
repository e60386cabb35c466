"""The report of a gain series: a table of all settings, the two parts of read noise, the conversion-gain switch."""

from __future__ import annotations

from photosite.calibration.gain_series.result import GainSeries, GainStep
from photosite.calibration.parameters import parameter_label
from photosite.report.calibration import provenance_blocks, rejected_blocks, warning_blocks
from photosite.report.diagnostics import explanations, notices
from photosite.report.figures.gain_series import gain_series_figure
from photosite.report.numbers import format_number
from photosite.report.page import Block, Page, Paragraph, Section, Subheading, Table, columns, figure_block, numeric
from photosite.report.tables import format_estimate

SERIES_PARAMETERS = {
    "system_gain_dn_per_e": "Gain",
    "read_noise_dn": "Read noise",
    "read_noise_e": "Read noise",
    "black_level_dn": "Black",
    "saturation_capacity_e": "Full well",
    "dynamic_range_db": "Range",
}
"""Parameters shown for each setting, and their short titles."""

FOOTER = "Values are estimate ± standard uncertainty (GUM); error bars and bands in figures are 95 % intervals."


def gain_series_page(series: GainSeries) -> Page:
    """Return the report of a gain series as a page."""
    frames = sum(step.calibration.frame_count for step in series.steps)
    lead = (
        f"{frames} dark frames and flat fields at {len(series.steps)} gain settings, {series.settings[0]:g} to "
        f"{series.settings[-1]:g}. Scale of the settings: "
        f"{'proportional to the gain' if series.scale == 'proportional' else series.scale}."
    )
    base = series.steps[0].calibration.base
    name = "an image sensor" if base is None else base.name
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
        Section("Conversion gain", (Paragraph(switch_sentence(series)), Paragraph(unity_sentence(series)))),
        Section("Warnings and rejected frames", _warning_blocks(series)),
        Section("Provenance", tuple(block for step in series.steps for block in _provenance_blocks(step))),
    )
    return Page(f"Gain series of {name}", lead, sections, FOOTER)


_MODEL = (
    "The variance of the read noise in DN is (noise before the amplifier × K)² + (noise after the amplifier)². The "
    "first part is amplified with the signal; the second is independent of the gain. Rounding is subtracted."
)


def _warning_blocks(series: GainSeries) -> tuple[Block, ...]:
    """Return the warnings of the series, then rejected frames and warnings of each setting."""
    own = {f"gain setting {step.setting:g}: {text}" for step in series.steps for text in step.calibration.warnings}
    together = notices(entry for entry in series.diagnostics if entry.text not in own)
    blocks: list[Block] = [*together] or [Paragraph("No problems found in the joint analysis.")]
    for step in series.steps:
        of_it = (*rejected_blocks(step.calibration), *warning_blocks(step.calibration))
        blocks += [Subheading(f"Gain setting {step.setting:g}"), *of_it]
    of_steps = (entry for step in series.steps for entry in step.calibration.diagnostics)
    return *blocks, *explanations((*series.diagnostics, *of_steps))


def _provenance_blocks(step: GainStep) -> tuple[Block, ...]:
    blocks = provenance_blocks(step.calibration, f"gain{step.setting:g}.frames")
    return Subheading(f"Gain setting {step.setting:g}"), *blocks


def settings_table(series: GainSeries) -> Table:
    """Return a table with a row per setting."""
    titles = ["Setting", *(f"{title} ({parameter_label(name).unit})" for name, title in SERIES_PARAMETERS.items())]
    rows = tuple(
        (f"{step.setting:g}", *(format_estimate(getattr(step.calibration, name)) for name in SERIES_PARAMETERS))
        for step in series.steps
    )
    return Table("By gain setting, with standard uncertainties", tuple(map(numeric, titles)), rows)


def modes_table(series: GainSeries) -> Table:
    """Return a table with a row per conversion gain."""
    rows = []
    for mode in series.modes:
        free = mode.degrees_of_freedom
        fit = "" if free is None or mode.chi_square is None else f"{format_number(mode.chi_square, 3)} / {free}"
        parts = (mode.pre_amplifier_noise_e, mode.post_amplifier_noise_dn)
        texts = [format_estimate(part) + (f": {part.reason}" if part.reason else "") for part in parts]
        rows.append((f"{mode.settings[0]:g} to {mode.settings[-1]:g}", *texts, fit, f"{mode.scatter_percent:.2g}"))
    numbers = map(numeric, ("Before (e⁻)", "After (DN)", "χ² / degrees of freedom", "Scatter (%)"))
    caption = "Noise before and after the amplifier; scatter of the variance beyond sampling"
    return Table(caption, columns("Settings", *numbers), tuple(rows))


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
