"""Tables of parameters: estimates with their uncertainties, or the reason why they are missing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from photosite.calibration.parameters import PARAMETER_LABELS, Parameters, parameter_label
from photosite.calibration.photon_transfer.channel import LinearRange
from photosite.calibration.result import Calibration
from photosite.report.numbers import format_interval, format_number, format_time, format_uncertain
from photosite.report.page import Heading, Paragraph, Table, columns, numeric, sentence
from photosite.values.estimate import Estimate


def parameter_tables(parameters: Parameters) -> tuple[Table, ...]:
    """Return a table of the estimated parameters by topic, and one of the missing parameters with the reasons."""
    estimates = parameters.estimates()
    found = {name: entry for name, entry in estimates.items() if entry.value is not None}
    missing = {name: entry for name, entry in estimates.items() if entry.value is None}
    tables = []
    if found:
        titles = columns("Parameter", numeric("Value"), "Unit", "95 % interval", "Method")
        tables.append(Table("Estimated, with standard uncertainties", titles, _by_topic(found)))
    if missing:
        reasons = tuple((*_label_and_unit(name), entry.reason or "") for name, entry in missing.items())
        tables.append(Table("Not estimated", columns("Parameter", "Unit", "Reason"), reasons))
    return tuple(tables)


def _by_topic(estimates: Mapping[str, Estimate]) -> tuple[tuple[str, ...] | Heading, ...]:
    topics: dict[str, list[tuple[str, ...] | Heading]] = {}
    for name, entry in estimates.items():
        topic = parameter_label(name).topic
        label, unit = _label_and_unit(name)
        row = (label, format_estimate(entry), unit, interval_text(entry), entry.method)
        topics.setdefault(topic, [Heading(topic)]).append(row)
    return tuple(row for rows in topics.values() for row in rows)


def _label_and_unit(name: str) -> tuple[str, str]:
    shown = parameter_label(name)
    return shown.label, shown.unit


def format_estimate(entry: Estimate) -> str:
    """Format value and standard uncertainty, the upper limit of one within chance of 0, or "not estimated".

    Examples
    --------
    >>> format_estimate(Estimate(0.5218, 0.0034)), format_estimate(Estimate(reason="no flats"))
    ('0.5218 ± 0.0034', 'not estimated')
    >>> format_estimate(Estimate(-0.12, 0.05, upper_limit_95=0.16))
    '< 0.16'
    """
    if entry.value is None or entry.standard_uncertainty is None:
        return "not estimated"
    if entry.upper_limit_95 is not None:
        return f"< {format_number(entry.upper_limit_95, 2)}"
    if entry.value < 0 and entry.interval_95 == (0.0, 0.0):
        return "negative variance"
    return format_uncertain(entry.value, entry.standard_uncertainty)


def interval_text(entry: Estimate) -> str:
    """Format the 95 % interval; "" without a value.

    Examples
    --------
    >>> interval_text(Estimate(0.5218, 0.0034)).split()
    ['0.5151', 'to', '0.5285']
    >>> interval_text(Estimate(-0.12, 0.05, upper_limit_95=0.16)).split()
    ['0', 'to', '0.16']
    """
    interval = entry.interval_95
    if interval is None or entry.standard_uncertainty is None or (interval == (0.0, 0.0) and (entry.value or 0.0) < 0):
        return ""
    if entry.upper_limit_95 is not None:
        text = f"0 to {format_number(entry.upper_limit_95, 2)}"
    else:
        text = format_interval(*interval, entry.standard_uncertainty)
    return text.replace(" ", "\u00a0")  # on one line


def comparison_blocks(rows: Mapping[str, Mapping[str, Estimate]], first: str = "") -> tuple[Table | Paragraph, ...]:
    """Return a table with a row per part, such as a capture or a setting, and the reasons for missing values."""
    titles = list(next(iter(rows.values())))
    cells = tuple((name, *(_with_interval(entry) for entry in entries.values())) for name, entries in rows.items())
    reasons: dict[tuple[str, str], list[str]] = {}
    for name, entries in rows.items():
        for title, entry in entries.items():
            if entry.value is None and entry.reason:
                reasons.setdefault((title.partition(" (")[0], entry.reason), []).append(name)
    notes = tuple(Paragraph(sentence(f"{what} of {', '.join(of)}: {why}")) for (what, why), of in reasons.items())
    caption = "With standard uncertainties; 95 % intervals in parentheses"
    return Table(caption, columns(first, *titles), cells), *notes


def _with_interval(entry: Estimate) -> str:
    value, interval = format_estimate(entry).replace(" ", "\u00a0"), interval_text(entry)
    return f"{value} ({interval})" if interval else value


def channel_table(channels: Mapping[str, Parameters]) -> Table:
    """Return a table with a column per color channel, and a row per parameter that at least one channel has."""
    estimates = {channel: parameters.estimates() for channel, parameters in channels.items()}
    rows = tuple(
        (*_label_and_unit(name), *(format_estimate(estimates[channel][name]) for channel in channels))
        for name in PARAMETER_LABELS
        if any(estimates[channel][name].value is not None for channel in channels)
    )
    titles = columns("Parameter", "Unit", *map(numeric, channels))
    return Table("By color channel, with standard uncertainties", titles, rows)


def linear_range_table(ranges: Mapping[str, LinearRange]) -> Table:
    """Return a table of the channels' linear ranges."""
    rows = []
    for channel, found in ranges.items():
        if found.abscissa == "exposure_s":
            ends = f"{format_time(found.lowest)} to {format_time(found.highest)}"
        else:
            unit = "DN above dark" if found.abscissa == "signal_dn" else "photons per pixel"
            ends = f"{format_number(found.lowest, 4)} to {format_number(found.highest, 4)} {unit}"
        levels = f"{found.levels} of {found.levels_measured}"
        rows.append((channel, ends, format_number(found.highest_dn, 4), levels, found.rule))
    titles = columns("Channel", "Range", numeric("Brightest mean (DN)"), numeric("Light levels"), "Rule")
    return Table("Linear range", titles, tuple(rows))


