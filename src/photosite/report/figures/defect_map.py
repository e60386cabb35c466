"""Where on the chip its defective pixels lie."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.report.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILION, WIDTH_IN, styled
from photosite.sensor.measured_chip import DefectKind, Defects

_LOOKS = {
    DefectKind.HOT: ("hot", VERMILION, "o"),
    DefectKind.OFFSET: ("offset", ORANGE, "D"),
    DefectKind.DEAD: ("dead", BLACK, "x"),
    DefectKind.RESPONSE: ("response", BLUE, "+"),
    DefectKind.BLINKING: ("blinking", GREEN, "^"),
    DefectKind.NOISY: ("noisy", PURPLE, "v"),
}

_MOST = 4000
"""Of a kind that are drawn: those that are farthest off."""


@styled()
def defect_map_figure(defects: Defects, shape: tuple[int, int]) -> Figure:
    """The chip's area with a mark for each defective pixel.

    Parameters
    ----------
    defects
        The list.
    shape
        (rows, cols) of the chip.

    Returns
    -------
    matplotlib.figure.Figure
        Row 0 on top, as in a picture; the legend says how many there are of each kind. Of more than 4000 of a kind,
        the 4000 farthest off are drawn, and the legend says so.
    """
    rows, cols = shape
    height = min(max((WIDTH_IN - 2.4) * rows / cols, 2.2), 7.0)
    figure = Figure(figsize=(WIDTH_IN, height + 0.9))
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.grid(visible=False)
    for kind, (name, color, marker) in _LOOKS.items():
        chosen = defects.of(kind)
        if not len(chosen):
            continue
        drawn = np.argsort(-np.abs(chosen.deviation), kind="stable")[:_MOST]
        label = f"{name}: {len(chosen)}" + (f", {_MOST} drawn" if len(chosen) > _MOST else "")
        top_value_shares = len(drawn) > 400
        axes.plot(
            chosen.col[drawn],
            chosen.row[drawn],
            marker,
            color=color,
            markerfacecolor="none",
            markersize=3.0 if top_value_shares else 5.0,
            markeredgewidth=0.7 if top_value_shares else 1.1,
            label=label,
        )
    axes.set_xlim(-0.5, cols - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)
    axes.set_xlabel("column")
    axes.set_ylabel("row")
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    if len(defects):
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), borderaxespad=0.0, markerscale=1.3)
    else:
        axes.text(0.5, 0.5, "no defective pixels", transform=axes.transAxes, ha="center", va="center")
    return figure
