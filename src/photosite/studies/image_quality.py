"""Coverage of the 95 % intervals of image quality: charts with hidden truth are drawn by plain NumPy and measured."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from photosite.engine.threads import threads_for
from photosite.engine.workers import in_order, run_tasks
from photosite.errors import InputError
from photosite.metrics.measure import measure
from photosite.metrics.measurement import Result
from photosite.metrics.registry import measurement, measurements
from photosite.studies.coverage import NOMINAL_COVERAGE
from photosite.studies.measurement_study import WITHOUT_DRAWS, measurement_studies
from photosite.studies.outcome import Outcome, Outcomes, compare_estimate
from photosite.values.uncertain import Missing

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class QuantityCoverage:
    """Coverage of one quantity of a measurement.

    Parameters
    ----------
    measurement, quantity
        Id and name.
    charts, intervals, withheld
        Charts with an interval, intervals of all parts, and values that are missing.
    covered
        Mean over charts of the fraction of their intervals that contain the truth.
    bias, width, largest
        Mean, root mean square and largest of the error over its standard uncertainty; 1 is the right width.
    """

    measurement: str
    quantity: str
    charts: int
    intervals: int
    withheld: int
    covered: float
    bias: float
    width: float
    largest: float

    @property
    def probability(self) -> float:
        """Probability of a coverage at least as far from 95 % if intervals are correct: exact binomial test.

        The intervals of a chart count as one: they may have errors in common.
        """
        from scipy.stats import binomtest

        return float(binomtest(round(self.covered * self.charts), self.charts, NOMINAL_COVERAGE).pvalue)


@dataclass(frozen=True)
class ImageQualityStudy:
    """Coverage of all quantities, with the charts that were refused, by measurement and reason, and seconds a chart."""

    charts: int
    rows: tuple[QuantityCoverage, ...]
    refused: dict[str, dict[str, int]]
    seconds: dict[str, float]

    def of(self, name: str) -> list[QuantityCoverage]:
        """Return the rows of a measurement."""
        return [row for row in self.rows if row.measurement == name]

    def pooled(self, name: str) -> float:
        """Return the coverage of a measurement: the mean over its quantities."""
        return float(np.mean([row.covered for row in self.of(name)]))

    def to_dict(self) -> dict[str, Any]:
        """Return the content that `photosite reproduce image-quality --json` prints."""
        return {
            "charts": self.charts,
            "measurements": {
                name: {
                    "varied": measurement_studies()[name].varied,
                    "covered": self.pooled(name) if self.of(name) else None,
                    "seconds": seconds,
                    "refused": self.refused.get(name, {}),
                    "quantities": [asdict(row) | {"probability": row.probability} for row in self.of(name)],
                }
                for name, seconds in self.seconds.items()
            },
            "without_draws": dict(WITHOUT_DRAWS),
        }

    def markdown(self, before: str = "") -> str:
        """Return the table of the documentation; measurements that are not in the study keep their rows of `before`."""
        kept = {line.split("`")[1]: line for line in before.splitlines() if line.startswith("| `")}
        lines = [
            "| measurement | edition | oracle | coverage | by quantity | largest error | time |",
            "|---|---|---|---|---|---|---|",
        ]
        for name, entry in measurements().items():
            about = f"| `{name}` | {entry.standard} | {entry.oracle} |"
            rows = self.of(name)
            if rows:
                each = sorted(100.0 * row.covered for row in rows)
                span = f"{each[0]:.0f} to {each[-1]:.0f} %" if len(each) > 1 else ""
                largest = max((row.largest for row in rows), key=abs)
                seconds = f"{self.seconds[name]:.2g} s"
                lines.append(f"{about} {100.0 * self.pooled(name):.1f} % | {span} | {largest:+.1f} u | {seconds} |")
            elif name in WITHOUT_DRAWS:
                lines.append(f"{about} none: {WITHOUT_DRAWS[name]} | | | |")
            else:
                lines.append(kept.get(name, f"{about} not drawn | | | |"))
        return "\n".join(lines) + "\n"


def image_quality_study(
    names: Sequence[str] = (),
    *,
    charts: int = 200,
    processes: int | None = 2,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> ImageQualityStudy:
    """Measure drawn charts and count the intervals that contain the truth.

    Parameters
    ----------
    names
        Ids of measurements; all that have draws by default.
    charts
        Charts of each measurement. The standard error of a coverage of 95 % is 1.5 % with 200 charts.
    processes, scheduler
        Number of local processes, or address of a Dask scheduler, as for `run_tasks`; the result does not depend on it.
    progress
        Called with (charts done, charts in total).

    Raises
    ------
    InputError
        If a measurement is unknown or has no draws.
    """
    known = measurement_studies()
    for name in names:
        measurement(name)
        if name not in known:
            reason = WITHOUT_DRAWS.get(name, "it has no draws")
            raise InputError("measurement", value=name, expected=f"one of {', '.join(known)}", hint=reason)
    chosen = list(dict.fromkeys(names)) or [name for name in measurements() if name in known]
    tasks = [(name, number) for name in chosen for number in range(charts)]
    found: dict[str, list[_Measured]] = {name: [] for name in chosen}
    completed = run_tasks(_measure, tasks, processes=processes, scheduler=scheduler, name=_task_name)
    for done, ((name, _), result) in enumerate(zip(tasks, in_order(completed), strict=True), 1):
        found[name].append(result)
        if progress is not None:
            progress(done, len(tasks))
    refused: dict[str, dict[str, int]] = {}
    for name, results in found.items():
        for result in results:
            if isinstance(result.outcomes, str):
                reasons = refused.setdefault(name, {})
                reasons[result.outcomes] = reasons.get(result.outcomes, 0) + 1
    seconds = {name: float(np.median([result.seconds for result in results])) for name, results in found.items()}
    return ImageQualityStudy(charts, tuple(r for each in found.items() for r in _rows(*each)), refused, seconds)


@dataclass(frozen=True)
class _Measured:
    """Outcomes of a chart by quantity and part, or why it was refused; seconds of the measurement."""

    outcomes: dict[tuple[str, str], Outcome | str] | str
    seconds: float


def _task_name(task: tuple[str, int]) -> str:
    return f"{task[0]}, chart {task[1]}"


def _measure(task: tuple[str, int]) -> _Measured:
    with threads_for(1):
        return measure_chart(*task)


def measure_chart(name: str, number: int) -> _Measured:
    """Draw a chart, measure it, and compare the result with the truth."""
    random = np.random.default_rng([number, *name.encode()])
    chart = measurement_studies()[name].draw(random, number)
    options = {name: chart.options} if chart.options else None
    start = time.process_time()
    result = measure(chart.frames, chart.chart, only=[name], options=options, **chart.placing).results[name]
    seconds = time.process_time() - start
    if isinstance(result, Missing):
        return _Measured(result.reason, seconds)
    assert isinstance(result, Result)
    truth = chart.truth_of(result)
    outcomes = {key: compare_estimate(result.values[key], value) for key, value in truth.items()}
    return _Measured(outcomes, seconds)


def _rows(name: str, results: Sequence[_Measured]) -> list[QuantityCoverage]:
    by_quantity: dict[str, list[Outcomes]] = {}
    for result in results:
        if isinstance(result.outcomes, str):
            continue
        own: dict[str, Outcomes] = {}
        for (quantity, part), outcome in result.outcomes.items():
            own.setdefault(quantity, {})[part] = outcome
        for quantity, outcomes in own.items():
            by_quantity.setdefault(quantity, []).append(outcomes)
    rows = []
    for quantity, charts in by_quantity.items():
        known = [[each for each in chart.values() if isinstance(each, Outcome)] for chart in charts]
        withheld = sum(isinstance(each, str) for chart in charts for each in chart.values())
        with_interval = [chart for chart in known if chart]
        if not with_interval:
            continue
        errors = np.array([each.error / each.standard_uncertainty for chart in known for each in chart if _noisy(each)])
        covered = float(np.mean([np.mean([each.covered for each in chart]) for chart in with_interval]))
        bias, width, largest = math.nan, math.nan, math.nan
        if errors.size:
            bias, width = float(errors.mean()), float(np.sqrt(np.mean(errors**2)))
            largest = float(errors[np.argmax(np.abs(errors))])
        count = sum(map(len, known))
        rows.append(
            QuantityCoverage(name, quantity, len(with_interval), count, withheld, covered, bias, width, largest)
        )
    return rows


def _noisy(outcome: Outcome) -> bool:
    return outcome.standard_uncertainty > 0.0
