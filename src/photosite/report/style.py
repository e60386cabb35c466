"""How the figures look: one style, one palette, and how a figure becomes bytes.

Figures are matplotlib `Figure` objects, never pyplot's: nothing is shared between two of them. The style is in force
while a figure is made and while it is drawn (`styled`), whatever the user's own matplotlib settings are, so that the
same input gives the same bytes.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import matplotlib
import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

# Okabe and Ito, "Color Universal Design" (2008): told apart by readers of every colour vision.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
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

WIDTH_IN, HEIGHT_IN = 7.0, 4.5

STRIP_IN = 0.26
"""Height of the strip for a line below a figure."""

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
    "svg.fonttype": "path",  # the reader needs no font
    "svg.hashsalt": "photosite",  # else every drawing gets identifiers of its own
}

# matplotlib keeps its settings in one table for the whole process; two threads must not swap them at once.
_SETTINGS = threading.RLock()


@contextmanager
def styled() -> Iterator[None]:
    """The style in force; also a decorator for functions that make figures."""
    with _SETTINGS, matplotlib.style.context(["default", _STYLE]):
        yield


def new_figure(width_in: float = WIDTH_IN, height_in: float = HEIGHT_IN) -> tuple[Figure, Axes]:
    """A figure with one pair of axes, laid out so that nothing is cut off."""
    figure = Figure(figsize=(width_in, height_in))
    return figure, figure.add_subplot()


def channel_style(channel: str, position: int = 0) -> tuple[str, str, LineStyle]:
    """Colour, marker and line style of a colour channel.

    Parameters
    ----------
    channel
        Its name. R, G and B look alike in every figure.
    position
        Its place among the channels; chooses the look of any other name.

    Examples
    --------
    >>> channel_style("G")
    ('#009E73', 's', '--')
    >>> channel_style("M") == channel_style("R")
    False
    """
    return _CHANNELS.get(channel) or _OTHERS[position % len(_OTHERS)]


def svg_bytes(figure: Figure, below: str | None = None) -> bytes:
    """The figure as SVG; text is drawn as outlines. The same figure gives the same bytes.

    Parameters
    ----------
    figure
        It stays as it is.
    below
        A small line in a strip of its own under the figure.
    """
    stream = io.BytesIO()
    with styled(), _strip(figure, below) as area:
        metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(stream, format="svg", metadata=metadata, bbox_inches=area)
    return stream.getvalue()


def png_bytes(figure: Figure, dots_per_inch: float = 150.0, below: str | None = None) -> bytes:
    """The figure as PNG; `below` as in `svg_bytes`."""
    stream = io.BytesIO()
    with styled(), _strip(figure, below) as area:
        figure.savefig(stream, format="png", dpi=dots_per_inch, metadata={"Software": None}, bbox_inches=area)
    return stream.getvalue()


@contextmanager
def _strip(figure: Figure, below: str | None) -> Iterator[Bbox | None]:
    """What to save, in inches: the figure, and under it the line. Outside the figure, where no layout can touch it."""
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
