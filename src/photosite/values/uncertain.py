"""Values with uncertainty: as in a sensor file, and propagated to first order.

Propagation follows the GUM (JCGM 100:2008, 5.1 and 5.2). A result keeps its sensitivity to each independent source, so
that an uncertainty shared by two results, such as that of a system gain, is counted once in their ratio.

Each source has the half-widths of its 95 % interval to either side. A result's half-width to a side is the root
of the summed squares of those (Graybill and Wang, J. Am. Stat. Assoc. 75 (1980) 869; for differences Ting et al., J.
Stat. Comput. Simul. 35 (1990) 135). It is exact for one source, such as a mean square over few rows with its asymmetric
chi-square interval, and the usual one where all sources are normal. The sum of many sources is nearly normal, but the
sum of squared half-widths below the normal one stays below it. Therefore the missing part of such a half-width counts
less the larger the source's share of the whole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError, did_you_mean
from photosite.values.shown import Shown

COVERAGE_95 = 1.959963984540054
"""Half-width of a 95 % interval in standard uncertainties (normal distribution)."""

SIGMA_1_IN_1000, SIGMA_1_IN_10_000 = 3.29, 3.89
"""Distances in standard uncertainties, to either side, that a normal distribution exceeds in 1 of 1000 and 10 000."""

NORMAL_MAD = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution."""


@dataclass(frozen=True, eq=False, slots=True)
class Source:
    """An independent source of uncertainty; two sources are equal only if they are the same object.

    - `below`, `above`: Distance of the ends of the 95 % interval below and above the value, in standard uncertainties.
    """

    below: float = COVERAGE_95
    above: float = COVERAGE_95

    @classmethod
    def student(cls, freedom: float) -> Source:
        """Return the source of a mean or fitted parameter whose uncertainty has a number of degrees of freedom.

        Examples
        --------
        >>> round(Source.student(3.0).above, 3)
        3.182
        """
        from scipy.special import stdtrit

        reach = float(stdtrit(freedom, 0.975))
        return cls(reach, reach)

    @classmethod
    def mean_square(cls, freedom: float) -> Source:
        """Return the source of a variance with a number of degrees of freedom, with a chi-square interval.

        Examples
        --------
        >>> source = Source.mean_square(7.0)  # of 8 frames
        >>> round(source.below, 2), round(source.above, 2)
        (1.05, 5.88)
        """
        from scipy.special import chdtri

        # In standard uncertainties, the value times sqrt(2 / freedom).
        scale = math.sqrt(0.5 * freedom)
        low, high = freedom / float(chdtri(freedom, 0.025)), freedom / float(chdtri(freedom, 0.975))
        return cls((1.0 - low) * scale, (high - 1.0) * scale)

    def scaled(self, factor: float) -> Source:
        """Return a source with half-widths multiplied by a factor."""
        return Source(factor * self.below, factor * self.above)


