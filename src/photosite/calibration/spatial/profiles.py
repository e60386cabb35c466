"""Profiles of a mean frame along its rows and columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spatial.strips import Plane, strips


@dataclass(frozen=True, eq=False)
class Profile:
    """What the lines across one direction of a map hold, place by place along it.

    Parameters
    ----------
    mean, lowest, highest, middle
        (n,) mean, minimum and maximum over the lines, and the middle line's values, in the unit of the map.

    Notes
    -----
    EMVA 1288 R4.0, 8.7: horizontal and vertical profiles.
    """

    mean: NDArray[np.float64]
    lowest: NDArray[np.float64]
    highest: NDArray[np.float64]
    middle: NDArray[np.float64]


def profiles(planes: Sequence[Plane]) -> tuple[Profile, Profile]:
    """The horizontal and the vertical profile of one map, or of several of one size together.

    Parameters
    ----------
    planes
        (rows, cols) each. Of several, the mean is theirs, the extremes those of all, the middle line the first one's.

    Returns
    -------
    along_columns, along_rows
        Place by place along a row, over the rows: the horizontal profile; and the other way round.

    Examples
    --------
    >>> across, down = profiles([np.array([[1.0, 2.0], [3.0, 2.0], [8.0, 2.0]])])
    >>> across.mean.tolist(), across.highest.tolist(), across.middle.tolist()
    ([4.0, 2.0], [8.0, 2.0], [3.0, 2.0])
    >>> down.mean.tolist()
    [1.5, 2.5, 5.0]
    """
    rows, cols = planes[0].shape
    sums, lows, highs = (np.zeros(cols), np.full(cols, np.inf), np.full(cols, -np.inf))
    row_sums, row_lows, row_highs = (np.zeros(rows), np.full(rows, np.inf), np.full(rows, -np.inf))
    for plane in planes:
        for part, lines in strips(plane):
            sums += lines.sum(axis=0)
            np.minimum(lows, lines.min(axis=0), out=lows)
            np.maximum(highs, lines.max(axis=0), out=highs)
            row_sums[part] += lines.sum(axis=1)
            np.minimum(row_lows[part], lines.min(axis=1), out=row_lows[part])
            np.maximum(row_highs[part], lines.max(axis=1), out=row_highs[part])
    first, down, across = planes[0], rows // 2, cols // 2
    middle_row = np.array(first[down : down + 1, :]).ravel()
    middle_column = np.array(first[:, across : across + 1]).ravel()
    return (
        Profile(sums / (rows * len(planes)), lows, highs, middle_row),
        Profile(row_sums / (cols * len(planes)), row_lows, row_highs, middle_column),
    )
