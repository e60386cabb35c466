"""Profiles of a mean frame along its rows and columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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


def profile(planes: Sequence[NDArray[np.float64]], axis: int) -> Profile:
    """The profile of one map, or of several of one size together.

    Parameters
    ----------
    planes
        (rows, cols) each. Of several, the mean is theirs, the extremes those of all, the middle line the first one's.
    axis
        1 for the horizontal profile, place by place along a row; 0 for the vertical one.

    Examples
    --------
    >>> found = profile([np.array([[1.0, 2.0], [3.0, 2.0], [8.0, 2.0]])], axis=1)
    >>> found.mean.tolist(), found.highest.tolist(), found.middle.tolist()
    ([4.0, 2.0], [8.0, 2.0], [3.0, 2.0])
    """
    across = 1 - axis
    first = planes[0]
    return Profile(
        mean=np.mean([plane.mean(axis=across) for plane in planes], axis=0),
        lowest=np.min([plane.min(axis=across) for plane in planes], axis=0),
        highest=np.max([plane.max(axis=across) for plane in planes], axis=0),
        middle=np.array(np.take(first, first.shape[across] // 2, axis=across)),
    )