@dataclass(frozen=True)
class Uncertain(Shown):
    """A value and, per independent source, its change per standard uncertainty of the source.

    Examples
    --------
    >>> gain = Uncertain.of(0.28, 0.01)
    >>> response = Uncertain.of(0.126, 0.0)
    >>> efficiency = response / gain
    >>> round(efficiency.relative, 4), (efficiency * gain).standard_uncertainty < 1e-15
    (0.0357, True)
    """

    value: float
    parts: dict[Source, float] = field(default_factory=dict)

    @classmethod
    def of(cls, value: float, standard_uncertainty: float = 0.0, source: Source | None = None) -> Uncertain:
        """Return a new, independent input; exact where the uncertainty is 0. The default source is normal."""
        if standard_uncertainty == 0.0:
            return cls(value)
        return cls(value, {source or Source(): standard_uncertainty})

    @classmethod
    def of_variance(cls, value: float, standard_uncertainty: float = 0.0) -> Uncertain:
        """Return a new, independent mean square with 2 (value / uncertainty)^2 degrees of freedom (Satterthwaite).

        Examples
        --------
        >>> low, high = Uncertain.of_variance(4.0, 4.0 * math.sqrt(2 / 7)).interval_95
        >>> round(low, 2), round(high, 2)
        (1.75, 16.57)
        """
        if standard_uncertainty == 0.0 or value <= 0.0:
            return cls.of(value, standard_uncertainty)
        return cls.of(value, standard_uncertainty, Source.mean_square(2.0 * (value / standard_uncertainty) ** 2))

    @property
    def standard_uncertainty(self) -> float:
        """Root of the summed squares of the parts."""
        return math.hypot(*self.parts.values())

    @property
    def interval_95(self) -> tuple[float, float]:
        """The 95 % interval, lower and upper end."""
        below, above = self._reach(-1.0), self._reach(1.0)
        return self.value - below, self.value + above

    def _reach(self, side: float) -> float:
        """Return the half-width of the 95 % interval: above the value for side 1, below it for -1."""
        whole = self.standard_uncertainty
        if whole == 0.0:
            return 0.0
        squares = 0.0
        for source, part in self.parts.items():
            reach = source.above if part * side > 0.0 else source.below
            short = max(COVERAGE_95 - reach, 0.0)
            squares += (part * (reach + short * (1.0 - abs(part) / whole))) ** 2
        return math.sqrt(squares)

    def covariance(self, other: Uncertain) -> float:
        """Return the covariance with another result, from the sources that they share.

        Examples
        --------
        >>> gain = Uncertain.of(2.0, 0.1)
        >>> round((3.0 * gain).covariance(1.0 / gain), 6)
        -0.0075
        """
        return math.fsum(part * other.parts[source] for source, part in self.parts.items() if source in other.parts)

    @property
    def relative(self) -> float:
        """Standard uncertainty over the absolute value."""
        return self.standard_uncertainty / abs(self.value)

    def beyond(self, times: float) -> bool:
        """Return whether the value is farther from zero than a number of standard uncertainties."""
        return abs(self.value) > times * self.standard_uncertainty

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
        """Return a function of the value, given with its derivative."""
        return self._with(function(self.value), derivative(self.value))

    def sqrt(self) -> Uncertain:
        """Return the square root of a positive value."""
        return self.apply(math.sqrt, lambda x: 0.5 / math.sqrt(x))

    def decibel(self, factor: float) -> Uncertain:
        """Return `factor` times the decimal logarithm."""
        return self.apply(lambda x: factor * math.log10(x), lambda x: factor / (math.log(10.0) * x))


def _lift(number: Uncertain | float) -> Uncertain:
    return number if isinstance(number, Uncertain) else Uncertain(float(number))


def correlated(
    values: NDArray[np.float64], covariance: NDArray[np.float64], freedom: float = math.inf
) -> tuple[Uncertain, ...]:
    """Return inputs with a covariance matrix, such as the intercept and slope of a fitted line.

    - `values`, `covariance`, `freedom`: (p,) values, their (p, p) covariance, and its degrees of freedom.

    Examples
    --------
    >>> a, b = correlated(np.array([1.0, 2.0]), np.array([[1.0, -1.0], [-1.0, 1.0]]))
    >>> round((a + b).standard_uncertainty, 12)
    0.0
    """
    scales, vectors = np.linalg.eigh(covariance)
    keys = [Source.student(freedom) if math.isfinite(freedom) else Source() for _ in scales]
    loads = vectors * np.sqrt(np.clip(scales, 0.0, None))  # negative only by rounding
    return tuple(
        Uncertain(float(value), {key: float(load) for key, load in zip(keys, row, strict=True)})
        for value, row in zip(values, loads, strict=True)
    )


def weighted_mean(values: Sequence[Uncertain], weights: Sequence[float]) -> Uncertain:
    """Return the weighted mean, correlations included.

    Examples
    --------
    >>> weighted_mean([Uncertain.of(1.0), Uncertain.of(4.0)], [2, 1]).value
    2.0
    """
    total = sum(weights)
    return combined(values, [weight / total for weight in weights])


