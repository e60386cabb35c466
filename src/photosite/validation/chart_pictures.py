"""The chart of a validation as pictures: the measured and the simulated frame, cropped and developed alike."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.develop.pair import develop_pair
from photosite.validation.frame_validation import FrameValidation

_MARGIN = 0.06
"""Margin around the chart, as a fraction of its longer side."""


@dataclass(frozen=True, eq=False)
class ChartPictures:
    """The chart as measured and as simulated.

    Parameters
    ----------
    measured, simulated
        (rows, cols, 3) float32, display sRGB.
    origin
        Row and column of the pictures' first pixel in the frames.
    """

    measured: NDArray[np.float32]
    simulated: NDArray[np.float32]
    origin: tuple[int, int]


def chart_pictures(result: FrameValidation) -> ChartPictures:
    """Crop both frames to the chart and develop them with the same colour matrix and exposure."""
    rows, cols = _window(result)
    measured, simulated = (replace(frame, dn=frame.dn[rows, cols]) for frame in (result.measured, result.simulated))
    color = result.validation.color
    pair = develop_pair(measured, simulated, None if color is None else color.matrix)
    return ChartPictures(*pair, (rows.start, cols.start))


def _window(result: FrameValidation) -> tuple[slice, slice]:
    """Return the rows and columns around the chart, starting at a tile of the colour filter array."""
    points = np.asarray(result.corners)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    tile = (len(result.measured.cfa), len(result.measured.cfa[0]))
    rows, cols = (
        slice(
            max(0, math.floor((low[axis] - margin) / tile[axis]) * tile[axis]),
            min(result.measured.shape[axis], math.ceil(high[axis] + margin)),
        )
        for axis in (0, 1)
    )
    return rows, cols
