"""Each pixel's own temporal variance, from few frames: what the others tell of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_SAMPLE = 200_000
"""Pixels whose quartiles are taken: those are then known to 0.3 %."""

_OWN = 1e-6
"""A variance that the spread of the others explains with less than this probability stands for itself."""


@dataclass(frozen=True)
class NoiseSpread:
    """How the true temporal variances of a channel's pixels are spread: scaled inverse chi-square.

    Parameters
    ----------
    variance
        Their scale, DN^2.
    freedom
        Degrees of freedom: infinite where all pixels have one variance, 0 where the others tell nothing of a pixel.
    """

    variance: float
    freedom: float

    def limit(self, probability: float, measured_freedom: int) -> float:
        """The variance that an ordinary pixel's, measured with so many degrees of freedom, exceeds so rarely."""
        from scipy.stats import chi2, f

        if math.isinf(self.freedom):
            return float(self.variance * chi2.isf(probability, measured_freedom) / measured_freedom)
        return float(self.variance * f.isf(probability, measured_freedom, max(self.freedom, 0.01)))


def noise_spread(variances: NDArray[np.floating], freedom: int) -> NoiseSpread:
    """The spread of the true variances behind measured ones, from the quartiles of the latter.

    A measured variance over its pixel's true one is chi-square; with true ones that are scaled inverse chi-square, the
    measured ones follow Fisher's F (Smyth, Stat. Appl. Genet. Mol. Biol. 3 (2004) 3). The interquartile range of their
    logarithm gives its second degrees of freedom, their median the scale, so that few outliers do not matter.

    Parameters
    ----------
    variances
        Unbiased temporal variances of a channel's pixels.
    freedom
        Frames less one.

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
        # So little noise that most frames read alike: quartiles are those of rounding.
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
    """Each pixel's variance as best known from its own few frames and from the other pixels.

    The mean of what the true variance may be, given the pixel's own and the spread of all: d0 and d degrees of freedom
    give (d0 s0^2 + d s^2) / (d0 + d - 2). Pixels that are not like the others keep their own.

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
        total -= 2.0 if total > 4.0 else 0.0  # with so few, the mean has no meaning, and the mode-like value stands
        best = variances * np.float32(freedom / total) + np.float32(spread.freedom / total * spread.variance)
    return np.where(variances > np.float32(spread.limit(_OWN, freedom)), variances, best)
