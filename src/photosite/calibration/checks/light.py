"""Checks of the flat fields: an unsteady lamp, light leaks, first frames, single frames, shutters, stated levels."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from photosite.calibration.checks.dark_frames import LONG_DARKS_S
from photosite.calibration.checks.result_screening import BEYOND_CHANCE, too_short_for_dark_current
from photosite.calibration.diagnostics import Check
from photosite.calibration.evidence import Evidence
from photosite.calibration.reduction.groups import GroupStatistics, pooled_level
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.withheld import DARK_CURRENT, RESPONSE, SINGLE_FLATS
from photosite.frames.raw_frame import levels_disagree
from photosite.values.diagnostic import Diagnostic, DiagnosticKind, one_in
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Missing, Uncertain

SHORTEST_S = 1e-6
"""Exposure time below which few image sensors have a shutter."""

FAST_SHUTTER = DiagnosticKind(
    "exposure-unit",
    "warning",
    f"The shortest exposure time is below {SHORTEST_S:g} s, shorter than most shutters allow.",
    "If the times are in another unit, dark current and dark voltage are wrong by the same factor.",
    "Check the unit in the protocol or descriptor: an EMVA descriptor has nanoseconds, a protocol seconds.",
    DARK_CURRENT,
    "shortest exposure time, s",
    "none: times are compared",
)


def fast_shutter(evidence: Evidence) -> Iterator[Diagnostic]:
    """Exposure times in another unit than seconds."""
    frames = evidence.reduction.frames
    exposures = [group.exposure_s for group in frames.groups if group.exposure_s > 0.0]
    if not exposures:
        return
    shortest, longest = min(exposures), max(exposures)
    darks = np.unique([group.exposure_s for group in frames.of_kind("dark")])
    explained = len(darks) > 1 and too_short_for_dark_current(darks) is not None
    if shortest < SHORTEST_S and not explained:
        yield FAST_SHUTTER(
            f"the exposure times range from {shortest:.3g} to {longest:.3g} s, shorter than most shutters allow at the "
            f"shortest; in another unit (an EMVA descriptor has nanoseconds), dark current and dark voltage are wrong "
            f"by the same factor; check the unit in the protocol or descriptor",
            shortest,
        )


LEAK_FRACTION = 0.3
"""Fraction of the flat fields' slope above which the dark frames' slope is as likely a light leak as dark current."""

LIGHT_LEAK = DiagnosticKind(
    "light-leak",
    "warning",
    f"The dark signal grows with the exposure time by {100 * LEAK_FRACTION:.0f} % of the flat fields' rate or more.",
    "If light falls on the dark frames, dark current and its nonuniformity are too large.",
    "Cover the lens, switch the lamp off, and compare with dark frames in a dark room.",
    DARK_CURRENT,
    "slope of the dark signal, DN/s",
)


def light_leak(evidence: Evidence) -> Iterator[Diagnostic]:
    """A dark signal that grows with time nearly as the flat fields do: a light leak looks like dark current.

    The slope is compared with the median signal per second in the linear range of the flat fields, whose light may
    have been dimmed.
    """
    for channel in evidence.light.channels:
        _, slope = channel.dark.mean.line
        levels = channel.levels
        take = channel.used & levels.trusted & (levels.signal > 0.0) & (levels.exposure_s > 0.0)
        if isinstance(slope, Missing) or not take.any():
            continue
        rate = float(np.median(levels.signal[take] / levels.exposure_s[take]))
        if slope.value > LEAK_FRACTION * rate and slope.value > BEYOND_CHANCE * (slope.value - slope.interval_95[0]):
            longest = max(evidence.dark.groups, key=lambda entry: entry.group.exposure_s)
            yield LIGHT_LEAK(
                f"the dark signal grows by {slope.value:.3g} DN/s, {100 * slope.value / rate:.2g} % of that of the "
                f"flats (to {longest.levels[channel.index].mean:.4g} DN at {format_exposure(longest.group.exposure_s)} "
                f"s), unusually high for dark current; a light leak would bias dark current and DCNU",
                slope.value,
            )
            return


LAMP_DRIFT = 0.01
"""Shift from frame to frame, as a fraction of the signal, above which a warning is given."""

UNSTEADY_P_VALUE = 0.001
"""Fraction of calibrations under a steady lamp that may report an unsteady one; the same for the black level."""

UNSTEADY_LIGHT = DiagnosticKind(
    "unsteady-light",
    "warning",
    f"The means of the frames of a level differ by more than {100 * LAMP_DRIFT:.0f} % of the signal, beyond chance.",
    "The shifts are excluded from the temporal noise; the light of a level is less certain than its frames show.",
    "Let the lamp warm up, or take more frames of each level.",
    (*RESPONSE, "linearity_*"),
    "shift from frame to frame as a fraction of the signal",
    f"below {one_in(UNSTEADY_P_VALUE)} sets under a steady lamp",
)

UNSTEADY_BLACK = DiagnosticKind(
    "unsteady-black-level",
    "warning",
    "The dark frames of one exposure time differ in their means by more than the noise of a pixel.",
    "Black level and dark current are those of a black level that moves.",
    "Let the camera settle; switch its black level clamp off.",
    ("black_level_dn", *DARK_CURRENT),
    "shift from frame to frame, DN",
    f"below {one_in(UNSTEADY_P_VALUE)} clean sets",
)


def _rate_per_level(groups: Sequence[GroupStatistics]) -> float:
    """Return the probability per level at which all levels have `UNSTEADY_P_VALUE` at most (Bonferroni)."""
    return UNSTEADY_P_VALUE / max(sum(len(entry.levels) for entry in groups if entry.frames > 1), 1)


def unsteady_light(evidence: Evidence) -> Iterator[Diagnostic]:
    """Levels whose frames differ in their means by more than the noise of their pixels."""
    darks, lights = evidence.dark.groups, evidence.reduction.lights
    rate = _rate_per_level(lights)
    drifting: list[tuple[float, str]] = []
    # What may be the black level's: a standard deviation of few frames varies by a factor of 2.
    black_shift = 2.0 * max((level.frame_shift for dark in darks for level in dark.levels if level.repeated), default=0)
    for group in lights:
        blacks = [dark.mean for dark in darks[0].levels] if darks else [0.0] * len(group.levels)
        for level, black in zip(group.levels, blacks, strict=True):
            signal = level.mean - black
            large = level.repeated and signal > 0 and level.frame_shift > max(LAMP_DRIFT * signal, black_shift)
            if large and level.shifts_beyond_chance(rate):
                drifting.append((level.frame_shift / signal, group.label))
    if drifting:
        worst, label = max(drifting)
        yield UNSTEADY_LIGHT(
            f"the light was unsteady: {label} shift by {100 * worst:.2g} % from frame to frame; the shifts are "
            f"excluded from the temporal noise",
            worst,
        )


def unsteady_black(evidence: Evidence) -> Iterator[Diagnostic]:
    """Dark frames whose means shift by more than the noise of a pixel."""
    darks = evidence.dark.groups
    rate = _rate_per_level(darks)
    found = [
        (level.frame_shift, f"{group.label} (channel {name})")
        for group in darks
        for name, level in zip(evidence.reduction.names, group.levels, strict=True)
        if level.repeated and level.frame_shift > math.sqrt(level.variance) and level.shifts_beyond_chance(rate)
    ]
    if found:
        worst, label = max(found)
        yield UNSTEADY_BLACK(
            f"the black level was unsteady: {label} shift by {worst:.2g} DN from frame to frame, more than their noise",
            worst,
        )


def single_flats(evidence: Evidence) -> Iterator[Diagnostic]:
    """Light levels of one frame."""
    lights = evidence.reduction.lights
    if single := sum(group.frames == 1 for group in lights):
        text = f"{single} of {len(lights)} light levels have one frame and show no temporal noise"
        yield SINGLE_FLATS(text, single)


STATED_BLACK = DiagnosticKind(
    "stated-black-level",
    "warning",
    "The frames state a black level that the dark frames contradict.",
    "The calibration does not use the stated level; pictures developed with it have wrong shadows.",
    "Correct the black level in the metadata, or give it with --black-level, before developing the frames.",
    size="level of the dark frames, DN",
)

STATED_WHITE = DiagnosticKind(
    "stated-white-level",
    "warning",
    "Flat fields are brighter than the white level that the frames state.",
    "The calibration does not use the stated level; pictures developed with it clip early.",
    "Correct the white level in the metadata.",
    size="mean of the brightest flat fields, DN",
)


def _unknown_dark_signal(evidence: Evidence) -> float:
    """Return the largest signal of the dark current in long dark frames of one exposure time, DN; 0 for others.

    All of the dark noise may be its shot noise.
    """
    dark, noise, gain = evidence.dark, evidence.pooled.read_variance, evidence.light.gain
    longest = max(entry.group.exposure_s for entry in dark.groups)
    if longest < LONG_DARKS_S or any(lines.mean.fit is not None for lines in dark.lines):
        return 0.0
    if isinstance(noise, Missing) or isinstance(gain, Missing):
        return math.inf
    return max(noise.interval_95[1], 0.0) / gain.value


def stated_levels(evidence: Evidence) -> Iterator[Diagnostic]:
    """Stated black and white levels that the frames contradict. They matter for developing, not here."""
    frames, lights = evidence.reduction.frames, evidence.reduction.lights
    white = frames.white_level_dn or float((1 << frames.bits) - 1)
    stated, found = frames.black_level_dn, evidence.pooled.black_level
    if evidence.dark.groups and stated is not None and isinstance(found, Uncertain):
        low, high = found.interval_95
        if levels_disagree(stated, min(max(stated, low - _unknown_dark_signal(evidence)), high), white):
            yield STATED_BLACK(
                f"the black level is stated as {stated:g} DN, but that of the dark frames is {found.value:.2f} DN; "
                f"correct it before developing these frames",
                found.value,
            )
    if frames.white_level_dn is not None and lights:
        brightest, label = max((level.mean, entry.label) for entry in lights for level in entry.levels)
        if brightest > white and levels_disagree(white, brightest, 2 * white):
            text = f"the white level is stated as {white:g} DN, but {label} have a mean of {brightest:.1f} DN"
            yield STATED_WHITE(text, brightest)


FIRST_P_VALUE = 5e-4
"""Fraction of calibrations with frames in random order in which a difference may be reported."""

FIRST_LEAST_FRAMES = 3
"""Frames of a level that show whether the first one differs."""

FIRST_LEAST_FRACTION = 5e-4
"""Difference, as a fraction of the signal, that is reported; a smaller one is within the light's uncertainty."""

