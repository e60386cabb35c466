"""The signal-to-noise ratio against the amount of light, beside the linear model's and the ideal sensor's."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray

from photosite.calibration.photon_transfer.snr import SnrCurve
from photosite.report.figures.marks import channel_handles, draw_band, draw_points
from photosite.report.style import BLACK, GRAY, channel_style, new_figure, styled
from photosite.values.measured import COVERAGE_95

_POINTS = 160

_DASHES, _DOTS = (0, (4, 1.5, 1, 1.5)), (0, (1, 1.2))
"""Of the total ratio and of the ideal sensor's."""


@styled()
def snr_figure(curves: Mapping[str, SnrCurve], patterns: Mapping[str, tuple[float, float]] | None = None) -> Figure:
    """Points and linear model of each channel with their 95 % intervals, and the ratio of an ideal sensor.

    Parameters
    ----------
    curves
        By channel, all against the same axis.
    patterns
        DSNU1288 in DN and PRNU1288 as a share, by channel; those given get a line of the total ratio, too.

    Returns
    -------
    matplotlib.figure.Figure
        Ratio on the left, decibels on the right. Hollow points lie above the linear range.

    Notes
    -----
    EMVA 1288 R4.0 Linear, the SNR plot: measured points, the model from the fitted parameters, the ideal sensor.
    """
    figure, axes = new_figure(height_in=4.8)
    patterns = patterns or {}
    points = np.concatenate([curve.x for curve in curves.values()])
    low, high = points.min(), points.max()
    x = np.geomspace(0.7 * low, 1.4 * high, _POINTS)
    for position, (channel, curve) in enumerate(curves.items()):
        _draw_channel(axes, x, curve, channel, position, patterns.get(channel))
    axes.plot(x, np.sqrt(x), color=BLACK, linestyle=_DOTS, linewidth=1.4)
    photons = next(iter(curves.values())).photons
    axes.set(xscale="log", yscale="log", ylabel="signal-to-noise ratio")
    axes.set_xlabel("photons per pixel" if photons else "signal (e⁻)")
    beside = axes.secondary_yaxis("right", functions=(_decibel, _ratio))
    beside.set_yscale("linear")
    beside.set_ylabel("signal-to-noise ratio (dB)")
    axes.legend(handles=_legend(curves, bool(patterns)), loc="upper left")
    return figure


def _decibel(ratio: ArrayLike) -> ArrayLike:
    # matplotlib asks for 0 when it sets up the axis.
    return np.asarray(20.0 * np.log10(np.maximum(np.asarray(ratio, dtype=np.float64), np.finfo(float).tiny)))


def _ratio(decibel: ArrayLike) -> ArrayLike:
    return np.asarray(10.0 ** (np.asarray(decibel, dtype=np.float64) / 20.0))


def _draw_channel(
    axes: Axes,
    x: NDArray[np.float64],
    curve: SnrCurve,
    channel: str,
    position: int,
    pattern: tuple[float, float] | None,
) -> None:
    color, marker, line = channel_style(channel, position)
    draw_points(axes, curve.x, curve.snr, COVERAGE_95 * curve.snr_uncertainty, curve.used, (color, marker), size=4.0)
    model, uncertainty = curve.model(x)
    axes.plot(x, model, line, color=color, linewidth=1.3)
    draw_band(axes, x, model, COVERAGE_95 * uncertainty, color)
    if pattern is not None:
        axes.plot(x, curve.with_pattern(x, *pattern), color=color, linestyle=_DASHES, linewidth=1.0)


def _legend(curves: Mapping[str, SnrCurve], total: bool) -> list[Line2D]:
    hollow = None if all(curve.used.all() for curve in curves.values()) else "above the linear range"
    handles = channel_handles(list(curves), "measured; linear model", hollow)
    color = handles[0].get_color() if len(curves) == 1 else GRAY
    if total:
        label = "total, with DSNU and PRNU"
        handles.append(Line2D([], [], color=color, linestyle=_DASHES, linewidth=1.0, label=label))
    return [*handles, Line2D([], [], color=BLACK, linestyle=_DOTS, label="ideal sensor")]
