"""Histograms of a fixed pattern beside the normal distribution, and the pixels far out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

MOST_BINS = 256
"""EMVA 1288: bins of a histogram at most."""

EXPECTED_BEYOND = 0.1
"""Pixels of the whole map that a normal distribution would have beyond the threshold of candidates."""

_QUARTILE = NormalDist().inv_cdf(0.75)


@dataclass(frozen=True, eq=False)
class Histogram:
    """How many pixels deviate from the mean by how much, both ways and at all.

    Parameters
    ----------
    lower, width
        (bins,) lower ends of the bins, and their common width, in the unit of the map; 0 is its mean.
    count
        (bins,) pixels.
    sigma
        Standard deviation of the map, by which the normal distribution is drawn.
    deviation, percent_beyond
        (bins,) deviations, and the percentage of pixels that deviate by so much or more, either way: the
        accumulated histogram.

    Notes
    -----
    EMVA 1288 R4.0, 8.8: logarithmic histograms and accumulated histograms.
    """

    lower: NDArray[np.float64]
    width: float
    count: NDArray[np.int64]
    sigma: float
    deviation: NDArray[np.float64]
    percent_beyond: NDArray[np.float64]

    def normal(self) -> NDArray[np.float64]:
        """(bins,) how many pixels a normal distribution of the same standard deviation has in each bin."""
        if self.sigma == 0.0:
            return self.count.astype(np.float64)
        edges = np.append(self.lower, self.lower[-1] + self.width)
        return np.asarray(self.count.sum() * np.diff(_normal_below(edges, self.sigma)))

    def normal_beyond(self) -> NDArray[np.float64]:
        """(bins,) `percent_beyond` of a normal distribution of the same standard deviation."""
        if self.sigma == 0.0:
            return self.percent_beyond
        return np.asarray(200.0 * _normal_below(-self.deviation, self.sigma))


def _normal_below(x: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    from scipy.special import ndtr

    return np.asarray(ndtr(x / sigma))


def histogram(deviations: NDArray[np.float64], grain: float | None = None) -> Histogram:
    """The histogram of deviations from the mean.

    Parameters
    ----------
    deviations
        (pixels,) of a map from its mean.
    grain
        Step that the map's values are multiples of but for a common offset: 1 / n for the mean of n frames. Bins are
        whole numbers of it wide, as the standard has it, so that each holds equally many possible values. None where
        the values are continuous.

    Examples
    --------
    >>> found = histogram(np.array([-1.0, -0.5, 0.0, 0.0, 1.5]), grain=0.5)
    >>> found.lower.tolist(), found.count.tolist()
    ([-1.0, -0.5, 0.0, 0.5, 1.0, 1.5], [1, 1, 2, 0, 0, 1])
    >>> found.deviation.tolist(), found.percent_beyond.tolist()
    ([0.0, 0.5, 1.0, 1.5], [100.0, 60.0, 40.0, 20.0])
    """
    lowest, highest = float(deviations.min()), float(deviations.max())
    width, bins = _bins(highest - lowest, grain)
    count = _counted(deviations - lowest, width, bins, grain)
    size = np.abs(deviations)
    least = 0.0 if grain is None else float(size.min())
    step, steps = _bins(float(size.max()) - least, grain)
    beyond = np.cumsum(_counted(size - least, step, steps, grain)[::-1])[::-1]
    return Histogram(
        lower=lowest + width * np.arange(bins, dtype=np.float64),
        width=width,
        count=count,
        sigma=float(deviations.std()),
        deviation=least + step * np.arange(steps, dtype=np.float64),
        percent_beyond=100.0 * beyond / deviations.size,
    )


def _bins(extent: float, grain: float | None) -> tuple[float, int]:
    """Width and number of bins over an extent, which the last one holds too."""
    if grain is None:
        return (extent / MOST_BINS or 1.0) * (1.0 + 1e-12), MOST_BINS if extent > 0.0 else 1
    values = round(extent / grain)
    grains = values // MOST_BINS + 1
    return grains * grain, values // grains + 1


def _counted(above: NDArray[np.float64], width: float, bins: int, grain: float | None) -> NDArray[np.int64]:
    # Rounding must not push a value on a bin's lower end into the bin before it.
    places = np.floor(above / width + (0.0 if grain is None else 1e-6 * grain / width))
    return np.bincount(np.minimum(places, bins - 1).astype(np.intp), minlength=bins)


@dataclass(frozen=True, eq=False)
class FarPixels:
    """Pixels that deviate from the mean of their map by more than a threshold: candidates for a list of defects.

    Parameters
    ----------
    row, col
        (m,) places on the sensor, the most deviating first.
    deviation
        (m,) from the map's mean, in its unit.
    threshold
        Beyond which pixels were taken.
    rule
        Where the threshold is from.
    """

    row: NDArray[np.intp]
    col: NDArray[np.intp]
    deviation: NDArray[np.float64]
    threshold: float
    rule: str


def normal_threshold(deviations: NDArray[np.float64]) -> float:
    """The deviation beyond which a normal distribution would have a tenth of a pixel, either way.

    Its standard deviation is the interquartile range's, which far pixels do not widen.
    """
    low, high = np.quantile(deviations, [0.25, 0.75])
    sigma = float(high - low) / (2.0 * _QUARTILE)
    return sigma * -NormalDist().inv_cdf(0.5 * EXPECTED_BEYOND / deviations.size)


def far_pixels(
    planes: Sequence[tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]], threshold: float | None = None
) -> FarPixels:
    """The pixels of a map that deviate by more than a threshold.

    Parameters
    ----------
    planes
        (rows, cols) deviations from the mean, with the row and column of the sensor that each row and column is.
    threshold
        In the unit of the map; `normal_threshold` if None. EMVA 1288 leaves it to the application.

    Examples
    --------
    >>> plane = np.zeros((2, 3))
    >>> plane[1, 2] = 40.0
    >>> found = far_pixels([(plane, np.array([0, 2]), np.array([1, 3, 5]))], threshold=20.0)
    >>> found.row.tolist(), found.col.tolist(), found.deviation.tolist()
    ([2], [5], [40.0])
    """
    rule = "as given"
    if threshold is None:
        threshold = normal_threshold(np.concatenate([plane.ravel() for plane, _, _ in planes]))
        rule = f"where a normal distribution would have {EXPECTED_BEYOND:g} pixels"
    rows, cols, found = [], [], []
    for plane, row, col in planes:
        i, j = np.nonzero(np.abs(plane) > threshold)
        rows.append(row[i])
        cols.append(col[j])
        found.append(plane[i, j])
    deviation = np.concatenate(found)
    order = np.argsort(-np.abs(deviation), kind="stable")
    return FarPixels(np.concatenate(rows)[order], np.concatenate(cols)[order], deviation[order], float(threshold), rule)
