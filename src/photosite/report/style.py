"""The common style of all figures: lines, points, bands and legends, and figures as SVG and PNG bytes.

Figures are matplotlib `Figure` objects without pyplot, so they share no state. `styled` applies the style while a
figure is made and drawn, independent of the user's matplotlib settings, so that equal input gives equal bytes.
"""

from __future__ import annotations

import io
import math
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal

import matplotlib
import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

# Okabe and Ito, "Color Universal Design" (2008): distinguishable with any color vision.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
GRAY = "#6B6B6B"

LineStyle = Literal["-", "--", "-.", ":"]

_CHANNELS: dict[str, tuple[str, str, LineStyle]] = {
    "R": (VERMILION, "o", "-"),
    "G": (GREEN, "s", "--"),
    "B": (BLUE, "^", "-."),
}
_OTHERS: tuple[tuple[str, str, LineStyle], ...] = (
    (GRAY, "D", "-"),
    (PURPLE, "v", ":"),
    (ORANGE, "P", "--"),
    (SKY, "X", "-."),
    (BLACK, "*", ":"),
)

_LINES: tuple[tuple[str, str, LineStyle], ...] = (
    (BLUE, "o", "-"),
    (VERMILION, "s", "--"),
    (GREEN, "^", "-."),
    (PURPLE, "v", ":"),
    (ORANGE, "D", "-"),
    (GRAY, "P", "--"),
)

WIDTH_IN = 7.0

STRIP_IN = 0.26
"""Height of the strip for a line of text below a figure."""

BAND = 0.22
"""Opacity of an uncertainty band."""

_STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.labelsize": 10.0,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#444444",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E2E2E2",
    "grid.linewidth": 0.8,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "lines.linewidth": 1.6,
    "lines.markersize": 5.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.08,
    "svg.fonttype": "path",  # independent of installed fonts
    "svg.hashsalt": "photosite",  # reproducible identifiers
}

# matplotlib's settings are global; only one thread may change them at a time.
_SETTINGS = threading.RLock()

_Numbers = NDArray[np.float64]
_Mask = NDArray[np.bool_]


@contextmanager
def styled() -> Iterator[None]:
    """Apply the style; usable as a context manager and as a decorator."""
    with _SETTINGS:
        with matplotlib.style.context(["default", _STYLE]):
            yield
            interactive = matplotlib.is_interactive()
        # The first figure loads the backend. That of notebooks becomes interactive, or later figures are not shown.
        matplotlib.interactive(interactive)


def new_figure(height_in: float = 4.5) -> tuple[Figure, Axes]:
    """Return a figure of the usual width with one pair of axes."""
    figure = Figure(figsize=(WIDTH_IN, height_in))
    return figure, figure.add_subplot()


def legend_above(figure: Figure, handles: Sequence[Artist] | None = None, columns: int = 4) -> None:
    """Draw the legend above the axes, where it covers no data; by default of all labeled artists."""
    if handles is None:
        handles = [handle for axes in figure.axes for handle in axes.get_legend_handles_labels()[0]]
    labels = [str(handle.get_label()) for handle in handles]
    figure.legend(handles, labels, loc="outside upper right", ncols=min(len(handles), columns))


def two_panels(height_in: float = 5.4, upper_height: float = 1.0) -> tuple[Figure, Axes, Axes]:
    """Return a figure with two panels and one abscissa, the upper panel `upper_height` times as high as the lower."""
    figure = Figure(figsize=(WIDTH_IN, height_in))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(upper_height, 1.0))
    return figure, upper, lower


