"""Do the intervals hold what they promise: many virtual sensors, measured by calibrations that do not know them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

from photosite.calibration.calibrate import calibrate
from photosite.calibration.result import Calibration
from photosite.engine.jit import threads_for
from photosite.errors import CalibrationError, InputError
from photosite.studies.truth import measured_truth
from photosite.studies.virtual_lab import VirtualLab
from photosite.studies.virtual_sensors import CONDITIONS, condition

PROMISED = 0.95
"""Share of the intervals that are to hold the truth."""

LARGEST_BIAS = 0.1
"""Of the standard uncertainty, in size: what a mean error may be, beside what so many sensors leave to chance."""

FALSE_ALARM = 1e-3
"""Chance that an honest parameter is marked for its share, and again that one is for its mean error."""

_BATCH = 10
_ROUNDING = 1e-9
"""Relative; for values that are exact, such as the level of an ideal converter's top."""

Progress = Callable[[int, int], None]
"""Called with (sensors done, sensors to do)."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One parameter of one virtual sensor.

    Parameters
    ----------
    error, standard_uncertainty, scale
        Estimate less truth; the uncertainty stated; the truth's size, by which both are divided where sensors are
        taken together (1 for a truth of 0).
    covered
        Whether the 95 % interval holds the truth.
    """

    error: float
    standard_uncertainty: float
    scale: float
    covered: bool


@dataclass(frozen=True, slots=True)
class Coverage:
    """How one parameter did under one condition.

    Parameters
    ----------
    condition, parameter
        Their names.
    sensors, estimated
        How many there were, and of how many there is an estimate.
    covered
        Share of the uncertain estimates whose 95 % interval holds the truth.
    bias, bias_error
        Mean error over mean standard uncertainty, and its standard error (by the scatter of the errors over sensors).
    width
        Root of the mean squared error over the uncertainty: 1 for honest uncertainties.
    exact
        How many estimates are exact (uncertainty 0); where all are, neither bias nor width means anything.
    wrong
        How many of those miss the truth.
    reason
        Why some have no estimate: the first one's.
    """

    condition: str
    parameter: str
    sensors: int
    estimated: int
    covered: float
    bias: float
    width: float
    exact: int
    wrong: int
    reason: str | None = None
    bias_error: float = 0.0

    @property
    def share_probability(self) -> float:
        """How likely a share as far from 95 % as this is where intervals are honest: binomial, both sides, exact."""
        from scipy.stats import binomtest

        known = self.estimated - self.exact
        return float(binomtest(round(self.covered * known), known, PROMISED).pvalue) if known else 1.0

    @property
    def bias_probability(self) -> float:
        """How likely a mean error as large as this, or larger, is where the true one is a tenth of the uncertainty.

        By Student's distribution for the number of sensors; 1 where there are too few for a standard error.
        """
        from scipy.stats import t

        known = self.estimated - self.exact
        beyond = abs(self.bias) - LARGEST_BIAS
        if known < 2 or beyond <= 0.0:
            return 1.0
        return float(2.0 * t.sf(beyond / self.bias_error, known - 1)) if self.bias_error > 0.0 else 0.0

    @property
    def remarks(self) -> tuple[str, ...]:
        """What so many sensors can tell to be wrong, in words."""
        said = []
        if self.wrong:
            said.append(f"{self.wrong} of {self.exact} exact ones wrong")
        if self.share_probability < FALSE_ALARM:
            said.append(f"{'too few' if self.covered < PROMISED else 'too many'} hold the truth")
        if self.bias_probability < FALSE_ALARM:
            said.append("biased")
        return tuple(said)

    @property
    def holds(self) -> bool:
        """Whether nothing speaks against it at `FALSE_ALARM`; an exact one is always right."""
        return not self.remarks


@dataclass(frozen=True, slots=True)
class Refusal:
    """Sensors of one condition that a calibration refused for the same reason, and what it said of the first."""

    sensors: int
    example: str


@dataclass(frozen=True)
class CoverageStudy:
    """What the study found.

    Parameters
    ----------
    rows
        A line per condition and parameter that was estimated at least once.
    refused
        Per condition, calibrations that were refused: every reason, numbers left out, with how many and an example.
    sensors
        Virtual sensors per condition.
    """

    rows: tuple[Coverage, ...]
    refused: Mapping[str, tuple[Refusal, ...]]
    sensors: int

    def to_dict(self) -> dict[str, Any]:
        """What `photosite reproduce coverage --json` prints."""
        return {
            "sensors_per_condition": self.sensors,
            "false_alarm_probability": FALSE_ALARM,
            "parameters_outside": sum(not row.holds for row in self.rows),
            "conditions": {
                name: {
                    "summary": CONDITIONS[name].summary,
                    "parameters": {
                        row.parameter: {
                            "estimated": row.estimated,
                            "covered": row.covered,
                            "share_probability": row.share_probability,
                            "bias": row.bias,
                            "bias_standard_error": row.bias_error,
                            "bias_probability": row.bias_probability,
                            "width": row.width,
                            "exact": row.exact,
                            "wrong": row.wrong,
                            "holds": row.holds,
                            "remarks": list(row.remarks),
                        }
                        for row in self.rows
                        if row.condition == name
                    },
                    "refused": sum(entry.sensors for entry in self.refused.get(name, ())),
                    "why_refused": [
                        {"sensors": entry.sensors, "example": entry.example} for entry in self.refused.get(name, ())
                    ],
                }
                for name in dict.fromkeys([*(row.condition for row in self.rows), *self.refused])
            },
        }


