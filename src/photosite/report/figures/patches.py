"""Patches of a chart, measured against simulated: means and signal-to-noise ratios."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.metrics.patches import PatchStatistics
from photosite.report.style import BLACK, WIDTH_IN, channel_style, styled
from photosite.validation.result import Validation
from photosite.values.measured import COVERAGE_95

_DB_PER_RELATIVE_VARIANCE = 10.0 / np.log(10.0)
"""A relative change of a variance, small, in decibels."""

FillStyle = Literal["full", "bottom", "none"]

_Points = tuple[str, int, NDArray[np.bool_]]


@styled()
def patch_means_figure(validation: Validation, measured: str = "measured", simulated: str = "simulated") -> Figure:
    """Patch means, measured against simulated, and their relative differences.

    Parameters
    ----------
    validation
        The comparison; saturated patches are left out.
    measured, simulated
        What to call the two cameras.

    Returns
    -------
    matplotlib.figure.Figure
        Bars are 95 % intervals from the standard errors of both means. The axes are logarithmic where all means are
        above black.
    """
    figure, upper, lower = _two_axes()
    draw_patch_means(upper, lower, validation)
    if min(float(found.mean_dn[validation.used].min()) for found in (validation.measured, validation.simulated)) > 0:
        upper.set(xscale="log", yscale="log")
    draw_identity(upper)
    upper.set_ylabel(f"mean, {measured} (DN)")
    lower.set_ylabel("difference (%)")
    lower.set_xlabel(f"patch mean above black, {simulated} (DN)")
    upper.legend(loc="upper left", title="channel")
    figure.align_ylabels([upper, lower])
    return figure


def draw_patch_means(
    upper: Axes, lower: Axes, validation: Validation, filled: FillStyle = "full", largest_bar: float = math.inf
) -> None:
    """Means, measured against simulated, on the upper axes, and their relative differences in percent on the lower.

    Parameters
    ----------
    upper, lower
        To draw on.
    validation
        The comparison; saturated patches are left out.
    filled
        How markers are filled, to tell comparisons on one pair of axes apart.
    largest_bar
        Half-width of the widest interval on the lower axes; points known less well are on the upper axes only.
    """
    seen, made = validation.measured, validation.simulated
    for channel, k, which in _channels(validation):
        color, marker, _ = channel_style(channel, k)
        look = color, marker, filled
        x, y = made.mean_dn[which, k], seen.mean_dn[which, k]
        error_x, error_y = (COVERAGE_95 * found.standard_error_dn[which, k] for found in (made, seen))
        _draw_crosses(upper, (x, y), (error_x, error_y), look, channel)
        lit = x > 0
        half = 100.0 * np.hypot(error_x, error_y)[lit] / x[lit]
        known = half <= largest_bar
        _draw_crosses(lower, (x[lit][known], (100.0 * (y - x)[lit] / x[lit])[known]), (None, half[known]), look)


@styled()
def patch_snr_figure(validation: Validation, measured: str = "measured", simulated: str = "simulated") -> Figure:
    """Signal-to-noise ratio over the pixels of each patch, measured against simulated, and the differences.

    Parameters
    ----------
    validation, measured, simulated
        As for `patch_means_figure`; patches not above black or without noise have no ratio and are left out.

    Returns
    -------
    matplotlib.figure.Figure
        Bars are 95 % intervals from the standard errors of means and variances of both.
    """
    figure, upper, lower = _two_axes()
    draw_patch_snr(upper, lower, validation)
    draw_identity(upper)
    upper.set_ylabel(f"SNR, {measured} (dB)")
    lower.set_ylabel("difference (dB)")
    lower.set_xlabel(f"patch SNR, {simulated} (dB)")
    upper.legend(loc="upper left", title="channel")
    figure.align_ylabels([upper, lower])
    return figure


def draw_patch_snr(
    upper: Axes, lower: Axes, validation: Validation, filled: FillStyle = "full", largest_bar: float = math.inf
) -> None:
    """Signal-to-noise ratios on the upper axes, their differences in decibels on the lower.

    Parameters
    ----------
    upper, lower, validation, filled, largest_bar
        As for `draw_patch_means`; patches without a ratio are left out.
    """
    seen, made = validation.measured, validation.simulated
    for channel, k, which in _channels(validation):
        color, marker, _ = channel_style(channel, k)
        look = color, marker, filled
        shown = which & np.isfinite(made.spatial_snr_db[:, k]) & np.isfinite(seen.spatial_snr_db[:, k])
        x, y = made.spatial_snr_db[shown, k], seen.spatial_snr_db[shown, k]
        error_x, error_y = (COVERAGE_95 * _snr_error_db(found, shown, k) for found in (made, seen))
        _draw_crosses(upper, (x, y), (error_x, error_y), look, channel)
        half = np.hypot(error_x, error_y)
        known = half <= largest_bar
        _draw_crosses(lower, (x[known], (y - x)[known]), (None, half[known]), look)


_Values = NDArray[np.float64]


def _draw_crosses(
    axes: Axes,
    points: tuple[_Values, _Values],
    half: tuple[_Values | None, _Values],
    look: tuple[str, str, FillStyle],
    label: str | None = None,
) -> None:
    """Points with bars along both axes, or along the ordinate."""
    color, marker, filled = look
    axes.errorbar(*points, half[1], half[0], fmt="none", ecolor=color, elinewidth=0.9, zorder=2)
    axes.plot(*points, marker, color=color, fillstyle=filled, markerfacecoloralt="white", label=label, zorder=3)


def _snr_error_db(found: PatchStatistics, which: NDArray[np.bool_], k: int) -> NDArray[np.float64]:
    """Standard error of 20 log10(mean / noise), to first order."""
    mean, noise = found.mean_dn[which, k], found.spatial_noise_dn[which, k]
    of_mean = 2.0 * found.standard_error_dn[which, k] / mean
    of_noise = found.spatial_variance_error_dn2[which, k] / noise**2
    return np.asarray(_DB_PER_RELATIVE_VARIANCE * np.hypot(of_mean, of_noise))


def _two_axes() -> tuple[Figure, Axes, Axes]:
    figure = Figure(figsize=(WIDTH_IN, 5.4))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1.0))
    lower.axhline(0.0, color=BLACK, linewidth=0.8)
    return figure, upper, lower


def _channels(validation: Validation) -> Iterator[_Points]:
    """Each channel that has a patch left: its name, its place, and which patches."""
    for k, channel in enumerate(validation.measured.channels):
        which = validation.used[:, k]
        if which.any():
            yield channel, k, which


def draw_identity(axes: Axes) -> None:
    """The line of equality, over what is shown."""
    low = min(axes.get_xlim()[0], axes.get_ylim()[0])
    high = max(axes.get_xlim()[1], axes.get_ylim()[1])
    axes.plot([low, high], [low, high], color=BLACK, linewidth=0.8, zorder=1, scalex=False, scaley=False)
