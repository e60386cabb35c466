"""Image quality of measured and simulated frames of a chart: the table of both, with a verdict on each value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, Literal

from photosite.errors import InputError
from photosite.metrics.measure import ImageQuality
from photosite.metrics.measurement import Measured, Quantity, Result
from photosite.validation.agreement import check_verdict_settings
from photosite.values.estimate import Estimate
from photosite.values.shown import Reported, ResultTable, Shown, Tabular
from photosite.values.uncertain import COVERAGE_95

Verdict = Literal["agrees", "differs", "no interval", "missing"]


@dataclass(frozen=True)
class ComparedValue(Shown):
    """A value of image quality of measured and of simulated frames.

    Parameters
    ----------
    chart
        The chart, or the name of the photograph.
    name
        Measurement, quantity and part: "edge-sfr.mtf50.G".
    quantity
        The quantity.
    measured, simulated
        The estimates.
    standard_uncertainty
        Of their difference, from the sides of the intervals that face each other; None where neither has an interval.
    verdict
        "differs" where the difference is beyond the noise; "no interval" where it is not known whether it is; "missing"
        where the frames of a side do not show the value.
    """

    chart: str
    name: str
    quantity: Quantity
    measured: Estimate
    simulated: Estimate
    standard_uncertainty: float | None
    verdict: Verdict

    @property
    def difference(self) -> float | None:
        """Measured less simulated value; None where one is missing."""
        if self.measured.value is None or self.simulated.value is None:
            return None
        return self.measured.value - self.simulated.value

    @property
    def score(self) -> float | None:
        """The difference over its standard uncertainty; None where either is missing."""
        if self.difference is None or self.standard_uncertainty is None:
            return None
        return self.difference / self.standard_uncertainty

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        return {
            "chart": self.chart,
            "name": self.name,
            "unit": self.quantity.unit,
            "measured": self.measured.to_dict(),
            "simulated": self.simulated.to_dict(),
            "difference": self.difference,
            "standard_uncertainty": self.standard_uncertainty,
            "score": self.score,
            "verdict": self.verdict,
        }


@dataclass(frozen=True, eq=False)
class QualityComparison(Tabular, Reported):
    """Result of `compare_quality`.

    Parameters
    ----------
    values
        Each value of both sides.
    level, tolerance_percent
        False-alarm rate of the whole table, and the relative tolerance.
    notes
        Photographs that are not compared, with the reasons.
    """

    values: tuple[ComparedValue, ...]
    level: float
    tolerance_percent: float
    notes: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether no value differs."""
        return all(each.verdict != "differs" for each in self.values)

    @property
    def count(self) -> Mapping[Verdict, int]:
        """Number of values with each verdict."""
        found: dict[Verdict, int] = {}
        for each in self.values:
            found[each.verdict] = found.get(each.verdict, 0) + 1
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        return {
            "agrees": self.agrees,
            "level": self.level,
            "tolerance_percent": self.tolerance_percent,
            "notes": list(self.notes),
            "values": [each.to_dict() for each in self.values],
        }

    def _table(self) -> ResultTable:
        columns = "value", "measured", "simulated", "difference", "over uncertainty", "unit", "verdict"
        several = len({each.chart for each in self.values}) > 1
        rows = [
            (
                *(each.chart,) * several,
                *(each.name, each.measured.shown_value, each.simulated.shown_value),
                *(each.difference, each.score, each.quantity.unit, each.verdict),
            )
            for each in self.values
        ]
        titles = (*("chart",) * several, *columns)
        return ResultTable("Image quality of measured and simulated frames", titles, rows)


