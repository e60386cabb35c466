"""Coverage of the 95 % intervals with a few defective pixels of each kind, made by a plain NumPy generator."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.effects.pixel_defects import FoundDefects
from photosite.calibration.result import Calibration
from photosite.calibration.setting import calibrate_setting
from photosite.engine.threads import threads_for
from photosite.engine.workers import in_order, run_tasks
from photosite.errors import CalibrationError
from photosite.sensor.model import Sensor
from photosite.studies.conditions import Condition
from photosite.studies.disturbed_lab import DisturbedLab
from photosite.studies.effect_study import log_uniform
from photosite.studies.outcome import Outcome, compare_estimates
from photosite.studies.plain_camera import Disturbance

FRACTIONS = (1e-4, 1e-3, 1e-2)
"""Fractions of the pixels that are defective."""

PARAMETERS = (
    *("system_gain_dn_per_e", "read_noise_e", "dsnu_e", "prnu_percent", "dark_current_e_per_s"),
    *("dcnu_percent", "black_level_dn", "quantum_efficiency_percent"),
)
"""The parameters that are compared with the truth, that of the pixels without defects."""

SENSORS = Condition("defective pixels", "sensors with defective pixels", shape=(96, 128))
"""The sensors and the protocol."""

Progress = Callable[[int, int], None]
_Places = NDArray[np.bool_]
_Make = Callable[[_Places, Sensor, np.random.Generator], Disturbance]


def _scattered(shape: tuple[int, int], count: int, rng: np.random.Generator) -> _Places:
    chosen = np.zeros(shape, np.bool_)
    chosen.flat[rng.choice(chosen.size, count, replace=False)] = True
    return chosen


def _column(shape: tuple[int, int], count: int, rng: np.random.Generator) -> _Places:
    """Return neighboring columns, of which the last one has the pixels that are left."""
    chosen = np.zeros(shape[::-1], np.bool_)
    first = int(rng.integers(shape[1] - -(-count // shape[0]) + 1))
    chosen[first:].reshape(-1)[:count] = True
    return chosen.T


def _cluster(shape: tuple[int, int], count: int, rng: np.random.Generator) -> _Places:
    """Return the pixels nearest to a place."""
    row, col = (int(rng.integers(length)) for length in shape)
    distance = np.hypot(*np.ogrid[-row : shape[0] - row, -col : shape[1] - col])
    chosen = np.zeros(shape, np.bool_)
    chosen.flat[np.argsort(distance, axis=None, kind="stable")[:count]] = True
    return chosen


def _hot(bad: _Places, sensor: Sensor, rng: np.random.Generator) -> Disturbance:
    return Disturbance(hot_e_per_s=np.where(bad, rng.uniform(2000.0, 6000.0, bad.shape), 0.0))


def _stuck(bad: _Places, sensor: Sensor, rng: np.random.Generator) -> Disturbance:
    value = rng.integers(0, int(sensor.white_level_dn) + 1, bad.shape)
    return Disturbance(numbers=lambda values, noise, frame: np.where(bad, value, values))


def _white(bad: _Places, sensor: Sensor, rng: np.random.Generator) -> Disturbance:
    return Disturbance(numbers=lambda values, noise, frame: np.where(bad, sensor.white_level_dn, values))


def _dead(bad: _Places, sensor: Sensor, rng: np.random.Generator) -> Disturbance:
    response = np.where(bad, rng.uniform(0.0, 0.3, bad.shape), 1.0)
    return Disturbance(light=lambda values, noise, frame: values * response)


def _offset(bad: _Places, sensor: Sensor, rng: np.random.Generator) -> Disturbance:
    offset = np.where(bad, rng.uniform(200.0, 1000.0, bad.shape), 0.0)
    return Disturbance(numbers=lambda values, noise, frame: values + offset)


def _blinking(bad: _Places, sensor: Sensor, rng: np.random.Generator) -> Disturbance:
    """Return pixels with two levels, 50 to 2000 DN apart, at random in each frame."""
    jump = np.array([log_uniform(rng, 50.0, 2000.0) for _ in range(bad.size)]).reshape(bad.shape)
    return Disturbance(numbers=lambda values, noise, frame: values + bad * jump * noise.integers(0, 2, bad.shape))


def _lit_blinking(bad: _Places, sensor: Sensor, rng: np.random.Generator) -> Disturbance:
    """Return pixels whose response is 10 to 15 % smaller or larger, at random in each frame."""
    change = np.where(bad, rng.uniform(0.10, 0.15, bad.shape), 0.0)
    return Disturbance(
        light=lambda values, noise, frame: values * (1.0 + change * (2 * noise.integers(0, 2, bad.shape) - 1))
    )


KINDS: Mapping[str, tuple[Callable[[tuple[int, int], int, np.random.Generator], _Places], _Make]] = {
    "hot": (_scattered, _hot),
    "stuck": (_scattered, _stuck),
    "white": (_scattered, _white),
    "dead": (_scattered, _dead),
    "offset": (_scattered, _offset),
    "blinking": (_scattered, _blinking),
    "blinking if lit": (_scattered, _lit_blinking),
    "white columns": (_column, _white),
    "dead cluster": (_cluster, _dead),
}
"""The kinds of defects: where they are, and what they do."""


@dataclass(frozen=True)
class DefectCoverage:
    """Coverage with defects of one kind.

    Parameters
    ----------
    kind, fraction
        Kind of the defects ("none" without), and fraction of the pixels that have them.
    sensors, refused, withheld
        Numbers of sensors, of calibrations that failed, and of parameters without a value.
    intervals, covered
        Numbers of intervals, and of those that contain the truth.
    largest
        Largest error in standard uncertainties.
    pixels, missed, others
        Defective pixels, those that were not found, and pixels that were found but are not defective.
    """

    kind: str
    fraction: float
    sensors: int
    refused: int
    withheld: int
    intervals: int
    covered: int
    largest: float
    pixels: int
    missed: int
    others: int

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, for JSON."""
        return dict(vars(self))


