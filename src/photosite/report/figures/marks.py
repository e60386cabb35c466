"""Points with error bars, bands and legend entries, in the same style for all figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from photosite.report.style import BAND, GRAY, channel_style

_Numbers = NDArray[np.float64]
_Mask = NDArray[np.bool_]


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
