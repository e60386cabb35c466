"""Coverage of the 95 % intervals: many virtual sensors are drawn, shot and calibrated, and compared with the truth."""

from __future__ import annotations

import math
import re
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from photosite.calibration.captures.combined import CombinedCalibration, calibrate_combined
from photosite.calibration.captures.each_capture import calibrate_captures
from photosite.calibration.result import Calibration
from photosite.calibration.setting import calibrate_setting
from photosite.engine.jit import threads_for
from photosite.engine.workers import in_order, run_tasks
from photosite.errors import CalibrationError, InputError, did_you_mean
from photosite.frames.frame_set import FrameSet
from photosite.sensor.capture_readout import capture_scale, captures_of, part_sensor
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.studies import disturbed_lab
from photosite.studies.disturbed_lab import DisturbedLab, Draw
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.truth import measured_truth, true_parameters
from photosite.studies.virtual_lab import VirtualLab, virtual_lab
from photosite.values.cfa import cfa_from, channel_names
from photosite.values.estimate import Estimate

NOMINAL_COVERAGE = 0.95
"""Share of the intervals that should contain the truth."""

LARGEST_BIAS = 0.1
"""Largest acceptable mean error, relative to the standard uncertainty."""

FALSE_ALARM = 1e-3
"""Probability that correct intervals are flagged for their coverage, and again for their mean error."""

_BATCH = 10
_ROUNDING = 1e-9
"""Relative tolerance for exact values, such as the full scale of an ideal converter."""

Progress = Callable[[int, int], None]
"""Called with (sensors done, sensors in total)."""

Range = tuple[float, float]
"""Lowest and highest value; the logarithm is drawn uniformly between them."""

SHORTEST_S, LONGEST_FLAT_S, LONGEST_WIDE_S = 1e-4, 0.05, 0.5
_EFFICIENCY = {"M": 0.5, "R": 0.35, "G": 0.5, "B": 0.3}
"""Quantum efficiency of each channel; sensors vary by 10 %."""

_GOLDEN_RATIO = 0.6180339887498949
"""Its multiples modulo 1 fill the unit interval evenly."""

_SILVER_RATIO = 0.41421356237309505
"""Likewise, independently of the golden ratio's."""


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


@dataclass(frozen=True, slots=True)
class Coverage:
    """Coverage of one parameter under one condition.

    Exact estimates (uncertainty 0) count neither in bias nor in width.
    """

    condition: str
    parameter: str
    sensors: int
    estimated: int  # sensors with an estimate
    covered: float  # share of the uncertain estimates whose 95 % interval contains the truth
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
                for name in dict.fromkeys([*(row.condition for row in self.rows), *self.refused])
            },
        }


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
            outcomes, warnings, effects = result
            warned[name].extend(warnings)
            seen[name].update(effects)
            for parameter, outcome in outcomes.items():
                found[name].setdefault(parameter, []).append(outcome)
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


_Result = tuple[dict[str, Outcome | str], tuple[str, ...], tuple[str, ...]] | str
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
    if isinstance(lab, VirtualLab) and lab.camera.sensor.captures is not None:
        return _measure_captures(lab)
    try:
        calibration = calibrate_setting(lab.frame_set(), maps=maps)
    except CalibrationError as error:
        return str(error)
    if isinstance(lab, DisturbedLab):
        outcomes = compare(calibration, lab.truth(calibration))
    else:
        outcomes = compare(calibration, measured_truth(lab, calibration))
        for compare_effect in (_compare_curve, _compare_channels, _compare_noise):
            outcomes |= compare_effect(calibration, lab.camera.sensor)
    return outcomes, tuple(calibration.warnings), reported_effects(calibration)


