"""Several gain settings in one measurement: each calibrated, then what they say together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.calibrate import calibrate
from photosite.calibration.gain_series.gain_law import (
    FEWEST_SETTINGS,
    LawName,
    ReadNoise,
    StepTest,
    Switch,
    find_law,
    find_switch,
    log_amplification,
    step_in_gain,
    step_in_read_noise,
)
from photosite.calibration.gain_series.result import ConversionGainSwitch, GainMode, GainSeries, GainStep
from photosite.calibration.parameters import Parameters
from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.reduction.frame_reader import Progress
from photosite.calibration.spatial.spread import spread, spread_interval_95, upper_limit_95
from photosite.errors import CalibrationError
from photosite.frames.frame_set import FrameSet
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.measured import COVERAGE_95, Measured
from photosite.values.uncertain import Uncertain, correlated

_AT_THE_PIXEL = ("read_noise_mv", "dsnu_mv", "dark_voltage_mv_per_s", "conversion_gain_uv_per_e")
"""What is counted in volts at the pixel: inverse to the analog gain."""


def calibrate_series(
    frames: FrameSet,
    sensor: Sensor | None = None,
    progress: Progress | None = None,
    *,
    partial: str | PathLike[str] | None = None,
) -> GainSeries:
    """Calibrate every gain setting of a measurement, and find what they share.

    Per setting: all that `calibrate` gives. Of all together: whether and where the pixel's conversion gain switches
    (`photosite.calibration.gain_series.gain_law.find_switch`: false alarms in at most 1 % of series), the read noise
    before and
    after the amplifier for each conversion gain, and the setting of one digital number per electron.

    Parameters
    ----------
    frames
        Darks and flats at two gain settings or more, each of which could be calibrated by itself.
    sensor
        What is known beforehand; `frames.sensor` if None. Its analog gain is taken as that of the lowest setting, and
        those of the others as what the settings say.
    progress
        As for `calibrate`, over all settings.
    partial
        As for `calibrate`: a folder, which gets one for each setting.

    Raises
    ------
    CalibrationError
        If there are fewer than two settings, frames without one, or frames of a setting that cannot be calibrated.
    FileError
        If a frame cannot be read.
    InputError
        If `sensor` cannot have taken these frames.
    """
    settings = frames.gain_settings
    if len(settings) < 2:
        raise CalibrationError(
            f"{frames.source}: a gain series has two gain settings or more, these frames have one; "
            f"calibrate takes them, or state each frame's gain_setting in the protocol"
        )
    stated = [setting for setting in settings if setting is not None]
    if len(stated) < len(settings):
        raise CalibrationError(
            f"{frames.source}: some frames state no gain setting and some do; state it for all, in the protocol"
        )
    base = sensor if sensor is not None else frames.sensor
    count = _Count(frames.frame_count, progress)
    steps = []
    for setting in stated:
        part = frames.at_gain(setting)
        sums = None if partial is None else Path(partial) / f"gain{setting:g}"
        steps.append(GainStep(setting, calibrate(part, base, progress=count.of(part.frame_count), partial=sums)))
    return analyse_series(steps, base, frames.source)


class _Count:
    """Progress over settings: frames done before, and what a setting adds by reading frames again."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self.done, self.total, self.progress = 0, total, progress

    def of(self, frames: int) -> Progress | None:
        report = self.progress
        if report is None:
            return None
        before, planned = self.done, self.total

        def progress(done: int, expected: int) -> None:
            self.done, self.total = before + done, planned - frames + expected
            report(self.done, self.total)

        return progress