def defect_coverage(
    sensors: int = 50,
    *,
    kinds: Sequence[str] = tuple(KINDS),
    fractions: Sequence[float] = FRACTIONS,
    processes: int | None = 2,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> list[DefectCoverage]:
    """Measure virtual sensors without defects, and with each kind and fraction of them, and count the intervals.

    Parameters
    ----------
    sensors
        Virtual sensors of each kind and fraction.
    kinds, fractions
        Names of `KINDS`, and fractions of the pixels.
    processes, scheduler
        Number of local processes, or address of a Dask scheduler, as for `run_tasks`; the result does not depend on it.
    progress
        Called with (sensors done, sensors in total).
    """
    cases = [("none", 0.0), *((kind, fraction) for kind in kinds for fraction in fractions)]
    tasks = [(kind, fraction, number) for kind, fraction in cases for number in range(sensors)]
    results: dict[tuple[str, float], list[_Result]] = {case: [] for case in cases}
    completed = run_tasks(_measure, tasks, processes=processes, scheduler=scheduler, name=_task_name)
    for done, ((kind, fraction, _), result) in enumerate(zip(tasks, in_order(completed), strict=True), 1):
        results[kind, fraction].append(result)
        if progress is not None:
            progress(done, len(tasks))
    return [_row(*case, found) for case, found in results.items()]


_Result = tuple[list[Outcome | str], tuple[int, int, int]] | None
"""Of one sensor: outcomes, and numbers of defective pixels, of missed ones and of others; None where refused."""


def _task_name(task: tuple[str, float, int]) -> str:
    return f"{task[0]}, {100 * task[1]:g} %, sensor {task[2]}"


def _measure(task: tuple[str, float, int]) -> _Result:
    with threads_for(1):
        return measure_sensor(*task)


def measure_sensor(kind: str, fraction: float, number: int) -> _Result:
    """Shoot and calibrate one sensor, and compare it with the truth of the pixels without defects."""
    sensor, shape = SENSORS.sensor(number), SENSORS.shape
    rng = np.random.default_rng([number, round(1e6 * fraction), *kind.encode()])
    bad, disturbance = np.zeros(shape, np.bool_), Disturbance()
    if fraction:
        place, make = KINDS[kind]
        bad = place(shape, max(round(fraction * bad.size), 1), rng)
        disturbance = make(bad, sensor, rng)
    lab = DisturbedLab(sensor, SENSORS.protocol, SENSORS.level, disturbance, seed=int(rng.integers(1 << 31)))
    try:
        calibration = calibrate_setting(lab.frame_set())
    except CalibrationError:
        return None
    truth = {name: value for name, value in lab.truth(calibration).items() if name in PARAMETERS}
    outcomes = list(compare_estimates(calibration.estimates(), truth).values())
    found = _found(calibration, shape)
    return outcomes, (int(bad.sum()), int((bad & ~found).sum()), int((found & ~bad).sum()))


def _found(calibration: Calibration, shape: tuple[int, int]) -> _Places:
    found = np.zeros(shape, np.bool_)
    defects = calibration.findings["pixel_defects"]
    if isinstance(defects, FoundDefects) and defects.left_out is not None:
        found.flat[defects.left_out.pixels.index] = True
    return found


def _row(kind: str, fraction: float, results: Sequence[_Result]) -> DefectCoverage:
    measured = [result for result in results if result is not None]
    outcomes = [outcome for of_sensor, _ in measured for outcome in of_sensor]
    known = [outcome for outcome in outcomes if isinstance(outcome, Outcome) and outcome.standard_uncertainty > 0.0]
    errors = [abs(outcome.error) / outcome.standard_uncertainty for outcome in known]
    pixels, missed, others = (sum(counts[k] for _, counts in measured) for k in range(3))
    return DefectCoverage(
        kind,
        fraction,
        len(results),
        len(results) - len(measured),
        sum(isinstance(outcome, str) for outcome in outcomes),
        len(known),
        sum(outcome.covered for outcome in known),
        max(errors, default=math.nan),
        pixels,
        missed,
        others,
    )
