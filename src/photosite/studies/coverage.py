"""Coverage of the 95 % intervals: many virtual sensors are drawn, shot and calibrated, and compared with the truth."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from photosite.calibration.captures.combined import CombinedCalibration, calibrate_combined
from photosite.calibration.captures.each_capture import calibrate_captures
from photosite.calibration.result import Calibration
from photosite.calibration.setting import calibrate_setting
from photosite.engine.threads import threads_for
from photosite.engine.workers import in_order, run_tasks
from photosite.errors import CalibrationError, InputError
from photosite.frames.frame_set import FrameSet
from photosite.sensor.capture_readout import capture_scale, captures_of, part_sensor
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.studies.conditions import CONDITIONS, condition
from photosite.studies.disturbed_lab import DisturbedLab
from photosite.studies.effect_study import effect_outcomes, stated_effects
from photosite.studies.outcome import Outcome, Outcomes, compare_estimate, compare_estimates
from photosite.studies.truth import measured_truth, true_parameters
from photosite.studies.virtual_lab import VirtualLab
from photosite.values.uncertain import Missing

NOMINAL_COVERAGE = 0.95
"""Fraction of the intervals that should contain the truth."""

LARGEST_BIAS = 0.1
"""Largest acceptable mean error, relative to the standard uncertainty."""

FALSE_ALARM = 1e-3
"""Probability that correct intervals are flagged for their coverage, and again for their mean error."""

_BATCH = 10

_COLUMNS = 7
"""Conditions in each table of the documentation."""

Progress = Callable[[int, int], None]
"""Called with (sensors done, sensors in total)."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Coverage of one parameter under one condition.

    Exact estimates (uncertainty 0) count neither in bias nor in width.
    """

    condition: str
    parameter: str
    sensors: int
    estimated: int  # sensors with an estimate
    covered: float  # fraction of the uncertain estimates whose 95 % interval contains the truth
    bias: float  # mean error over mean standard uncertainty
    width: float  # root mean square of error over uncertainty: 1 for correct uncertainties
    exact: int
    wrong: int  # exact estimates that miss the truth
    reason: str | None = None  # why the first sensor without an estimate has none
    bias_error: float = 0.0  # standard error of the bias, from the scatter over sensors

    @property
    def share_probability(self) -> float:
        """Probability of a coverage at least as far from 95 % if the intervals are correct: exact binomial test."""
        from scipy.stats import binomtest

        known = self.estimated - self.exact
        return float(binomtest(round(self.covered * known), known, NOMINAL_COVERAGE).pvalue) if known else 1.0

    @property
    def bias_probability(self) -> float:
        """Probability of a mean error at least this large if the true one is a tenth of the uncertainty.

        From Student's t distribution; 1 with too few sensors for a standard error.
        """
        from scipy.stats import t

        known = self.estimated - self.exact
        beyond = abs(self.bias) - LARGEST_BIAS
        if known < 2 or beyond <= 0.0:
            return 1.0
        return float(2.0 * t.sf(beyond / self.bias_error, known - 1)) if self.bias_error > 0.0 else 0.0

    @property
    def remarks(self) -> tuple[str, ...]:
        """Significant deviations from correct intervals, in words."""
        found = []
        if self.wrong:
            found.append(f"{self.wrong} of {self.exact} exact values wrong")
        if self.share_probability < FALSE_ALARM:
            found.append(f"coverage too {'low' if self.covered < NOMINAL_COVERAGE else 'high'}")
        if self.bias_probability < FALSE_ALARM:
            found.append("biased")
        return tuple(found)

    @property
    def passes(self) -> bool:
        """Whether there is no significant deviation."""
        return not self.remarks

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for JSON."""
        return {
            "estimated": self.estimated,
            "covered": self.covered,
            "share_probability": self.share_probability,
            "bias": self.bias,
            "bias_standard_error": self.bias_error,
            "bias_probability": self.bias_probability,
            "width": self.width,
            "exact": self.exact,
            "wrong": self.wrong,
            "passes": self.passes,
            "remarks": list(self.remarks),
        }


@dataclass(frozen=True, slots=True)
class Message:
    """Number of sensors of one condition with the same error or warning but for its numbers, and one of the texts."""

    sensors: int
    example: str


