"""Readout channels in the report: their gains and offsets."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.calibration.parameters import parameter_label
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.numbers import format_uncertain
from photosite.report.page import Block, Table, columns, figure_block, numeric
from photosite.report.style import BLACK, BLUE, WIDTH_IN, styled
from photosite.report.tables import format_estimate
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.uncertain import Measured


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return gains and offsets of the readout channels, if they differ, and the amplifiers that the files name."""
    own = (*_pixels(calibration), *_amplifiers(calibration))
    if (channels := calibration.readout_channels) is None:
        return own
    figure = figure_block(
        readout_channels_figure(channels),
        "Gain and offset of each readout channel with 95 % intervals",
        "Readout channels: deviation of their gains and offsets from the mean channel, with 95 % intervals.",
    )
    return (figure, readout_channel_table(channels), *own)


def _pixels(calibration: Calibration) -> tuple[Block, ...]:
    """Return a table of DSNU, PRNU and DCNU with and without the differences between readout channels."""
    if not (pixels := calibration.pixel_nonuniformity):
        return ()
    rows = tuple(
        (f"{shown.label} ({shown.unit})", format_estimate(getattr(calibration, name)), format_estimate(entry))
        for name, entry in pixels.items()
        if entry.value is not None and (shown := parameter_label(name))
    )
    titles = columns("Parameter", numeric("All pixels together"), numeric("Within readout channels"))
    return (Table("Nonuniformity with and without the differences between readout channels", titles, rows),)


def _amplifiers(calibration: Calibration) -> tuple[Block, ...]:
    """Return a table of the amplifiers, each calibrated by itself."""
    if not calibration.amplifiers:
        return ()
    shown = (*("system_gain_dn_per_e", "read_noise_e", "black_level_dn", "saturation_dn"), "dsnu_e", "prnu_percent")
    labels = [parameter_label(name) for name in shown]
    rows = tuple(
        (
            name,
            f"{each.region.r0} to {each.region.r1 - 1}, {each.region.c0} to {each.region.c1 - 1}",
            *(format_estimate(getattr(each.parameters, parameter)) for parameter in shown),
        )
        for name, each in calibration.amplifiers.items()
    )
    titles = columns("Amplifier", "Rows, columns", *(numeric(f"{one.label} ({one.unit})") for one in labels))
    return (Table("Amplifiers, each calibrated by itself", titles, rows),)


def readout_channel_table(channels: ReadoutChannels) -> Table:
    """Return a table of the readout channels' gains and offsets."""
    tables = channels.relative_gain, channels.offset_e

    def cell(table: tuple[tuple[Measured, ...], ...] | None, r: int, c: int) -> str:
        return (
            "as the others" if table is None else format_uncertain(table[r][c].value, table[r][c].standard_uncertainty)
        )

    places = np.ndindex(*channels.shape)
    rows = tuple((f"{r + 1}, {c + 1}", *(cell(table, r, c) for table in tables)) for r, c in places)
    parts = "row and column of the repeating tile" if channels.arrangement == "tile" else "halves or quadrants"
    titles = columns("Channel (row, column)", numeric("Relative gain"), numeric("Offset (e⁻)"))
    return Table(f"Readout channels: {parts}", titles, rows)


@styled()
def readout_channels_figure(channels: ReadoutChannels) -> Figure:
    """Draw gain and offset of each readout channel with 95 % intervals, less those of the mean channel."""
    rows, cols = channels.shape
    names = [f"{r + 1}, {c + 1}" if min(rows, cols) > 1 else str(r + c + 1) for r, c in np.ndindex(rows, cols)]
    tables = {"gain deviation (%)": (channels.relative_gain, 1.0, 100.0), "offset (e⁻)": (channels.offset_e, 0.0, 1.0)}
    known = {label: entry for label, entry in tables.items() if entry[0] is not None}
    figure = Figure(figsize=(WIDTH_IN, 3.2))
    panels = figure.subplots(1, len(known), squeeze=False)[0]
    for axes, (label, (table, usual, scale)) in zip(panels, known.items(), strict=True):
        entries = [entry for row in table or () for entry in row]
        shown = [_shifted(entry, usual, scale) for entry in entries]
        _draw_intervals(axes, dict(zip(names, shown, strict=True)), label)
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
        axes.set_xlabel("readout channel" + (" (row, column)" if min(rows, cols) > 1 else ""))
    return figure


def _shifted(entry: Measured, usual: float, scale: float) -> tuple[float, float, float]:
    """Return value and interval less the usual value, scaled."""
    value, low, high = (scale * (number - usual) for number in (entry.value, *entry.interval_95))
    return value, low, high


def _draw_intervals(axes: Axes, entries: Mapping[str, tuple[float, float, float]], label: str) -> None:
    """Draw a point with its interval for each entry."""
    values, low, high = np.array(list(entries.values())).T
    places = np.arange(len(entries), dtype=np.float64)
    axes.vlines(places, low, high, color=BLUE, linewidth=1.4)
    axes.plot(places, values, "o", color=BLUE, markerfacecolor=BLUE, zorder=3, clip_on=False)
    axes.set_xticks(places, list(entries))
    axes.set_xlim(-0.6, len(entries) - 0.4)
    axes.set_ylabel(label)
    axes.grid(visible=False, axis="x")


FIGURE = EffectFigure("Rows, columns and readout channels", 20, _blocks)
