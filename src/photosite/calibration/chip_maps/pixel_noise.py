"""Temporal variance of single pixels from few frames, moderated by the variances of all pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_SAMPLE = 200_000
"""Pixels sampled for the quartiles, which are then known to 0.3 %."""

_OWN = 1e-6
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
    return np.where(variances > np.float32(spread.limit(_OWN, freedom)), variances, best)
