"""Intervals and diagnostics of clean sensors drawn at random over the range of practice, made by plain NumPy."""

from __future__ import annotations

import math
import tempfile
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.calibration.calibrate import calibrate
from photosite.calibration.result import Calibration
from photosite.calibration.spatial.nonuniformity import SMALLEST_SIDE
from photosite.engine.threads import threads_for
from photosite.engine.workers import in_order, run_tasks
from photosite.errors import PhotositeError, PhotositeWarning
from photosite.frames.open import open_frames
from photosite.studies.drawn_sensors import NO_PATTERN, DrawnSensor, draw_sensor
from photosite.studies.outcome import Outcome, compare_estimate

EACH_COVERAGE = 0.92, 0.98
"""Goal for the coverage of each parameter."""

Progress = Callable[[int, int], None]


COARSE_DN = 0.45
"""Read noise below which quantization hides it: a dark temporal variance of 0.24 DN^2, EMVA 1288, and what dark current
adds."""


def _one_dark_time(sensor: DrawnSensor) -> bool:
    return len(sensor.dark_times_s) == 1


def _longer_flats(sensor: DrawnSensor) -> bool:
    return sensor.lights[-1].exposure_s > sensor.dark_times_s[-1]


def _coarse(sensor: DrawnSensor) -> bool:
    return sensor.gain * sensor.read_noise_e < COARSE_DN


def _below_saturation(sensor: DrawnSensor) -> bool:
    """Return whether not all pixels of a channel saturate in each frame."""
    mean_e = float(_charges_e(sensor, min(sensor.efficiency.values()))[-1])
    spread_e = math.sqrt(mean_e + sensor.read_noise_e**2 + sensor.dsnu_e**2 + (sensor.prnu * mean_e) ** 2)
    return mean_e - 5.0 * spread_e < sensor.saturation_e


def _charges_e(sensor: DrawnSensor, efficiency: float) -> NDArray[np.float64]:
    """Return the mean charge of each level of light in a channel, that of the dark current included."""
    return np.array([level.photons * efficiency + sensor.dark_e_per_s * level.exposure_s for level in sensor.lights])


def _level_near_full_well(sensor: DrawnSensor) -> bool:
    """Return whether wells are full below the converter's range, and a level of a channel lies near them."""
    charges = np.concatenate([_charges_e(sensor, each) for each in sensor.efficiency.values()])
    spread = 5.0 * math.hypot(sensor.prnu, sensor.well_e**-0.5)
    return sensor.saturation_e == sensor.well_e and bool((np.abs(charges / sensor.well_e - 1.0) < spread).any())


def _few_linear_levels(sensor: DrawnSensor) -> bool:
    """Return whether fewer than three levels of a channel are below 70 % of that of the largest variance, or nearly.

    The variance is that of normal charges cut off at saturation.
    """
    z = np.linspace(-6.0, 6.0, 601)
    density = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
    for efficiency in sensor.efficiency.values():
        charge = _charges_e(sensor, efficiency)
        cut = np.minimum(charge[:, None] + np.sqrt(charge + sensor.read_noise_e**2)[:, None] * z, sensor.saturation_e)
        variance = (cut**2 @ density) - (cut @ density) ** 2
        peak = int(np.argmax(variance > 0.98 * variance.max()))
        if np.count_nonzero(charge < 0.69 * charge[peak]) < 3:
            return True
    return False


def _small_planes(sensor: DrawnSensor) -> bool:
    """Return whether the planes of a color, or the frame, are too small for the standard's high-pass."""
    return min(sensor.shape) // (1 if sensor.tile == "mono" else 2) < SMALLEST_SIDE


def _weak_dark_current(sensor: DrawnSensor) -> bool:
    """Return whether the dark signal of the longest dark frames is below six standard errors, or 3 DN if rounded."""
    longest = next(level for level in sensor.levels if level.exposure_s == sensor.dark_times_s[-1])
    noise_dn = math.hypot(sensor.gain * sensor.read_noise_e, 0.3)
    error_dn = noise_dn * math.sqrt(2.0 / (longest.count * sensor.shape[0] * sensor.shape[1]))
    return sensor.gain * sensor.dark_e_per_s * longest.exposure_s < (3.0 if _coarse(sensor) else 6.0 * error_dn)


