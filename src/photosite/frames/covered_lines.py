"""Levels of lines without light, and shifts of frames to the level of a reference frame.

Covered pixels have dark current, which overscan lacks: the reference is a frame of the same exposure time.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

_LEAST_LINES = 5
"""Lines that show how uncertain a change of their level is."""
_SIGNIFICANCE = 3.0
_MAD_TO_MEDIAN_UNCERTAINTY = 1.4826 * 1.2533


def shifted_down(dn: Any, shift: int, most: int | None) -> Any:
    """Return numbers that are lower by a whole number; unsigned ones at 0 and at the largest one, `most`, stay.

    Examples
    --------
    >>> shifted_down(np.array([0, 100, 4095], np.uint16), -3, 4095).tolist()
    [0, 103, 4095]
    """
    if not shift:
        return dn
    if dn.dtype.kind != "u":
        return dn - shift
    top = int(np.iinfo(dn.dtype).max) if most is None else most
    moved = np.clip(dn.astype(np.int64) - shift, 0, top).astype(dn.dtype)
    return np.where((dn == 0) | (dn >= top), dn, moved)


def line_means(areas: Iterable[NDArray[np.uint16]]) -> NDArray[np.float64]:
    """Return the means of the lines of covered areas, (rows, cols) each; lines are along the longer side."""
    means = [area.mean(axis=0 if area.shape[0] >= area.shape[1] else 1) for area in areas if area.size]
    return np.concatenate(means) if means else np.zeros(0)


def level_change(means: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    """Return the median change of the lines since a reference frame, or 0 for one within chance.

    Examples
    --------
    >>> lines = np.array([64.1, 64.0, 63.9, 64.2, 64.0, 64.1])
    >>> round(level_change(lines + 3.0, lines), 9), level_change(lines[::-1], lines)
    (3.0, 0.0)
    """
    if len(means) != len(reference) or len(means) < _LEAST_LINES:
        return 0.0
    change = means - reference
    found = float(np.median(change))
    spread = _MAD_TO_MEDIAN_UNCERTAINTY * float(np.median(np.abs(change - found))) / len(change) ** 0.5
    return found if abs(found) > _SIGNIFICANCE * spread else 0.0