def compare_quality(
    measured: ImageQuality, simulated: ImageQuality, *, level: float = 0.05, tolerance_percent: float = 0.0
) -> QualityComparison:
    """Compare every value of image quality of measured and simulated frames of one chart.

    A value differs if the difference is beyond the tolerance and the quantile of the combined uncertainty. The
    false-alarm rate is shared evenly by the values that have intervals, so that it holds for the whole table.

    Parameters
    ----------
    measured, simulated
        Results of `photosite.measure` for the same chart.
    level
        False-alarm rate of the table, between 0 and 1.
    tolerance_percent
        Tolerance relative to the simulated value, in percent.

    Raises
    ------
    InputError
        If the charts differ, or the level or tolerance is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from photosite.metrics.measure import measure
    >>> y, x = np.mgrid[:128, :128] + 0.5
    >>> edges = (100 + 300 / (1 + np.exp(-(x - 64 + 0.09 * (y - 64)) / blur)) for blur in (0.8, 1.2))
    >>> noise = np.random.default_rng(1)
    >>> sharp, blurred = (measure(noise.poisson(edge), "slanted-edge", only=["edge-sfr"]) for edge in edges)
    >>> compare_quality(sharp, sharp).agrees, compare_quality(sharp, blurred).agrees
    (True, False)
    """
    if measured.chart.name != simulated.chart.name:
        one, other = measured.chart.name, simulated.chart.name
        raise InputError("chart", value=other, expected=f"{one}, as in the measured frames")
    sides = {measured.chart.name: (measured.results, simulated.results)}
    return compare_results(sides, level=level, tolerance_percent=tolerance_percent)


Results = Mapping[str, Measured]


def compare_results(
    charts: Mapping[str, tuple[Results, Results]], *, level: float = 0.05, tolerance_percent: float = 0.0
) -> QualityComparison:
    """Compare measured with simulated results of charts, by the name of the photograph, as `compare_quality` does.

    Raises
    ------
    InputError
        If the level or tolerance is invalid.
    """
    check_verdict_settings(level, tolerance_percent)
    pairs: list[tuple[str, str, Quantity, Estimate, Estimate]] = []
    absent = Estimate(reason="it was not measured")
    for chart, (measured, simulated) in charts.items():
        for id, seen in measured.items():
            made = simulated.get(id)
            values = [found.values if isinstance(found, Result) else {} for found in (seen, made)]
            known = next((found for found in (seen, made) if isinstance(found, Result)), None)
            if known is None:
                continue
            for key in dict.fromkeys((*values[0], *values[1])):
                name = ".".join(filter(None, (id, *key)))
                both = values[0].get(key, absent), values[1].get(key, absent)
                pairs.append((chart, name, known.quantity(key[0]), *both))
    spreads = [_spread(seen, made) for *_, seen, made in pairs]
    quantile = NormalDist().inv_cdf(1.0 - level / max(sum(each is not None for each in spreads), 1) / 2.0)
    compared = [
        ComparedValue(*pair, spread, _verdict(*pair[3:], _reach(pair[4], spread, quantile, tolerance_percent)))
        for pair, spread in zip(pairs, spreads, strict=True)
    ]
    return QualityComparison(tuple(compared), level, tolerance_percent)


def _spread(one: Estimate, other: Estimate) -> float | None:
    """Return the standard uncertainty of the difference of two estimates; None where neither is known."""
    if one.value is None or other.value is None:
        return None
    low, high = sorted((one, other), key=lambda each: each.value or 0.0)
    sides = []
    for each, side in ((low, 1), (high, 0)):
        ends = each.interval_95
        if ends is not None and each.value is not None:
            sides.append(abs(ends[side] - each.value) / COVERAGE_95)
    return math.hypot(*sides) if sides and any(sides) else None


def _reach(simulated: Estimate, spread: float | None, quantile: float, tolerance_percent: float) -> float | None:
    """Return the largest difference that noise and tolerance explain; None without either."""
    if spread is None and not tolerance_percent:
        return None
    return quantile * (spread or 0.0) + 0.01 * tolerance_percent * abs(simulated.value or 0.0)


def _verdict(measured: Estimate, simulated: Estimate, reach: float | None) -> Verdict:
    one, other = measured.value, simulated.value
    if one is None or other is None:
        return "missing"
    if one == other:
        return "agrees"
    return "no interval" if reach is None else "agrees" if abs(one - other) <= reach else "differs"
