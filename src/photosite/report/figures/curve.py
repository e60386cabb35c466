"""Measured points, the line through them, and what the line leaves: photon transfer, response, dark signal."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from photosite.calibration.result import Curve
from photosite.measured import COVERAGE_95
from photosite.report.style import BLACK, GRAY, WIDTH_IN, channel_style, styled

_WIDE = 30.0
"""An axis may be logarithmic where the largest number is more than this many times the smallest."""

Residuals = Literal["percent", "standard"]


@styled()
def curve_figure(curves: Mapping[str, Curve], residuals: Residuals = "standard") -> Figure:
    """Points and fitted line of each channel; below, what the line leaves of the points it was fitted to.

    Parameters
    ----------
    curves
        By channel: one kind of curve, so that axes and units agree. Points without a finite number are not drawn.
    residuals
        What the lower axes show: "percent" of the line, or "standard": in standard uncertainties, extra
        variance included.

    Returns
    -------
    matplotlib.figure.Figure
        Filled points were fitted, hollow ones were not. The abscissa is logarithmic where every point allows it and
        the points span more than a factor of 30; the ordinate too, where the fitted points do. A point that was not
        fitted and is not above 0 is then a triangle at the lower border.

    Notes
    -----
    EMVA 1288 R4.0, 6.5 and 6.6, asks for the photon transfer and linearity plots.
    """
    figure = Figure(figsize=(WIDTH_IN, 5.4))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.6, 1.0))
    some = next(iter(curves.values()))
    drawn = {channel: _finite(curve) for channel, curve in curves.items()}
    upper.set(**_scales(drawn.values()))
    for position, (channel, curve) in enumerate(drawn.items()):
        _draw_points(upper, curve, channel, position)
        _draw_residuals(lower, curve, channel, position, residuals)
    lower.axhline(0.0, color=BLACK, linewidth=0.8)
    if residuals == "standard":
        for limit in (-COVERAGE_95, COVERAGE_95):
            lower.axhline(limit, color=GRAY, linewidth=0.8, linestyle=":")
        reach = max(2.8, *(abs(limit) for limit in lower.get_ylim()))
        lower.set_ylim(-reach, reach)
    upper.set_ylabel(some.y_label)
    lower.set_xlabel(some.x_label)
    lower.set_ylabel("residual (%)" if residuals == "percent" else "residual (std. unc.)")
    handles = _legend(drawn)
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    figure.align_ylabels([upper, lower])
    return figure


def _finite(curve: Curve) -> Curve:
    keep = np.isfinite(curve.x) & np.isfinite(curve.y)
    return Curve(
        curve.title,
        curve.x_label,
        curve.y_label,
        curve.x[keep],
        curve.y[keep],
        curve.y_uncertainty[keep],
        curve.used[keep],
        curve.intercept,
        curve.slope,
        curve.extra_variance,
    )


def _scales(curves: Collection[Curve]) -> dict[str, str]:
    """Scale of each axis."""
    x = np.concatenate([curve.x for curve in curves])
    fitted = np.concatenate([curve.y[curve.used] for curve in curves])
    if not (fitted.size and x.min() > 0 and fitted.min() > 0):
        return {"xscale": "linear", "yscale": "linear"}
    log_x = x.max() > _WIDE * x.min()
    log_y = log_x and fitted.max() > _WIDE * fitted.min()
    return {"xscale": "log" if log_x else "linear", "yscale": "log" if log_y else "linear"}


def _draw_points(axes: Axes, curve: Curve, channel: str, position: int) -> None:
    color, marker, line = channel_style(channel, position)
    for used in (True, False):
        which = curve.used == used
        face = color if used else "white"
        axes.plot(curve.x[which], curve.y[which], marker, color=color, markerfacecolor=face, zorder=2 + used)
    below = curve.x[curve.y <= 0] if axes.get_yscale() == "log" else curve.x[:0]
    if below.size:
        border = axes.get_xaxis_transform()
        axes.plot(below, np.full(below.size, 0.025), "v", color=color, markerfacecolor="white", transform=border)
    if curve.intercept is None or curve.slope is None or not curve.used.any():
        return
    ends = curve.x[curve.used].min(), curve.x[curve.used].max()
    log_x, log_y = axes.get_xscale() == "log", axes.get_yscale() == "log"
    x = np.geomspace(*ends, 200) if log_x else np.linspace(*ends, 2)
    y = curve.intercept + curve.slope * x
    shown = y > 0 if log_y else np.isfinite(y)
    axes.plot(x[shown], y[shown], line, color=color, linewidth=1.3)


def _draw_residuals(axes: Axes, curve: Curve, channel: str, position: int, residuals: Residuals) -> None:
    if curve.intercept is None or curve.slope is None:
        return
    color, marker, _ = channel_style(channel, position)
    x, y, u = curve.x[curve.used], curve.y[curve.used], curve.y_uncertainty[curve.used]
    line = curve.intercept + curve.slope * x
    if residuals == "percent":
        scale = 100.0 / np.abs(line)
        axes.errorbar(x, (y - line) * scale, COVERAGE_95 * u * scale, fmt=marker, color=color, elinewidth=0.9)
    else:
        spread = np.sqrt(u**2 + curve.extra_variance)
        known = spread > 0
        axes.plot(x[known], (y - line)[known] / spread[known], marker, color=color)


def _legend(curves: Mapping[str, Curve]) -> list[Line2D]:
    looks = [channel_style(channel, position) for position, channel in enumerate(curves)]
    names = ["fitted"] if len(curves) == 1 else list(curves)
    handles = [
        Line2D([], [], color=color, marker=marker, linestyle=line, label=name)
        for name, (color, marker, line) in zip(names, looks, strict=True)
    ]
    if not all(curve.used.all() for curve in curves.values()):
        color, marker = looks[0][:2] if len(curves) == 1 else (GRAY, "o")
        hollow = Line2D([], [], color=color, marker=marker, linestyle="", markerfacecolor="white", label="not fitted")
        handles.append(hollow)
    return handles