_CORRELATED = {
    "system_gain_dn_per_e": "K",
    "quantum_efficiency_percent": "η",
    "read_noise_e": "Read noise",
    "temporal_dark_noise_e": "σd",
    "saturation_capacity_e": "μe.sat",
    "dark_current_e_per_s": "μI.mean",
    "dsnu1288_e": "DSNU1288",
    "prnu1288_percent": "PRNU1288",
}


def correlation_table(calibration: Calibration) -> Table | None:
    """Return a table of the correlations between the main parameters; None with fewer than two of them."""
    estimates = calibration.estimates()
    names = [name for name in _CORRELATED if (estimates[name].standard_uncertainty or 0.0) > 0.0]
    if len(names) < 2:
        return None
    joint = calibration.covariance.among(names)
    sigma = np.sqrt(np.diag(joint))
    rows = tuple(
        (
            parameter_label(name).label,
            *(f"{joint[i, k] / (sigma[i] * sigma[k]):z.2f}".replace("-", "−") for k in range(i)),
            *("" for _ in names[i + 1 :]),
        )
        for i, name in enumerate(names)
        if i > 0
    )
    caption = "Correlation of the errors: parameters with a common cause, such as the system gain, err together"
    return Table(caption, columns("Correlation with", *(numeric(_CORRELATED[name]) for name in names[:-1])), rows)


def estimates_table(title: str, entries: Mapping[tuple[str, str], Estimate]) -> Table:
    """Return a table of the estimates that have a value, by label and unit."""
    rows = tuple(
        (label, format_estimate(entry), unit, interval_text(entry))
        for (label, unit), entry in entries.items()
        if entry.value is not None
    )
    return Table(title, columns("Quantity", numeric("Value"), "Unit", "95 % interval"), rows)
