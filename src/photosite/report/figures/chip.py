"""Figures of a chip: temporal noise, defects, blinking pixels; spectrogram, profiles and histogram of its pattern."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from photosite.calibration.chip_maps.noise_shape import tukey_density, tukey_reach
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise
from photosite.calibration.spatial.spatial_analysis import (
    FramePattern,
    Histogram,
    Profile,
    SpatialAnalysis,
    Spectrogram,
)
from photosite.report.style import (
    BAND,
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    VERMILION,
    WIDTH_IN,
    channel_style,
    label_log_ticks,
    legend_above,
    new_figure,
    styled,
    thinned,
)
from photosite.values.uncertain import COVERAGE_95, Missing

_PER_POINT = 2  # bins of the histogram per point
_NORMAL_QUARTILE = 0.6744897501960817


@styled()
def noise_histogram_figure(noise: TemporalNoise) -> Figure:
    """Draw the histogram of all deviations from the pixels' means, with the normal and the Tukey lambda distribution.

    The density is logarithmic; tails heavier than normal lie above the dashed line. The normal distribution has the
    quartiles of the histogram. The Tukey lambda distribution has its shape and standard deviation, and is drawn if the
    shape differs significantly from normal. If it has a largest deviation, its label states the number of values
    beyond.
    """
    figure, axes = new_figure()
    bins = len(noise.residual_count) // _PER_POINT * _PER_POINT
    count = noise.residual_count[:bins].reshape(-1, _PER_POINT).sum(axis=1)
    x = noise.residual_dn[:bins].reshape(-1, _PER_POINT).mean(axis=1)
    width, total = float(x[1] - x[0]), float(count.sum())
    filled = count > 0
    density = count[filled] / (total * width)
    bars = np.minimum(np.sqrt(count[filled]), 0.999 * count[filled]) / (total * width)
    low, high = _quantiles(noise, np.array([0.25, 0.75]))
    sigma = (high - low) / (2 * _NORMAL_QUARTILE)
    normal = np.linspace(x[filled][0], x[filled][-1], 600)
    dots: dict[str, Any] = {"fmt": "o", "color": BLUE, "markersize": 3.2, "elinewidth": 0.8}
    axes.errorbar(x[filled], density, bars, label="values", zorder=2, **dots)
    bell = np.exp(-0.5 * (normal / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    label = f"normal, {sigma:.3g} DN from quartiles"
    axes.plot(normal, bell, color=BLACK, linestyle="--", label=label, zorder=3)
    if noise.shape.tukey_lambda.value is not None and not noise.shape.shape_is_normal:
        _draw_tukey(axes, noise.shape.tukey_lambda.value, x, count)
    axes.set_yscale("log")
    axes.set_ylim(0.4 / (total * width), 3.0 * float(density.max()))
    reach = 1.05 * max(-x[filled][0], x[filled][-1], 5 * sigma)
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("deviation from the pixel's mean (DN)")
    axes.set_ylabel("density (1/DN)")
    legend_above(figure)
    return figure


def _draw_tukey(axes: Axes, shape: float, x: NDArray[np.float64], count: NDArray[np.int64]) -> None:
    """Draw the Tukey lambda distribution with the standard deviation of the values, and its ends, if it has any."""
    spread = float(np.sqrt(count @ x**2 / count.sum()))
    reach = tukey_reach(shape, spread)
    label = f"Tukey lambda, shape {shape:.3f}".replace("-", "−")
    if (beyond := int(count[np.abs(x) > reach].sum())) > 0:
        label += f": ends at ±{reach:.3g} DN, {beyond} values beyond"
        for end in (-reach, reach):
            axes.axvline(end, color=ORANGE, linestyle=":", linewidth=0.9, zorder=1)
    axes.plot(*tukey_density(shape, spread), color=ORANGE, label=label, zorder=4)


def _quantiles(noise: TemporalNoise, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quantiles of the histogram, linear within a bin."""
    width = noise.residual_dn[1] - noise.residual_dn[0]
    below = np.cumsum(noise.residual_count) / noise.residual_count.sum()
    return np.asarray(np.interp(p, below, noise.residual_dn + width / 2))


