"""Whether frames can support a calibration: refusals, and warnings about what they cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence

from photosite.calibration.reduction.groups import CLIPPED_DARK_SHARE, GroupStatistics, group_label
from photosite.errors import CalibrationError, InputError
from photosite.frames.frame_set import FrameSet, gain_settings_text
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_names, tile_text

LAMP_DRIFT = 0.01
"""Shift from frame to frame, as a share of the signal, that is worth a warning."""

FALSE_ALARMS = 0.001
"""Share of calibrations under a steady lamp that may be told it was unsteady; the same for the black level."""


def check_sensor(frames: FrameSet, sensor: Sensor | None) -> None:
    """The sensor known beforehand must be one that these frames can come from.

    Raises
    ------
    InputError
        If its converter or its colour filter array is another.
    """
    if sensor is None:
        return
    if sensor.readout.bits != frames.bits:
        raise InputError(
            f"sensor '{sensor.name}' has {sensor.readout.bits} bits, the frames have {frames.bits}; "
            f"calibrate with the sensor that took them"
        )
    if sensor.array.cfa != frames.cfa:
        raise InputError(
            f"sensor '{sensor.name}' has the colour filter array {tile_text(sensor.array.cfa)}, the frames have "
            f"{tile_text(frames.cfa)}; calibrate with the sensor that took them"
        )


def check_plan(frames: FrameSet) -> None:
    """Refuse, before any frame is read, a set that cannot support a calibration.

    Raises
    ------
    CalibrationError
        If there are several gain settings, no dark exposure was taken twice, there is one exposure only, all
        light levels state the same photons, or an exposure time is not above zero.
    """
    source = frames.source
    if len(frames.gain_settings) > 1:
        raise CalibrationError(
            f"{source}: holds frames of {len(frames.gain_settings)} gain settings ({gain_settings_text(frames)}); one "
            f"calibration is of one: take FrameSet.at_gain(setting), or calibrate_series for all of them"
        )
    for group in frames.groups:
        if not (math.isfinite(group.exposure_s) and group.exposure_s > 0):
            raise CalibrationError(
                f"{source}: {group_label(group)}: an exposure time is above zero; correct the protocol"
            )
    darks, lights = frames.of_kind("dark"), frames.of_kind("light")
    if not darks:
        raise CalibrationError(
            f"{source}: no dark frames; take at least two with the lens covered, better 50, at one exposure"
        )
    if max(len(group) for group in darks) < 2:
        raise CalibrationError(
            f"{source}: every dark exposure was taken once; temporal noise needs at least two dark frames at one "
            f"exposure, better 50"
        )
    exposures = {group.exposure_s for group in frames.groups}
    levels = {(group.exposure_s, group.photons_per_pixel) for group in lights}
    if len(exposures) == 1 and len(levels) < 2:
        raise CalibrationError(
            f"{source}: all {frames.frame_count} frames have one exposure, {exposures.pop():g} s; gain, PRNU and dark "
            f"voltage are slopes and need at least two, better ten, from dark to saturation"
        )
    if len(levels) == 1:
        raise CalibrationError(
            f"{source}: all light frames have one exposure, {lights[0].exposure_s:g} s; gain and PRNU are slopes and "
            f"need at least two light levels, better ten, up to saturation"
        )
    photons = {group.photons_per_pixel for group in lights}
    if len(lights) > 1 and len(photons) == 1 and None not in photons:
        raise CalibrationError(
            f"{source}: all {len(lights)} light levels state the same light, {lights[0].photons_per_pixel:g} photons "
            f"per pixel; gain and responsivity are slopes against it: state the photons of each level, or leave them "
            f"out, and the exposure times are taken"
        )


def check_darks(frames: FrameSet, darks: Sequence[GroupStatistics], rejected: Sequence[str] = ()) -> None:
    """Refuse dark frames that are black or saturated all over, still, or only copies of each other.

    Raises
    ------
    CalibrationError
        With the group and the share of pixels.
    """
    names = channel_names(frames.cfa)
    for statistics in darks:
        for name, level in zip(names, statistics.levels, strict=True):
            where = f"{frames.source}: {statistics.label}" + (f", channel {name}" if len(names) > 1 else "")
            if level.low_fraction == 1.0:
                raise CalibrationError(
                    f"{where}: all numbers are clipped at 0 DN, and nothing is left to see; raise the camera's black "
                    f"level (pedestal) and take the darks again"
                )
            if level.high_fraction > CLIPPED_DARK_SHARE:
                raise CalibrationError(
                    f"{where}: {100 * level.high_fraction:.3g} % of the pixels are at {(1 << frames.bits) - 1} DN; "
                    f"dark frames cannot be saturated: cover the lens, shorten the exposure"
                )
            if level.repeated and level.variance == 0.0:
                raise CalibrationError(
                    f"{where}: the {level.frames} frames do not differ in a single pixel; take frames with their "
                    f"noise, not copies"
                )
    if not any(statistics.frames > 1 for statistics in darks):
        raise CalibrationError(
            f"{frames.source}: without repeated files no dark exposure has two frames ({rejected[0]}); "
            f"take at least two dark frames at one exposure"
        )


def check_lights(frames: FrameSet, lights: Sequence[GroupStatistics], dark_level: Sequence[float]) -> None:
    """Refuse light frames that are darker than darkness.

    Parameters
    ----------
    dark_level
        Per channel, the mean of the shortest dark exposure.

    Raises
    ------
    CalibrationError
        If the brightest light group is not brighter than the dark level in any channel.
    """
    if not lights:
        return
    brightest = max(lights, key=lambda statistics: max(level.mean for level in statistics.levels))
    pairs = list(zip(brightest.levels, dark_level, strict=True))
    if all(level.mean <= dark for level, dark in pairs):
        level, dark = pairs[0]
        raise CalibrationError(
            f"{frames.source}: the brightest {brightest.label} read {level.mean:.2f} DN on average, no more than the "
            f"darks' {dark:.2f} DN; check that kinds are not swapped and that the lamp was on"
        )


def frame_warnings(frames: FrameSet, darks: Sequence[GroupStatistics], lights: Sequence[GroupStatistics]) -> list[str]:
    """What the frames show that spoils no estimate but should be known.

    A shift from frame to frame is told where it is large and beyond what the pixels' noise does to the frame means;
    all levels and channels together raise a false alarm in at most `FALSE_ALARMS` of calibrations.
    """
    warnings = _unsteady_light(darks, lights) + _unsteady_black(channel_names(frames.cfa), darks)
    if single := [statistics for statistics in lights if statistics.frames == 1]:
        warnings.append(f"{len(single)} of {len(lights)} light levels have one frame and tell no temporal noise")
    return warnings


def _rate_each(groups: Sequence[GroupStatistics]) -> float:
    """False alarms for one level, so that all of them together raise `FALSE_ALARMS` at most (Bonferroni)."""
    return FALSE_ALARMS / max(sum(len(entry.levels) for entry in groups if entry.frames > 1), 1)


def _unsteady_light(darks: Sequence[GroupStatistics], lights: Sequence[GroupStatistics]) -> list[str]:
    rate = _rate_each(lights)
    drifting: list[tuple[float, str]] = []
    for statistics in lights:
        for level, dark in zip(statistics.levels, darks[0].levels, strict=True):
            signal = level.mean - dark.mean
            large = level.repeated and signal > 0 and level.frame_shift > LAMP_DRIFT * signal
            if large and level.shifts_beyond_chance(rate):
                drifting.append((level.frame_shift / signal, statistics.label))
    if not drifting:
        return []
    worst, label = max(drifting)
    return [
        f"the light was unsteady: {label} shift by {100 * worst:.2g} % from frame to frame; the shifts were left "
        f"out of the temporal noise"
    ]


def _unsteady_black(names: Sequence[str], darks: Sequence[GroupStatistics]) -> list[str]:
    rate = _rate_each(darks)
    return [
        f"the black level was unsteady: {statistics.label} (channel {name}) shift by {level.frame_shift:.2g} DN from "
        f"frame to frame, more than their noise"
        for statistics in darks
        for name, level in zip(names, statistics.levels, strict=True)
        if level.repeated and level.frame_shift > math.sqrt(level.variance) and level.shifts_beyond_chance(rate)
    ]
