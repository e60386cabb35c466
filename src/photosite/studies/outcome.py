"""Estimates of virtual sensors compared with the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from photosite.values.estimate import Estimate

_ROUNDING = 1e-9
"""Relative tolerance for exact values, such as the full scale of an ideal converter."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Estimate of one parameter of one virtual sensor, compared with the truth.

    `error` is estimate minus truth, `scale` the size of the truth, 1 for a truth of 0: error and uncertainty are
    divided by it when sensors are combined. `covered` is whether the 95 % interval contains the truth.
    """

    error: float
    standard_uncertainty: float
    scale: float
    covered: bool

    @classmethod
    def of(
        cls, value: float, standard_uncertainty: float, interval_95: tuple[float, float], truth: float, scale: float = 0
    ) -> Outcome:
        """Return the outcome of an estimate; `scale` is the size of the truth by default.

        Examples
        --------
        >>> Outcome.of(2.5, 0.2, (2.1, 2.9), truth=2.0)
        Outcome(error=0.5, standard_uncertainty=0.2, scale=2.0, covered=False)
        """
        slack = _ROUNDING * abs(truth)
        covered = interval_95[0] - slack <= truth <= interval_95[1] + slack
        return cls(value - truth, standard_uncertainty, scale or abs(truth) or 1.0, covered)


Outcomes = dict[str, Outcome | str]
"""By name, the outcome, or the reason for a missing estimate."""


def compare_estimate(entry: Estimate, truth: float) -> Outcome | str:
    """Compare an estimate with the truth; return the reason where it has no value."""
    if entry.value is None or entry.standard_uncertainty is None or entry.interval_95 is None:
        return entry.reason or ""
    return Outcome.of(entry.value, entry.standard_uncertainty, entry.interval_95, truth)


def compare_estimates(estimates: Mapping[str, Estimate], truth: Mapping[str, float]) -> Outcomes:
    """Compare each estimate with its truth; those without a true value are left out."""
    return {name: compare_estimate(entry, truth[name]) for name, entry in estimates.items() if name in truth}