def reported_effects(calibration: Calibration) -> tuple[str, ...]:
    """Return the names of the effects that a calibration reports.

    Spreads, such as the noise of rows, count where they are `beyond_chance`.
    """
    temporal = calibration.temporal
    found = {
        "response curve": bool(calibration.response_curve),
        "readout channels": calibration.readout_channels is not None,
        "interpixel coupling": calibration.coupling is not None and calibration.coupling.seen,
        "flicker": calibration.flicker is not None,
        "row noise": calibration.row_noise_dn.beyond_chance,
        "column noise": calibration.column_noise_dn.beyond_chance,
        "read noise spread": temporal is not None and temporal.read_noise_log_spread.beyond_chance,
        "blinking pixels": temporal is not None and temporal.blinking_fraction.value is not None,
        "warnings": bool(calibration.warnings),
    }
    return tuple(name for name, reported in found.items() if reported)


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
    try:
        found = calibrate_captures({name: FrameSet.from_arrays(each, bits=bits) for name, each in taken.items()})
        together = calibrate_combined(FrameSet.from_arrays(output, bits=sensor.output_bits))
    except CalibrationError as error:
        return str(error)
    gains = {name: part_sensor(sensor, name).system_gain_dn_per_e for name in captures.names}
    first, *others = captures.names
    outcomes: dict[str, Outcome | str] = {}
    for name, calibration in found.captures.items():
        truth = true_parameters(part_sensor(sensor, name))
        truth = {parameter: truth[parameter] for parameter in ("system_gain_dn_per_e", "read_noise_e")}
        outcomes |= {f"{name}_{parameter}": each for parameter, each in compare(calibration, truth).items()}
    for name in others:
        ratio = captures.light(name) / captures.light(first)
        signal, electrons = found.signal_ratio[name], found.sensitivity_ratio[name]
        outcomes[f"{name}_signal_ratio"] = _outcome(signal, ratio * gains[name] / gains[first])
        outcomes[f"{name}_sensitivity_ratio"] = _outcome(electrons, ratio)
    outcomes |= _compare_combined(together, sensor)
    calibrations = found.captures.values()
    effects = dict.fromkeys(effect for each in calibrations for effect in reported_effects(each))
    return outcomes, tuple(text for each in calibrations for text in each.warnings), tuple(effects)


def _compare_combined(found: CombinedCalibration, sensor: Sensor) -> dict[str, Outcome | str]:
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
        "combined_output_gain_dn_per_e": _outcome(found.captures[0].output_gain_dn_per_e, per_e / light[first]),
        "combined_read_noise_e": _outcome(found.captures[0].read_noise_e, read_e),
    }
    ratio = found.captures[-1].sensitivity_ratio
    if ratio is None or ratio.value is None or ratio.value > 0.7:
        return {**outcomes, "combined_sensitivity_ratio": "no knee"}
    last_gain = found.captures[-1].output_gain_dn_per_e
    return {
        **outcomes,
        "combined_sensitivity_ratio": _outcome(ratio, light[last] / light[first]),
        "combined_last_output_gain_dn_per_e": _outcome(last_gain, per_e / light[last]),
        "combined_knee_dn": _outcome(found.knees[-1].signal_dn, knee_dn),
    }


def _compare_curve(calibration: Calibration, sensor: Sensor) -> dict[str, Outcome | str]:
    """Compare the deviation of the response at half and at the largest signal below saturation with the truth."""
    if sensor.effects is None or (curve := sensor.effects.response_curve) is None:
        return {}
    result: dict[str, Outcome | str] = {}
    gain = sensor.system_gain_dn_per_e
    for found in calibration.response_curve.values():
        full = 0.9 * sensor.saturation_capacity_e * gain
        for name, share in (("half", 0.5), ("full", 1.0)):
            level = int(np.argmin(np.abs(found.signal_dn - share * full)))
            signal_e = float(found.signal_dn[level]) / gain
            true = 100.0 * (signal_e / curve.charge_at(signal_e, sensor.pixel.well_capacity_e.value) - 1.0)
            entry = found.deviation_percent[level]
            low, high = entry.interval_95
            covered = low <= true <= high
            result[f"response_curve_{name}_percent"] = Outcome(
                entry.value - true, entry.standard_uncertainty, abs(true), covered
            )
    return result


def _compare_channels(calibration: Calibration, sensor: Sensor) -> dict[str, Outcome | str]:
    """Compare the gain of the first readout channel with the truth."""
    if sensor.effects is None or (true := sensor.effects.readout_channels) is None or true.relative_gain is None:
        return {}
    found = calibration.readout_channels
    if found is None or found.relative_gain is None or found.arrangement != true.arrangement:
        return {"readout_channel_gain": "not found"}
    entry, expected = found.relative_gain[0][0], true.relative_gain[0][0].value
    low, high = entry.interval_95
    return {
        "readout_channel_gain": Outcome(
            entry.value - expected, entry.standard_uncertainty, abs(expected - 1.0), low <= expected <= high
        )
    }