FIRST_FRAMES = DiagnosticKind(
    "first-frames-differ",
    "warning",
    "The first frame of most light levels is the lowest, or the highest.",
    "Charge of the level before (image lag), or light that is still changing, shifts responsivity and linearity.",
    "Take more frames of each level, and leave out the first ones.",
    (*RESPONSE, "linearity_*"),
    "difference from the other frames as a fraction of the signal",
    f"below {one_in(FIRST_P_VALUE)} sets with frames in random order",
)


def first_frames(evidence: Evidence) -> Iterator[Diagnostic]:
    """First frames of the flat fields that differ from the others of their level.

    In n frames of random order the first is the lowest with probability 1 / n.
    """
    found = _first_frames(evidence.reduction)
    if found is not None:
        fraction, extreme, levels = found
        yield FIRST_FRAMES(
            f"the first frame is the {'highest' if fraction > 0.0 else 'lowest'} in {extreme} of {levels} "
            f"levels of light, and its signal differs by {100.0 * fraction:+.2g} % from that of the other frames: "
            f"charge of the level before (image lag), or light that is still changing. It shifts responsivity and "
            f"linearity; take more frames and leave out the first ones",
            fraction,
        )


def _first_frames(reduction: Reduction) -> tuple[float, int, int] | None:
    """Return the median difference of the first frames, in how many levels they are extreme, and of how many."""
    totals = {id(entry.source): entry.total for entry in reduction.used}
    if reduction.reference_group is None:
        return None
    dark = pooled_level(reduction.reference_group.levels).mean
    pixels = reduction.frames.rows * reduction.frames.cols
    fractions, chances, lowest, highest = [], [], 0, 0
    for entry in reduction.lights:
        if any(level.clipped for level in entry.levels):
            continue
        signal = [totals[id(source)] / pixels - dark for source in entry.group.frames if id(source) in totals]
        first, others = signal[0], signal[1:]
        if len(signal) < FIRST_LEAST_FRAMES or np.mean(others) <= 0.0:
            continue
        lowest += first < min(others)
        highest += first > max(others)
        chances.append(1.0 / len(signal))
        fractions.append(first / float(np.mean(others)) - 1.0)
    if not fractions:
        return None
    from scipy.special import bdtrc

    # The largest of the chances is an upper limit for groups of different sizes.
    extreme = max(lowest, highest)
    by_chance = 2.0 * float(bdtrc(extreme - 1, len(chances), max(chances)))
    fraction = float(np.median(fractions))
    if by_chance > FIRST_P_VALUE or abs(fraction) < FIRST_LEAST_FRACTION or (fraction > 0.0) != (highest > lowest):
        return None
    return fraction, extreme, len(fractions)


CHECKS = (
    Check("result", 70, fast_shutter),
    Check("result", 72, light_leak),
    Check("result", 74, unsteady_light),
    Check("result", 76, unsteady_black),
    Check("result", 78, single_flats),
    Check("result", 80, stated_levels),
    Check("result", 90, first_frames),
)
