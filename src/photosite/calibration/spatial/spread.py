"""Standard deviations of estimated variances, which may come out negative: value, 95 % interval and upper limit."""

from __future__ import annotations

import math
from statistics import NormalDist

from photosite.values.measured import COVERAGE_95
from photosite.values.uncertain import Uncertain


def signed_root(x: float) -> float:
    """sign(x) sqrt(|x|): a spread whose variance came out negative keeps its sign and its size."""
    return math.copysign(math.sqrt(abs(x)), x)


NOISY = 25.0
"""Uncertainties of a variance, below which the bias of its root is worth taking off."""


def spread(variance: Uncertain) -> Uncertain:
    """The standard deviation of an estimated variance, signed where that came out negative.

    First order, u(s) = u(v) / (2 s), breaks down where the variance is not far from zero. The uncertainty here is
    the larger distance from s to the roots of the ends of the variance's 95 % interval, over 1.96: it becomes
    the first-order one for a variance far from zero and stays finite at zero, where the interval still covers.

    The root of a noisy variance is too small on average, by the share 1 / (8 r^2) for a variance of r uncertainties;
    1 / (8 r^2 + 4) is put back, which does not run away at zero: from r = 1.5 on the bias left is below a tenth of the
    uncertainty. Beyond r = 25, where it is below a hundredth, and of a negative variance the root is taken as it is.

    Examples
    --------
    >>> s = spread(Uncertain.of(4.0, 0.04))
    >>> round(s.value, 4), round(s.standard_uncertainty, 4)
    (2.0, 0.01)
    >>> spread(Uncertain.of(-0.25, 0.5)).value
    -0.5
    """
    u = variance.standard_uncertainty
    s = signed_root(variance.value)
    if u == 0.0:
        return Uncertain(s)
    below = s - signed_root(variance.value - COVERAGE_95 * u)
    above = signed_root(variance.value + COVERAGE_95 * u) - s
    slope = max(below, above) / (COVERAGE_95 * u)
    if 0.0 < variance.value < NOISY * u:
        s *= 1.0 + 0.125 / ((variance.value / u) ** 2 + 0.5)
    return Uncertain(s, {source: slope * part for source, part in variance.parts.items()})


def spread_interval_95(variance: Uncertain) -> tuple[float, float]:
    """The 95 % interval of `spread`: the signed roots of the ends of an interval of the variance.

    No standard deviation is negative; an interval of 2.5 % on either side would end below zero for a fortieth of the
    sensors that have none. This one reaches up to `upper_limit_95` where the variance came out negative. On that side
    it then misses a small true variance in less than 2.5 %, and is as much shorter on the other: a variance of 0 is
    left out below in 5 %. So 95 % hold the truth, however small it is. (With another upper end, Feldman and Cousins,
    Phys. Rev. D 57 (1998) 3873, go from limits to intervals in this way.) Far from zero it is the variance's own.

    Examples
    --------
    >>> low, high = spread_interval_95(Uncertain.of_variance(4.0, 4.0 * math.sqrt(2 / 7)))
    >>> round(low, 2), round(high, 2)
    (1.32, 4.07)
    >>> low, high = spread_interval_95(Uncertain.of(1.645, 1.0))  # where `upper_limit_95` ends
    >>> round(low, 1), round(high, 1)
    (0.0, 1.9)
    """
    low, high = _positive_interval(variance.value, *variance.interval_95)
    limit = upper_limit_95(variance) if variance.value < 0.0 else None
    return signed_root(low), signed_root(high) if limit is None else max(signed_root(high), limit)


def _positive_interval(value: float, low: float, high: float) -> tuple[float, float]:
    """The interval of a variance that is not negative, from the one of 2.5 % on either side.

    The logarithm of the estimate plus what noise adds to it is taken as normal, with the interval's own ratio of its
    sides: a mean square's interval is close to this, and a symmetric one is this exactly.
    """
    below, above = value - low, high - value
    if min(below, above) <= 0.0:
        return low, high
    sigma = math.log(above / below) / COVERAGE_95 or 1e-12
    size = -below / math.expm1(-COVERAGE_95 * sigma)
    if value / size >= 1.0:
        return low, high  # no noise is so large
    x = -math.log1p(-value / size) / sigma
    if x >= 2.0 * COVERAGE_95:
        return low, high
    lower = (size - value) * math.expm1(sigma * _lower_end(x))
    return lower, (size - value) * math.expm1(sigma * _upper_end(x)) if x < 0.0 else high


def _upper_end(x: float) -> float:
    """Of the mean, 0 or more, of a normal estimate x < 0 of standard deviation 1: P(mean > end | mean > 0) = 0.05."""
    tail = 0.05 * 0.5 * math.erfc(-x / math.sqrt(2.0))
    return x - NormalDist().inv_cdf(tail) if tail > 0.0 else 0.0


def _lower_end(x: float) -> float:
    """Of the same for x < 3.92: with `_upper_end`, or x + 1.96 from 0 on, 95 % hold the mean, whatever it is."""
    # A mean t is the upper end of an estimate -y, below which 0.05 P(< -y) lie: 0.05 P(> -y) are left for above t + z.
    first, last = 0.0, 37.0
    for _ in range(50):
        y = 0.5 * (first + last)
        tail = 0.5 * math.erfc(y / math.sqrt(2.0))
        z = -NormalDist().inv_cdf(0.05 * (1.0 - tail))
        first, last = (y, last) if _upper_end(-y) + z > x else (first, y)
    return x - z


def upper_limit_95(variance: Uncertain) -> float | None:
    """95 % upper limit of a standard deviation whose variance is not distinguishable from zero, else None.

    The limit is that of a normal variance estimate under the knowledge that the true variance is not negative.
    None, too, where the estimate is so far below zero (37 uncertainties) that no true variance explains it.

    Examples
    --------
    >>> round(upper_limit_95(Uncertain.of(0.0, 1.0)), 3)
    1.4
    >>> upper_limit_95(Uncertain.of(9.0, 1.0)) is None
    True
    """
    u = variance.standard_uncertainty
    normal = NormalDist()
    if u == 0.0 or variance.value > normal.inv_cdf(0.95) * u:
        return None
    # P(true > limit | true > 0) = 0.05, written with the small tail (erfc) so that it holds far below zero.
    tail = 0.05 * 0.5 * math.erfc(-variance.value / (u * math.sqrt(2.0)))
    if tail == 0.0:
        return None
    return signed_root(variance.value - u * normal.inv_cdf(tail))