@styled()
def spectrogram_figure(patterns: Mapping[str, FramePattern]) -> Figure:
    """Draw the square roots of the horizontal and the vertical spectrogram of each channel, all dark or all light.

    Pale: the mean frame. Full: after the standard's high-pass filter. Dashed: the white part, the median of the
    filtered spectrum, with the band that contains 95 % of the frequencies of a pattern without structure. Dotted, for a
    single channel: the temporal noise that remains in the mean frame. Ordinates are logarithmic.

    References
    ----------
    EMVA 1288 R4.0, 8.6.
    """
    figure = Figure(figsize=(WIDTH_IN, 5.6))
    upper, lower = figure.subplots(2, 1, sharey=True)
    alone = len(patterns) == 1
    for color, pattern in zip(_colors(patterns).values(), patterns.values(), strict=True):
        across, down = pattern.horizontal_filtered, pattern.vertical_filtered
        _draw_spectrogram(upper, pattern.horizontal, across, down.length, color, alone=alone)
        _draw_spectrogram(lower, pattern.vertical, down, across.length, color, alone=alone)
    some = next(iter(patterns.values()))
    for axes, title in ((upper, "horizontal, along rows"), (lower, "vertical, along columns")):
        axes.set(yscale="log", xlim=(0.0, 0.5), ylabel=f"standard deviation ({some.unit})")
        axes.set_title(title, loc="left")
        label_log_ticks(axes.yaxis)
    lower.set_xlabel(
        "frequency (cycles per pixel" + (")" if some.frames and len(patterns) == 1 else " of the channel)")
    )
    return _with_legend(figure, _spectrogram_legend(patterns))


def _with_legend(figure: Figure, handles: list[Line2D]) -> Figure:
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _colors(patterns: Mapping[str, FramePattern]) -> dict[str, str]:
    return {channel: channel_style(channel, position)[0] for position, channel in enumerate(patterns)}


def white_band(found: Spectrogram, lines: int) -> tuple[float, float]:
    """Return the standard deviations that enclose 95 % of the frequencies of a pattern without structure.

    The spectrogram is the mean of the powers of a number of lines, chi-square distributed with twice as many degrees of
    freedom.

    Examples
    --------
    >>> none = np.array([])
    >>> [round(float(end), 3) for end in white_band(Spectrogram(none, none, 8, 4.0, 0.0), 1)]
    [0.318, 3.841]
    """
    from scipy.stats import chi2

    low, high = np.sqrt(found.white * chi2.ppf([0.025, 0.975], 2 * lines) / (2 * lines))
    return float(low), float(high)


def _draw_spectrogram(
    axes: Axes, plain: Spectrogram, filtered: Spectrogram, lines: int, color: str, *, alone: bool
) -> None:
    for found, opacity in ((plain, 0.35), (filtered, 1.0)):
        # Omit frequency 0, the power of the line means, which would stretch the axis.
        axes.plot(*thinned(found.frequency[1:], np.sqrt(found.power[1:])), color=color, alpha=opacity, linewidth=0.9)
    # Three bands of full opacity would hide each other.
    opacity = BAND if alone else BAND / 3
    axes.axhspan(*white_band(filtered, lines), color=BLACK if alone else color, alpha=opacity, linewidth=0)
    axes.axhline(np.sqrt(filtered.white), color=BLACK if alone else color, linewidth=1.1, linestyle="--")
    if alone and filtered.temporal > 0.0:
        axes.axhline(np.sqrt(filtered.temporal), color=GRAY, linewidth=1.1, linestyle=":")


def _spectrogram_legend(patterns: Mapping[str, FramePattern]) -> list[Line2D]:
    alone, colors = len(patterns) == 1, _colors(patterns)
    color = next(iter(colors.values())) if alone else GRAY
    handles = [] if alone else [Line2D([], [], color=look, label=channel) for channel, look in colors.items()]
    handles += [
        Line2D([], [], color=color, alpha=0.35, label="mean frame"),
        Line2D([], [], color=color, label="high-pass filtered"),
        Line2D([], [], color=BLACK if alone else GRAY, linestyle="--", label="white part, 95 %"),
    ]
    if alone:
        handles.append(Line2D([], [], color=GRAY, linestyle=":", label="temporal noise"))
    return handles


_PROFILE_LINES = (
    ("highest", "maximum", VERMILION, 0.8),
    ("lowest", "minimum", BLUE, 0.8),
    ("middle", "middle line", GREEN, 0.6),
    ("mean", "mean", BLACK, 1.2),
)


@styled()
def profiles_figure(spatial: SpatialAnalysis) -> Figure:
    """Draw the horizontal and vertical profiles of one channel, in the light and in the dark.

    Above: the mean frame near half saturation minus dark, if there is one. Below: the mean dark frame. Left: mean,
    maximum, minimum and middle row at each column. Right: the same at each row.

    References
    ----------
    EMVA 1288 R4.0, 8.7.
    """
    patterns = [spatial.dark] if isinstance(spatial.light, Missing) else [spatial.light, spatial.dark]
    figure = Figure(figsize=(WIDTH_IN, 0.6 + 2.5 * len(patterns)))
    panels = figure.subplots(len(patterns), 2, squeeze=False, sharey="row", sharex="col")
    for row, pattern in zip(panels, patterns, strict=True):
        for axes, profile in ((row[0], pattern.along_columns), (row[1], pattern.along_rows)):
            _draw_profile(axes, profile)
        row[0].set_ylabel("signal (DN)" if pattern.kind == "light" else "dark (DN)")
        row[0].set_title("light − dark" if pattern.kind == "light" else "dark", loc="left")
    panels[-1][0].set_xlabel("column")
    panels[-1][1].set_xlabel("row")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(handles))
    return figure


