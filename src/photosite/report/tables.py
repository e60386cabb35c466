"""Tables of parameters: estimates with their uncertainties, or the reason why there are none."""

from __future__ import annotations

from collections.abc import Mapping

from photosite.calibration.parameters import PARAMETER_LABELS, parameter_label
from photosite.calibration.result import Calibration, Estimate, LinearRange, Parameters
from photosite.report.html import Block, Column, Table
from photosite.report.numbers import format_interval, format_number, format_uncertain

_ABSCISSAS = {"exposure_s": ("exposure", "s"), "photons_per_pixel": ("photons per pixel", "photons")}


def parameter_tables(parameters: Parameters) -> tuple[Block, ...]:
    """One table per topic of what was estimated, and one of what was not, with the reasons.

    Parameters
    ----------
    parameters
        A calibration, or one of its channels.

    Returns
    -------
    tuple of Table
        Every parameter is in exactly one of them.
    """
    estimates = parameters.estimates()
    topics = dict.fromkeys(label.topic for label in PARAMETER_LABELS.values())
    tables = [_topic_table(topic, estimates) for topic in topics]
    missing = {name: entry for name, entry in estimates.items() if entry.value is None}
    if missing:
        tables.append(
            Table(
                "Not estimated",
                (Column("Parameter"), Column("Unit"), Column("Why")),
                tuple((*_label_and_unit(name), entry.reason or "") for name, entry in missing.items()),
            )
        )
    return tuple(table for table in tables if table.rows)


def _topic_table(topic: str, estimates: Mapping[str, Estimate]) -> Table:
    rows = tuple(
        _estimate_row(name, entry)
        for name, entry in estimates.items()
        if parameter_label(name).topic == topic and entry.value is not None
    )
    columns = (
        Column("Parameter"),
        Column("Value", numeric=True),
        Column("Unit"),
        Column("95 % interval"),
        Column("Method"),
    )
    return Table(topic, columns, rows)


def _estimate_row(name: str, entry: Estimate) -> tuple[str, ...]:
    label, unit = _label_and_unit(name)
    return label, format_estimate(entry), unit, _interval(entry), entry.method


def _label_and_unit(name: str) -> tuple[str, str]:
    shown = parameter_label(name)
    return shown.label, shown.unit


def format_estimate(entry: Estimate) -> str:
    """Value and standard uncertainty, or "not estimated".

    Examples
    --------
    >>> format_estimate(Estimate(0.5218, 0.0034)), format_estimate(Estimate(reason="no flats"))
    ('0.5218 ± 0.0034', 'not estimated')
    """
    if entry.value is None or entry.standard_uncertainty is None:
        return "not estimated"
    return format_uncertain(entry.value, entry.standard_uncertainty)


def _interval(entry: Estimate) -> str:
    interval = entry.interval_95
    if interval is None or entry.standard_uncertainty is None:
        return ""
    text = format_interval(*interval, entry.standard_uncertainty)
    if entry.upper_limit_95 is not None:
        text += f"; upper limit {format_number(entry.upper_limit_95, 3)}"
    return text


def channel_table(channels: Mapping[str, Parameters]) -> Table:
    """A column per colour channel, a row per parameter that at least one channel has.

    Parameters
    ----------
    channels
        Parameters by channel, one or more.
    """
    estimates = {channel: parameters.estimates() for channel, parameters in channels.items()}
    rows = tuple(
        (*_label_and_unit(name), *(format_estimate(estimates[channel][name]) for channel in channels))
        for name in PARAMETER_LABELS
        if any(estimates[channel][name].value is not None for channel in channels)
    )
    columns = (Column("Parameter"), Column("Unit"), *(Column(channel, numeric=True) for channel in channels))
    return Table("By colour channel, with standard uncertainties", columns, rows)


def linear_range_table(ranges: Mapping[str, LinearRange]) -> Table:
    """Where each channel was taken as linear.

    Parameters
    ----------
    ranges
        By channel.
    """
    rows = []
    for channel, found in ranges.items():
        what, unit = _ABSCISSAS[found.abscissa]
        ends = f"{what} {format_number(found.lowest, 4)} to {format_number(found.highest, 4)} {unit}"
        levels = f"{found.levels} of {found.levels_measured}"
        rows.append((channel, ends, format_number(found.highest_dn, 4), levels, found.rule))
    columns = (
        Column("Channel"),
        Column("Range"),
        Column("Brightest mean (DN)", numeric=True),
        Column("Light levels", numeric=True),
        Column("Rule"),
    )
    return Table("Linear range", columns, tuple(rows))


def frames_table(calibration: Calibration) -> Table:
    """What was calibrated."""
    tile = "/".join("".join(row) for row in calibration.cfa)
    known = "nothing" if calibration.base is None else calibration.base.name
    rows = (
        ("Source", calibration.source),
        ("Frames used", str(calibration.frame_count)),
        ("Frames left out", str(len(calibration.rejected))),
        ("Size", f"{calibration.rows} × {calibration.cols} pixels (rows × columns)"),
        ("Converter", f"{calibration.bits} bits"),
        ("Colour filter array", "monochrome" if tile == "M" else tile),
        ("Known beforehand", known),
    )
    return Table("The measurement", (Column("What"), Column("Value")), rows)