@dataclass(frozen=True)
class CoverageStudy:
    """Coverage by condition and parameter, where at least one sensor has an estimate; failed calibrations and warnings
    by condition, grouped by text; sensors with each of the reported effects by condition; and the number of virtual
    sensors per condition."""

    rows: tuple[Coverage, ...]
    refused: Mapping[str, tuple[Message, ...]]
    warnings: Mapping[str, tuple[Message, ...]]
    effects: Mapping[str, Mapping[str, int]]
    sensors: int

    def to_dict(self) -> dict[str, Any]:
        """Return the content that `photosite reproduce coverage --json` prints."""
        return {
            "sensors_per_condition": self.sensors,
            "false_alarm_probability": FALSE_ALARM,
            "parameters_outside": sum(not row.passes for row in self.rows),
            "conditions": {
                name: {
                    "summary": CONDITIONS[name].summary,
                    "parameters": {row.parameter: row.to_dict() for row in self.rows if row.condition == name},
                    "refused": sum(entry.sensors for entry in self.refused.get(name, ())),
                    "why_refused": [asdict(entry) for entry in self.refused.get(name, ())],
                    "warnings": [asdict(entry) for entry in self.warnings.get(name, ())],
                    "effects": dict(self.effects.get(name, {})),
                }
                for name in self.conditions
            },
        }

    @property
    def conditions(self) -> list[str]:
        """The conditions that were studied."""
        return list(dict.fromkeys([*(row.condition for row in self.rows), *self.refused]))

    def markdown(self) -> str:
        """Return the tables of the documentation: parameters of some conditions each, and what was reported."""
        lines = []
        for first in range(0, len(self.conditions), _COLUMNS):
            names = self.conditions[first : first + _COLUMNS]
            rows = {(row.parameter, row.condition): row for row in self.rows if row.condition in names}
            lines += [
                "| parameter | " + " | ".join(f"`{name}`" for name in names) + " |",
                "|---" * (len(names) + 1) + "|",
            ]
            for parameter in dict.fromkeys(parameter for parameter, _ in rows):
                cells = (_cell(rows.get((parameter, name)), self.sensors) for name in names)
                lines.append(f"| `{parameter}` | " + " | ".join(cells) + " |")
            lines.append("")
        lines += ["| condition | refused | with a warning | effects reported, in sensors |", "|---|---|---|---|"]
        for name in self.conditions:
            effects = dict(self.effects.get(name, {}))
            warned = effects.pop("warnings", 0)
            reported = ", ".join(f"{effect} {count}" for effect, count in effects.items())
            lines.append(f"| `{name}` | {sum(m.sensors for m in self.refused.get(name, ()))} | {warned} | {reported} |")
        return "\n".join(lines) + "\n"


def _cell(row: Coverage | None, sensors: int) -> str:
    """Return coverage and mean error for a table, bold where flagged, and the sensors with an estimate if not all."""
    if row is None:
        return ""
    counted = row.estimated - row.exact
    text = f"{100 * row.covered:.1f} {row.bias:+.2f}".replace("-", "\N{MINUS SIGN}") if counted else "exact"
    text += "" if row.estimated == sensors else f" ({row.estimated})"
    return text if row.passes else f"**{text}**"


