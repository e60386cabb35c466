"""Logarithmic histograms of the fixed pattern, and accumulated ones, beside the normal distribution."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from photosite.calibration.spatial.spatial_analysis import FramePattern, Histogram
from photosite.report.style import BAND, BLACK, GRAY, WIDTH_IN, channel_style, styled
from photosite.values.measured import COVERAGE_95


@styled()
def histogram_figure(patterns: Mapping[str, FramePattern]) -> Figure:
    """How many pixels deviate from the mean by how much, and how many by so much or more.

    Parameters
    ----------
    patterns
        By channel; all dark or all light.

    Returns
    -------
    matplotlib.figure.Figure
        Left, the histogram; right, the accumulated one. Steps: the pixels; dashed: a normal distribution of the same
        standard deviation. Vertical lines: beyond them pixels are candidates for the list of defects. Ordinates are
        logarithmic.

    Notes
    -----
    EMVA 1288 R4.0, 8.8.
    """
    figure = Figure(figsize=(WIDTH_IN, 3.9))
    left, right = figure.subplots(1, 2)
    for axes in (left, right):
        axes.set_yscale("log")
    alone = len(patterns) == 1
    for position, (channel, pattern) in enumerate(patterns.items()):
        color = channel_style(channel, position)[0]
        _draw(left, right, pattern.histogram, color, BLACK if alone else color)
        for axes, places in ((left, (-1.0, 1.0)), (right, (1.0,))):
            for sign in places:
                axes.axvline(
                    sign * pattern.outliers.threshold, color=GRAY if alone else color, linewidth=0.9, linestyle=":"
                )
    some = next(iter(patterns.values()))
    left.set(ylabel="pixels", xlabel=f"deviation from the mean ({some.unit})")
    left.set_ylim(bottom=0.5)
    reach = max(_reach(pattern) for pattern in patterns.values())
    left.set_xlim(-reach, reach)
    pixels = max(int(pattern.histogram.count.sum()) for pattern in patterns.values())
    right.set(ylabel="pixels beyond (%)", xlabel=f"deviation, either way ({some.unit})")
    right.set_ylim(50.0 / pixels, 200.0)
    right.set_xlim(0.0, reach)
    handles = _legend(patterns)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _reach(pattern: FramePattern) -> float:
    """Of the farthest pixel and of the threshold, with some room."""
    ends = abs(pattern.histogram.lower[0]), abs(pattern.histogram.lower[-1] + pattern.histogram.width)
    return 1.05 * float(max(*ends, pattern.outliers.threshold))


def _draw(left: Axes, right: Axes, found: Histogram, color: str, dashes: str) -> None:
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
    """What a normal distribution lets expect, and the band of 95 % of the counts; below 0 that goes to the foot."""
    low = np.maximum(expected - COVERAGE_95 * deviation, 1e-9)
    axes.fill_between(x, low, expected + COVERAGE_95 * deviation, color=color, alpha=BAND, linewidth=0)
    axes.plot(x, expected, "--", color=color, linewidth=1.1)


def _legend(patterns: Mapping[str, FramePattern]) -> list[Line2D]:
    alone = len(patterns) == 1
    looks = [(channel, channel_style(channel, position)[0]) for position, channel in enumerate(patterns)]
    handles = [Line2D([], [], color=color, label="pixels" if alone else channel) for channel, color in looks]
    shared = BLACK if alone else GRAY
    handles.append(Line2D([], [], color=shared, linestyle="--", label="normal, 95 % of the counts"))
    handles.append(Line2D([], [], color=GRAY, linestyle=":", label="threshold of candidates"))
    return handles
