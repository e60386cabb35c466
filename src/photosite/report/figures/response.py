"""Figures of the response to light and exposure time: fitted curves, SNR, linearity, and the general model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from photosite.calibration.photon_transfer.channel import Curve
from photosite.calibration.photon_transfer.general_model import GeneralModel
from photosite.calibration.photon_transfer.linearity import Linearity, LinearityFit
from photosite.calibration.photon_transfer.snr import SnrCurve
from photosite.report.style import (
    BLACK,
    GRAY,
    channel_handles,
    channel_style,
    draw_band,
    draw_points,
    label_log_ticks,
    legend_above,
    new_figure,
    styled,
    two_panels,
)
from photosite.values.uncertain import COVERAGE_95, Uncertain

_WIDE = 30.0  # ratio of the largest to the smallest value from which on an axis is logarithmic
_POINTS, _SNR_POINTS = 120, 160  # points of a line and its band

Residuals = Literal["percent", "standard"]


@styled()
def curve_figure(curves: Mapping[str, Curve], residuals: Residuals = "standard") -> Figure:
    """Draw points and fitted line of each channel, and the residuals below.

    Filled points were fitted, hollow ones were not. The axes are linear, so that a straight line is straight. Error
    bars are 95 % intervals from sampling; bands are those of the lines, from the covariance of each fit.

    Parameters
    ----------
    curves
        One kind of curve by channel, with the same axes and units. Non-finite points are not drawn.
    residuals
        Unit of the residuals: "percent" of the line, or "standard" uncertainties including the extra variance.

    References
    ----------
    EMVA 1288 R4.0, 6.5 and 6.6: photon transfer and linearity plots.
    """
    figure, upper, lower = two_panels(upper_height=2.6)
    drawn = {channel: _finite(curve) for channel, curve in curves.items()}
    handles = draw_curves(upper, curves)
    for position, (channel, curve) in enumerate(drawn.items()):
        _draw_residuals(lower, curve, channel, position, residuals)
    lower.axhline(0.0, color=BLACK, linewidth=0.8)
    if residuals == "standard":
        for limit in (-COVERAGE_95, COVERAGE_95):
            lower.axhline(limit, color=GRAY, linewidth=0.8, linestyle=":")
        reach = max(2.8, *(abs(limit) for limit in lower.get_ylim()))
        lower.set_ylim(-reach, reach)
    lower.set_xlabel(upper.get_xlabel())
    upper.set_xlabel("")
    lower.set_ylabel("residual (%)" if residuals == "percent" else "residual (std. unc.)")
    return _with_legend(figure, handles)


def draw_curves(axes: Axes, curves: Mapping[str, Curve]) -> list[Line2D]:
    """Draw points and fitted line of each channel, and label the axes; return the entries of a legend."""
    drawn = {channel: _finite(curve) for channel, curve in curves.items()}
    some = next(iter(drawn.values()))
    axes.set(xlabel=some.x_label, ylabel=some.y_label)
    for position, (channel, curve) in enumerate(drawn.items()):
        _draw_points(axes, curve, channel, position)
    hollow = None if all(curve.used.all() for curve in drawn.values()) else "not fitted"
    return channel_handles(list(drawn), "fitted", hollow)


def _with_legend(figure: Figure, handles: list[Line2D]) -> Figure:
    """Return a figure of two panels with a legend above them and aligned labels."""
    if handles:
        legend_above(figure, handles, columns=len(handles))
    figure.align_ylabels(figure.axes)
    return figure


def _finite(curve: Curve) -> Curve:
    keep = np.isfinite(curve.x) & np.isfinite(curve.y)
    points = {name: getattr(curve, name)[keep] for name in ("x", "y", "y_uncertainty", "used")}
    return replace(curve, **points)


def _draw_points(axes: Axes, curve: Curve, channel: str, position: int) -> None:
    color, marker, line = channel_style(channel, position)
    draw_points(axes, curve.x, curve.y, COVERAGE_95 * curve.y_uncertainty, curve.used, (color, marker))
    if curve.intercept is None or curve.slope is None or not curve.used.any():
        return
    x = np.linspace(curve.x[curve.used].min(), curve.x[curve.used].max(), _POINTS)
    y = curve.intercept + curve.slope * x
    axes.plot(x, y, line, color=color, linewidth=1.3)
    if (band := curve.line(x)) is not None:
        draw_band(axes, x, y, COVERAGE_95 * band[1], color)


def _draw_residuals(axes: Axes, curve: Curve, channel: str, position: int, residuals: Residuals) -> None:
    if curve.intercept is None or curve.slope is None:
        return
    color, marker, _ = channel_style(channel, position)
    order = np.flatnonzero(curve.used)[np.argsort(curve.x[curve.used], kind="stable")]
    x, u = curve.x[order], curve.y_uncertainty[order]
    line = curve.intercept + curve.slope * x
    left = curve.y[order] - line
    if residuals == "percent":
        scale = 100.0 / np.abs(line)
        draw_points(axes, x, left * scale, COVERAGE_95 * u * scale, np.ones_like(x, dtype=np.bool_), (color, marker))
    else:
        spread = np.sqrt(u**2 + curve.extra_variance)
        known = spread > 0
        x, left, scale = x[known], left[known], 1.0 / spread[known]
        axes.plot(x, left * scale, marker, color=color)
    if (band := curve.line(x)) is not None and len(x) > 1:
        draw_band(axes, x, np.zeros_like(x), COVERAGE_95 * band[1] * scale, color)


_DASHES, _DOTS = (0, (4, 1.5, 1, 1.5)), (0, (1, 1.2))  # of the total ratio and of the ideal sensor's


@styled()
def snr_figure(curves: Mapping[str, SnrCurve], patterns: Mapping[str, tuple[float, float]] | None = None) -> Figure:
    """Draw the SNR against light, as ratio and in decibels: points, linear model with 95 % intervals, ideal sensor.

    Hollow points lie above the linear range.

    Parameters
    ----------
    curves
        By channel, all against the same axis.
    patterns
        DSNU1288 in DN and PRNU1288 as a fraction, by channel. These channels also get a line of the total ratio.

    References
    ----------
    EMVA 1288 R4.0 Linear, SNR plot.
    """
    figure, axes = new_figure(height_in=4.8)
    patterns = patterns or {}
    points = np.concatenate([curve.x for curve in curves.values()])
    low, high = points.min(), points.max()
    x = np.geomspace(0.7 * low, 1.4 * high, _SNR_POINTS)
    for position, (channel, curve) in enumerate(curves.items()):
        color, marker, line = channel_style(channel, position)
        half = COVERAGE_95 * curve.snr_uncertainty
        draw_points(axes, curve.x, curve.snr, half, curve.used, (color, marker), size=4.0)
        model, uncertainty = curve.model(x)
        axes.plot(x, model, line, color=color, linewidth=1.3)
        draw_band(axes, x, model, COVERAGE_95 * uncertainty, color)
        if channel in patterns:
            total = curve.with_pattern(x, *patterns[channel])
            axes.plot(x, total, color=color, linestyle=_DASHES, linewidth=1.0)
    axes.plot(x, np.sqrt(x), color=BLACK, linestyle=_DOTS, linewidth=1.4)
    photons = next(iter(curves.values())).photons
    axes.set(xscale="log", yscale="log", ylabel="signal-to-noise ratio")
    label_log_ticks(axes.xaxis)
    label_log_ticks(axes.yaxis)
    axes.set_xlabel("photons per pixel" if photons else "signal (e⁻)")
    beside = axes.secondary_yaxis("right", functions=(_decibel, _ratio))
    beside.set_yscale("linear")
    beside.set_ylabel("signal-to-noise ratio (dB)")
    legend_above(figure, _snr_legend(curves, bool(patterns)), columns=3)
    return figure


def _decibel(ratio: ArrayLike) -> ArrayLike:
    # matplotlib evaluates 0 when it sets up the axis.
    return np.asarray(20.0 * np.log10(np.maximum(np.asarray(ratio, dtype=np.float64), np.finfo(float).tiny)))


def _ratio(decibel: ArrayLike) -> ArrayLike:
    return np.asarray(10.0 ** (np.asarray(decibel, dtype=np.float64) / 20.0))


def _snr_legend(curves: Mapping[str, SnrCurve], total: bool) -> list[Line2D]:
    hollow = None if all(curve.used.all() for curve in curves.values()) else "above the linear range"
    handles = channel_handles(list(curves), "measured; linear model", hollow)
    color = handles[0].get_color() if len(curves) == 1 else GRAY
    if total:
        label = "total, with DSNU and PRNU"
        handles.append(Line2D([], [], color=color, linestyle=_DASHES, linewidth=1.0, label=label))
    return [*handles, Line2D([], [], color=BLACK, linestyle=_DOTS, label="ideal sensor")]


@styled()
def linearity_figure(linearity: Mapping[str, Linearity]) -> Figure:
    """Draw the deviations of the light levels from the fitted lines, in percent, by channel.

    Above: relative to the line (releases 3.1 and 4.0). Below: relative to full scale (release 3.0). Error bars are 95 %
    intervals. Filled levels, between 5 and 95 % of saturation, were fitted. Dotted lines mark their extremes.

    References
    ----------
    EMVA 1288 R4.0 Linear, plot of deviations from linearity.
    """
    figure, upper, lower = two_panels()
    for position, (channel, found) in enumerate(linearity.items()):
        for axes, fit in ((upper, found.relative), (lower, found.full_scale)):
            _draw_linearity(axes, found, fit, channel, position)
    for axes in (upper, lower):
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
    upper.set_ylabel("deviation from the line (%)")
    lower.set_ylabel("deviation / full scale (%)")
    lower.set_xlabel(_X_LABELS[next(iter(linearity.values())).abscissa])
    hollow = None if all(found.used.all() for found in linearity.values()) else "not fitted"
    return _with_legend(figure, channel_handles(list(linearity), "fitted", hollow, lines=False))


_X_LABELS = {"photons_per_pixel": "photons per pixel", "exposure_s": "exposure (s)"}


def _draw_linearity(axes: Axes, found: Linearity, fit: LinearityFit, channel: str, position: int) -> None:
    color, marker, _ = channel_style(channel, position)
    half = COVERAGE_95 * fit.deviation_uncertainty
    draw_points(axes, found.x, fit.deviation_percent, half, found.used, (color, marker), size=4.0)
    for limit in (fit.lowest.value, fit.highest.value):
        axes.axhline(limit, color=color, linewidth=0.8, linestyle=":")
    # Scale the axis to the fitted levels; others may lie far outside.
    inside = fit.deviation_percent[found.used]
    reach = max(1e-9, *(abs(inside) + half[found.used]))
    low, high = axes.get_ylim() if position else (0.0, 0.0)
    axes.set_ylim(min(low, -1.6 * reach), max(high, 1.6 * reach))


@styled()
def general_model_figure(channels: Mapping[str, GeneralModel]) -> Figure:
    """Draw the characteristic curve of each channel, and the input signal-to-noise ratio below.

    Error bars are 95 % intervals. Dotted, for a single channel: the threshold, where the ratio is 1, and saturation.

    References
    ----------
    EMVA 1288 R4.0 General.
    """
    figure, upper, lower = two_panels()
    for position, (channel, found) in enumerate(channels.items()):
        look = channel_style(channel, position)[:2]
        every = np.ones(len(found.x), dtype=np.bool_)
        draw_points(upper, found.x, found.signal_dn, COVERAGE_95 * found.signal_uncertainty, every, look, 4.0)
        shown = np.isfinite(found.snr) & (found.x > 0.0)
        half = COVERAGE_95 * found.snr_uncertainty[shown]
        draw_points(lower, found.x[shown], found.snr[shown], half, every[shown], look, 4.0)
        for value in (found.threshold, found.saturation) if len(channels) == 1 else ():
            if isinstance(value, Uncertain):
                for axes in (upper, lower):
                    axes.axvline(value.value, color=GRAY, linewidth=0.9, linestyle=":")
    lower.axhline(1.0, color=GRAY, linewidth=0.9, linestyle=":")
    positive = np.concatenate([found.x[found.x > 0.0] for found in channels.values()])
    lower.set(xscale="log" if positive.max() > _WIDE * positive.min() else "linear", yscale="log")
    lower.set_xlabel(_X_LABELS[next(iter(channels.values())).abscissa])
    lower.set_ylabel("input SNR")
    upper.set_ylabel("signal (DN)")
    return _with_legend(figure, channel_handles(list(channels), "", lines=False) if len(channels) > 1 else [])
