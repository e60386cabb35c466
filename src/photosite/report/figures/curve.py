"""Measured points, the line through them, and what the line leaves: photon transfer, response, dark signal."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.calibration.photon_transfer.curves import Curve
from photosite.report.figures.marks import channel_handles, draw_band, draw_points
from photosite.report.style import BLACK, GRAY, WIDTH_IN, channel_style, styled
from photosite.values.measured import COVERAGE_95

_WIDE = 30.0
"""An axis may be logarithmic where the largest number is more than this many times the smallest."""

_POINTS = 120
"""Of a line and its band."""

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

        Bars are 95 % intervals of the points from sampling alone; the bands are those of the lines, from the
        covariance of each fit.

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
    hollow = None if all(curve.used.all() for curve in drawn.values()) else "not fitted"
    handles = channel_handles(list(drawn), "fitted", hollow)
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    figure.align_ylabels([upper, lower])
    return figure


def _finite(curve: Curve) -> Curve:
    keep = np.isfinite(curve.x) & np.isfinite(curve.y)
    points = {name: getattr(curve, name)[keep] for name in ("x", "y", "y_uncertainty", "used")}
    return replace(curve, **points)


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
    draw_points(axes, curve.x, curve.y, COVERAGE_95 * curve.y_uncertainty, curve.used, (color, marker))
    below = curve.x[curve.y <= 0] if axes.get_yscale() == "log" else curve.x[:0]
    if below.size:
        border = axes.get_xaxis_transform()
        axes.plot(below, np.full(below.size, 0.025), "v", color=color, markerfacecolor="white", transform=border)
    if curve.intercept is None or curve.slope is None or not curve.used.any():
        return
    ends = curve.x[curve.used].min(), curve.x[curve.used].max()
    x = np.geomspace(*ends, _POINTS) if axes.get_xscale() == "log" else np.linspace(*ends, _POINTS)
    y = curve.intercept + curve.slope * x
    shown = y > 0 if axes.get_yscale() == "log" else np.isfinite(y)
    axes.plot(x[shown], y[shown], line, color=color, linewidth=1.3)
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
