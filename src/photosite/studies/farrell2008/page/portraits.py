"""Portraits side by side: whole above, the face below, every pixel as it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.report.style import styled
from photosite.studies.farrell2008.portrait import FACE, portrait


@dataclass(frozen=True, eq=False)
class Column:
    """A picture and what stands with it.

    Parameters
    ----------
    title
        Above it.
    picture
        (rows, cols, 3), display sRGB.
    note
        Below its face.
    """

    title: str
    picture: NDArray[Any]
    note: str


@styled()
def portraits_figure(columns: Sequence[Column]) -> Figure:
    """The pictures in a row, each with its face enlarged below it.

    Parameters
    ----------
    columns
        From left to right. Pictures may differ in size, and are shown alike.
    """
    figure = Figure(figsize=(8.6, 5.2))
    wholes, faces = figure.subplots(
        2, len(columns), height_ratios=(600 / 512, (FACE.r1 - FACE.r0) / (FACE.c1 - FACE.c0))
    )
    rows, cols = portrait().picture.shape[:2]
    for column, whole, face in zip(columns, wholes, faces, strict=True):
        height, width = column.picture.shape[:2]
        r0, r1 = (round(height * r / rows) for r in (FACE.r0, FACE.r1))
        c0, c1 = (round(width * c / cols) for c in (FACE.c0, FACE.c1))
        whole.imshow(column.picture, interpolation="none")
        face.imshow(column.picture[r0:r1, c0:c1], interpolation="none")
        whole.set_title(column.title)
        face.set_xlabel(column.note)
        for axes in (whole, face):
            axes.set(xticks=(), yticks=())
            axes.grid(visible=False)
            axes.spines[:].set_visible(False)
    return figure
