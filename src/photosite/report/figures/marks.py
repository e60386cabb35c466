"""Points with their intervals and bands around lines, alike in every figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from photosite.report.style import BAND, GRAY, channel_style

_Numbers = NDArray[np.float64]


def draw_points(
    axes: Axes,
    x: _Numbers,
    y: _Numbers,
    half: _Numbers,
    used: NDArray[np.bool_],
    look: tuple[str, str],
    size: float = 5.0,
) -> None:
    """Points with bars: filled where they were used, hollow where not.

    Parameters
    ----------
    axes
        To draw on.
    x, y, half, used
        (points,) place, height of a bar to each side, and whether the point was used.
    look
        Colour and marker.
    size
        Of a marker, in points.
    """
    color, marker = look
    for filled in (True, False):
        which = used == filled
        axes.errorbar(
            x[which],
            y[which],
            half[which],
            fmt=marker,
            color=color,
            markerfacecolor=color if filled else "white",
            markersize=size,
            elinewidth=0.9,
            zorder=2 + filled,
        )


def draw_band(axes: Axes, x: _Numbers, middle: _Numbers, half: _Numbers, color: str) -> None:
    """A band of so much to each side of a line; on a logarithmic axis only where it is above 0."""
    low, high = middle - half, middle + half
    shown = np.isfinite(low) & np.isfinite(high)
    if axes.get_yscale() == "log":
        shown &= low > 0
    axes.fill_between(x[shown], low[shown], high[shown], color=color, alpha=BAND, linewidth=0)


def channel_handles(
    channels: Sequence[str], alone: str, hollow: str | None = None, *, lines: bool = True
) -> list[Line2D]:
    """The legend's entries: a channel each, and what hollow points are.

    Parameters
    ----------
    channels
        Their names, in the order they were drawn in.
    alone
        What to call a channel that is the only one.
    hollow
        What hollow points are, if there are any.
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
    """A long line for a plot: runs of neighbours by their lowest and highest value, so that no peak is lost.

    Parameters
    ----------
    x, y
        (n,).
    most
        Runs at most, more than a plot has places for.

    Returns
    -------
    tuple of numpy.ndarray
        The line itself where it is short; else twice the runs, at the middle of each its lowest and highest value.

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