def _draw_profile(axes: Axes, profile: Profile) -> None:
    place = np.arange(len(profile.mean), dtype=np.float64)
    for name, label, color, width in _PROFILE_LINES:
        axes.plot(*thinned(place, getattr(profile, name)), color=color, linewidth=width, label=label)
    axes.set_xlim(0, len(place) - 1)


@styled()
def histogram_figure(patterns: Mapping[str, FramePattern]) -> Figure:
    """Draw the logarithmic and the accumulated histogram of deviations from the mean of each channel.

    The channels are all dark or all light. Left: histogram. Right: accumulated histogram. Steps: pixels. Dashed: normal
    distribution of the same standard deviation. Vertical lines: threshold of outliers. Ordinates are logarithmic.

    References
    ----------
    EMVA 1288 R4.0, 8.8.
    """
    figure = Figure(figsize=(WIDTH_IN, 3.9))
    left, right = figure.subplots(1, 2)
    for axes in (left, right):
        axes.set_yscale("log")
    alone = len(patterns) == 1
    for color, pattern in zip(_colors(patterns).values(), patterns.values(), strict=True):
        _draw_histogram(left, right, pattern.histogram, color, BLACK if alone else color)
        for axes, sign in ((left, -1.0), (left, 1.0), (right, 1.0)):
            threshold = sign * pattern.outliers.threshold
            axes.axvline(threshold, color=GRAY if alone else color, linewidth=0.9, linestyle=":")
    some = next(iter(patterns.values()))
    left.set(ylabel="pixels", xlabel=f"deviation from the mean ({some.unit})")
    left.set_ylim(bottom=0.5)
    reach = max(_reach(pattern) for pattern in patterns.values())
    left.set_xlim(-reach, reach)
    pixels = max(int(pattern.histogram.count.sum()) for pattern in patterns.values())
    right.set(ylabel="pixels beyond (%)", xlabel=f"absolute deviation ({some.unit})")
    right.set_ylim(50.0 / pixels, 200.0)
    right.set_xlim(0.0, reach)
    return _with_legend(figure, _histogram_legend(patterns))


def _reach(pattern: FramePattern) -> float:
    """Return the axis limit that includes the farthest pixel and the threshold."""
    ends = abs(pattern.histogram.lower[0]), abs(pattern.histogram.lower[-1] + pattern.histogram.width)
    return 1.05 * float(max(*ends, pattern.outliers.threshold))


def _draw_histogram(left: Axes, right: Axes, found: Histogram, color: str, dashes: str) -> None:
    edges = np.append(found.lower, found.lower[-1] + found.width)
    left.stairs(found.count, edges, color=color, linewidth=1.0)
    normal, beyond = found.normal(), found.normal_beyond()
    _draw_normal(left, found.lower + 0.5 * found.width, normal, np.sqrt(normal), dashes)
    right.step(found.deviation, found.percent_beyond, where="post", color=color, linewidth=1.2)
    spread = np.sqrt(beyond * (100.0 - beyond) / found.count.sum())
    _draw_normal(right, found.deviation, beyond, spread, dashes)


def _draw_normal(
    axes: Axes, x: NDArray[np.float64], expected: NDArray[np.float64], deviation: NDArray[np.float64], color: str
) -> None:
    """Draw the expected counts of a normal distribution with their 95 % band."""
    low = np.maximum(expected - COVERAGE_95 * deviation, 1e-9)
    axes.fill_between(x, low, expected + COVERAGE_95 * deviation, color=color, alpha=BAND, linewidth=0)
    axes.plot(x, expected, "--", color=color, linewidth=1.1)


def _histogram_legend(patterns: Mapping[str, FramePattern]) -> list[Line2D]:
    alone, colors = len(patterns) == 1, _colors(patterns)
    return [
        *(Line2D([], [], color=color, label="pixels" if alone else channel) for channel, color in colors.items()),
        Line2D([], [], color=BLACK if alone else GRAY, linestyle="--", label="normal, 95 % of the counts"),
        Line2D([], [], color=GRAY, linestyle=":", label="threshold of outliers"),
    ]