def coverage_study(
    names: Sequence[str] = (),
    *,
    sensors: int = 500,
    processes: int | None = 2,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> CoverageStudy:
    """Measure many virtual sensors under each condition and count the intervals that contain the truth.

    Parameters
    ----------
    names
        Conditions; all of `CONDITIONS` by default.
    sensors
        Virtual sensors per condition. The standard error of a coverage of 95 % is 1 % with 500 sensors.
    processes, scheduler
        Number of local processes, or address of a Dask scheduler, as for `run_tasks`; the result does not depend on it.
    progress
        Called as sensors are done.

    Raises
    ------
    InputError
        If a condition is unknown, a number is below 1, or there is no scheduler.
    WorkerError
        If workers die.
    """
    chosen = [condition(name).name for name in names or CONDITIONS]
    if sensors < 1:
        raise InputError("sensors", value=sensors, expected="1 or more")
    batches = [range(first, min(first + _BATCH, sensors)) for first in range(0, sensors, _BATCH)]
    tasks = [(name, batch) for name in chosen for batch in batches]
    found: dict[str, dict[str, list[Outcome | str]]] = {name: {} for name in chosen}
    refused: dict[str, list[str]] = {name: [] for name in chosen}
    warned: dict[str, list[str]] = {name: [] for name in chosen}
    seen: dict[str, Counter[str]] = {name: Counter() for name in chosen}
    done = 0
    completed = run_tasks(_measure_batch, tasks, processes=processes, scheduler=scheduler, name=_task_name)
    for (name, batch), results in zip(tasks, in_order(completed), strict=True):
        for result in results:
            if isinstance(result, str):
                refused[name].append(result)
                continue
            measured, warnings, effects = result
            warned[name].extend(warnings)
            seen[name].update(effects)
            for parameter, entry in measured.items():
                found[name].setdefault(parameter, []).append(entry)
        done += len(batch)
        if progress is not None:
            progress(done, len(chosen) * sensors)
    rows = []
    for name, parameters in found.items():
        for parameter, entries in parameters.items():
            known = [entry for entry in entries if isinstance(entry, Outcome)]
            reasons = [entry for entry in entries if isinstance(entry, str)]
            if known:
                rows.append(_row(name, parameter, known, reasons))
    failed = {name: _grouped(texts) for name, texts in refused.items() if texts}
    return CoverageStudy(
        tuple(rows),
        failed,
        {name: _grouped(texts) for name, texts in warned.items() if texts},
        {name: dict(sorted(effects.items())) for name, effects in seen.items()},
        sensors,
    )


def _grouped(texts: Sequence[str]) -> tuple[Message, ...]:
    """Group texts that differ in numbers and sensor names only, the most frequent first."""
    kinds: dict[str, list[str]] = {}
    for text in texts:
        kind = re.sub(r"[\d.e+-]*\d", "#", text.partition("clipped at 0 DN: ")[2] or text)
        kinds.setdefault(kind, []).append(text)
    groups = sorted(kinds.values(), key=len, reverse=True)
    return tuple(Message(len(group), group[0]) for group in groups)


_Result = tuple[Outcomes, tuple[str, ...], tuple[str, ...]] | str
"""Of one sensor: by parameter, its outcome, or the reason for a missing estimate, the warnings and the reported
effects; or why the calibration failed."""


def _task_name(task: tuple[str, Sequence[int]]) -> str:
    name, numbers = task
    return f"{name}, sensors {numbers[0]} to {numbers[-1]}"


def _measure_batch(task: tuple[str, Sequence[int]]) -> list[_Result]:
    name, numbers = task
    with threads_for(1):  # a second thread does not pay for itself on small chips
        return [measure_sensor(CONDITIONS[name].lab(number), maps=CONDITIONS[name].maps) for number in numbers]


def measure_sensor(lab: VirtualLab | DisturbedLab, *, maps: bool = False) -> _Result:
    """Shoot and calibrate one virtual sensor, with the maps of its chip if wanted, and compare with the truth."""
    try:
        if isinstance(lab, DisturbedLab):
            calibration = calibrate_setting(lab.frame_set(), maps=maps)
            outcomes = compare(calibration, lab.truth(calibration))
            return outcomes, tuple(calibration.warnings), reported_effects(calibration)
        sensor = lab.camera.sensor
        if sensor.captures is not None:
            return _measure_captures(lab)
        for name, study, _ in stated_effects(sensor):
            if study.measure is not None:
                outcomes, warnings = study.measure(lab)
                return {f"{name}.{each}": entry for each, entry in outcomes.items()}, warnings, (name,)
        calibration = calibrate_setting(lab.frame_set(), maps=maps)
    except CalibrationError as error:
        return str(error)
    outcomes = compare(calibration, measured_truth(lab, calibration)) | effect_outcomes(calibration.findings, sensor)
    return outcomes, tuple(calibration.warnings), reported_effects(calibration)


def reported_effects(calibration: Calibration) -> tuple[str, ...]:
    """Return the names of the effects that a calibration finds, and "warnings" if it has any."""
    findings = calibration.findings.items()
    found = [name for name, entry in findings if not isinstance(entry, Missing) and entry.present]
    return (*found, "warnings") if calibration.warnings else tuple(found)


def _measure_captures(lab: VirtualLab) -> _Result:
    """Shoot and calibrate the captures of one virtual sensor; compare gain, read noise and ratios with the truth."""
    sensor, captures = lab.camera.sensor, captures_of(lab.camera.sensor)
    taken: dict[str, list[tuple[Any, float, Any]]] = {name: [] for name in captures.names}
    output = []
    for _, step, raw in lab.frames():
        output.append((step.kind, step.exposure_s, raw.dn))
        for name, dn in raw.captures.items():
            taken[name].append((step.kind, step.exposure_s, dn))
    bits = sensor.readout.bits
    found = calibrate_captures({name: FrameSet.from_arrays(each, bits=bits) for name, each in taken.items()})
    together = calibrate_combined(FrameSet.from_arrays(output, bits=sensor.output_bits))
    gains = {name: part_sensor(sensor, name).system_gain_dn_per_e for name in captures.names}
    first, *others = captures.names
    outcomes: Outcomes = {}
    for name, calibration in found.captures.items():
        truth = true_parameters(part_sensor(sensor, name))
        truth = {parameter: truth[parameter] for parameter in ("system_gain_dn_per_e", "read_noise_e")}
        outcomes |= {f"{name}_{parameter}": each for parameter, each in compare(calibration, truth).items()}
    for name in others:
        ratio = captures.light(name) / captures.light(first)
        signal, electrons = found.signal_ratio[name], found.sensitivity_ratio[name]
        outcomes[f"{name}_signal_ratio"] = compare_estimate(signal, ratio * gains[name] / gains[first])
        outcomes[f"{name}_sensitivity_ratio"] = compare_estimate(electrons, ratio)
    outcomes |= _compare_combined(together, sensor)
    calibrations = found.captures.values()
    effects = dict.fromkeys(effect for each in calibrations for effect in reported_effects(each))
    return outcomes, tuple(text for each in calibrations for text in each.warnings), tuple(effects)


def _compare_combined(found: CombinedCalibration, sensor: Sensor) -> Outcomes:
    """Compare what combined frames show of the first and the last capture, and of the last knee, with the truth."""
    captures = captures_of(sensor)
    first, *_, before, last = captures.names
    per_e = captures.combination.dn_per_e.value
    light = {name: captures.light(name) for name in captures.names}
    one = part_sensor(sensor, first)
    read_e = one.electrons(one.noise.read_noise_mv.value)
    if found.captures[0].system_gain_dn_per_e.value is None:  # the quantization of the converter is a part of it
        read_e = math.hypot(read_e, math.sqrt(QUANTIZATION_DN2) / one.system_gain_dn_per_e)
    scale = capture_scale(sensor, before)
    knee_dn = captures.combination.switch_percent / 100.0 * scale.saturation_dn / scale.dn_per_light_e * per_e
    outcomes = {
        "combined_output_gain_dn_per_e": compare_estimate(found.captures[0].output_gain_dn_per_e, per_e / light[first]),
        "combined_read_noise_e": compare_estimate(found.captures[0].read_noise_e, read_e),
    }
    ratio = found.captures[-1].sensitivity_ratio
    if ratio is None or ratio.value is None or ratio.value > 0.7:
        return {**outcomes, "combined_sensitivity_ratio": "no knee"}
    last_gain = found.captures[-1].output_gain_dn_per_e
    return {
        **outcomes,
        "combined_sensitivity_ratio": compare_estimate(ratio, light[last] / light[first]),
        "combined_last_output_gain_dn_per_e": compare_estimate(last_gain, per_e / light[last]),
        "combined_knee_dn": compare_estimate(found.knees[-1].signal_dn, knee_dn),
    }


def compare(calibration: Calibration, truth: Mapping[str, float]) -> Outcomes:
    """Compare each estimate with its truth; parameters without a true value are left out."""
    return compare_estimates(calibration.estimates(), truth)


def _row(name: str, parameter: str, outcomes: Sequence[Outcome], reasons: Sequence[str]) -> Coverage:
    exact = [entry for entry in outcomes if entry.standard_uncertainty == 0.0]
    known = [entry for entry in outcomes if entry.standard_uncertainty > 0.0]
    n = max(len(known), 1)
    uncertainty = math.fsum(entry.standard_uncertainty / entry.scale for entry in known)
    bias = math.fsum(entry.error / entry.scale for entry in known) / uncertainty if known else 0.0
    # Standard error of a ratio of two means: its residuals are error - bias * uncertainty.
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
