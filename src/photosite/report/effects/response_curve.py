"""The response curve in the report: deviation from a straight response, by channel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.photon_transfer.response_curve import ResponseCurve
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import Block, Table, columns, figure_block, numeric
from photosite.report.style import BAND, BLACK, channel_handles, channel_style, legend_above, new_figure, styled


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return figure and tables of the response curves, if the response bends."""
    if not (curves := calibration.response_curve):
        return ()
    figure = figure_block(
        response_curve_figure(curves),
        "Deviation of the response from a straight one against the signal, with its 95 % band",
        "Response curve: deviation of the signal from a straight response with the gain at small signal. The bands are "
        "95 % intervals. Hollow: deviation from the stated light, where it is beyond chance.",
    )
    return figure, *response_curve_tables(curves)


def response_curve_tables(curves: Mapping[str, ResponseCurve]) -> tuple[Table, ...]:
    """Return a table of each channel's response curve, up to saturation."""
    titles = columns(numeric("Signal (DN)"), numeric("Electrons"), numeric("Deviation (%)"))
    tables = []
    for channel, curve in curves.items():
        top = int(np.argmax(curve.signal_dn))
        rows = tuple(
            (format_number(float(signal), 4), *(format_uncertain(e.value, e.standard_uncertainty) for e in entries))
            for signal, *entries in zip(curve.signal_dn, curve.electrons, curve.deviation_percent, strict=True)
        )
        caption = "Response curve of channel {}: electrons, and deviation from a straight response with the gain"
        tables.append(Table(caption.format(channel), titles, rows[: top + 1]))
    return tuple(tables)


@styled()
def response_curve_figure(curves: Mapping[str, ResponseCurve]) -> Figure:
    """Draw the deviation of the signal from a straight response against the signal, by channel.

    Points and error bars: the sensor's deviation at each light level, with 95 % intervals. The band joins the
    intervals. Hollow: the part due to the light, where it is not in proportion to the stated one beyond chance.
    """
    figure, axes = new_figure(height_in=4.2)
    hollow = None
    for position, (channel, curve) in enumerate(curves.items()):
        color, marker, line = channel_style(channel, position)
        order = np.argsort(curve.signal_dn)
        x = curve.signal_dn[order]
        of_sensor, of_light = (
            np.array([(entries[i].value, *entries[i].interval_95) for i in order])
            for entries in (curve.deviation_percent, curve.light_deviation_percent)
        )
        value, low, high = of_sensor.T
        axes.plot(x, value, line, color=color, linewidth=1.3, marker=marker, markersize=4.0, zorder=3)
        axes.fill_between(x, low, high, color=color, alpha=BAND, linewidth=0)
        off = (of_light[:, 1] > 0.0) | (of_light[:, 2] < 0.0)
        if off.any():
            hollow = "deviation of the light"
            axes.plot(x[off], of_light[off, 0], marker, color=color, markerfacecolor="white", markersize=4.0)
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    axes.set(xlabel="signal (DN)", ylabel="deviation from a straight response (%)")
    legend_above(figure, channel_handles(list(curves), "measured, with 95 % band", hollow))
    return figure


FIGURE = EffectFigure("Photon transfer", 10, _blocks)