TRUE: Mapping[str, Callable[[DrawnSensor], bool]] = {
    "one-dark-exposure": _one_dark_time,
    "unknown-dark-current": lambda sensor: _one_dark_time(sensor) and _longer_flats(sensor),
    "short-dark-exposures": _longer_flats,
    "noise-hidden-by-quantization": _coarse,
    "no-saturation": _below_saturation,
    "partly-full-wells": _level_near_full_well,
    "few-light-levels": _few_linear_levels,
    "no-dark-current": _weak_dark_current,
    "small-frames": _small_planes,
}
"""When diagnostics, and reasons of missing values, are true of clean frames. All others are false alarms."""


@dataclass(frozen=True)
class SensorResult:
    """The calibration of one sensor.

    Parameters
    ----------
    sensor
        The sensor.
    outcomes
        By parameter, its outcome, or the reason why it has no value.
    raised
        Ids of the diagnostics, those of the missing values included.
    refused
        Why the calibration was refused, or None.
    """

    sensor: DrawnSensor
    outcomes: Mapping[str, Outcome | str] = field(default_factory=dict)
    raised: frozenset[str] = frozenset()
    refused: str | None = None

    @property
    def false_alarms(self) -> frozenset[str]:
        """Ids of the diagnostics that are not true of the frames."""
        return frozenset(id for id in self.raised if id not in TRUE or not TRUE[id](self.sensor))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "sensor": self.sensor.to_dict(),
            "parameters": {
                name: outcome
                if isinstance(outcome, str)
                else {"error": outcome.error, "uncertainty": outcome.standard_uncertainty, "covered": outcome.covered}
                for name, outcome in self.outcomes.items()
            },
            "diagnostics": sorted(self.raised),
            "false_alarms": sorted(self.false_alarms),
            "refused": self.refused,
        }