def _compare_noise(calibration: Calibration, sensor: Sensor) -> dict[str, Outcome | str]:
    """Compare the distribution of the read noise over the pixels with the truth."""
    if calibration.temporal is None or sensor.effects is None:
        return {}
    truth: dict[str, float] = {}
    if (spread := sensor.effects.read_noise_spread) is not None and spread.log_spread is not None:
        truth["read_noise_log_spread"] = spread.log_spread
    if (telegraph := sensor.effects.telegraph_noise) is not None:
        truth["blinking_fraction"] = telegraph.fraction
        truth["blinking_amplitude_dn"] = telegraph.amplitude_e * sensor.system_gain_dn_per_e
    return _outcomes({name: getattr(calibration.temporal, name) for name in truth}, truth)


def compare(calibration: Calibration, truth: Mapping[str, float]) -> dict[str, Outcome | str]:
    """Compare each estimate with its truth; parameters without a true value are left out."""
    return _outcomes(calibration.estimates(), truth)


def _outcomes(estimates: Mapping[str, Estimate], truth: Mapping[str, float]) -> dict[str, Outcome | str]:
    result: dict[str, Outcome | str] = {}
    for name, entry in estimates.items():
        if name not in truth:
            continue
        result[name] = _outcome(entry, truth[name])
    return result


def _outcome(entry: Estimate, truth: float) -> Outcome | str:
    """Compare an estimate with the truth; return the reason where it has no value."""
    if entry.value is None or entry.standard_uncertainty is None or entry.interval_95 is None:
        return entry.reason or ""
    low, high = entry.interval_95
    slack = _ROUNDING * abs(truth)
    covered = low - slack <= truth <= high + slack
    return Outcome(entry.value - truth, entry.standard_uncertainty, abs(truth) or 1.0, covered)


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


# Conditions of the coverage study: families of virtual sensors, and the protocol that measures them.


