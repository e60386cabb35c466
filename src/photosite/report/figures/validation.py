"""Figures that compare measured with simulated or true values: patches, color differences, deviations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.metrics.patches import PatchStatistics
from photosite.report.style import BLACK, BLUE, GRAY, VERMILION, WIDTH_IN, channel_style, styled, two_panels
from photosite.validation.result import ColorComparison, Validation
from photosite.values.uncertain import COVERAGE_95

_DB_PER_RELATIVE_VARIANCE = 10.0 / np.log(10.0)  # decibels per small relative change of a variance

FillStyle = Literal["full", "bottom", "none"]


@styled()
def patch_means_figure(validation: Validation, measured: str = "measured", simulated: str = "simulated") -> Figure:
    """Draw measured against simulated patch means, and their relative differences, with the names of both cameras.

    Saturated patches are omitted. Error bars are 95 % intervals from the standard errors of both means. The axes are
    logarithmic if all means are above black.
    """
    figure, upper, lower = _two_axes()
    draw_patch_means(upper, lower, validation)
    if min(float(found.mean_dn[validation.used].min()) for found in (validation.measured, validation.simulated)) > 0:
        upper.set(xscale="log", yscale="log")
    draw_identity(upper)
    return _labelled(figure, f"mean, {measured} (DN)", "difference (%)", f"patch mean above black, {simulated} (DN)")


def draw_patch_means(
    upper: Axes, lower: Axes | None, validation: Validation, filled: FillStyle = "full", largest_bar: float = math.inf
) -> None:
    """Draw measured against simulated means on the upper axes, and relative differences in percent on the lower.

    Parameters
    ----------
    upper, lower
        Axes to draw on; None: without the differences.
    validation
        The comparison. Saturated patches are omitted.
    filled
        Fill style of the markers, to distinguish several comparisons.
    largest_bar
        Largest half width of an interval on the lower axes; less precise points appear on the upper axes only.
    """
    seen, made = validation.measured, validation.simulated
    for channel, k, which in _channels(validation):
        color, marker, _ = channel_style(channel, k)
        look = color, marker, filled
        x, y = made.mean_dn[which, k], seen.mean_dn[which, k]
        error_x, error_y = (COVERAGE_95 * found.standard_error_dn[which, k] for found in (made, seen))
        _draw_crosses(upper, (x, y), (error_x, error_y), look, channel)
        if lower is None:
            continue
        lit = x > 0
        half = 100.0 * np.hypot(error_x, error_y)[lit] / x[lit]
        known = half <= largest_bar
        _draw_crosses(lower, (x[lit][known], (100.0 * (y - x)[lit] / x[lit])[known]), (None, half[known]), look)


@styled()
def patch_snr_figure(validation: Validation, measured: str = "measured", simulated: str = "simulated") -> Figure:
    """Draw measured against simulated SNR over the pixels of each patch, and the differences.

    Saturated patches and those without a ratio are omitted. Error bars are 95 % intervals from the standard errors of
    means and variances of both.
    """
    figure, upper, lower = _two_axes()
    draw_patch_snr(upper, lower, validation)
    draw_identity(upper)
    return _labelled(figure, f"SNR, {measured} (dB)", "difference (dB)", f"patch SNR, {simulated} (dB)")


def draw_patch_snr(
    upper: Axes, lower: Axes, validation: Validation, filled: FillStyle = "full", largest_bar: float = math.inf
) -> None:
    """Draw signal-to-noise ratios on the upper axes, and differences in decibels on the lower, as `draw_patch_means`.

    Patches without a ratio are omitted.
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
    """Draw points with error bars along both axes, or along the ordinate."""
    color, marker, filled = look
    axes.errorbar(*points, half[1], half[0], fmt="none", ecolor=color, elinewidth=0.9, zorder=2)
    axes.plot(*points, marker, color=color, fillstyle=filled, markerfacecoloralt="white", label=label, zorder=3)