def analyse_series(steps: Sequence[GainStep], base: Sensor | None = None, source: str = "") -> GainSeries:
    """What calibrated settings say together; `steps` in rising order."""
    warnings = [f"gain setting {step.setting:g}: {text}" for step in steps for text in step.calibration.warnings]
    known = [step for step in steps if step.calibration.system_gain_dn_per_e.value is not None]
    if len(known) < 2:
        reasons = "; ".join(sorted({step.calibration.system_gain_dn_per_e.reason or "" for step in steps} - {""}))
        raise CalibrationError(f"{source}: fewer than two gain settings have a system gain: {reasons}")
    if len(known) < len(steps):
        left = ", ".join(f"{step.setting:g}" for step in steps if step not in known)
        warnings.append(f"no system gain at setting {left}: left out of what is said of all settings")
    settings = np.array([step.setting for step in known])
    gain, u_gain = _values(known, "system_gain_dn_per_e")
    law = find_law(settings, gain)
    amplification = log_amplification(settings, law)
    rest = np.log(gain) - amplification
    noise = _read_noise(known, gain, u_gain)
    gain_step = step_in_gain(rest, (u_gain / gain) ** 2) if len(known) >= FEWEST_SETTINGS else None
    noise_step = step_in_read_noise(noise) if noise is not None and gain_step is not None else None
    found = None if gain_step is None else find_switch(gain_step, noise_step)
    if gain_step is None:
        warnings.append(
            f"{len(known)} gain settings: from {FEWEST_SETTINGS} on a conversion-gain switch could be told from scatter"
        )
    warnings += _irregular(rest, settings, found)
    splits = [slice(0, len(known))] if found is None else [slice(0, found.split), slice(found.split, len(known))]
    modes = tuple(_mode(settings[part], noise[part] if noise is not None else None) for part in splits)
    return GainSeries(
        tuple(_at_analog_gain(step, steps[0].setting, law, base) for step in steps),
        law,
        None if found is None or gain_step is None else _switch(found, settings, gain_step, modes),
        modes,
        _unity(settings, rest, (u_gain / gain) ** 2, splits, law),
        tuple(warnings),
        source,
    )


