"""Pictures side by side in a figure, every pixel of theirs a whole number of the figure's: nothing is resampled.

Rings that drawing a picture at another size would make are not what a gallery of sampling should show.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

DOTS_PER_INCH = 110.0
"""At which the gallery's figures are drawn."""

Panel = tuple[str, NDArray[np.float32]]
"""A title, and (rows, cols, 3) display sRGB or (rows, cols) grey, 0 to 1."""

_GAP, _TITLE, _MARGIN = 10, 24, 6
_TITLE_POINTS = 9.0


def pictures(rows: Sequence[Sequence[Panel]], width_in: float | None = None, *, below_in: float = 0.0) -> Figure:
    """Pictures under their titles, in rows.

    Parameters
    ----------
    rows
        The panels of each row.
    width_in
        Pictures are drawn as many times larger, a whole number for each, as fits; None: once.
    below_in
        Height of the room that is left under them.
    """
    widest = max(map(_row_width, rows))
    room = widest if width_in is None else round(width_in * DOTS_PER_INCH) - 2 * _MARGIN
    heights = []
    scales = []
    for row in rows:
        gaps = _GAP * (len(row) - 1)
        scales.append(max(1, (room - gaps) // (_row_width(row) - gaps)))
        heights.append(_TITLE + scales[-1] * max(picture.shape[0] for _, picture in row))
    width = 2 * _MARGIN + max(
        scale * (_row_width(row) - _GAP * (len(row) - 1)) + _GAP * (len(row) - 1)
        for row, scale in zip(rows, scales, strict=True)
    )
    below = round(below_in * DOTS_PER_INCH)
    height = 2 * _MARGIN + sum(heights) + below
    figure = Figure(figsize=(width / DOTS_PER_INCH, height / DOTS_PER_INCH), dpi=DOTS_PER_INCH)
    figure.set_layout_engine("none")
    top = _MARGIN
    for row, scale, tall in zip(rows, scales, heights, strict=True):
        left = _MARGIN
        for title, picture in row:
            box = (left, top + _TITLE, scale * picture.shape[1], scale * picture.shape[0])
            _draw(place(figure, box), title, picture)
            left += box[2] + _GAP
        top += tall
    return figure


def place(figure: Figure, box: tuple[int, int, int, int]) -> Axes:
    """Axes at (left, top, width, height) in the figure's pixels."""
    width, height = (round(side * DOTS_PER_INCH) for side in figure.get_size_inches())
    left, top, wide, tall = box
    return figure.add_axes((left / width, 1 - (top + tall) / height, wide / width, tall / height))


def curves_below(figure: Figure, below_in: float) -> Axes:
    """Axes for curves in the room under pictures, as wide as these, with room for their labels."""
    width, height = (round(side * DOTS_PER_INCH) for side in figure.get_size_inches())
    below = round(below_in * DOTS_PER_INCH)
    top, left, foot = height - below + 30, 76, 52
    return place(figure, (left, top, width - left - 20, below - 30 - foot))


def enlarged(picture: NDArray[np.float32], times: int) -> NDArray[np.float32]:
    """Every pixel as a square of pixels."""
    return picture.repeat(times, axis=0).repeat(times, axis=1)


def _row_width(row: Sequence[Panel]) -> int:
    return sum(int(picture.shape[1]) for _, picture in row) + _GAP * (len(row) - 1)


def _draw(axes: Axes, title: str, picture: NDArray[np.float32]) -> None:
    axes.imshow(picture, interpolation="nearest", cmap="gray", vmin=0, vmax=1, aspect="auto")
    axes.set_title(title, fontsize=_TITLE_POINTS, pad=5, loc="left")
    axes.set_axis_off()
