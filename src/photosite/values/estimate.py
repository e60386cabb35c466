"""An estimated parameter: its value, standard deviation and method, or the reason why it is missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any

from photosite.errors import CalibrationError
from photosite.values.shown import Shown
from photosite.values.uncertain import COVERAGE_95, Measured, Missing, Source, Uncertain, Value

_normal_quantile = NormalDist().inv_cdf


def signed_root(x: float) -> float:
    """Return sign(x) sqrt(|x|), so that a negative variance estimate keeps its sign and size."""
    return math.copysign(math.sqrt(abs(x)), x)


def signed_square(x: float) -> float:
    """Return x |x|, the inverse of `signed_root`."""
    return x * abs(x)


NOISY = 25.0
"""Ratio of a variance to its uncertainty below which the bias of the root is corrected."""


def standard_deviation(variance: Uncertain) -> Uncertain:
    """Return the standard deviation of an estimated variance; negative if the estimate is negative.

    First-order propagation, u(s) = u(v) / (2 s), fails for a variance near zero. The uncertainty here is the larger
    distance from s to the roots of the ends of the variance's 95 % interval, divided by 1.96. It equals the first-order
    value for a variance far from zero, stays finite at zero, and the interval keeps its coverage.

    The root of a noisy variance is too small on average, by the relative amount 1 / (8 r^2) for a variance of r
    uncertainties. The factor 1 + 1 / (8 r^2 + 4) corrects this and stays finite at zero. From r = 1.5 on the remaining
    bias is below a tenth of the uncertainty. Variances above r = 25, where the bias is below a hundredth, and negative
    ones are not corrected.

    Examples
    --------
    >>> s = standard_deviation(Uncertain.of(4.0, 0.04))
    >>> round(s.value, 4), round(s.standard_uncertainty, 4)
    (2.0, 0.01)
    >>> standard_deviation(Uncertain.of(-0.25, 0.5)).value
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


def standard_deviation_interval_95(variance: Uncertain) -> tuple[float, float]:
    """Return the 95 % interval of `standard_deviation`, from 0 on: the roots of the ends of one of the variance.

    A symmetric interval would lie below zero for one in 40 sensors without any spread. Where the estimate is negative,
    this interval therefore reaches up to `upper_limit_95`, and misses a small true variance from above in fewer than
    2.5 % of cases. The lower end is raised to compensate: a true variance of 0 is excluded in 5 %. The coverage is 95 %
    for every true variance. Far from zero the interval is that of the variance. A variance so far below zero that no
    true one explains it has the interval from 0 to 0.

    References
    ----------
    Feldman and Cousins, Phys. Rev. D 57 (1998) 3873, derive intervals from limits in this way, with another upper end.

    Examples
    --------
    >>> low, high = standard_deviation_interval_95(Uncertain.of_variance(4.0, 4.0 * math.sqrt(2 / 7)))
    >>> round(low, 2), round(high, 2)
    (1.32, 4.07)
    >>> low, high = standard_deviation_interval_95(Uncertain.of(1.645, 1.0))  # the largest with an `upper_limit_95`
    >>> round(low, 1), round(high, 1)
    (0.0, 1.9)
    """
    low, high = (math.sqrt(max(end, 0.0)) for end in _positive_interval(variance.value, *variance.interval_95))
    limit = upper_limit_95(variance) if variance.value < 0.0 else None
    return low, high if limit is None else max(high, limit)


