"""Pixels far from all others, such as dead columns and stuck pixels, that make much of a fixed pattern's variance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]

_FAR = 8.0
"""Distance from the median in standard deviations by the quartiles: 1 of 10^15 pixels of a normal distribution."""
_SHARE = 0.2
_QUARTILE = 0.6745
_SAMPLES = 1_000_000


@dataclass(frozen=True)
class FarPixels:
    """Pixels far from the others, in a map of offsets or of responses.

    Parameters
    ----------
    what
        The nonuniformity that the map gives.
    count
        Number of these pixels.
    share
        Share of the variance over all pixels that they make.
    """

    what: str
    count: int
    share: float

    def __str__(self) -> str:
        return (
            f"{self.count} pixels far from all others, such as dead or stuck ones, make {100 * self.share:.3g} % of "
            f"the variance of the {self.what}, which is that of all pixels, as are its parts of rows and columns. Maps "
            f"(--maps) list them"
        )


def find_far_pixels(what: str, maps: Sequence[_Array]) -> FarPixels | None:
    """Return the pixels that lie far from those of their own map; None unless they make a fifth of the variance.

    Examples
    --------
    >>> offsets = np.random.default_rng(1).normal(size=(100, 100))
    >>> find_far_pixels("DSNU", [offsets])
    >>> offsets[:, 7] = 30
    >>> found = find_far_pixels("DSNU", [offsets])
    >>> found.count, round(found.share, 2)
    (100, 0.9)
    """
    count, far, whole = 0, 0.0, 0.0
    for values in maps:
        low, middle, high = np.percentile(values.ravel()[:: 1 + values.size // _SAMPLES], [25, 50, 75])
        limit = (_FAR * 0.5 * (high - low) / _QUARTILE) ** 2
        for rows in np.array_split(values, 1 + values.size // _SAMPLES):
            square = (rows - middle) ** 2
            beyond = square > limit
            count, far, whole = (
                count + int(beyond.sum()),
                far + float(square[beyond].sum()),
                whole + float(square.sum()),
            )
    return FarPixels(what, count, far / whole) if far > _SHARE * whole else None