@dataclass(frozen=True)
class ParameterResult:
    """Intervals of one parameter.

    Parameters
    ----------
    parameter
        Name in `Parameters`.
    intervals, covered
        Numbers of intervals, and of those that contain the truth.
    rms_z, largest_z, sensor
        Root mean square and largest error in standard uncertainties, and the sensor of the largest. NaN and None for
        standard deviations whose truth is 0, which are not normal.
    exact, wrong, withheld
        Numbers of exact values, of those that are wrong, and of sensors without a value.
    """

    parameter: str
    intervals: int
    covered: int
    rms_z: float
    largest_z: float
    sensor: int | None
    exact: int
    wrong: int
    withheld: int

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, for JSON."""
        return {name: None if isinstance(x, float) and math.isnan(x) else x for name, x in vars(self).items()}


@dataclass(frozen=True)
class RandomSensors:
    """Result of the study: that of each sensor, in their order."""

    results: tuple[SensorResult, ...]

    @property
    def parameters(self) -> tuple[ParameterResult, ...]:
        """Intervals by parameter."""
        names = dict.fromkeys(name for result in self.results for name in result.outcomes)
        return tuple(self._parameter(name) for name in names)

    def _parameter(self, name: str) -> ParameterResult:
        entries = [(r.sensor.number, r.outcomes[name]) for r in self.results if name in r.outcomes]
        known = [(number, entry) for number, entry in entries if isinstance(entry, Outcome)]
        exact = [entry for _, entry in known if not entry.standard_uncertainty]
        uncertain = {number: entry for number, entry in known if entry.standard_uncertainty}
        z = {} if name in NO_PATTERN else {number: _z(entry) for number, entry in uncertain.items()}
        worst = max(z, key=lambda number: abs(z[number]), default=None)
        return ParameterResult(
            name,
            len(uncertain),
            sum(entry.covered for entry in uncertain.values()),
            float(np.sqrt(np.mean(np.square(list(z.values()))))) if z else math.nan,
            math.nan if worst is None else z[worst],
            worst,
            len(exact),
            sum(not entry.covered for entry in exact),
            len(entries) - len(known),
        )

    @property
    def errors(self) -> list[float]:
        """Errors in standard uncertainties, except of standard deviations whose truth is 0."""
        outcomes = [x for result in self.results for name, x in result.outcomes.items() if name not in NO_PATTERN]
        return [_z(entry) for entry in outcomes if isinstance(entry, Outcome) and entry.standard_uncertainty]

    @property
    def coverage(self) -> float:
        """Fraction of all intervals that contain the truth."""
        parameters = self.parameters
        return sum(each.covered for each in parameters) / max(sum(each.intervals for each in parameters), 1)

    @property
    def false_alarms(self) -> dict[str, list[int]]:
        """By id, the sensors for which a diagnostic is not true."""
        found: dict[str, list[int]] = {}
        for result in self.results:
            for id in sorted(result.false_alarms):
                found.setdefault(id, []).append(result.sensor.number)
        return found

    @property
    def raised(self) -> dict[str, int]:
        """By id, the number of sensors for which a diagnostic is raised, the most frequent first."""
        counts: dict[str, int] = {}
        for result in self.results:
            for id in result.raised:
                counts[id] = counts.get(id, 0) + 1
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    @property
    def refused(self) -> dict[int, str]:
        """By sensor, why its calibration was refused."""
        return {result.sensor.number: result.refused for result in self.results if result.refused is not None}

    def to_dict(self) -> dict[str, Any]:
        """Return the content that `photosite reproduce random-sensors --json` prints."""
        return {
            "sensors": len(self.results),
            "coverage": self.coverage,
            "parameters": [each.to_dict() for each in self.parameters],
            "diagnostics": self.raised,
            "false_alarms": self.false_alarms,
            "refused": self.refused,
            "results": [result.to_dict() for result in self.results],
        }

    def figure(self) -> Figure:
        """Draw the distribution of all errors, and the coverage of each parameter."""
        return _figure(self)


def _z(outcome: Outcome) -> float:
    return outcome.error / outcome.standard_uncertainty


def random_sensors(
    numbers: Iterable[int] = range(400),
    *,
    processes: int | None = 2,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> RandomSensors:
    """Draw clean sensors, write their frames to files, calibrate them, and compare with the truth.

    Parameters
    ----------
    numbers
        Numbers of the sensors.
    processes, scheduler
        Number of local processes, or address of a Dask scheduler, as for `run_tasks`; the result does not depend on it.
    progress
        Called with (sensors done, sensors in total).
    """
    tasks, results = list(numbers), []
    completed = run_tasks(_measure, tasks, processes=processes, scheduler=scheduler, name="sensor {}".format)
    for result in in_order(completed):
        results.append(result)
        if progress is not None:
            progress(len(results), len(tasks))
    return RandomSensors(tuple(results))


def _measure(number: int) -> SensorResult:
    with threads_for(1):
        return measure_sensor(draw_sensor(number))


def measure_sensor(sensor: DrawnSensor) -> SensorResult:
    """Write the frames of one sensor, calibrate it, and compare with the truth."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", PhotositeWarning)
        path, options = sensor.write(Path(folder))
        try:
            calibration = calibrate(open_frames(path, **options))
        except PhotositeError as error:
            return SensorResult(sensor, refused=str(error))
        if not isinstance(calibration, Calibration):
            return SensorResult(sensor, refused=f"calibrated as {type(calibration).__name__}")
        estimates = calibration.estimates()
        hidden = estimates["read_noise_e"].reason_id == "noise-hidden-by-quantization"
        truth = sensor.truth(calibration.dsnu1288_exposure_s, hidden=hidden)
        return SensorResult(
            sensor,
            {name: compare_estimate(estimates[name], true) for name, true in truth.items()},
            frozenset(
                [each.id for each in calibration.diagnostics if each.severity != "withheld"]
                + [id for name in truth if (id := estimates[name].reason_id)]
            ),
        )


def _figure(study: RandomSensors) -> Figure:
    from photosite.report.style import BLUE, GRAY, VERMILION, styled

    with styled():
        figure = Figure(figsize=(7.0, 5.5), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.3))
        errors = np.clip(study.errors, -5.0, 5.0)
        edges = np.linspace(-5.0, 5.0, 41)
        left.hist(errors, edges, density=True, color=BLUE, label="all parameters")
        x = np.linspace(-5.0, 5.0, 201)
        left.plot(x, np.exp(-(x**2) / 2.0) / math.sqrt(2.0 * math.pi), color=VERMILION, label="normal")
        left.set(xlabel="error / standard uncertainty", ylabel="density")
        left.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
        rows = [row for row in study.parameters if row.intervals][::-1]
        places = np.arange(len(rows))
        share = np.array([row.covered / row.intervals for row in rows])
        spread = np.sqrt(0.95 * 0.05 / np.array([row.intervals for row in rows]))
        right.axvspan(*(100.0 * limit for limit in EACH_COVERAGE), color=GRAY, alpha=0.2)
        right.axvline(95.0, color=GRAY)
        right.errorbar(100.0 * share, places, xerr=100.0 * spread, fmt="o", color=BLUE, markersize=3.5)
        right.set_yticks(places, [row.parameter for row in rows], fontsize=7.0)
        right.set_ylim(-0.7, len(rows) - 0.3)
        right.set_xlabel("intervals with the truth, %")
    return figure
