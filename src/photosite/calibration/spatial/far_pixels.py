"""Outlying pixels, such as dead columns and stuck pixels, that dominate the variance of a fixed pattern."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.lazy_maps import Map
from photosite.engine.site_planes import far_sums, spaced_values
from photosite.engine.threads import thread_count

_Array = NDArray[np.float64]


@dataclass(frozen=True)
class FarPixels:
    """Pixels far from the others, in a map of offsets or of responses.

    Parameters
    ----------
    what
        The nonuniformity that the map gives: PRNU, or DSNU1288 with the exposure time.
    count
        Number of these pixels.
    fraction
        Fraction of the variance over all pixels that they make.
    """

    what: str
    count: int
    fraction: float

    def __str__(self) -> str:
        return (
            f"{self.count} outlying pixels, such as hot, dead or stuck ones, make {100 * self.fraction:.3g} % of "
            f"the variance of the {self.what}, which is that of all pixels, as are its parts of rows and columns. Maps "
            f"(--maps) list them"
        )


_FAR_SIGMA = 8.0
"""Distance from the median in standard deviations by the quartiles: 1 of 10^15 pixels of a normal distribution."""
_FRACTION = 0.2
"""Fraction of the variance over pixels from which far pixels are reported: the others have a tenth less spread."""
_QUARTILE = 0.6745  # of a normal distribution, in standard deviations
_SAMPLES = 1 << 16
"""Pixels of a site from which the quartiles are computed, at least, where it has as many: the limit is known to 1 %."""


def find_far_pixels(what: str, values: Map, tile: tuple[int, ...] = (1, 1)) -> FarPixels | None:
    """Return the pixels that lie far from those of their own site; None unless they make a fifth of the variance.

    Parameters
    ----------
    what
        The nonuniformity that the map gives.
    values
        (rows, cols) map.
    tile
        Rows and columns of the color filter array's tile. Lines beyond the last whole tile are left out.

    Examples
    --------
    >>> offsets = np.random.default_rng(1).normal(size=(100, 100))
    >>> find_far_pixels("DSNU", offsets)
    >>> offsets[:, 7] = 30
    >>> found = find_far_pixels("DSNU", offsets)
    >>> found.count, round(found.fraction, 2)
    (100, 0.9)
    """
    sites = list(np.ndindex(tile[0], tile[1]))
    rows, cols = (length // period for length, period in zip(values.shape, tile, strict=True))
    step = max(rows * cols // _SAMPLES, 1)
    while math.gcd(step, cols) > 1:  # else the same columns would be sampled in all rows
        step -= 1

    def quartiles(site: tuple[int, ...]) -> list[float]:
        sample = spaced_values(values, (site[0], site[1]), tile, step)
        return [float(x) for x in np.percentile(sample, [25, 50, 75], overwrite_input=True)]

    with ThreadPoolExecutor(min(len(sites), thread_count())) as threads:
        low, middle, high = np.array(list(threads.map(quartiles, sites))).T.reshape(3, tile[0], tile[1])
    limit = (_FAR_SIGMA * 0.5 * (high - low) / _QUARTILE) ** 2
    count, far, total = far_sums(values, np.ascontiguousarray(middle), limit)
    return FarPixels(what, count, far / total) if far > _FRACTION * total else None