def _snr_error_db(found: PatchStatistics, which: NDArray[np.bool_], k: int) -> NDArray[np.float64]:
    """Return the standard error of 20 log10(mean / noise), to first order."""
    mean, noise = found.mean_dn[which, k], found.spatial_noise_dn[which, k]
    of_mean = 2.0 * found.standard_error_dn[which, k] / mean
    of_noise = found.spatial_variance_error_dn2[which, k] / noise**2
    return np.asarray(_DB_PER_RELATIVE_VARIANCE * np.hypot(of_mean, of_noise))


def _two_axes() -> tuple[Figure, Axes, Axes]:
    figure, upper, lower = two_panels(upper_height=2.4)
    lower.axhline(0.0, color=BLACK, linewidth=0.8)
    return figure, upper, lower


def _labelled(figure: Figure, above: str, below: str, x_label: str) -> Figure:
    upper, lower = figure.axes
    upper.set_ylabel(above)
    lower.set(ylabel=below, xlabel=x_label)
    upper.legend(loc="upper left", title="channel")
    figure.align_ylabels([upper, lower])
    return figure


def _channels(validation: Validation) -> Iterator[tuple[str, int, NDArray[np.bool_]]]:
    """Yield each channel with usable patches: name, index and mask of the patches."""
    for k, channel in enumerate(validation.measured.channels):
        which = validation.used[:, k]
        if which.any():
            yield channel, k, which


def draw_identity(axes: Axes) -> None:
    """Draw the line of equality over the current limits."""
    low = min(axes.get_xlim()[0], axes.get_ylim()[0])
    high = max(axes.get_xlim()[1], axes.get_ylim()[1])
    axes.plot([low, high], [low, high], color=BLACK, linewidth=0.8, zorder=1, scalex=False, scaley=False)


_JUST_VISIBLE = 1.0  # about the smallest CIEDE2000 difference visible between adjacent surfaces, by convention


@styled()
def color_difference_figure(colors: ColorComparison) -> Figure:
    """Draw the CIEDE2000 and CIE 1976 color difference of each patch; a dotted line marks 1 if the axis reaches it."""
    count = len(colors.names)
    figure = Figure(figsize=(WIDTH_IN, 1.1 + 0.19 * count))
    axes = figure.add_subplot()
    rows = np.arange(count)
    axes.hlines(rows, 0.0, colors.delta_e_76, color="#D0D0D0", linewidth=1.0)
    axes.plot(colors.delta_e_2000, rows, "o", color=BLUE, label="CIEDE2000")
    axes.plot(colors.delta_e_76, rows, "D", color=VERMILION, markerfacecolor="white", label="CIE 1976")
    largest = float(max(colors.delta_e_76.max(), colors.delta_e_2000.max()))
    if largest > 0.5 * _JUST_VISIBLE:
        axes.axvline(_JUST_VISIBLE, color=GRAY, linestyle=":", linewidth=1.0)
    axes.set_yticks(rows, colors.names)
    axes.set_ylim(count - 0.4, -0.6)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("color difference (ΔE units)")
    axes.grid(axis="y", visible=False)
    figure.legend(loc="outside upper right", ncols=2)
    return figure


@styled()
def deviations_figure(labels: Sequence[str], deviations: Sequence[float]) -> Figure:
    """Draw the deviation of each estimate from the true value in standard uncertainties, a row per parameter.

    Correct estimates lie within the band of ±1.96 in 95 % of cases.
    """
    rows = np.arange(len(labels))
    figure = Figure(figsize=(WIDTH_IN, 1.1 + 0.27 * len(labels)))
    axes = figure.add_subplot()
    axes.axvspan(-COVERAGE_95, COVERAGE_95, color="#E8F1F8", zorder=0)
    for limit in (-COVERAGE_95, COVERAGE_95):
        axes.axvline(limit, color=GRAY, linewidth=0.9, linestyle="--")
    axes.axvline(0.0, color=BLACK, linewidth=0.9)
    axes.hlines(rows, 0.0, np.asarray(deviations), color=BLUE, linewidth=1.4)
    axes.plot(deviations, rows, "o", color=BLUE, markersize=6)
    reach = max(3.0, 1.1 * float(np.max(np.abs(deviations))))
    axes.set_xlim(-reach, reach)
    axes.set_yticks(rows, list(labels))
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.set_xlabel("estimate − true value (standard uncertainties)")
    axes.grid(axis="y", visible=False)
    return figure
