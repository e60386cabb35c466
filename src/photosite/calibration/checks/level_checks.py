"""Checks of the levels of groups: clipping, bit depth, digital gain, first frames, stated light and stated levels.

A protocol or descriptor is written by hand or by another tool. A wrong unit in it leaves every frame readable, but
makes the results wrong. Each error here rests on something impossible in the levels, and names the likely cause.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.checks.result_screening import BEYOND_CHANCE, too_short_for_dark_current
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.photon_transfer import STILL_SHARE
from photosite.calibration.reduction.groups import CLIPPED_DARK_SHARE, GroupStatistics, pooled_level
from photosite.calibration.reduction.reduce import Reduction
from photosite.frames.frame_set import FrameSet
from photosite.frames.raw_frame import levels_disagree
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

AT_THE_TOP, LEAST_BITS = 0.98, 6
"""Share of a light level's pixels at the full scale of a smaller converter that shows that converter's bit depth, and
the smallest bit depth that is searched."""

LEAK_SHARE = 0.3
"""Share of the flat fields' slope above which the dark frames' slope is as likely a light leak as dark current."""

_FACTORS = {1e3: "a thousand", 1e6: "a million", 1e9: "a thousand million", 60.0: "sixty", 3600.0: "3600"}


def check_levels(reduction: Reduction) -> None:
    """Raise a CalibrationError where the levels cannot support a calibration.

    Reasons are dark frames that are black, saturated or without noise, flat fields not brighter than the dark frames,
    and numbers of another bit depth than stated.
    """
    _check_step(reduction)
    _check_darks(reduction)
    if reduction.lights:
        _check_lights(reduction)
        _check_copies(reduction)
        _check_full_scale(reduction)


def check_channels(reduction: Reduction, channels: Sequence[Channel]) -> None:
    """Raise a CalibrationError for a lit dark group, and for signals not proportional to the stated light."""
    if channels:
        _check_unlit(reduction, max(float(channel.levels.signal.max()) for channel in channels))
        _check_proportion(reduction, channels)


def _check_step(reduction: Reduction) -> None:
    """Check that the numbers are not all multiples of a power of two: shifted numbers of fewer bits."""
    group, bits = reduction.first_group, reduction.frames.bits
    bits_used = reduction.bits_used
    if reduction.reference_mean is not None:
        bits_used |= int(np.bitwise_or.reduce(reduction.reference_mean.sum, axis=None))
    step = bits_used & -bits_used
    if step > 1 and any(level.spatial_variance > 0.0 for level in group.levels):
        shift = step.bit_length() - 1
        raise reduction.error(
            f"all numbers are multiples of {step}: they have {bits - shift} bits shifted by {shift} bits, not "
            f"{bits} bits",
            f"Divide them by {step} and state {bits - shift} bits",
            group,
        )


def _check_darks(reduction: Reduction) -> None:
    for group in reduction.darks:
        for name, level in zip(reduction.names, group.levels, strict=True):
            if level.low_fraction == 1.0:
                hint = "Raise the camera's black level (pedestal) and take the dark frames again"
                raise reduction.error("all numbers are clipped at 0 DN", hint, group, name)
            if level.high_fraction > CLIPPED_DARK_SHARE:
                raise reduction.error(
                    f"{100 * level.high_fraction:.3g} % of the pixels are at {(1 << reduction.frames.bits) - 1} DN, "
                    f"but dark frames cannot be saturated",
                    "Cover the lens, or shorten the exposure time",
                    group,
                    name,
                )
            if level.repeated and level.variance == 0.0:
                what = f"the {level.frames} frames do not differ in a single pixel"
                raise reduction.error(what, "Use frames with their noise, not copies", group, name)


def _check_lights(reduction: Reduction) -> None:
    """Check that the brightest light group is brighter than the shortest dark exposure."""
    if not reduction.darks:
        return
    brightest = max(reduction.lights, key=lambda group: max(level.mean for level in group.levels))
    pairs = [(light.mean, dark.mean) for light, dark in zip(brightest.levels, reduction.darks[0].levels, strict=True)]
    if all(light <= dark for light, dark in pairs):
        raise reduction.error(
            f"the brightest {brightest.label} have a mean of {pairs[0][0]:.2f} DN, not above the dark frames' "
            f"{pairs[0][1]:.2f} DN",
            "Check that dark and light frames are not swapped, and that the lamp was on",
        )


def _check_copies(reduction: Reduction) -> None:
    """Check that no flat fields are without noise though brighter ones have noise: clipping leaves none brighter."""
    for k, name in enumerate(reduction.names):
        repeated = [entry for entry in reduction.lights if entry.levels[k].repeated]
        for entry in repeated:
            level = entry.levels[k]
            brighter = [other.levels[k].variance for other in repeated if other.levels[k].mean > 1.05 * level.mean]
            if brighter and level.low_fraction < CLIPPED_DARK_SHARE and level.variance < STILL_SHARE * min(brighter):
                raise reduction.error(
                    f"the {level.frames} frames hardly differ (variance {level.variance:.2g} DN^2), but brighter flats "
                    f"do ({min(brighter):.2g} DN^2 or more)",
                    "Use frames with their noise, not copies",
                    entry,
                    name,
                )


def _check_full_scale(reduction: Reduction) -> None:
    """Check that flat fields do not end at the full scale of a smaller converter than stated.

    Pixels clipped by a converter all read the same number; pixels clipped by a well spread around any number. Some
    pixels may respond less.
    """
    bits = reduction.frames.bits
    if any(steps is not None for steps in reduction.steps):  # numbers after a digital gain
        return
    for k, name in enumerate(reduction.names):
        top = reduction.whites[k]
        share = max(group.levels[k].high_fraction for group in reduction.lights)
        if share >= AT_THE_TOP and top & (top + 1) == 0 and LEAST_BITS <= top.bit_length() < bits:
            pixels = "every pixel" if share == 1.0 else f"{100 * share:.3g} % of the pixels"
            raise reduction.error(
                f"the brightest flat fields{reduction.of_channel(name, ' of channel {}')} have {top} DN in {pixels}, "
                f"the full scale of {top.bit_length()} bits, but {bits} bits are stated or assumed",
                "Correct the bits",
            )


def _check_unlit(reduction: Reduction, brightest_dn: float) -> None:
    """Check that no dark group is far brighter than all dark frames of longer exposure.

    `brightest_dn` is the largest signal of the flat fields above dark.
    """
    order = sorted(reduction.darks, key=lambda entry: entry.group.exposure_s)
    for index, entry in enumerate(order[:-1]):
        for k, level in enumerate(entry.levels):
            others = max(other.levels[k].mean for other in order[index + 1 :])
            if level.mean - others > max(LEAST_SIGNAL * brightest_dn, 5.0 * math.sqrt(level.spatial_variance)):
                raise reduction.error(
                    f"{entry.label} have a mean of {level.mean:.4g} DN, but all dark frames of longer exposure "
                    f"{others:.4g} DN or less: light fell on them, or flat fields are listed as dark frames"
                )


@dataclass(frozen=True)
class _Proportion:
    """Signals that should be proportional to an axis, with their uncertainties; (levels,) each."""

    x: NDArray[np.float64]
    signal: NDArray[np.float64]
    uncertainty: NDArray[np.float64]

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Signal per unit of the axis, relative to its median over the levels."""
        per_unit = self.signal / self.x
        return np.asarray(per_unit / np.median(per_unit))

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Whether a level deviates by more than `FARTHEST`, and beyond chance."""
        expected = np.median(self.signal / self.x) * self.x
        significant = np.abs(self.signal - expected) > 5.0 * self.uncertainty
        return np.asarray(((self.ratio > FARTHEST) | (self.ratio < 1.0 / FARTHEST)) & significant)


def _check_proportion(reduction: Reduction, channels: Sequence[Channel]) -> None:
    """Check that signals in the linear range are proportional to the stated light."""
    for name, channel in zip(reduction.names, channels, strict=True):
        levels = channel.levels
        take = channel.used & levels.trusted & (levels.x > 0.0)
        take &= levels.signal > LEAST_SIGNAL * levels.signal[take].max(initial=0.0)
        if take.sum() < 3:
            continue
        found = _Proportion(levels.x[take], levels.signal[take], np.sqrt(np.diag(levels.signal_covariance)[take]))
        ratio, beyond = found.ratio, found.beyond
        if not beyond.any():
            continue
        by_photons = levels.photons_known
        worst = int(np.argmax(np.abs(np.log(ratio)) * beyond))
        level = f"{found.x[worst]:g} photons" if by_photons else f"{format_exposure(float(found.x[worst]))} s"
        cause, hint = _likely_cause(found, levels.exposure_s[take] if by_photons else None)
        raise reduction.error(
            f"the signal is not proportional to the stated {'photons' if by_photons else 'exposure times'}: flat "
            f"fields at {level}{reduction.of_channel(name, ' (channel {})')} have {found.signal[worst]:.4g} DN above "
            f"dark, {ratio[worst]:.3g} times the proportion of the others, and {int(beyond.sum())} of {len(ratio)} "
            f"levels deviate; {cause}",
            hint,
        )


def _likely_cause(found: _Proportion, exposure_s: NDArray[np.float64] | None) -> tuple[str, str]:
    """Return the likely cause of a missing proportion, to photons if `exposure_s` is given, and what to do."""
    if exposure_s is not None and len(np.unique(exposure_s)) > 1 and not replace(found, x=exposure_s).beyond.any():
        return "it is proportional to the exposure times instead", "Correct the photons"
    off = found.ratio[found.beyond]
    for factor, words in _FACTORS.items():
        power = np.abs(np.log(off) / math.log(factor))
        if np.all(power > 0.9) and np.all(power < 1.1):
            return f"they deviate by a factor of {words}: units are mixed (s, ms, us, ns)", "State all in one unit"
    if float(found.signal.max()) < FARTHEST * float(found.signal.min()):
        cause = "the signal is the same at every level: automatic exposure, or a lamp dimmed against the exposure time"
        return cause, "Switch the automatic exposure off and keep the lamp constant"
    order = np.argsort(found.signal)
    in_order = np.array_equal(order, np.argsort(found.x))
    if not in_order and not _Proportion(np.sort(found.x), found.signal[order], found.uncertainty[order]).beyond.any():
        return "sorted by signal they fit: levels were swapped", "Correct the list of files and levels"
    hint = "Check the list of files and levels, the lamp, and automatic aperture, gain or exposure"
    return "the cause is unknown", hint


def level_warnings(
    reduction: Reduction, darks: Sequence[GroupStatistics], channels: Sequence[Channel]
) -> Iterator[str]:
    """Yield warnings about levels that do not prevent a calibration."""
    yield from _fast_shutter(reduction.frames)
    yield from _light_leak(darks, channels)
    yield from _unsteady_light(darks, reduction.lights)
    yield from _unsteady_black(reduction.names, darks)
    if single := sum(group.frames == 1 for group in reduction.lights):
        yield f"{single} of {len(reduction.lights)} light levels have one frame and show no temporal noise"
    yield from _stated_levels(reduction.frames, darks, reduction.lights)


def _fast_shutter(frames: FrameSet) -> Iterator[str]:
    exposures = [group.exposure_s for group in frames.groups if group.exposure_s > 0.0]
    if not exposures:
        return
    shortest, longest = min(exposures), max(exposures)
    darks = np.unique([group.exposure_s for group in frames.of_kind("dark")])
    explained = len(darks) > 1 and too_short_for_dark_current(darks) is not None
    if shortest < SHORTEST_S and not explained:
        yield (
            f"the exposure times range from {shortest:.3g} to {longest:.3g} s, and hardly a shutter is as fast as the "
            f"shortest; in another unit (an EMVA descriptor has nanoseconds), dark current and dark voltage are wrong "
            f"by the same factor; check the unit in the protocol or descriptor"
        )


def _light_leak(darks: Sequence[GroupStatistics], channels: Sequence[Channel]) -> Iterator[str]:
    """Warn where the dark signal grows with time nearly as the flat fields do: a light leak looks like dark current.

    The slope is compared with the smallest signal per second in the linear range of the flat fields.
    """
    for channel in channels:
        _, slope = channel.dark.mean.line
        levels = channel.levels
        take = channel.used & levels.trusted & (levels.signal > 0.0)
        if isinstance(slope, Missing) or not take.any():
            continue
        rate = float(np.min(levels.signal[take] / levels.exposure_s[take]))
        if slope.value > LEAK_SHARE * rate and slope.value > BEYOND_CHANCE * (slope.value - slope.interval_95[0]):
            longest = max(darks, key=lambda entry: entry.group.exposure_s)
            yield (
                f"the dark signal grows by {slope.value:.3g} DN/s, {100 * slope.value / rate:.2g} % of the dimmest "
                f"flats (to {longest.levels[channel.index].mean:.4g} DN at {format_exposure(longest.group.exposure_s)} "
                f"s), which is much for dark current; a light leak would falsify dark current and DCNU"
            )
            return


def _rate_per_level(groups: Sequence[GroupStatistics]) -> float:
    """Return the false alarm rate per level at which all levels together have `FALSE_ALARMS` at most (Bonferroni)."""
    return FALSE_ALARMS / max(sum(len(entry.levels) for entry in groups if entry.frames > 1), 1)


def _unsteady_light(darks: Sequence[GroupStatistics], lights: Sequence[GroupStatistics]) -> Iterator[str]:
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
        yield (
            f"the light was unsteady: {label} shift by {100 * worst:.2g} % from frame to frame; the shifts are "
            f"excluded from the temporal noise"
        )


def _unsteady_black(names: Sequence[str], darks: Sequence[GroupStatistics]) -> Iterator[str]:
    rate = _rate_per_level(darks)
    found = [
        (level.frame_shift, f"{group.label} (channel {name})")
        for group in darks
        for name, level in zip(names, group.levels, strict=True)
        if level.repeated and level.frame_shift > math.sqrt(level.variance) and level.shifts_beyond_chance(rate)
    ]
    if found:
        worst, label = max(found)
        yield (
            f"the black level was unsteady: {label} shift by {worst:.2g} DN from frame to frame, more than their noise"
        )


def _stated_levels(
    frames: FrameSet, darks: Sequence[GroupStatistics], lights: Sequence[GroupStatistics]
) -> Iterator[str]:
    """Warn of stated black and white levels that the frames contradict. They matter for developing, not here."""
    white = frames.white_level_dn or float((1 << frames.bits) - 1)
    stated = frames.black_level_dn
    for dark in darks[:1]:
        found = pooled_level(dark.levels).mean
        if stated is not None and levels_disagree(stated, found, white):
            yield (
                f"the black level is stated as {stated:g} DN, but the {dark.label} have a mean of {found:.2f} DN; "
                f"correct it before developing these frames"
            )
    if frames.white_level_dn is not None and lights:
        brightest, label = max((level.mean, entry.label) for entry in lights for level in entry.levels)
        if brightest > white and levels_disagree(white, brightest, 2 * white):
            yield f"the white level is stated as {white:g} DN, but {label} have a mean of {brightest:.1f} DN"


EQUAL_GAINS = 0.01
"""Relative difference up to which the digital gains of two channels are equal."""


def digital_gain_warnings(reduction: Reduction) -> Iterator[str]:
    """Yield a warning for each channel with a digital gain: its size, and what it means for the results."""
    darks = reduction.first_group.levels
    for name, steps, level in zip(reduction.names, reduction.steps, darks, strict=True):
        if steps is None:
            continue
        text = f"{steps}{reduction.of_channel(name)}"
        if not steps.uniform:
            yield (
                f"{text}, as with companded numbers that were decoded; the quantization noise of each level was taken "
                f"off its temporal variance"
            )
            continue
        if (bits := steps.stretched_from(reduction.frames.bits)) is not None:
            text += f": numbers of {bits} bits stretched to {reduction.frames.bits} bits"
        yield (
            f"{text}; the system gain holds for the numbers of the file, quantization noise of "
            f"{level.quantisation:.3g} DN² was taken off in place of 1/12 DN², and figures from the converter's "
            f"bit depth (millivolts) are wrong by the gain; use raw numbers if the camera gives them"
        )


def unequal_gains(reduction: Reduction) -> Missing | None:
    """Return why the channels have no common system gain; None where they have."""
    gains = [1.0 if steps is None else steps.of_groups[reduction.reference or 0] for steps in reduction.steps]
    if max(gains) < (1.0 + EQUAL_GAINS) * min(gains):
        return None
    each = ", ".join(f"{name} {gain:.3g}" for name, gain in zip(reduction.names, gains, strict=True))
    return Missing(f"the channels have different digital gains ({each}); the system gain is stated for each of them")


FIRST_BY_CHANCE = 5e-4
"""Share of calibrations with frames in random order in which a difference may be reported."""

FIRST_LEAST_FRAMES = 3
"""Frames of a level that show whether the first one differs."""

FIRST_LEAST_SHARE = 5e-4
"""Difference, as a share of the signal, below which nothing is reported: it is lost in the uncertainty of the light."""


@dataclass(frozen=True)
class FirstFrames:
    """First frames that differ from the other frames of their level.

    Parameters
    ----------
    share
        Median difference of their signal from that of the others, as a share of it.
    extreme, levels
        Number of levels whose first frame is the lowest, or the highest where `share` is positive; number of levels.
    """

    share: float
    extreme: int
    levels: int

    def __str__(self) -> str:
        return (
            f"the first frame is the {'highest' if self.share > 0.0 else 'lowest'} in {self.extreme} of {self.levels} "
            f"levels of light, and its signal differs by {100.0 * self.share:+.2g} % from that of the other frames: "
            f"charge of the level before (image lag), or light that is still changing. It shifts responsivity and "
            f"linearity; take more frames and leave out the first ones"
        )


def find_first_frames(reduction: Reduction) -> FirstFrames | None:
    """Return how the first frames of the flat fields differ; None where they do not, within chance.

    In n frames of random order the first is the lowest with probability 1 / n.
    """
    totals = {id(entry.source): entry.total for entry in reduction.used}
    if reduction.reference_group is None:
        return None
    dark = pooled_level(reduction.reference_group.levels).mean
    pixels = reduction.frames.rows * reduction.frames.cols
    shares, chances, lowest, highest = [], [], 0, 0
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
        shares.append(first / float(np.mean(others)) - 1.0)
    if not shares:
        return None
    from scipy.stats import binom

    # The largest of the chances is an upper limit for groups of different sizes.
    extreme = max(lowest, highest)
    by_chance = 2.0 * float(binom.sf(extreme - 1, len(chances), max(chances)))
    share = float(np.median(shares))
    if by_chance > FIRST_BY_CHANCE or abs(share) < FIRST_LEAST_SHARE or (share > 0.0) != (highest > lowest):
        return None
    return FirstFrames(share, extreme, len(shares))
