"""Spectrograms of mean frames: regular patterns are peaks, uneven light is the rise at the left."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from photosite.calibration.spatial.spatial_analysis import FramePattern, Spectrogram
from photosite.report.figures.marks import thinned
from photosite.report.style import BAND, BLACK, GRAY, WIDTH_IN, channel_style, styled


@styled()
def spectrogram_figure(patterns: Mapping[str, FramePattern]) -> Figure:
    """Horizontal and vertical spectrogram, as square roots: the standard deviation that each frequency stands for.

    Parameters
    ----------
    patterns
        By channel; all dark or all light.

    Returns
    -------
    matplotlib.figure.Figure
        Pale: the mean frame as it is; full: after the standard's high-pass. Dashed: the white part, the median of the
        high-passed spectrum, in the band in which 95 % of the frequencies of a pattern without structure lie; dotted:
        what temporal noise leaves in the mean frame, where there is one channel only. Ordinates are logarithmic.

    Notes
    -----
    EMVA 1288 R4.0, 8.6.
    """
    figure = Figure(figsize=(WIDTH_IN, 5.6))
    upper, lower = figure.subplots(2, 1, sharey=True)
    for position, (channel, pattern) in enumerate(patterns.items()):
        color = channel_style(channel, position)[0]
        alone = len(patterns) == 1
        across, down = pattern.horizontal_filtered, pattern.vertical_filtered
        _draw(upper, pattern.horizontal, across, down.length, color, alone=alone)
        _draw(lower, pattern.vertical, down, across.length, color, alone=alone)
    some = next(iter(patterns.values()))
    for axes, title in ((upper, "horizontal, along rows"), (lower, "vertical, along columns")):
        axes.set(yscale="log", xlim=(0.0, 0.5), ylabel=f"standard deviation ({some.unit})")
        axes.set_title(title, loc="left")
        for set_formatter in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
            set_formatter(FuncFormatter(lambda value, _: _tick(value, upper.get_ylim())))
    lower.set_xlabel(
        "frequency (cycles per pixel" + (")" if some.frames and len(patterns) == 1 else " of the channel)")
    )
    handles = _legend(patterns)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _tick(value: float, limits: tuple[float, float]) -> str:
    """A number for each tick of a short axis, for those at 1, 2 and 5 of a longer one."""
    leading = value / 10.0 ** np.floor(np.log10(value) + 1e-9)
    wanted = limits[1] < 2.0 * limits[0] or any(np.isclose(leading, number) for number in (1.0, 2.0, 5.0))
    return f"{value:.3g}" if wanted else ""


def white_band(found: Spectrogram, lines: int) -> tuple[float, float]:
    """Between which standard deviations 95 % of the frequencies of a pattern without structure lie.

    Parameters
    ----------
    found
        Whose white part.
    lines
        How many lines it is the mean of: the mean of so many powers follows chi square of twice as many degrees of
        freedom over them.

    Examples
    --------
    >>> none = np.array([])
    >>> [round(float(end), 3) for end in white_band(Spectrogram(none, none, 8, 4.0, 0.0), 1)]
    [0.318, 3.841]
    """
    from scipy.stats import chi2

    low, high = np.sqrt(found.white * chi2.ppf([0.025, 0.975], 2 * lines) / (2 * lines))
    return float(low), float(high)


def _draw(axes: Axes, plain: Spectrogram, filtered: Spectrogram, lines: int, color: str, *, alone: bool) -> None:
    for found, opacity in ((plain, 0.35), (filtered, 1.0)):
        # At frequency 0 stands what the lines' means differ by; it would stretch the axis.
        axes.plot(*thinned(found.frequency[1:], np.sqrt(found.power[1:])), color=color, alpha=opacity, linewidth=0.9)
    # Three bands of full opacity would cover each other.
    opacity = BAND if alone else BAND / 3
    axes.axhspan(*white_band(filtered, lines), color=BLACK if alone else color, alpha=opacity, linewidth=0)
    axes.axhline(np.sqrt(filtered.white), color=BLACK if alone else color, linewidth=1.1, linestyle="--")
    if alone and filtered.temporal > 0.0:
        axes.axhline(np.sqrt(filtered.temporal), color=GRAY, linewidth=1.1, linestyle=":")


def _legend(patterns: Mapping[str, FramePattern]) -> list[Line2D]:
    alone = len(patterns) == 1
    looks = [(channel, channel_style(channel, position)[0]) for position, channel in enumerate(patterns)]
    color = looks[0][1] if alone else GRAY
    handles = [] if alone else [Line2D([], [], color=look, label=channel) for channel, look in looks]
    handles += [
        Line2D([], [], color=color, alpha=0.35, label="mean frame"),
        Line2D([], [], color=color, label="high-passed"),
        Line2D([], [], color=BLACK if alone else GRAY, linestyle="--", label="white part, 95 %"),
    ]
    if alone:
        handles.append(Line2D([], [], color=GRAY, linestyle=":", label="temporal noise left"))
    return handles