def _positive_interval(value: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval of a variance that cannot be negative, from the interval with 2.5 % on either side.

    The logarithm of the estimate plus a constant is taken as normal, with the interval's own ratio of its sides. This
    is close for a mean square, and exact for a symmetric interval.
    """
    below, above = value - low, high - value
    if min(below, above) <= 0.0:
        return low, high
    sigma = math.log(above / below) / COVERAGE_95 or 1e-12
    size = -below / math.expm1(-COVERAGE_95 * sigma)
    if value / size >= 1.0:
        return low, high  # noise cannot be so large
    x = -math.log1p(-value / size) / sigma
    if x >= 2.0 * COVERAGE_95:
        return low, high
    lower = (size - value) * math.expm1(sigma * _lower_end(x))
    return lower, (size - value) * math.expm1(sigma * _upper_end(x)) if x < 0.0 else high


def _upper_end(x: float) -> float:
    """Return the upper limit of the mean, 0 or more, given a normal estimate x < 0 of standard deviation 1.

    The limit satisfies P(mean > limit | mean > 0) = 0.05.
    """
    tail = 0.05 * 0.5 * math.erfc(-x / math.sqrt(2.0))
    return x - _normal_quantile(tail) if tail > 0.0 else 0.0


def _lower_end(x: float) -> float:
    """Return the lower end for x < 3.92 that completes `_upper_end` (x + 1.96 from 0 on) to 95 % coverage."""
    # A mean t is the upper end of an estimate -y. Estimates below -y use up P(< -y); 0.05 P(> -y) remain above t + z.
    first, last = 0.0, 37.0
    for _ in range(50):
        y = 0.5 * (first + last)
        tail = 0.5 * math.erfc(y / math.sqrt(2.0))
        z = -_normal_quantile(0.05 * (1.0 - tail))
        first, last = (y, last) if _upper_end(-y) + z > x else (first, y)
    return x - z


def upper_limit_95(variance: Uncertain) -> float | None:
    """Return the 95 % upper limit of a standard deviation whose variance is not distinguishable from zero, else None.

    The limit is that of a normal variance estimate, given that the true variance is not negative. The result is also
    None if the estimate lies so far below zero (37 uncertainties) that no true variance explains it.

    Examples
    --------
    >>> round(upper_limit_95(Uncertain.of(0.0, 1.0)), 3)
    1.4
    >>> upper_limit_95(Uncertain.of(9.0, 1.0)) is None
    True
    """
    u = variance.standard_uncertainty
    if u == 0.0 or variance.value > _normal_quantile(0.95) * u:
        return None
    # P(true > limit | true > 0) = 0.05, written with erfc, which stays accurate far below zero.
    tail = 0.05 * 0.5 * math.erfc(-variance.value / (u * math.sqrt(2.0)))
    if tail == 0.0:
        return None
    return signed_root(variance.value - u * _normal_quantile(tail))


Interval = tuple[float, float]

BEYOND_CHANCE = 6.0
"""Value of a spread over its standard uncertainty from which it counts as found: a variance of 3.6 uncertainties."""


@dataclass(frozen=True, slots=True)
class Estimate(Shown):
    """One estimated parameter, or the reason why it is missing.

    Parameters
    ----------
    value, standard_uncertainty
        In the unit given by the parameter's name; None where the parameter could not be estimated.
    reason
        Why there is no value.
    upper_limit_95
        Upper end of the interval, given where the variance behind the value is not distinguishable from zero; the
        interval then begins at 0. The value is kept for averages over measurements: it is -sqrt(-variance) for a
        negative variance difference.
    method
        How the parameter was estimated, with the clause of the standard where there is one.
    interval_95
        95 % interval; by default that of a normal distribution. It is asymmetric for few rows or frames.
    parts
        Change of the value per standard uncertainty of each independent source. Estimates may share sources.
    reason_id
        Kind of the reason in the registry of diagnostics.

    Examples
    --------
    >>> Estimate(2.0, 0.1).interval_95
    (1.804..., 2.195...)
    """

    value: float | None = None
    standard_uncertainty: float | None = None
    reason: str | None = None
    upper_limit_95: float | None = None
    method: str = ""
    interval_95: Interval | None = None
    parts: Mapping[Source, float] = field(default_factory=dict, repr=False, compare=False)
    reason_id: str = field(default="", repr=False)

    def __post_init__(self) -> None:
        if self.upper_limit_95 is not None and self.value is not None:
            object.__setattr__(self, "interval_95", (0.0, self.upper_limit_95))
        elif self.interval_95 is None and self.value is not None and self.standard_uncertainty is not None:
            half = COVERAGE_95 * self.standard_uncertainty
            object.__setattr__(self, "interval_95", (self.value - half, self.value + half))

    @classmethod
    def of(
        cls, value: Value, method: str, upper_limit_95: float | None = None, interval_95: Interval | None = None
    ) -> Estimate:
        """Return the estimate of a propagated or missing value."""
        if isinstance(value, Missing):
            return cls(reason=value.reason, method=method, reason_id=value.id)
        interval_95 = interval_95 or value.interval_95
        return cls(value.value, value.standard_uncertainty, None, upper_limit_95, method, interval_95, value.parts)

    @classmethod
    def of_variance(cls, variance: Uncertain, method: str, scale: Uncertain | None = None) -> Estimate:
        """Return the estimate of the standard deviation of an estimated variance, multiplied by a scale.

        Examples
        --------
        >>> found = Estimate.of_variance(Uncertain.of(-0.25, 0.5), "")
        >>> found.value, found.interval_95[0], found.upper_limit_95 == found.interval_95[1]
        (-0.5, 0.0, True)
        """
        scale = Uncertain(1.0) if scale is None else scale
        interval = standard_deviation_interval_95(variance * scale * scale)
        limit = None if upper_limit_95(variance) is None else interval[1]
        return cls.of(standard_deviation(variance) * scale, method, limit, interval)

    @property
    def uncertain(self) -> Value:
        """The value with its sources, for further propagation."""
        if self.value is None:
            return Missing(self.reason or "", self.reason_id)
        return Uncertain(self.value, dict(self.parts))

    @property
    def shown_value(self) -> float | None:
        """The value for tables and files: 0 for the root of a negative variance.

        Examples
        --------
        >>> Estimate(-0.12, 0.05, upper_limit_95=0.16).shown_value, Estimate(-0.12, 0.05).shown_value
        (0.0, -0.12)
        """
        below = self.value is not None and self.value < 0.0 and self.interval_95 is not None
        return 0.0 if below and self.interval_95 and self.interval_95[0] == 0.0 else self.value

    @property
    def beyond_chance(self) -> bool:
        """Whether a standard deviation is found beyond chance: fewer than 1 in 500 without a spread are.

        Examples
        --------
        >>> [Estimate.of_variance(Uncertain.of(one, 1.0), "").beyond_chance for one in (2.0, 4.0)]
        [False, True]
        """
        return self.value is not None and self.value > BEYOND_CHANCE * (self.standard_uncertainty or 0.0)

    def measured(self, source: str) -> Measured:
        """Return the estimate in the form of a sensor file.

        Raises
        ------
        CalibrationError
            If the value is missing.
        """
        if self.value is None or self.standard_uncertainty is None:
            raise CalibrationError(f"the value is missing: {self.reason}")
        return Measured(self.value, self.standard_uncertainty, source)

    def to_dict(self) -> dict[str, Any]:
        """Return `value`, `standard_uncertainty`, and of the other fields those that are set.

        A standard deviation of a negative variance has the value 0, and the signed root as `signed_value`.
        """
        entry: dict[str, Any] = {"value": self.shown_value, "standard_uncertainty": self.standard_uncertainty}
        if self.shown_value != self.value:
            entry["signed_value"] = self.value
        for name in ("interval_95", "reason", "upper_limit_95", "method"):
            if getattr(self, name):
                entry[name] = getattr(self, name)
        return entry
