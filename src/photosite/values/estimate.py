"""An estimated parameter: its value with uncertainty and method, or the reason why it is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from photosite.errors import CalibrationError
from photosite.values.standard_deviation import standard_deviation, standard_deviation_interval_95, upper_limit_95
from photosite.values.uncertain import COVERAGE_95, Measured, Missing, Source, Uncertain, Value

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Estimate:
    """One estimated parameter, or the reason why it is missing.

    Parameters
    ----------
    value, standard_uncertainty
        In the unit given by the parameter's name; None where the parameter could not be estimated.
    reason
        Why there is no value.
    upper_limit_95
        95 % upper limit, given where the variance behind the value is not distinguishable from zero. A negative
        variance difference is kept: the value is then -sqrt(-variance).
    method
        How the parameter was estimated, with the clause of the standard where there is one.
    interval_95
        95 % interval; by default that of a normal distribution. It is asymmetric for few rows or frames.
    parts
        Change of the value per standard uncertainty of each independent source. Estimates may share sources.

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

    def __post_init__(self) -> None:
        if self.interval_95 is None and self.value is not None and self.standard_uncertainty is not None:
            half = COVERAGE_95 * self.standard_uncertainty
            object.__setattr__(self, "interval_95", (self.value - half, self.value + half))

    @classmethod
    def of(
        cls, value: Value, method: str, upper_limit_95: float | None = None, interval_95: Interval | None = None
    ) -> Estimate:
        """Return the estimate of a propagated or missing value."""
        if isinstance(value, Missing):
            return cls(reason=value.reason, method=method)
        interval_95 = interval_95 or value.interval_95
        return cls(value.value, value.standard_uncertainty, None, upper_limit_95, method, interval_95, value.parts)

    @classmethod
    def of_variance(cls, variance: Uncertain, method: str) -> Estimate:
        """Return the estimate of the standard deviation of an estimated variance."""
        interval = standard_deviation_interval_95(variance)
        return cls.of(standard_deviation(variance), method, upper_limit_95(variance), interval)

    @property
    def uncertain(self) -> Value:
        """The value with its sources, for further propagation."""
        return Missing(self.reason or "") if self.value is None else Uncertain(self.value, dict(self.parts))

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
        """Return `value`, `standard_uncertainty`, and of the other fields those that are set."""
        entry: dict[str, Any] = {"value": self.value, "standard_uncertainty": self.standard_uncertainty}
        for name in ("interval_95", "reason", "upper_limit_95", "method"):
            if getattr(self, name):
                entry[name] = getattr(self, name)
        return entry
