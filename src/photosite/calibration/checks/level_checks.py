"""Checks of the levels of groups: clipping, bit depth, stated light and stated levels.

A protocol or descriptor is written by hand or by another tool. A wrong unit in it leaves every frame readable, but
makes the results wrong. Each error here rests on something impossible in the levels, and names the likely cause.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.checks.result_screening import BEYOND_CHANCE, too_short_for_dark_current
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.reduction.groups import CLIPPED_DARK_SHARE, GroupStatistics, pooled_level
from photosite.calibration.reduction.reduce import Reduction
from photosite.errors import CalibrationError
from photosite.frames.black_level import levels_disagree
from photosite.frames.frame_set import FrameSet
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Missing

LAMP_DRIFT = 0.01
"""Shift from frame to frame, as a share of the signal, above which a warning is given."""

FALSE_ALARMS = 0.001
"""Share of calibrations under a steady lamp that may report an unsteady one; the same for the black level."""

FARTHEST = 1.5
"""Factor by which a signal may deviate from the proportion of the others; lamps and shutters are better."""

LEAST_SIGNAL = 0.02
"""Signal, as a share of the brightest in the linear range, below which stray light hides the proportion."""

SHORTEST_S = 1e-6
"""Exposure time below which few image sensors have a shutter."""

AT_THE_TOP = 0.98
"""Share of a light level's pixels at the full scale of a smaller converter that shows that converter's bit depth."""

LEAK_SHARE = 0.3
"""Share of the flats' slope above which the darks' slope is as likely a light leak as dark current."""

_FACTORS = {1e3: "a thousand", 1e6: "a million", 1e9: "a thousand million", 60.0: "sixty", 3600.0: "3600"}


def check_levels(reduction: Reduction) -> None:
    """Raise a CalibrationError where the levels cannot support a calibration.

    Reasons are darks that are black, saturated or without noise, flats not brighter than the darks, and
    numbers of another bit depth than stated.
    """
    _check_step(reduction)
    _check_darks(reduction)
    if reduction.lights:
        _check_lights(reduction)
        _check_full_scale(reduction)


def check_channels(reduction: Reduction, channels: Sequence[Channel]) -> None:
    """Raise a CalibrationError for a lit dark group, and for signals not proportional to the stated light."""
    if channels:
        _check_unlit(reduction, max(float(channel.levels.signal.max()) for channel in channels))
        _check_proportion(reduction, channels)


def _of_channel(reduction: Reduction, name: str, text: str = ", channel {}") -> str:
    return text.format(name) if len(reduction.names) > 1 else ""


def _check_step(reduction: Reduction) -> None:
    """Check that the numbers are not all multiples of a power of two: shifted numbers of fewer bits."""
    group, frames = reduction.darks[reduction.reference], reduction.frames
    bits_used = int(np.bitwise_or.reduce(reduction.reference_mean.sum, axis=None))
    step = bits_used & -bits_used
    varied = any(level.spatial_variance > 0.0 for level in group.levels)
    if bits_used == 0 or step == 1 or not varied:
        return
    shift = step.bit_length() - 1
    raise CalibrationError(
        f"all numbers add up to multiples of {step}: they have {frames.bits - shift} bits shifted by {shift} bits, not "
        f"{frames.bits} bits",
        where=f"{frames.source}: {group.label}",
        hint=f"Divide them by {step} and state {frames.bits - shift} bits",
    )


def _check_darks(reduction: Reduction) -> None:
    frames = reduction.frames
    for group in reduction.darks:
        for name, level in zip(reduction.names, group.levels, strict=True):
            where = f"{frames.source}: {group.label}{_of_channel(reduction, name)}"
            if level.low_fraction == 1.0:
                hint = "Raise the camera's black level (pedestal) and take the darks again"
                raise CalibrationError("all numbers are clipped at 0 DN", where=where, hint=hint)
            if level.high_fraction > CLIPPED_DARK_SHARE:
                raise CalibrationError(
                    f"{100 * level.high_fraction:.3g} % of the pixels are at {(1 << frames.bits) - 1} DN, but dark "
                    f"frames cannot be saturated",
                    where=where,
                    hint="Cover the lens, or shorten the exposure time",
                )
            if level.repeated and level.variance == 0.0:
                raise CalibrationError(
                    f"the {level.frames} frames do not differ in a single pixel",
                    where=where,
                    hint="Use frames with their noise, not copies",
                )
    if not any(group.frames > 1 for group in reduction.darks):
        raise CalibrationError(
            f"without repeated files no dark exposure has two frames ({reduction.rejected[0]})",
            where=frames.source,
            hint="Take at least two dark frames at one exposure time",
        )


def _check_lights(reduction: Reduction) -> None:
    """Check that the brightest light group is brighter than the shortest dark exposure."""
    brightest = max(reduction.lights, key=lambda group: max(level.mean for level in group.levels))
    pairs = [(light.mean, dark.mean) for light, dark in zip(brightest.levels, reduction.darks[0].levels, strict=True)]
    if all(light <= dark for light, dark in pairs):
        raise CalibrationError(
            f"the brightest {brightest.label} have a mean of {pairs[0][0]:.2f} DN, not above the darks' "
            f"{pairs[0][1]:.2f} DN",
            where=reduction.frames.source,
            hint="Check that dark and light frames are not swapped, and that the lamp was on",
        )


def _check_full_scale(reduction: Reduction) -> None:
    """Check that flats do not end at the full scale of a smaller converter than stated.

    Pixels clipped by a converter all read the same number; pixels clipped by a well spread around any number. Some
    pixels may respond less.
    """
    frames = reduction.frames
    for k, name in enumerate(reduction.names):
        highest, share = max(level[k] for level in reduction.top_shares)
        top = int(highest)
        if share >= AT_THE_TOP and 0 < top < (1 << frames.bits) - 1:
            pixels = "every pixel" if share == 1.0 else f"{100 * share:.3g} % of the pixels"
            raise CalibrationError(
                f"the brightest flats{_of_channel(reduction, name, ' of channel {}')} have {top} DN in {pixels}, the "
                f"full scale of {top.bit_length()} bits, but {frames.bits} bits are stated or assumed",
                where=frames.source,
                hint="Correct the bits",
            )


def _check_unlit(reduction: Reduction, brightest_dn: float) -> None:
    """Check that no dark group is far brighter than all darks of longer exposure.

    `brightest_dn` is the largest signal of the flats above dark.
    """
    order = sorted(reduction.darks, key=lambda entry: entry.group.exposure_s)
    for index, entry in enumerate(order[:-1]):
        for k, level in enumerate(entry.levels):
            others = max(other.levels[k].mean for other in order[index + 1 :])
            if level.mean - others > max(LEAST_SIGNAL * brightest_dn, 5.0 * math.sqrt(level.spatial_variance)):
                raise CalibrationError(
                    f"{entry.label} have a mean of {level.mean:.4g} DN, but all darks of longer exposure {others:.4g} "
                    f"DN or less: light fell on them, or flats are listed as darks",
                    where=reduction.frames.source,
                )


@dataclass(frozen=True)
class _Proportion:
    """Signal per unit of an axis, relative to its median over the levels; and which levels deviate too far."""

    x: NDArray[np.float64]
    ratio: NDArray[np.float64]
    beyond: NDArray[np.bool_]

    @classmethod
    def of(cls, x: NDArray[np.float64], signal: NDArray[np.float64], uncertainty: NDArray[np.float64]) -> _Proportion:
        per_unit = signal / x
        ratio = per_unit / np.median(per_unit)
        # The difference must be significant as well: unexpected signal, or missing signal.
        significant = np.abs(signal - np.median(per_unit) * x) > 5.0 * uncertainty
        return cls(x, ratio, ((ratio > FARTHEST) | (ratio < 1.0 / FARTHEST)) & significant)


def _check_proportion(reduction: Reduction, channels: Sequence[Channel]) -> None:
    """Check that signals in the linear range are proportional to the stated light.

    A deviation by half and more is not non-linearity: exposure times are in mixed units, swapped or invented, or the
    lamp changed.
    """
    for name, channel in zip(reduction.names, channels, strict=True):
        levels = channel.levels
        take = channel.used & (levels.x > 0.0)
        take &= levels.signal > LEAST_SIGNAL * levels.signal[take].max(initial=0.0)
        if take.sum() < 3:
            continue
        signal, uncertainty = levels.signal[take], np.sqrt(np.diag(levels.signal_covariance)[take])
        found = _Proportion.of(levels.x[take], signal, uncertainty)
        if not found.beyond.any():
            continue
        by_photons = levels.photons_known
        worst = int(np.argmax(np.abs(np.log(found.ratio)) * found.beyond))
        level = f"{found.x[worst]:g} photons" if by_photons else f"{format_exposure(float(found.x[worst]))} s"
        cause, hint = _likely_cause(found, levels.exposure_s[take], signal, uncertainty, by_photons)
        raise CalibrationError(
            f"the signal is not proportional to the stated {'photons' if by_photons else 'exposure times'}: flats at "
            f"{level}{_of_channel(reduction, name, ' (channel {})')} have {signal[worst]:.4g} DN above dark, "
            f"{found.ratio[worst]:.3g} times the proportion of the others, and {int(found.beyond.sum())} of "
            f"{len(signal)} levels deviate; {cause}",
            where=reduction.frames.source,
            hint=hint,
        )


def _likely_cause(
    found: _Proportion,
    exposure_s: NDArray[np.float64],
    signal: NDArray[np.float64],
    uncertainty: NDArray[np.float64],
    by_photons: bool,
) -> tuple[str, str]:
    """Return the likely cause of a missing proportion, and what to do."""
    if by_photons and len(np.unique(exposure_s)) > 1:
        by_time = _Proportion.of(exposure_s, signal, uncertainty)
        if not by_time.beyond.any():
            return "it is proportional to the exposure times instead", "Correct the photons"
    off = found.ratio[found.beyond]
    for factor, words in _FACTORS.items():
        power = np.abs(np.log(off) / math.log(factor))
        if np.all(power > 0.9) and np.all(power < 1.1):
            return f"they deviate by a factor of {words}: units are mixed (s, ms, us, ns)", "State all in one unit"
    if float(signal.max()) < FARTHEST * float(signal.min()):
        return (
            "the signal is the same at every level: automatic exposure, or a lamp dimmed against the exposure time",
            "Switch the automatic exposure off and keep the lamp constant",
        )
    order = np.argsort(signal)
    in_order = np.array_equal(order, np.argsort(found.x))
    if not in_order and not _Proportion.of(np.sort(found.x), signal[order], uncertainty[order]).beyond.any():
        return "sorted by signal they fit: levels were swapped", "Correct the list of files and levels"
    return (
        "the cause is unknown",
        "Check the list of files and levels, the lamp, and automatic aperture, gain or exposure",
    )


def level_warnings(reduction: Reduction, darks: Sequence[GroupStatistics], channels: Sequence[Channel]) -> list[str]:
    """Return warnings about levels that do not prevent a calibration."""
    return [
        *_fast_shutter(reduction.frames),
        *_light_leak(darks, channels),
        *_unsteady_light(darks, reduction.lights),
        *_unsteady_black(reduction.names, darks),
        *_single_frames(reduction.lights),
        *_stated_levels(reduction.frames, darks[0], reduction.lights),
    ]


def _fast_shutter(frames: FrameSet) -> list[str]:
    exposures = [group.exposure_s for group in frames.groups]
    shortest, longest = min(exposures), max(exposures)
    darks = np.unique([group.exposure_s for group in frames.of_kind("dark")])
    if shortest >= SHORTEST_S or (len(darks) > 1 and too_short_for_dark_current(darks) is not None):
        return []
    return [
        f"the exposure times range from {shortest:.3g} to {longest:.3g} s, and hardly a shutter is as fast as the "
        f"shortest; in another unit (an EMVA descriptor has nanoseconds), dark current and dark voltage are wrong by "
        f"the same factor; check the unit in the protocol or descriptor"
    ]


def _light_leak(darks: Sequence[GroupStatistics], channels: Sequence[Channel]) -> list[str]:
    """Warn where the dark signal grows with time nearly as the flats do: a light leak looks like dark current.

    The darks' slope is compared with the smallest signal per second in the linear range of the flats.
    """
    for channel in channels:
        _, slope = channel.dark.mean.line
        levels = channel.levels
        take = channel.used & (levels.signal > 0.0)
        if isinstance(slope, Missing) or not take.any():
            continue
        rate = float(np.min(levels.signal[take] / levels.exposure_s[take]))
        if slope.value > LEAK_SHARE * rate and slope.value > BEYOND_CHANCE * (slope.value - slope.interval_95[0]):
            longest = max(darks, key=lambda entry: entry.group.exposure_s)
            return [
                f"the dark signal grows by {slope.value:.3g} DN/s, {100 * slope.value / rate:.2g} % of the dimmest "
                f"flats (to {longest.levels[channel.index].mean:.4g} DN at {format_exposure(longest.group.exposure_s)} "
                f"s), which is much for dark current; a light leak would falsify dark current and DCNU"
            ]
    return []


def _rate_per_level(groups: Sequence[GroupStatistics]) -> float:
    """Return the false alarm rate per level at which all levels together have `FALSE_ALARMS` at most (Bonferroni)."""
    return FALSE_ALARMS / max(sum(len(entry.levels) for entry in groups if entry.frames > 1), 1)


def _unsteady_light(darks: Sequence[GroupStatistics], lights: Sequence[GroupStatistics]) -> list[str]:
    rate = _rate_per_level(lights)
    drifting: list[tuple[float, str]] = []
    for group in lights:
        for level, dark in zip(group.levels, darks[0].levels, strict=True):
            signal = level.mean - dark.mean
            large = level.repeated and signal > 0 and level.frame_shift > LAMP_DRIFT * signal
            if large and level.shifts_beyond_chance(rate):
                drifting.append((level.frame_shift / signal, group.label))
    if not drifting:
        return []
    worst, label = max(drifting)
    return [
        f"the light was unsteady: {label} shift by {100 * worst:.2g} % from frame to frame; the shifts are excluded "
        f"from the temporal noise"
    ]


def _unsteady_black(names: Sequence[str], darks: Sequence[GroupStatistics]) -> list[str]:
    rate = _rate_per_level(darks)
    return [
        f"the black level was unsteady: {group.label} (channel {name}) shift by {level.frame_shift:.2g} DN from frame "
        f"to frame, more than their noise"
        for group in darks
        for name, level in zip(names, group.levels, strict=True)
        if level.repeated and level.frame_shift > math.sqrt(level.variance) and level.shifts_beyond_chance(rate)
    ]


def _single_frames(lights: Sequence[GroupStatistics]) -> list[str]:
    single = sum(group.frames == 1 for group in lights)
    return [f"{single} of {len(lights)} light levels have one frame and show no temporal noise"] if single else []


def _stated_levels(frames: FrameSet, dark: GroupStatistics, lights: Sequence[GroupStatistics]) -> list[str]:
    """Warn of stated black and white levels that the frames contradict. They matter for developing, not here."""
    white = frames.white_level_dn or float((1 << frames.bits) - 1)
    warnings = []
    stated, found = frames.black_level_dn, pooled_level(dark.levels).mean
    if stated is not None and levels_disagree(stated, found, white):
        warnings.append(
            f"the black level is stated as {stated:g} DN, but the {dark.label} have a mean of {found:.2f} DN; correct "
            f"it before developing these frames"
        )
    if frames.white_level_dn is not None and lights:
        brightest, label = max((level.mean, entry.label) for entry in lights for level in entry.levels)
        if brightest > white and levels_disagree(white, brightest, 2 * white):
            warnings.append(f"the white level is stated as {white:g} DN, but {label} have a mean of {brightest:.1f} DN")
    return warnings