def coverage_study(
    names: Sequence[str] = (), *, sensors: int = 500, processes: int = 2, progress: Progress | None = None
) -> CoverageStudy:
    """Measure many virtual sensors under each condition and count how often the intervals hold the truth.

    Parameters
    ----------
    names
        Conditions; all of `CONDITIONS` if none.
    sensors
        Virtual sensors per condition. With 500 of them a share of 95 % is found to 1 % (one standard error), with
        2000 to half of that.
    processes
        Processes that share the work; the result does not depend on it.
    progress
        Called as sensors are done.

    Raises
    ------
    InputError
        If a condition is unknown, or a number is below 1.
    """
    chosen = [condition(name).name for name in names or CONDITIONS]
    for what, number in (("sensors", sensors), ("processes", processes)):
        if number < 1:
            raise InputError(f"a coverage study has 1 of its {what} or more, not {number}")
    tasks = [(name, batch) for name in chosen for batch in _batches(sensors)]
    found: dict[str, dict[str, list[Outcome | str]]] = {name: {} for name in chosen}
    refused: dict[str, list[str]] = {name: [] for name in chosen}
    done = 0
    for (name, batch), results in zip(tasks, _work(tasks, processes), strict=True):
        for result in results:
            if isinstance(result, str):
                refused[name].append(result)
                continue
            for parameter, outcome in result.items():
                found[name].setdefault(parameter, []).append(outcome)
        done += len(batch)
        if progress is not None:
            progress(done, len(chosen) * sensors)
    return CoverageStudy(tuple(_rows(found)), {name: _refusals(why) for name, why in refused.items() if why}, sensors)


def _refusals(reasons: Sequence[str]) -> tuple[Refusal, ...]:
    """By reason, the most frequent first; numbers and the sensor's name are not part of a reason."""
    kinds: dict[str, list[str]] = {}
    for reason in reasons:
        kinds.setdefault(re.sub(r"[\d.e+-]*\d", "#", reason.partition("clipped at 0 DN: ")[2] or reason), []).append(
            reason
        )
    groups = sorted(kinds.values(), key=len, reverse=True)
    return tuple(Refusal(len(group), group[0]) for group in groups)


def _batches(sensors: int) -> list[range]:
    return [range(first, min(first + _BATCH, sensors)) for first in range(0, sensors, _BATCH)]


_Result = dict[str, Outcome | str] | str
"""Of one sensor: by parameter its outcome or the reason why it has no estimate; or why the calibration was refused."""


def _work(tasks: Sequence[tuple[str, Sequence[int]]], processes: int) -> Iterator[list[_Result]]:
    if processes == 1:
        yield from map(_measure_batch, tasks)
        return
    # Spawned, because the threads of compiled kernels do not survive a fork.
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        try:
            yield from pool.map(_measure_batch, tasks)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _measure_batch(task: tuple[str, Sequence[int]]) -> list[_Result]:
    name, numbers = task
    with threads_for(1):  # small chips: a second thread of a kernel waits longer than it works
        return [measure_sensor(CONDITIONS[name].lab(number)) for number in numbers]


def measure_sensor(lab: VirtualLab) -> _Result:
    """Shoot and calibrate one virtual sensor, and compare with the truth.

    Returns
    -------
    dict or str
        By parameter its outcome, or why it has no estimate; the reason alone where the calibration was refused.
    """
    try:
        calibration = calibrate(lab.frame_set())
    except CalibrationError as error:
        return str(error)
    return compare(calibration, measured_truth(lab, calibration))


def compare(calibration: Calibration, truth: Mapping[str, float]) -> dict[str, Outcome | str]:
    """Each estimate beside its truth; parameters without a truth are left out."""
    result: dict[str, Outcome | str] = {}
    for name, entry in calibration.estimates().items():
        if name not in truth:
            continue
        if entry.value is None or entry.standard_uncertainty is None or entry.interval_95 is None:
            result[name] = entry.reason or ""
            continue
        low, high = entry.interval_95
        slack = _ROUNDING * abs(truth[name])
        result[name] = Outcome(
            entry.value - truth[name],
            entry.standard_uncertainty,
            abs(truth[name]) or 1.0,
            low - slack <= truth[name] <= high + slack,
        )
    return result


def _rows(found: Mapping[str, Mapping[str, list[Outcome | str]]]) -> Iterable[Coverage]:
    for name, parameters in found.items():
        for parameter, entries in parameters.items():
            outcomes = [entry for entry in entries if isinstance(entry, Outcome)]
            reasons = [entry for entry in entries if isinstance(entry, str)]
            if outcomes:
                yield _row(name, parameter, outcomes, reasons)


def _row(name: str, parameter: str, outcomes: Sequence[Outcome], reasons: Sequence[str]) -> Coverage:
    exact = [entry for entry in outcomes if entry.standard_uncertainty == 0.0]
    known = [entry for entry in outcomes if entry.standard_uncertainty > 0.0]
    n = max(len(known), 1)
    uncertainty = math.fsum(entry.standard_uncertainty / entry.scale for entry in known)
    bias = math.fsum(entry.error / entry.scale for entry in known) / uncertainty if known else 0.0
    # A ratio of two means: its residuals are error - bias * uncertainty.
    residuals = [(entry.error - bias * entry.standard_uncertainty) / entry.scale for entry in known]
    scatter = math.fsum(x**2 for x in residuals) * n / max(n - 1, 1)
    return Coverage(
        condition=name,
        parameter=parameter,
        sensors=len(outcomes) + len(reasons),
        estimated=len(outcomes),
        covered=sum(entry.covered for entry in known) / n,
        bias=bias,
        width=math.sqrt(math.fsum((entry.error / entry.standard_uncertainty) ** 2 for entry in known) / n),
        exact=len(exact),
        wrong=sum(not entry.covered for entry in exact),
        reason=reasons[0] if reasons else None,
        bias_error=math.sqrt(scatter) / uncertainty if known else 0.0,
    )
