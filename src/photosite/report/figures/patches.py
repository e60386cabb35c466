"""Patches of a chart, measured against simulated: means and signal-to-noise ratios."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.measured import COVERAGE_95
from photosite.metrics.patches import PatchStatistics
from photosite.report.style import BLACK, WIDTH_IN, channel_style, styled
from photosite.validation.result import Validation

_DB_PER_RELATIVE_VARIANCE = 10.0 / np.log(10.0)
"""A relative change of a variance, small, in decibels."""

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
    seen, made = validation.measured, validation.simulated
    darkest = math.inf
    for channel, k, which in _channels(validation):
        color, marker, _ = channel_style(channel, k)
        x, y = made.mean_dn[which, k], seen.mean_dn[which, k]
        error = COVERAGE_95 * np.hypot(made.standard_error_dn[which, k], seen.standard_error_dn[which, k])
        upper.plot(x, y, marker, color=color, label=channel)
        lit = x > 0
        darkest = min(darkest, *x, *y)
        percent = 100.0 / x[lit]
        lower.errorbar(x[lit], (y - x)[lit] * percent, error[lit] * percent, fmt=marker, color=color, elinewidth=0.9)
    if darkest > 0:
        upper.set(xscale="log", yscale="log")
    _identity(upper)
    upper.set_ylabel(f"mean, {measured} (DN)")
    lower.set_ylabel("difference (%)")
    lower.set_xlabel(f"patch mean above black, {simulated} (DN)")
    upper.legend(loc="upper left", title="channel")
    figure.align_ylabels([upper, lower])
    return figure


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
    seen, made = validation.measured, validation.simulated
    for channel, k, which in _channels(validation):
        color, marker, _ = channel_style(channel, k)
        shown = which & np.isfinite(made.spatial_snr_db[:, k]) & np.isfinite(seen.spatial_snr_db[:, k])
        x, y = made.spatial_snr_db[shown, k], seen.spatial_snr_db[shown, k]
        error = COVERAGE_95 * np.hypot(_snr_error_db(made, shown, k), _snr_error_db(seen, shown, k))
        upper.plot(x, y, marker, color=color, label=channel)
        lower.errorbar(x, y - x, error, fmt=marker, color=color, elinewidth=0.9)
    _identity(upper)
    upper.set_ylabel(f"SNR, {measured} (dB)")
    lower.set_ylabel("difference (dB)")
    lower.set_xlabel(f"patch SNR, {simulated} (dB)")
    upper.legend(loc="upper left", title="channel")
    figure.align_ylabels([upper, lower])
    return figure


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


def _identity(axes: Axes) -> None:
    """The line of equality, over what is shown."""
    low = min(axes.get_xlim()[0], axes.get_ylim()[0])
    high = max(axes.get_xlim()[1], axes.get_ylim()[1])
    axes.plot([low, high], [low, high], color=BLACK, linewidth=0.8, zorder=1, scalex=False, scaley=False)
