"""Points with their intervals and bands around lines, alike in every figure."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from photosite.report.style import BAND

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