def label_log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers: 1, 2 and 5; decades if it is long, all ticks if it is short.

    Examples
    --------
    >>> _, axes = new_figure()
    >>> _ = axes.set(xscale="log", xlim=(1500, 40000))
    >>> label_log_ticks(axes.xaxis)
    >>> [text for text in axes.xaxis.get_minor_formatter().format_ticks([2000, 3000, 5000, 10000]) if text]
    ['2000', '5000', '10000']
    """

    def text(value: float, _: int | None) -> str:
        low, high = axis.get_view_interval()
        digit = f"{value:.1e}"[0]
        if digit not in ("1" if high > 1e3 * low else "125" if high > 2 * low else "123456789"):
            return ""
        if 1e-4 < value < 1e5:
            return f"{value:g}"
        return f"$10^{{{math.log10(value):.0f}}}$" if digit == "1" else ""

    axis.set_major_formatter(FuncFormatter(text))
    axis.set_minor_formatter(FuncFormatter(text))


def channel_style(channel: str, position: int = 0) -> tuple[str, str, LineStyle]:
    """Return color, marker and line style of a color channel.

    R, G and B look the same in every figure; the position among the channels selects the style of other names. Channels
    of a color behind polarizers, such as R90 and R45, have the color and differ in marker and line.

    Examples
    --------
    >>> channel_style("G")
    ('#009E73', 's', '--')
    >>> channel_style("M") == channel_style("R")
    False
    """
    if (of_color := _CHANNELS.get(channel.rstrip("0123456789"))) is None:
        return _OTHERS[position % len(_OTHERS)]
    return of_color if channel in _CHANNELS else (of_color[0], *_OTHERS[position % len(_OTHERS)][1:])


def line_style(position: int) -> tuple[str, str, LineStyle]:
    """Return color, marker and line style of one of several lines that are not color channels.

    Examples
    --------
    >>> len({line_style(position) for position in range(24)})
    24
    """
    color, marker, _ = _LINES[position % len(_LINES)]
    style = _LINES[(position + position // len(_LINES)) % 4][2]
    return color, marker, style


def svg_bytes(figure: Figure, below: str | None = None) -> bytes:
    """Return the figure as SVG, with text as outlines and an optional small line of text in a strip below.

    The figure is not changed. Equal figures give equal bytes.
    """
    metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    return _saved(figure, below, format="svg", metadata=metadata)


def png_bytes(figure: Figure, dots_per_inch: float = 150.0, below: str | None = None) -> bytes:
    """Return the figure as PNG, as `svg_bytes` does."""
    return _saved(figure, below, format="png", dpi=dots_per_inch, metadata={"Software": None})


def _saved(figure: Figure, below: str | None, **how: Any) -> bytes:
    stream = io.BytesIO()
    with styled(), _strip(figure, below) as area:
        figure.savefig(stream, bbox_inches=area, **how)
    return stream.getvalue()


@contextmanager
def _strip(figure: Figure, below: str | None) -> Iterator[Bbox | None]:
    """Yield the area to save, in inches: the figure and the strip below it, which the layout does not affect."""
    if below is None:
        yield None
        return
    width, height = figure.get_size_inches()
    text = figure.text(
        1.0 - 0.08 / width, -0.5 * STRIP_IN / height, below, ha="right", va="center", fontsize=8.0, color=GRAY
    )
    text.set_in_layout(False)
    try:
        yield Bbox.from_extents(0.0, -STRIP_IN, width, height)
    finally:
        text.remove()


# Points with error bars, bands and legend entries, in the same style for all figures.


def draw_points(
    axes: Axes, x: _Numbers, y: _Numbers, half: _Numbers, used: _Mask, look: tuple[str, str], size: float = 5.0
) -> None:
    """Draw points with error bars of a half length: filled if used in a fit, else hollow.

    `look` is the color and the marker.
    """
    color, marker = look
    for filled in (True, False):
        which = used == filled
        style: dict[str, Any] = {"fmt": marker, "markersize": size, "elinewidth": 0.9, "zorder": 2 + filled}
        fill = color if filled else "white"
        axes.errorbar(x[which], y[which], half[which], color=color, markerfacecolor=fill, **style)


def draw_band(axes: Axes, x: _Numbers, middle: _Numbers, half: _Numbers, color: str) -> None:
    """Draw a band of the given half width around a line; on a logarithmic axis only where it is above 0."""
    low, high = middle - half, middle + half
    shown = np.isfinite(low) & np.isfinite(high)
    if axes.get_yscale() == "log":
        shown &= low > 0
    axes.fill_between(x[shown], low[shown], high[shown], color=color, alpha=BAND, linewidth=0)


def channel_handles(
    channels: Sequence[str], alone: str, hollow: str | None = None, *, lines: bool = True
) -> list[Line2D]:
    """Return legend entries for the channels, and for hollow points.

    Parameters
    ----------
    channels
        Names, in drawing order.
    alone, hollow
        Label of a single channel, and of hollow points, if there are any.
    lines
        Whether the channels have lines.
    """
    looks = [channel_style(channel, position) for position, channel in enumerate(channels)]
    names = [alone] if len(channels) == 1 else channels
    handles = [
        Line2D([], [], color=color, marker=marker, linestyle=line if lines else "", label=name)
        for name, (color, marker, line) in zip(names, looks, strict=True)
    ]
    if hollow is not None:
        color, marker = looks[0][:2] if len(channels) == 1 else (GRAY, "o")
        handles.append(Line2D([], [], color=color, marker=marker, linestyle="", markerfacecolor="white", label=hollow))
    return handles


def thinned(x: _Numbers, y: _Numbers, most: int = 800) -> tuple[_Numbers, _Numbers]:
    """Thin a long line to the lowest and highest value of at most `most` runs of neighbors, so that peaks remain.

    A short line is returned unchanged.

    Examples
    --------
    >>> [part.tolist() for part in thinned(np.arange(5.0), np.array([1.0, 5.0, 2.0, 0.0, 3.0]), most=1)]
    [[2.0, 2.0], [0.0, 5.0]]
    """
    if len(x) <= 2 * most:
        return x, y
    step = -(-len(x) // most)
    starts = np.arange(0, len(x), step)
    middle = x[(starts + np.minimum(starts + step, len(x)) - 1) // 2]
    ends = np.stack([np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)], axis=1)
    return np.repeat(middle, 2), ends.ravel()
