"""Histograms of a fixed pattern beside the normal distribution, and the pixels far out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spatial.strips import Plane, spread_sample, strips

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


def histogram(planes: Sequence[Plane], centres: Sequence[float], grain: float | None = None) -> Histogram:
    """The histogram of a map's deviations from its mean, or of several maps' together.

    Parameters
    ----------
    planes, centres
        (rows, cols) each, and each one's mean.
    grain
        Step that a map's values are multiples of: 1 / n for the mean of n frames. Bins are whole numbers of it wide, as
        the standard has it, so that each holds equally many possible values. None where the values are continuous.

    Examples
    --------
    >>> found = histogram([np.array([[9.0, 9.5, 10.0, 10.0, 11.5]])], [10.0], grain=0.5)
    >>> found.lower.tolist(), found.count.tolist()
    ([-1.0, -0.5, 0.0, 0.5, 1.0, 1.5], [1, 1, 2, 0, 0, 1])
    >>> found.deviation.tolist(), found.percent_beyond.tolist()
    ([0.0, 0.5, 1.0, 1.5], [100.0, 60.0, 40.0, 20.0])
    """
    range_ = _Range.of(planes, centres)
    width, bins = _bins(range_.highest - range_.lowest, grain)
    least = 0.0 if grain is None else range_.least
    step, steps = _bins(max(range_.highest, -range_.lowest) - least, grain)
    count, sizes = np.zeros(bins, np.int64), np.zeros(steps, np.int64)
    for deviations in _deviations(planes, centres):
        count += _counted(deviations - range_.lowest, width, bins, grain)
        sizes += _counted(np.abs(deviations) - least, step, steps, grain)
    return Histogram(
        lower=range_.lowest + width * np.arange(bins, dtype=np.float64),
        width=width,
        count=count,
        sigma=range_.sigma,
        deviation=least + step * np.arange(steps, dtype=np.float64),
        percent_beyond=100.0 * np.cumsum(sizes[::-1])[::-1] / sizes.sum(),
    )


def _deviations(planes: Sequence[Plane], centres: Sequence[float]) -> Iterator[NDArray[np.floating]]:
    return (lines - centre for plane, centre in zip(planes, centres, strict=True) for _, lines in strips(plane))


@dataclass(frozen=True)
class _Range:
    """Lowest, highest and least deviation, and their standard deviation."""

    lowest: float
    highest: float
    least: float
    sigma: float

    @classmethod
    def of(cls, planes: Sequence[Plane], centres: Sequence[float]) -> _Range:
        lowest, highest, least = np.inf, -np.inf, np.inf
        total = squares = 0.0
        pixels = 0
        for some in _deviations(planes, centres):
            lowest, highest = min(lowest, float(some.min())), max(highest, float(some.max()))
            least = min(least, float(np.abs(some).min()))
            total += float(some.sum(dtype=np.float64))
            squares += float(np.einsum("ij,ij->", some, some, dtype=np.float64))
            pixels += some.size
        # The centres are the means: what is left of the mean square is rounding.
        return cls(lowest, highest, least, float(np.sqrt(max(squares / pixels - (total / pixels) ** 2, 0.0))))


def _bins(extent: float, grain: float | None) -> tuple[float, int]:
    """Width and number of bins over an extent, which the last one holds too."""
    if grain is None:
        return (extent / MOST_BINS or 1.0) * (1.0 + 1e-12), MOST_BINS if extent > 0.0 else 1
    values = round(extent / grain)
    grains = values // MOST_BINS + 1
    return grains * grain, values // grains + 1


def _counted(above: NDArray[np.floating], width: float, bins: int, grain: float | None) -> NDArray[np.int64]:
    # Rounding must not push a value on a bin's lower end into the bin before it.
    places = np.floor(above / width + (0.0 if grain is None else 1e-6 * grain / width))
    return np.bincount(np.minimum(places, bins - 1).astype(np.int32).ravel(), minlength=bins)


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

    def to_dict(self, unit: str) -> dict[str, Any]:
        """`threshold`, `unit`, `rule`, and `row`, `col`, `deviation` of each pixel."""
        found = {"row": self.row.tolist(), "col": self.col.tolist(), "deviation": self.deviation.tolist()}
        return {"threshold": self.threshold, "unit": unit, "rule": self.rule, **found}


def normal_threshold(sample: NDArray[np.floating], pixels: int) -> float:
    """The deviation beyond which a normal distribution of so many pixels would have a tenth of one, either way.

    Its standard deviation is that of a sample of them by its interquartile range, which far pixels do not widen.
    """
    low, high = np.quantile(sample, [0.25, 0.75])
    sigma = float(high - low) / (2.0 * _QUARTILE)
    return sigma * -NormalDist().inv_cdf(0.5 * EXPECTED_BEYOND / pixels)


Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""The row and the column of the sensor that each row and each column of a plane is."""


def far_pixels(
    planes: Sequence[Plane], centres: Sequence[float], places: Sequence[Places], threshold: float | None = None
) -> FarPixels:
    """The pixels of a map, or of several together, that deviate from the mean by more than a threshold.

    Parameters
    ----------
    planes, centres, places
        (rows, cols) each; each one's mean; where on the sensor its pixels are.
    threshold
        In the unit of the map; `normal_threshold` if None. EMVA 1288 leaves it to the application.

    Examples
    --------
    >>> plane = np.full((2, 3), 7.0)
    >>> plane[1, 2] = 47.0
    >>> found = far_pixels([plane], [7.0], [(np.array([0, 2]), np.array([1, 3, 5]))], threshold=20.0)
    >>> found.row.tolist(), found.col.tolist(), found.deviation.tolist()
    ([2], [5], [40.0])
    """
    rule = "as given"
    if threshold is None:
        sample = np.concatenate([spread_sample(plane) - c for plane, c in zip(planes, centres, strict=True)])
        threshold = normal_threshold(sample, sum(plane.shape[0] * plane.shape[1] for plane in planes))
        rule = f"where a normal distribution would have {EXPECTED_BEYOND:g} pixels"
    rows, cols, found = [], [], []
    for plane, centre, (row, col) in zip(planes, centres, places, strict=True):
        for part, lines in strips(plane):
            deviations = lines - centre
            i, j = np.nonzero(np.abs(deviations) > threshold)
            rows.append(row[part][i])
            cols.append(col[j])
            found.append(deviations[i, j].astype(np.float64))
    deviation = np.concatenate(found)
    order = np.argsort(-np.abs(deviation), kind="stable")
    return FarPixels(np.concatenate(rows)[order], np.concatenate(cols)[order], deviation[order], float(threshold), rule)