@dataclass(frozen=True)
class Condition:
    """A family of virtual sensors and the protocol that measures each of them."""

    name: str
    summary: str
    cfa: str  # name of the tile
    bits: int
    rows: int
    cols: int
    gain_dn_per_e: Range
    read_noise_dn: Range
    level: float  # signal of the brightest flat field, relative to saturation of the brightest channel; varies by 8 %
    protocol: ShootingProtocol
    black_sigma: float = 10.0  # black level in standard deviations of a dark frame (read noise and DSNU)
    photons_known: bool = False  # whether the light is metered
    lines: Range | None = None  # noise of rows, and of columns, over the read noise
    bend_percent: Range | None = None  # deviation of the response at the well capacity, of either sign, cubic
    coupling_percent: Range | None = None  # interpixel capacitance; a tenth of it to the diagonal neighbors
    channels_percent: Range | None = None  # difference of the gains of odd and even columns
    uneven: bool = False  # whether the read noise differs between pixels, some of which blink
    maps: bool = False  # whether the maps of the chip are measured, too
    captures: bool = False  # a charge read with two gains, and a smaller photodiode
    pattern: Range | None = None  # fixed offsets of rows and of columns over the DSNU, gains of columns in percent
    disturbed: Draw | None = None  # what disturbs the frames, which a plain camera then makes

    def sensor(self, number: int) -> Sensor:
        """Return a sensor with all parameters drawn from its number.

        Saturation of even numbers is limited by the converter, of odd numbers by the well.
        """
        rng = np.random.default_rng([zlib.crc32(self.name.encode()), number])

        def between(low: float, high: float) -> float:
            return float(low * (high / low) ** rng.random())

        gain, read_dn = between(*self.gain_dn_per_e), between(*self.read_noise_dn)
        swing_v, analog_gain = 1.0, between(1.0, 3.0)
        mv_per_dn = 1e3 * swing_v / (analog_gain * 2**self.bits)
        dsnu_dn = read_dn * between(0.3, 1.5)
        black = self.black_sigma * float(np.hypot(read_dn, dsnu_dn))
        range_e = (2**self.bits - 1 - black) / gain
        well_e = float(round(range_e * (0.8 if number % 2 else 1.5)))
        tile = cfa_from(self.cfa)
        captures = {"captures": _captures(between, read_dn / gain)} if self.captures else {}
        return Sensor.model_validate(
            {
                **captures,
                "name": f"{self.name}, sensor {number}",
                "serial": f"{self.name}, chip {number}",
                "array": {"rows": self.rows, "cols": self.cols, "cfa": tile},
                "pixel": {
                    "width_um": 5.0,
                    "height_um": 5.0,
                    "fill_factor": 0.8,
                    "conversion_gain_uv_per_e": gain * mv_per_dn * 1e3,
                    "voltage_swing_v": swing_v,
                    "well_capacity_e": well_e,
                },
                "channels": {
                    name: {
                        "wavelength_nm": (380.0, 780.0),
                        "quantum_efficiency": (_EFFICIENCY[name] * between(0.9, 1.1),) * 2,
                    }
                    for name in channel_names(tile)
                },
                "noise": {
                    "read_noise_mv": read_dn * mv_per_dn,
                    **({} if self.lines is None else _line_noise(read_dn * mv_per_dn, between, self.lines)),
                    "dsnu_mv": dsnu_dn * mv_per_dn,
                    "prnu_percent": between(0.5, 2.0),
                    "dark_voltage_mv_per_s": between(10.0, 100.0) * gain * mv_per_dn,
                    "dcnu_percent": between(10.0, 50.0),
                },
                "readout": {"bits": self.bits, "analog_gain": analog_gain, "black_level_dn": black},
                "effects": self._effects(between, number, read_dn / gain, dsnu_dn / gain),
            }
        )

    def _effects(
        self, between: Callable[[float, float], float], number: int, read_e: float, dsnu_e: float
    ) -> dict[str, Any] | None:
        """Return the section of effects; None without any."""
        effects: dict[str, Any] = {}
        sign = 1.0 if number // 2 % 2 else -1.0
        if self.bend_percent is not None:
            effects["response_curve"] = {"polynomial_percent": (0.0, sign * between(*self.bend_percent))}
        if self.channels_percent is not None:
            half = sign * between(*self.channels_percent) / 200.0
            effects["readout_channels"] = {"relative_gain": [[1.0 + half, 1.0 - half]]}
        if self.uneven:
            effects["read_noise_spread"] = {"log_spread": between(0.1, 0.4)}
            effects["telegraph_noise"] = {"fraction": between(0.02, 0.1), "amplitude_e": read_e * between(1.0, 10.0)}
        if self.pattern is not None:
            offsets = {f"{line}_offset_e": between(*self.pattern) * dsnu_e for line in ("row", "column")}
            effects["line_pattern"] = offsets | {"column_gain_percent": between(*self.pattern)}
        if self.coupling_percent is not None:
            share = between(*self.coupling_percent)
            effects["interpixel_capacitance"] = {"coupling_percent": share, "diagonal_percent": 0.1 * share}
        return effects or None

    def lab(self, number: int) -> VirtualLab | DisturbedLab:
        """Return the laboratory that measures a sensor."""
        # The light level varies, so that saturation falls anywhere between two exposures.
        level = self.level * (0.92 + 0.16 * ((number * _GOLDEN_RATIO) % 1.0))
        sensor = self.sensor(number)
        if sensor.captures is not None:  # to the saturation of the least sensitive capture
            last = part_sensor(sensor, sensor.captures.names[-1])
            level *= last.saturation_capacity_e / sensor.saturation_capacity_e / sensor.captures.light("small")
        if self.disturbed is None:
            return virtual_lab(sensor, self.protocol, level=level, seed=number, photons_known=self.photons_known)
        effect, factors = self.disturbed(sensor, np.random.default_rng([number]))
        return DisturbedLab(sensor, self.protocol, level, effect, factors, seed=zlib.crc32(self.name.encode()) + number)


def _line_noise(read_mv: float, between: Callable[[float, float], float], share: Range) -> dict[str, float]:
    return {name: read_mv * between(*share) for name in ("row_noise_mv", "column_noise_mv")}


def _captures(between: Callable[[float, float], float], read_noise_e: float) -> dict[str, Any]:
    """Return the section of captures: one charge with a high and a low gain, and a small photodiode."""
    low = {"name": "low", "charge": "shared", "charge_of": "high", "relative_gain": between(0.2, 0.5)}
    small = {"name": "small", "relative_sensitivity": between(0.03, 0.3), "crosstalk": {"high": between(1e-3, 1e-2)}}
    low["read_noise_e"], small["read_noise_e"] = (read_noise_e * between(1.0, 3.0) for _ in range(2))
    return {"parts": ({"name": "high"}, low, small), "combination": {"dn_per_e": 16.0, "black_level_dn": 4096.0}}


