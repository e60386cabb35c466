"""Noise of single pixels: their temporal variance from few frames, and random telegraph noise.

Variances are moderated by those of all pixels. Blinking pixels jump between two levels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_SAMPLE = 200_000
"""Pixels sampled for the quartiles, which are then known to 0.3 %."""

_EXTREME_P_VALUE = 1e-6
"""Probability below which a pixel's variance is too large to be moderated, and is kept unchanged."""


@dataclass(frozen=True)
class NoiseSpread:
    """Distribution of the true temporal variances of a channel's pixels: scaled inverse chi-square.

    `variance` is the scale, DN^2. `freedom` is infinite if all pixels have the same variance, and 0 if the other pixels
    are uninformative.
    """

    variance: float
    freedom: float

    def limit(self, probability: float, measured_freedom: int) -> float:
        """Return the measured variance that an ordinary pixel exceeds with the given probability."""
        from scipy.stats import chi2, f

        if math.isinf(self.freedom):
            return float(self.variance * chi2.isf(probability, measured_freedom) / measured_freedom)
        return float(self.variance * f.isf(probability, measured_freedom, max(self.freedom, 0.01)))


def noise_spread(variances: NDArray[np.floating], freedom: int) -> NoiseSpread:
    """Estimate the distribution of the true variances from the quartiles of the measured ones.

    A measured variance divided by the true one is chi-square distributed. If the true variances are scaled inverse
    chi-square, the measured ones follow Fisher's F (Smyth, Stat. Appl. Genet. Mol. Biol. 3 (2004) 3). The interquartile
    range of their logarithm gives its second degrees of freedom, and their median the scale, so that few outliers do
    not matter.

    `variances` are unbiased, and `freedom` is the number of frames minus one.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> even = noise_spread(4.0 * rng.chisquare(15, 50_000) / 15, 15)
    >>> round(even.variance, 1), even.freedom > 500
    (4.0, True)
    """
    from scipy.optimize import brentq
    from scipy.stats import f

    values = np.asarray(variances).ravel()
    values = values[:: max(1, values.size // _SAMPLE)]
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    if low <= 0.0:
        # With so little noise, most frames are equal and the quartiles are those of rounding.
        return NoiseSpread(float(np.mean(values, dtype=np.float64)), math.inf)
    wanted = math.log(high / low)

    def excess(log_freedom: float) -> float:
        other = math.exp(log_freedom)
        return float(np.log(f.ppf(0.75, freedom, other) / f.ppf(0.25, freedom, other))) - wanted

    least, most = math.log(0.5), math.log(1e4)
    if excess(most) >= 0.0:
        found = math.inf
    elif excess(least) <= 0.0:
        found = 0.0
    else:
        found = math.exp(brentq(excess, least, most, xtol=1e-3))
    at = f.ppf(0.5, freedom, 1e8 if math.isinf(found) else max(found, 0.5))
    return NoiseSpread(float(middle / at), found)


def moderated(variances: NDArray[np.float32], freedom: int, spread: NoiseSpread) -> NDArray[np.float32]:
    """Combine each pixel's variance with the distribution of all pixels.

    The result is the mean of the true variance given both: d0 and d degrees of freedom give
    (d0 s0^2 + d s^2) / (d0 + d - 2). Pixels with an extreme variance keep their own.

    Examples
    --------
    >>> own = np.array([3.0, 5.0, 400.0], np.float32)
    >>> moderated(own, 15, NoiseSpread(4.0, 45.0)).tolist()
    [3.8793..., 4.3965..., 400.0]
    """
    if math.isinf(spread.freedom):
        best = np.full_like(variances, spread.variance)
    else:
        total = freedom + spread.freedom
        total -= 2.0 if total > 4.0 else 0.0  # the mean does not exist for few degrees of freedom
        best = variances * np.float32(freedom / total) + np.float32(spread.freedom / total * spread.variance)
    return np.where(variances > np.float32(spread.limit(_EXTREME_P_VALUE, freedom)), variances, best)


BLINKING_P_VALUE = 1e-4
"""Probability that a pixel with normal noise is classified as blinking."""

LEAST_FRAMES = 12
"""Smallest number of frames in which two levels are searched for."""

LEAST_DISTANCE = 4.0
"""Smallest distance of the levels in units of the noise within them: 2.7 for the halves of a normal distribution, and
3.5 for those of a uniform one (a slow drift)."""

LEAST_VARIANCE_DN2 = 0.5
"""Smallest temporal variance. Below it, the two levels may be neighboring integers, as in every quiet pixel."""

MOST_FRAMES = 256
"""Largest number of frames of a pixel that are used; the first ones."""

_DRAWS = 60_000


@dataclass(frozen=True)
class TwoLevels:
    """The best division of each pixel's values into a lower and an upper group.

    Parameters
    ----------
    ratio, within
        (pixels,) sum of squares between the groups over that within them; variance within, n - 2 degrees of freedom.
    lower, upper, high_fraction
        (pixels,) mean of each group; fraction of the frames in the upper one.
    """

    ratio: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    high_fraction: NDArray[np.float64]
    within: NDArray[np.float64]

    @property
    def distance(self) -> NDArray[np.float64]:
        """Distance (pixels,) between the levels in units of the noise within them."""
        return (self.upper - self.lower) / np.sqrt(self.within)


def least_visits(frames: int) -> int:
    """Return the smallest number of frames that form a level: three, or a twentieth of all."""
    return max(3, -(-frames // 20))


def two_levels(series: NDArray[np.floating]) -> TwoLevels:
    """Divide each pixel's values so that the sum of squares within the two groups is smallest (exact two-means).

    `series` is (pixels, frames), with at least `LEAST_FRAMES` frames.

    Examples
    --------
    >>> found = two_levels(np.array([[0.0, 1, 0, 1, 0, 1, 10, 11, 10, 11, 10, 11]]))
    >>> found.upper[0] - found.lower[0], found.high_fraction[0]
    (np.float64(10.0), np.float64(0.5))
    """
    n = series.shape[1]
    ordered = np.sort(np.asarray(series, dtype=np.float64), axis=1)
    centre = ordered.mean(axis=1, keepdims=True)
    ordered -= centre
    total = np.sum(ordered**2, axis=1)
    visits = least_visits(n)
    cut = np.arange(visits, n - visits + 1)
    lower_sum = np.cumsum(ordered, axis=1)[:, cut - 1]  # of `cut` values; the others sum to its negative
    between = lower_sum**2 * (n / (cut * (n - cut)))
    best = np.argmax(between, axis=1)
    row = np.arange(len(ordered))
    count, lower_sum, between = cut[best], lower_sum[row, best], between[row, best]
    # With only one or two different values, the difference is a rounding error.
    inside = np.maximum(total - between, np.where(total > 0.0, 1e-12 * total, 1.0))
    return TwoLevels(
        ratio=between / inside,
        lower=centre[:, 0] + lower_sum / count,
        upper=centre[:, 0] - lower_sum / (n - count),
        high_fraction=(n - count) / n,
        within=inside / (n - 2),
    )


@lru_cache(maxsize=8)
def ratio_limit(frames: int) -> float:
    """Return the ratio that pixels with normal noise exceed with probability `BLINKING_P_VALUE`.

    The ratio does not depend on the mean and variance of the values, so one sample of normal numbers gives its
    distribution. For normal noise the ratio is independent of the measured variance (Basu), so the limit also holds for
    pixels selected by a large variance. The tail is exponential in the logarithm of the ratio. It is fitted beyond the
    99 % point of 60 000 draws with a fixed seed.
    """
    rng = np.random.default_rng(1288)
    chunks = [two_levels(rng.standard_normal((_DRAWS // 10, frames))).ratio for _ in range(10)]
    logs = np.sort(np.log(np.concatenate(chunks)))
    start = logs[-_DRAWS // 100]
    decay = float(np.mean(logs[logs > start] - start))
    return float(np.exp(start + decay * np.log(0.01 / BLINKING_P_VALUE)))


def find_blinking(series: NDArray[np.floating], seed: int = 0) -> tuple[NDArray[np.bool_], TwoLevels]:
    """Find pixels whose values have two levels that normal noise of any variance would not show.

    Nearly all pixels are found that spend 30 to 70 % of the time in either level, if the levels are 12 times the noise
    apart in 16 frames, 7 times in 40 frames, or 5 times in 150 frames.

    Parameters
    ----------
    series
        (pixels, frames) values in DN, at least `LEAST_FRAMES` frames. Frames beyond `MOST_FRAMES` are ignored.
    seed
        Seed of the dither of up to 0.5 DN, which prevents rounding from forming levels.

    Returns
    -------
    found, levels
        (pixels,) True for blinking pixels; the levels of the values without dither.
    """
    series = series[:, :MOST_FRAMES]
    rng = np.random.default_rng(seed)
    spread_out = two_levels(series + rng.uniform(-0.5, 0.5, series.shape))
    enough = series.var(axis=1, ddof=1) >= LEAST_VARIANCE_DN2
    found = enough & (spread_out.ratio > ratio_limit(series.shape[1])) & (spread_out.distance >= LEAST_DISTANCE)
    return found, two_levels(series)
