"""Figure 2: the chart, measured and simulated side by side."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.develop.pair import develop_pair
from photosite.report.pictures import magnified, shrink
from photosite.report.style import styled
from photosite.studies.farrell2008.page.drawing import Drawing
from photosite.studies.farrell2008.patches import CameraPatches, Patches

_WIDEST, _WIDEST_DIFFERENCE = 262, 98
_MAGNIFICATION = 10.0


def pictures_drawing(chapter: Patches) -> Drawing:
    """Figure 2."""
    return Drawing.of(
        "figure2-pictures",
        pictures_figure(chapter),
        "The colour chart as the virtual camera and as the simulation see it, and ten times their difference",
        "Figure 2: raw frames after bilinear demosaic, through the simulation’s best matrix to XYZ under D65 and "
        "display encoding, at one exposure. Measured is the virtual camera. Every pixel shown is the mean of a square. "
        f"Right: measured less simulated, {_MAGNIFICATION:g} times and on larger squares, around gray, in display "
        "values: the uneven lamp, and noise in what is dark.",
    )


@styled()
def pictures_figure(chapter: Patches) -> Figure:
    """A row for each camera.

    Parameters
    ----------
    chapter
        What `compare_charts` gave.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), Figure 2.
    """
    figure = Figure(figsize=(10.2, 5.0))
    panels = figure.subplots(2, 3)
    for row, found in zip(panels, chapter.cameras.values(), strict=True):
        titles = ("measured (virtual camera)", "simulated", f"difference × {_MAGNIFICATION:g}")
        for axes, picture, title in zip(row, _pictures(found), titles, strict=True):
            _show(axes, picture)
            axes.set_title(title, loc="left")
        row[0].set_ylabel(found.case.title)
    return figure


def _pictures(found: CameraPatches) -> tuple[NDArray[np.float32], ...]:
    # The matrix takes numbers above black; its scale is free to `develop`, which sets its own exposure.
    pair = develop_pair(found.measured, found.simulated, found.colors.simulated)
    measured, simulated = (shrink(picture, _WIDEST_DIFFERENCE) for picture in pair)
    return *(shrink(picture, _WIDEST) for picture in pair), magnified(measured, simulated, _MAGNIFICATION)


def _show(axes: Axes, picture: NDArray[np.float32]) -> None:
    axes.imshow(np.rint(255.0 * picture).astype(np.uint8), interpolation="none")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    for side in axes.spines.values():
        side.set_visible(False)