def combined(values: Sequence[Uncertain], coefficients: Sequence[float] | NDArray[np.float64]) -> Uncertain:
    """Return a linear combination, correlations included."""
    products = (value * float(part) for value, part in zip(values, coefficients, strict=True))
    return sum(products, Uncertain(0.0))


@dataclass(frozen=True, eq=False)
class JointCovariance(Shown):
    """The covariance of several results.

    - `names`, `matrix`: (n,) names of the results, and (n, n) covariance in their units.

    Examples
    --------
    >>> a, b = Uncertain.of(1.0, 0.5), Uncertain.of(2.0, 0.1)
    >>> joint = JointCovariance.of({"a": a, "b": b, "sum": a + b})
    >>> joint.among(["a", "sum"]).round(4).tolist()
    [[0.25, 0.25], [0.25, 0.26]]
    """

    names: tuple[str, ...]
    matrix: NDArray[np.float64]

    @classmethod
    def of(cls, values: Mapping[str, Uncertain]) -> JointCovariance:
        """Return the covariance of results that may share sources."""
        n = len(values)
        matrix = np.array([[a.covariance(b) for b in values.values()] for a in values.values()])
        return cls(tuple(values), matrix.reshape(n, n))

    def among(self, names: Sequence[str]) -> NDArray[np.float64]:
        """Return the (names, names) covariance of some results.

        Raises `InputError` if a name is unknown.
        """
        if unknown := [name for name in names if name not in self.names]:
            hint = did_you_mean(unknown[0], self.names)
            raise InputError("names", value=unknown[0], expected="names of results with a value", hint=hint)
        place = [self.names.index(name) for name in names]
        return self.matrix[np.ix_(place, place)]


@dataclass(frozen=True)
class Missing(Shown):
    """A result that could not be obtained, with the reason, and its kind in the registry of diagnostics."""

    reason: str
    id: str = ""

    def to_dict(self) -> dict[str, str]:
        """Return `reason`."""
        return {"reason": self.reason}


Value = Uncertain | Missing


def derive(function: Callable[..., Uncertain], *inputs: Value) -> Value:
    """Return `function(*inputs)`, or the first input that is missing.

    Examples
    --------
    >>> derive(lambda a, b: a / b, Uncertain.of(1.0), Missing("no volts")).reason
    'no volts'
    """
    missing = [entry for entry in inputs if isinstance(entry, Missing)]
    return missing[0] if missing else function(*inputs)


@dataclass(frozen=True, slots=True)
class Measured(Shown):
    """A value with its standard uncertainty and source.

    Parameters
    ----------
    value, standard_uncertainty
        In the unit at the end of the field's name; the standard uncertainty (GUM) of an exact value is 0.
    source, assumed
        Origin of the value; whether it is an assumption, neither measured nor published.

    Raises
    ------
    InputError
        If the value is not finite, or the uncertainty is negative or not finite.

    Examples
    --------
    >>> read_noise_mv = Measured(0.52, 0.004, source="150 dark frames")
    >>> float(read_noise_mv), [round(x, 4) for x in read_noise_mv.interval_95]
    (0.52, [0.5122, 0.5278])
    """

    value: float
    standard_uncertainty: float = 0.0
    source: str | None = None
    assumed: bool = False

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise InputError("value", value=self.value, expected="a finite number")
        if not (math.isfinite(self.standard_uncertainty) and self.standard_uncertainty >= 0):
            expected = "a finite number, 0 or above"
            raise InputError("standard_uncertainty", value=self.standard_uncertainty, expected=expected)

    def __float__(self) -> float:
        return self.value

    @property
    def interval_95(self) -> tuple[float, float]:
        """Lower and upper end of the 95 % interval."""
        half = COVERAGE_95 * self.standard_uncertainty
        return self.value - half, self.value + half