def _protocol(
    name: str, *, darks: int, repeats: int, levels: int, flats: int, stack: int, reference_s: float = SHORTEST_S
) -> ShootingProtocol:
    """Dark frames at one exposure and in a series to 5 s, flat fields in equal steps, and a stack at 40 %."""
    times = [LONGEST_FLAT_S * (k + 1) / levels for k in range(levels)]
    half = 0.4 * LONGEST_FLAT_S
    return ShootingProtocol(
        name,
        (
            Step("dark", reference_s, darks),
            *series("dark", 0.01, 5.0, exposures=5, count=repeats),
            *(Step("light", t, flats) for t in times),
            *((Step("light", half, stack),) if stack else ()),
        ),
    )


FULL = _protocol("full", darks=24, repeats=4, levels=16, flats=4, stack=16)
WARM = _protocol("warm", darks=24, repeats=4, levels=16, flats=4, stack=16, reference_s=1.0)
WIDE = ShootingProtocol(
    "high dynamic range",
    (
        Step("dark", SHORTEST_S, 24),
        *series("dark", 0.01, 5.0, exposures=5, count=4),
        *series("light", 1e-3 * LONGEST_WIDE_S, LONGEST_WIDE_S, exposures=24, count=4),
    ),
)
FEW = _protocol("few frames", darks=4, repeats=2, levels=8, flats=2, stack=0)

_MONO, _BAYER, _LARGE, _TILES = (48, 64), (72, 88), (96, 128), (96, 120)
_PEDESTAL = "black level at 10 standard deviations of a dark frame"

