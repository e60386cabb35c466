"""Numbers that know where their uncertainty comes from.

First-order propagation after the GUM (JCGM 100:2008, 5.1 and 5.2): a result keeps its sensitivity to every
independent source, so that what two results share, a system gain say, is counted once in their ratio.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from photosite.measured import COVERAGE_95

_sources = itertools.count()


@dataclass(frozen=True)
class Uncertain:
    """A value and, per independent source, the change that one standard uncertainty of the source makes in it.

    Examples
    --------
    >>> gain = Uncertain.of(0.28, 0.01)
    >>> response = Uncertain.of(0.126, 0.0)
    >>> efficiency = response / gain
    >>> round(efficiency.relative, 4), (efficiency * gain).standard_uncertainty < 1e-15
    (0.0357, True)
    """

    value: float
    parts: dict[int, float] = field(default_factory=dict)

    @classmethod
    def of(cls, value: float, standard_uncertainty: float = 0.0) -> Uncertain:
        """A new, independent input; exact where the uncertainty is 0."""
        if standard_uncertainty == 0.0:
            return cls(value)
        return cls(value, {next(_sources): standard_uncertainty})

    @property
    def standard_uncertainty(self) -> float:
        """Root of the summed squares of the parts."""
        return math.hypot(*self.parts.values())

    @property
    def relative(self) -> float:
        """Standard uncertainty as a fraction of the value's size."""
        return self.standard_uncertainty / abs(self.value)

    def _with(self, value: float, slope: float, other: Uncertain | None = None, slope2: float = 0.0) -> Uncertain:
        parts = {source: slope * part for source, part in self.parts.items()}
        if other is not None:
            for source, part in other.parts.items():
                parts[source] = parts.get(source, 0.0) + slope2 * part
        return Uncertain(value, parts)

    def __add__(self, other: Uncertain | float) -> Uncertain:
        b = _lift(other)
        return self._with(self.value + b.value, 1.0, b, 1.0)

    def __sub__(self, other: Uncertain | float) -> Uncertain:
        b = _lift(other)
        return self._with(self.value - b.value, 1.0, b, -1.0)

    def __mul__(self, other: Uncertain | float) -> Uncertain:
        b = _lift(other)
        return self._with(self.value * b.value, b.value, b, self.value)

    def __truediv__(self, other: Uncertain | float) -> Uncertain:
        b = _lift(other)
        return self._with(self.value / b.value, 1.0 / b.value, b, -self.value / b.value**2)

    __radd__ = __add__
    __rmul__ = __mul__

    def __rtruediv__(self, other: float) -> Uncertain:
        return _lift(other) / self

    def apply(self, function: Callable[[float], float], derivative: Callable[[float], float]) -> Uncertain:
        """A function of the value, given with its derivative."""
        return self._with(function(self.value), derivative(self.value))

    def sqrt(self) -> Uncertain:
        """Square root of a positive value."""
        return self.apply(math.sqrt, lambda x: 0.5 / math.sqrt(x))

    def decibel(self, factor: float) -> Uncertain:
        """`factor` times the decimal logarithm."""
        return self.apply(lambda x: factor * math.log10(x), lambda x: factor / (math.log(10.0) * x))


def _lift(number: Uncertain | float) -> Uncertain:
    return number if isinstance(number, Uncertain) else Uncertain(float(number))


def correlated(values: NDArray[np.float64], covariance: NDArray[np.float64]) -> tuple[Uncertain, ...]:
    """Inputs that share a covariance matrix, such as the intercept and slope of a fitted line.

    Examples
    --------
    >>> a, b = correlated(np.array([1.0, 2.0]), np.array([[1.0, -1.0], [-1.0, 1.0]]))
    >>> round((a + b).standard_uncertainty, 12)
    0.0
    """
    scales, vectors = np.linalg.eigh(covariance)
    keys = [next(_sources) for _ in scales]
    loads = vectors * np.sqrt(np.clip(scales, 0.0, None))  # rounding alone makes an eigenvalue negative
    return tuple(
        Uncertain(float(value), {key: float(load) for key, load in zip(keys, row, strict=True)})
        for value, row in zip(values, loads, strict=True)
    )


def weighted_mean(values: Sequence[Uncertain], weights: Sequence[float]) -> Uncertain:
    """Mean with given weights, what the values share kept.

    Examples
    --------
    >>> weighted_mean([Uncertain.of(1.0), Uncertain.of(4.0)], [2, 1]).value
    2.0
    """
    total = sum(weights)
    result = Uncertain(0.0)
    for value, weight in zip(values, weights, strict=True):
        result = result + value * (weight / total)
    return result


def signed_root(x: float) -> float:
    """sign(x) sqrt(|x|): a spread whose variance came out negative keeps its sign and its size."""
    return math.copysign(math.sqrt(abs(x)), x)


def spread(variance: Uncertain) -> Uncertain:
    """The standard deviation of an estimated variance, signed where that came out negative.

    First order, u(s) = u(v) / (2 s), breaks down where the variance is not far from zero. The uncertainty here is
    the larger distance from s to the roots of the ends of the variance's 95 % interval, over 1.96: it becomes
    the first-order one for a variance far from zero and stays finite at zero, where the interval still covers.

    Examples
    --------
    >>> s = spread(Uncertain.of(4.0, 0.04))
    >>> s.value, round(s.standard_uncertainty, 4)
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
    return Uncertain(s, {source: slope * part for source, part in variance.parts.items()})


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


@dataclass(frozen=True)
class Missing:
    """What could not be estimated, and why."""

    reason: str


Value = Uncertain | Missing


def derive(function: Callable[..., Uncertain], *inputs: Value) -> Value:
    """`function(*inputs)`, or the first input that is missing.

    Examples
    --------
    >>> derive(lambda a, b: a / b, Uncertain.of(1.0), Missing("no volts")).reason
    'no volts'
    """
    for entry in inputs:
        if isinstance(entry, Missing):
            return entry
    return function(*inputs)
