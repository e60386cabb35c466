"""Calibrate several gain settings of one measurement, and analyze them together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.gain_series.result import ConversionGainSwitch, GainMode, GainSeries, GainStep
from photosite.calibration.gain_series.series_statistics import (
    FEWEST_SETTINGS,
    ReadNoise,
    SettingScale,
    StepTest,
    Switch,
    find_setting_scale,
    find_switch,
    log_amplification,
    step_in_gain,
    step_in_read_noise,
)
from photosite.calibration.parameters import Parameters
from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.reduction.frame_reader import Progress
from photosite.calibration.setting import calibrate_setting
from photosite.calibration.spatial.spatial_analysis import SpatialAnalysis
from photosite.calibration.withheld import FEW_SETTINGS, IRREGULAR_GAIN, SETTING_WITHOUT_GAIN
from photosite.frames.frame_set import FrameSet
from photosite.sensor.model import Sensor
from photosite.values.diagnostic import Diagnostic
from photosite.values.estimate import Estimate
from photosite.values.uncertain import COVERAGE_95, Measured, Uncertain, correlated

Array = NDArray[np.float64]

_AT_THE_PIXEL = (
    *("read_noise_mv", "row_noise_mv", "column_noise_mv", "dsnu_mv"),
    *("dark_voltage_mv_per_s", "conversion_gain_uv_per_e"),
)
"""Parameters in volts at the pixel, which are inversely proportional to the analog gain."""


def calibrate_series(
    frames: FrameSet,
    sensor: Sensor | None = None,
    progress: Progress | None = None,
    *,
    checkpoint: str | PathLike[str] | None = None,
) -> GainSeries:
    """Calibrate every gain setting of a measurement, and analyze them together.

    Each setting is calibrated by `calibrate`. The joint analysis gives the conversion-gain switch, if there is one
    (false alarms in at most 1 % of series; see `series_statistics.find_switch`), the read noise before and after the
    amplifier for each conversion gain, and the setting of one DN per electron.

    Parameters
    ----------
    frames
        Dark frames and flat fields at two gain settings or more, enough to calibrate each setting.
    sensor
        Base sensor; default `frames.sensor`. Its analog gain is taken as that of the lowest setting. The
        analog gain of the other settings follows from their nominal values.
    progress, checkpoint
        As for `calibrate`, over all settings; the checkpoint folder gets a subfolder for each.

    Raises
    ------
    CalibrationError
        If there are fewer than two settings, frames without a setting, or a setting that cannot be calibrated.
    FileError
        If a frame cannot be read.
    InputError
        If `sensor` does not match the frames.

    Examples
    --------
    >>> from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> def group(kind, exposure_s, iso):
    ...     electrons = 4e6 / iso * exposure_s * (kind == "light")
    ...     stack = 64 + iso / 200 * rng.poisson(electrons, (8, 32, 32)) + rng.normal(0, 2, (8, 32, 32))
    ...     sources = [FrameSource(f"{kind}-{i}", lambda dn=dn: dn) for i, dn in enumerate(np.uint16(stack + 0.5))]
    ...     return FrameGroup(kind, exposure_s, tuple(sources), gain_setting=iso)
    >>> steps = [("dark", 0.01), ("light", 0.01), ("light", 0.02), ("light", 0.03)]
    >>> groups = [group(kind, exposure_s, iso) for iso in (100, 200) for kind, exposure_s in steps]
    >>> series = calibrate_series(FrameSet(tuple(groups), rows=32, cols=32, bits=12))
    >>> series.settings, [round(step.calibration.system_gain_dn_per_e.value, 1) for step in series.steps]
    ((100, 200), [0.5, 1.0])
    """
    settings, where = frames.gain_settings, frames.source
    if len(settings) < 2:
        hint = "Use calibrate for one setting, or state each frame's gain_setting in the protocol"
        raise FEW_SETTINGS.error(
            "number of gain settings", where=where, value=len(settings), expected="2 or more", hint=hint
        )
    stated = [setting for setting in settings if setting is not None]
    if len(stated) < len(settings):
        without = next(group for group in frames.groups if group.gain_setting is None)
        hint = (
            "State it in names of files or folders (iso400, gain_2.5), headers (ISO, GAIN) or a protocol; {where} "
            "leaves them out"
        )
        what = f"some frames have no gain setting, such as {without.frames[0].name}"
        raise FEW_SETTINGS.error(what, where=where, hint=hint, arguments={"where": f"gain_setting={stated[0]:g}"})
    base = sensor if sensor is not None else frames.sensor
    done, total = 0, frames.frame_count
    steps = []
    for setting in stated:
        part = frames.at_gain(setting)
        before, others = done, total - part.frame_count

        def report(read: int, expected: int, before: int = before, others: int = others) -> None:
            nonlocal done, total  # frames that are read again count
            done, total = before + read, others + expected
            if progress is not None:
                progress(done, total)

        sums = None if checkpoint is None else Path(checkpoint) / f"gain{setting:g}"
        calibration = calibrate_setting(part, base, progress=report, checkpoint=sums)
        for pattern in calibration.spatial.values():
            if isinstance(pattern, SpatialAnalysis):
                pattern.compute()  # releases the mean frames of this setting
        steps.append(GainStep(setting, calibration))
    return analyse_series(steps, base, where)


def analyse_series(steps: Sequence[GainStep], base: Sensor | None = None, source: str = "") -> GainSeries:
    """Analyze calibrated settings together; `steps` in ascending order."""
    found_of_settings = [
        entry.within(f"gain setting {step.setting:g}")
        for step in steps
        for entry in step.calibration.diagnostics
        if entry.severity in ("note", "warning")
    ]
    found_of_series: list[Diagnostic] = []
    known = [step for step in steps if step.calibration.system_gain_dn_per_e.value is not None]
    if len(known) < 2:
        reasons = "; ".join(sorted({step.calibration.system_gain_dn_per_e.reason or "" for step in steps} - {""}))
        raise FEW_SETTINGS.error(f"fewer than two gain settings have a system gain ({reasons})", where=source)
    if len(known) < len(steps):
        left = ", ".join(f"{step.setting:g}" for step in steps if step not in known)
        text = f"no system gain at setting {left}: not used in the joint analysis, not in the sensor file"
        found_of_series.append(SETTING_WITHOUT_GAIN(text))
    settings = np.array([step.setting for step in known])
    gain, u_gain = _values(known, "system_gain_dn_per_e")
    scale = find_setting_scale(settings, gain)
    amplification = log_amplification(settings, scale)
    rest = np.log(gain) - amplification
    noise = _read_noise(known, gain, u_gain)
    gain_step = step_in_gain(rest, (u_gain / gain) ** 2) if len(known) >= FEWEST_SETTINGS else None
    noise_step = step_in_read_noise(noise) if noise is not None and gain_step is not None else None
    found = None if gain_step is None else find_switch(gain_step, noise_step)
    if gain_step is None:
        needed = f"the search for a conversion-gain switch needs at least {FEWEST_SETTINGS}"
        found_of_series.append(FEW_SETTINGS(f"{len(known)} gain settings: {needed}", len(known)))
    splits = [slice(0, len(known))] if found is None else [slice(0, found.split), slice(found.split, len(known))]
    found_of_series += [entry for part in splits for entry in _irregular(rest[part], settings[part])]
    modes = tuple(_mode(settings[part], noise[part] if noise is not None else None) for part in splits)
    return GainSeries(
        tuple(_at_analog_gain(step, steps[0].setting, scale, base) for step in steps),
        scale,
        None if found is None or gain_step is None else _switch(found, settings, gain_step, modes),
        modes,
        _unity(settings, rest, (u_gain / gain) ** 2, splits, scale),
        (*found_of_settings, *found_of_series),
        source,
    )


def _values(steps: Sequence[GainStep], name: str) -> tuple[Array, Array]:
    entries = [getattr(step.calibration, name) for step in steps]
    return np.array([e.value for e in entries]), np.array([e.standard_uncertainty for e in entries])


def _read_noise(steps: Sequence[GainStep], gain: Array, u_gain: Array) -> ReadNoise | None:
    if any((step.calibration.read_noise_dn.value or 0.0) <= 0.0 for step in steps):
        return None
    value, uncertainty = _values(steps, "read_noise_dn")
    # The inverse of `standard_deviation`, whose uncertainty is the larger distance to the interval ends' roots / 1.96.
    lower = value - COVERAGE_95 * uncertainty
    return ReadNoise(gain, u_gain, value**2, (value**2 - lower * np.abs(lower)) / COVERAGE_95)


def _mode(settings: Array, noise: ReadNoise | None) -> GainMode:
    method = "read noise^2 = (pre-amplifier noise K)^2 + post-amplifier noise^2, weighted fit over the settings"
    names = tuple(float(setting) for setting in settings)
    if noise is None or len(settings) < 2:
        reason = "one setting at this conversion gain; the two parts need at least two"
        if noise is None:
            reason = "the read noise of a setting is not known, or not distinguishable from rounding"
        missing = Estimate(reason=reason, method=method)
        return GainMode(names, missing, missing)
    fit = noise.two_parts()
    parts = correlated(fit.parameters, fit.covariance)
    pre, post = (Estimate.of_variance(part, method) for part in parts)
    scatter = 100.0 * math.sqrt(fit.extra_variance)
    return GainMode(names, pre, post, fit.chi_square, fit.degrees_of_freedom, scatter)


def _switch(found: Switch, settings: Array, gain_step: StepTest, modes: Sequence[GainMode]) -> ConversionGainSwitch:
    def between(low: int, high: int) -> tuple[float, float]:
        return float(settings[low - 1]), float(settings[high])

    step = Uncertain.of(float(gain_step.step[found.split - 1]), float(gain_step.step_uncertainty[found.split - 1]))
    below, above = (mode.pre_amplifier_noise_e for mode in modes)
    method = "pre-amplifier noise above the switch divided by that below"
    ratio = Estimate(reason="the pre-amplifier noise is not known on both sides of the switch", method=method)
    if above.value is not None and below.value is not None and below.upper_limit_95 is None and below.value > 0:
        high, low = (Uncertain.of(e.value or 0.0, e.standard_uncertainty or 0.0) for e in (above, below))
        ratio = Estimate.of(high / low, method)
    return ConversionGainSwitch(
        between(found.split, found.split),
        between(found.first, found.last),
        Estimate.of(step.apply(math.exp, math.exp), "gain per unit of setting above the switch divided by that below"),
        ratio,
        found.p_value,
        found.seen_in,
    )


def _irregular(rest: Array, settings: Array) -> list[Diagnostic]:
    """Return diagnostics of settings whose gain deviates from that of the others by a tenth or more."""
    if len(rest) < 3:
        return []
    off = np.exp(rest - np.median(rest)) - 1.0
    return [
        IRREGULAR_GAIN(
            f"gain setting {setting:g}: its system gain deviates by {100 * fraction:+.0f} % from the trend of the "
            "others",
            fraction,
        )
        for setting, fraction in zip(settings, off, strict=True)
        if abs(fraction) > 0.1
    ]


def _unity(settings: Array, rest: Array, variance: Array, splits: Sequence[slice], scale: SettingScale) -> Estimate:
    """Return the setting where ln K = level + ln amplification is 0: in the mode that contains it, or extrapolated."""
    method = "setting at which the system gain is 1 DN per electron, from the scale of the settings"
    places: list[tuple[Uncertain, float, float]] = []
    for part in splits:
        fit = fit_linear(np.ones((len(rest[part]), 1)), rest[part], np.diag(variance[part]))
        level = Uncertain.of(float(fit.parameters[0]), math.sqrt(float(fit.covariance[0, 0])))
        if scale == "proportional":
            place = level.apply(lambda x: math.exp(-x), lambda x: -math.exp(-x))
        else:
            place = level * (-1.0 / float(log_amplification(np.ones(1), scale)[0]))
        places.append((place, float(settings[part].min()), float(settings[part].max())))
    (first, _, below), (last, above, _) = places[0], places[-1]
    if len(places) == 2 and first.value > below and last.value < above:
        place_text = f"where the conversion gain switches, between {below:g} and {above:g}"
        return Estimate(reason=f"the gain passes 1 DN per electron {place_text}", method=method)
    place, low, high = min(places, key=lambda entry: max(entry[1] - entry[0].value, entry[0].value - entry[2]))
    if not low <= place.value <= high:
        method += f"; extrapolated from the settings {low:g} to {high:g}"
    return Estimate.of(place, method)


def _at_analog_gain(step: GainStep, lowest: float, scale: SettingScale, base: Sensor | None) -> GainStep:
    """Return the setting's calibration with the analog gain of the setting instead of that of the lowest one."""
    if base is None:
        return step
    low, own = log_amplification(np.array([lowest, step.setting]), scale)
    factor = math.exp(float(own - low))
    gain = base.readout.analog_gain
    source = f"at gain setting {step.setting:g}: nominally {factor:.4g} times that of the lowest setting"
    analog = Measured(gain.value * factor, gain.standard_uncertainty * factor, source, assumed=True)
    scaled = {name: replace(own, **_scaled(own, 1.0 / factor)) for name, own in step.calibration.channels.items()}
    whole = _scaled(step.calibration, 1.0 / factor)
    own_base = base.with_(analog_gain=analog)
    return GainStep(step.setting, replace(step.calibration, base=own_base, channels=scaled, **whole))


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