CONDITIONS: dict[str, Condition] = {
    entry.name: entry
    for entry in (
        Condition(
            "bright-mono-12", f"metered flat fields to 1.25 times saturation, {_PEDESTAL}", "mono", 12, *_MONO,
            (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, maps=True,
        ),
        Condition(
            "bright-cfa-12", "flat fields to 2.5 times saturation of the green pixels", "rggb", 12, *_BAYER,
            (0.15, 1.2), (0.8, 4.0), 2.5, FULL,
        ),
        Condition(
            "quad-cfa-12", "Quad Bayer", "quad-rggb", 12, *_TILES, (0.15, 1.2), (0.8, 4.0), 2.5, FULL,
        ),
        Condition(
            "xtrans-cfa-12", "X-Trans", "x-trans", 12, *_TILES, (0.15, 1.2), (0.8, 4.0), 2.5, FULL,
        ),
        Condition(
            "bright-mono-8", "8 bits: 4000 to 12 000 electrons in 255 steps", "mono", 8, *_MONO,
            (0.02, 0.06), (0.6, 1.5), 1.25, FULL, photons_known=True,
        ),
        Condition(
            "bright-cfa-10", "10 bits", "rggb", 10, *_BAYER,
            (0.05, 0.2), (0.6, 2.0), 2.5, FULL,
        ),
        Condition(
            "bright-mono-16", "16 bits", "mono", 16, *_MONO,
            (1.0, 4.0), (3.0, 20.0), 1.25, FULL, photons_known=True,
        ),
        Condition(
            "dim-mono-12", "brightest flat field at 2 % of saturation", "mono", 12, *_MONO,
            (0.15, 1.2), (0.8, 4.0), 0.02, FULL, photons_known=True,
        ),
        Condition(
            "dim-cfa-14", "brightest flat field at 2 % of saturation of the green pixels", "rggb", 14, *_BAYER,
            (0.5, 2.0), (2.0, 8.0), 0.02, FULL,
        ),
        Condition(
            "few-mono-12", "two frames per setting, four dark frames: 30 frames in total", "mono", 12, *_MONO,
            (0.15, 1.2), (0.8, 4.0), 1.25, FEW, photons_known=True,
        ),
        Condition(
            "few-cfa-12", "two frames per setting, four dark frames: 30 frames in total", "rggb", 12, *_BAYER,
            (0.15, 1.2), (0.8, 4.0), 2.5, FEW,
        ),
        Condition(
            "warm-mono-12", "24 reference dark frames at 1 s, with 10 to 100 electrons of dark current", "mono", 12,
            *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, WARM, photons_known=True,
        ),
        Condition(
            "clipped-mono-12", "black level at one standard deviation of a dark frame: a fifth of the dark pixels at "
            "0", "mono",
            12, *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, black_sigma=1.0, photons_known=True,
        ),
        Condition(
            "bent-mono-12", "response bent by 0.5 to 10 % at saturation, of either sign, second to fourth power",
            "mono",
            12, *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, disturbed=disturbed_lab.bend,
        ),
        Condition(
            "curve-mono-12", "response bent by 1 to 3 % at the well capacity, of either sign, third power; 144 x 192 "
            "pixels", "mono",
            12, 144, 192, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, bend_percent=(1.0, 3.0),
        ),
        Condition(
            "curve-level-mono-12", "the same at saturation, and light of one level 4 % off the stated one; 144 x 192 "
            "pixels", "mono",
            12, 144, 192, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True,
            disturbed=disturbed_lab.bend_and_wrong_level,
        ),
        Condition(
            "channels-mono-12", "gains of odd and even columns that differ by 1 to 4 %; 192 x 256 pixels", "mono",
            12, 192, 256, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, channels_percent=(1.0, 4.0),
        ),
        Condition(
            "pattern-mono-12", "fixed offsets of rows and columns of 0.1 to 1 times the DSNU, gains of columns of 0.1 "
            "to 1 %", "mono",
            12, *_LARGE, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, pattern=(0.1, 1.0),
        ),
        Condition(
            "crosstalk-mono-12", "crosstalk of 0.5 to 3 % of the charge to each next pixel", "mono",
            12, *_LARGE, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, disturbed=disturbed_lab.crosstalk,
        ),
        Condition(
            "coupled-mono-12", "interpixel capacitance of 0.3 to 2 % to each next pixel", "mono",
            12, *_LARGE, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, coupling_percent=(0.3, 2.0),
        ),
        Condition(
            "coupled-cfa-12", "the same; 192 x 256 pixels", "rggb", 12, 192, 256, (0.15, 1.2), (0.8, 4.0), 2.5, FULL,
            coupling_percent=(0.3, 2.0),
        ),
        Condition(
            "uneven-mono-12", "read noise with a log-normal spread of 0.1 to 0.4, and 2 to 10 % blinking pixels; black "
            "level at 30 standard deviations of a dark frame without them",
            "mono", 12, *_LARGE, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, uneven=True,
            maps=True, black_sigma=30.0,
        ),
        Condition(
            "flicker-mono-12", "flicker of the light: bands of 0.2 to 2 %, with a period of 10 to 40 rows", "mono",
            12, *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, disturbed=disturbed_lab.flicker,
        ),
        Condition(
            "rows-mono-12", "row noise of 0.1 to 1 times the read noise", "mono",
            12, *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, disturbed=disturbed_lab.row_noise,
        ),
        Condition(
            "lines-mono-12", "row noise and column noise of 0.05 to 0.6 times the read noise", "mono",
            12, *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, lines=(0.05, 0.6),
        ),
        Condition(
            "lines-cfa-12", "the same", "rggb", 12, *_BAYER, (0.15, 1.2), (0.8, 4.0), 2.5, FULL, lines=(0.05, 0.6),
        ),
        Condition(
            "hot-mono-12", "0.3 to 1 % hot pixels with 100 to 500 e-/s", "mono",
            12, *_LARGE, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, disturbed=disturbed_lab.hot_pixels,
        ),
        Condition(
            "shaded-mono-12", "corners 2 to 20 % darker than the center", "mono",
            12, *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, disturbed=disturbed_lab.shading,
        ),
        Condition(
            "level-mono-12", "light of one level 1 to 10 % off the stated one", "mono",
            12, *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, FULL, photons_known=True, disturbed=disturbed_lab.wrong_level,
        ),
        Condition(
            "captures-mono-12", "three captures: a charge read with two gains, and a photodiode of 3 to 30 % of the "
            "response; 24 levels in equal ratios", "mono",
            12, *_MONO, (0.15, 1.2), (0.8, 4.0), 1.25, WIDE, captures=True,
        ),
    )
}  # fmt: skip
"""All conditions by name."""


def condition(name: str) -> Condition:
    """Return a condition by name.

    Raises
    ------
    InputError
        If the name is unknown.

    Examples
    --------
    >>> condition("few-mono-12").protocol.frame_count, condition("bright-mono-8").sensor(3).readout.bits
    (30, 8)
    """
    if name not in CONDITIONS:
        raise InputError("condition", value=name, expected="a known name", hint=did_you_mean(name, CONDITIONS))
    return CONDITIONS[name]