def _values(steps: Sequence[GainStep], name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    entries = [getattr(step.calibration, name) for step in steps]
    return np.array([e.value for e in entries]), np.array([e.standard_uncertainty for e in entries])


def _read_noise(steps: Sequence[GainStep], gain: NDArray[np.float64], u_gain: NDArray[np.float64]) -> ReadNoise | None:
    """The read noise's variances; None where a setting lacks one above zero."""
    if any((step.calibration.read_noise_dn.value or 0.0) <= 0.0 for step in steps):
        return None
    value, uncertainty = _values(steps, "read_noise_dn")
    # `spread` gives the larger distance to the roots of the variance's interval ends, over 1.96: turned round.
    lower = value - COVERAGE_95 * uncertainty
    return ReadNoise(gain, u_gain, value**2, (value**2 - lower * np.abs(lower)) / COVERAGE_95)


def _mode(settings: NDArray[np.float64], noise: ReadNoise | None) -> GainMode:
    method = "read noise^2 = (pre-amplifier noise K)^2 + post-amplifier noise^2, weighted fit over the settings"
    names = tuple(float(setting) for setting in settings)
    if noise is None or len(settings) < 2:
        reason = (
            "a setting's read noise could not be told from rounding"
            if noise is None
            else "one setting at this conversion gain; its two parts need two or more"
        )
        missing = Estimate(reason=reason, method=method)
        return GainMode(names, missing, missing)
    fit = noise.two_parts()
    parts = correlated(fit.parameters, fit.covariance)
    pre, post = (Estimate.of(spread(part), method, upper_limit_95(part), spread_interval_95(part)) for part in parts)
    scatter = 100.0 * math.sqrt(fit.extra_variance)
    return GainMode(names, pre, post, fit.chi_square, fit.degrees_of_freedom, scatter)


def _switch(
    found: Switch, settings: NDArray[np.float64], gain_step: StepTest, modes: Sequence[GainMode]
) -> ConversionGainSwitch:
    def between(low: int, high: int) -> tuple[float, float]:
        return float(settings[low - 1]), float(settings[high])

    step = Uncertain.of(float(gain_step.step[found.split - 1]), float(gain_step.step_uncertainty[found.split - 1]))
    below, above = (mode.pre_amplifier_noise_e for mode in modes)
    method = "pre-amplifier noise above the switch over that below"
    ratio = Estimate(reason="the pre-amplifier noise is not known on both sides of it", method=method)
    if above.value is not None and below.value is not None and below.upper_limit_95 is None and below.value > 0:
        ratio = Estimate.of(
            Uncertain.of(above.value, above.standard_uncertainty or 0.0)
            / Uncertain.of(below.value, below.standard_uncertainty or 0.0),
            method,
        )
    return ConversionGainSwitch(
        between(found.split, found.split),
        between(found.first, found.last),
        Estimate.of(step.apply(math.exp, math.exp), "gain per unit of setting, above over below"),
        ratio,
        found.p_value,
        found.seen_in,
    )


def _irregular(rest: NDArray[np.float64], settings: NDArray[np.float64], found: Switch | None) -> list[str]:
    """Settings whose gain is far from what the setting says, a tenth of the gain or more."""
    split = len(rest) if found is None else found.split
    notes = []
    for part in (slice(0, split), slice(split, len(rest))):
        if len(rest[part]) < 3:
            continue
        off = np.exp(rest[part] - np.median(rest[part])) - 1.0
        notes += [
            f"gain setting {setting:g}: its system gain is {100 * share:+.0f} % off what the others' settings say"
            for setting, share in zip(settings[part], off, strict=True)
            if abs(share) > 0.1
        ]
    return notes


def _unity(
    settings: NDArray[np.float64],
    rest: NDArray[np.float64],
    variance: NDArray[np.float64],
    splits: Sequence[slice],
    law: LawName,
) -> Estimate:
    """Where ln K = level + ln amplification is 0: in the mode that holds it, else beyond the only one."""
    method = "setting at which the system gain is 1 DN per electron, by the settings' law"
    places: list[tuple[Uncertain, float, float]] = []
    for part in splits:
        fit = fit_linear(np.ones((len(rest[part]), 1)), rest[part], np.diag(variance[part]))
        level = Uncertain.of(float(fit.parameters[0]), math.sqrt(float(fit.covariance[0, 0])))
        if law == "proportional":
            place = level.apply(lambda x: math.exp(-x), lambda x: -math.exp(-x))
        else:
            place = level * (-1.0 / float(log_amplification(np.ones(1), law)[0]))
        places.append((place, float(settings[part].min()), float(settings[part].max())))
    (first, _, below), (last, above, _) = places[0], places[-1]
    if len(places) == 2 and first.value > below and last.value < above:
        reason = (
            f"the gain passes 1 DN per electron where the conversion gain switches, between {below:g} and {above:g}"
        )
        return Estimate(reason=reason, method=method)
    place, low, high = min(places, key=lambda entry: max(entry[1] - entry[0].value, entry[0].value - entry[2]))
    if not low <= place.value <= high:
        method += f"; extrapolated from the settings {low:g} to {high:g}"
    return Estimate.of(place, method)


def _at_analog_gain(step: GainStep, lowest: float, law: LawName, base: Sensor | None) -> GainStep:
    """The setting's calibration with the analog gain that the setting stands for in the place of the lowest one's."""
    if base is None:
        return step
    low, own = log_amplification(np.array([lowest, step.setting]), law)
    factor = math.exp(float(own - low))
    gain = base.readout.analog_gain
    source = f"at gain setting {step.setting:g}: {factor:.4g} times that of the lowest, as the settings say"
    analog = Measured(gain.value * factor, gain.standard_uncertainty * factor, source, assumed=True)
    own_base = base.with_(analog_gain=analog)
    scaled = {
        channel: replace(parameters, **_scaled(parameters, 1.0 / factor))
        for channel, parameters in step.calibration.channels.items()
    }
    own_values = _scaled(step.calibration, 1.0 / factor)
    return GainStep(step.setting, replace(step.calibration, base=own_base, channels=scaled, **own_values))


def _scaled(parameters: Parameters, factor: float) -> dict[str, Any]:
    return {name: _times(getattr(parameters, name), factor) for name in _AT_THE_PIXEL}


def _times(entry: Estimate, factor: float) -> Estimate:
    if entry.value is None or entry.standard_uncertainty is None:
        return entry
    low, high = entry.interval_95 or (entry.value, entry.value)
    return replace(
        entry,
        value=entry.value * factor,
        standard_uncertainty=entry.standard_uncertainty * factor,
        upper_limit_95=None if entry.upper_limit_95 is None else entry.upper_limit_95 * factor,
        interval_95=(low * factor, high * factor),
        parts={source: part * factor for source, part in entry.parts.items()},
    )
