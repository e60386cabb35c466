"""What frames were said to be against what they show: units, exposures and bits that cannot be true.

A protocol or a descriptor is written by hand or by somebody's tool. A wrong unit in it makes no frame unreadable: it
makes implausible numbers. Here each is found by what is impossible in it, and named with its likely cause.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.groups import GroupStatistics
from photosite.errors import CalibrationError
from photosite.frames.frame_set import FrameSet
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Missing, Value

if TYPE_CHECKING:
    from photosite.calibration.photon_transfer.channel import Channel

BEYOND_CHANCE = 2.0
"""Half-widths of a 95 % interval from which on chance is no explanation (once in 10 000 for a normal)."""

FARTHEST = 1.5
"""Factor by which a signal may miss the proportion to its light that the others keep; lamps and shutters are better."""

LEAST_SIGNAL = 0.02
"""Of the brightest level in the linear range: a signal below it says little about proportion, stray light much."""

SHORTEST_S = 1e-6
"""Exposure below which few image sensors have a shutter."""

SHORTEST_DARKS_S = 1e-4
"""Longest dark exposure below which no dark current is told: one of 10 000 electrons per second gathers one."""

LONGEST_LIKELY_S = 1e-3
"""What the longest dark exposure of a measurement reaches at least, to say by which factor stated ones are off."""

AT_THE_TOP = 0.98
"""Share of a light level's pixels at the top of a smaller converter that makes it the converter's own top."""

LEAK_SHARE = 0.3
"""Of what flats gain over the same time: dark frames that gain more are as likely lit as warm."""

_FACTORS = {1e3: "a thousand", 1e6: "a million", 1e9: "a thousand million", 60.0: "sixty", 3600.0: "3600"}


@dataclass(frozen=True)
class Implausible(Missing):
    """A figure that came out and cannot be true, and what the likely cause is."""


def screen_dark_slope(slope: Value, exposure_s: NDArray[np.float64], *, of_variance: bool = False) -> Value:
    """The slope of the dark level or variance against exposure, or why it is none.

    Charge does not flow backwards, and exposures too short for any to gather are in another unit than was said.

    Parameters
    ----------
    slope
        As fitted, DN/s or DN^2/s.
    exposure_s
        (m,) the dark exposures.
    of_variance
        Whether it is that of the temporal variance.
    """
    if isinstance(slope, Missing):
        return slope
    if (why := too_short_for_dark_current(exposure_s)) is not None:
        return why
    above = slope.interval_95[1] - slope.value
    if slope.value + BEYOND_CHANCE * above >= 0.0:
        return slope
    low, high = float(exposure_s.min()), float(exposure_s.max())
    fall, uncertainty = -slope.value * (high - low), slope.standard_uncertainty * (high - low)
    what, unit = ("temporal variance", "DN²") if of_variance else ("level", "DN")
    return Implausible(
        f"the dark {what} falls by {fall:.3g} ± {uncertainty:.1g} {unit} "
        f"from {format_exposure(low)} to {format_exposure(high)} s, and no dark current is negative: the camera takes "
        f"its dark signal off itself (black clamping), the black level drifted or the chip cooled down between the "
        f"exposures, or the exposure times are not what the protocol or descriptor says (order, unit)"
    )


def too_short_for_dark_current(exposure_s: NDArray[np.float64]) -> Implausible | None:
    """Why darks of these exposures, two or more, tell of no dark current: the times cannot be true; None if they can.

    Parameters
    ----------
    exposure_s
        (m,) the dark exposures.

    Examples
    --------
    >>> print(too_short_for_dark_current(np.array([2e-7, 2e-5])).reason)  # doctest: +ELLIPSIS
    the dark exposures are 2e-07 to 2e-05 s, ... off by a factor of 1000 or more (0.0002 to 0.02 s), microseconds ...
    """
    low, high = float(exposure_s.min()), float(exposure_s.max())
    if not 0.0 < high < SHORTEST_DARKS_S:
        return None
    factor = 1e3
    while high * factor < LONGEST_LIKELY_S:
        factor *= 1e3
    meant = {1e3: "microseconds", 1e6: "milliseconds", 1e9: "seconds"}.get(factor)
    where = "" if meant is None else f", {meant} where nanoseconds belong"
    return Implausible(
        f"the dark exposures are {low:.3g} to {high:.3g} s, too short for any dark current to gather (none reaches "
        f"{SHORTEST_DARKS_S:g} s): an EMVA descriptor's times are nanoseconds, a protocol's seconds, and these seem "
        f"off by a factor of {factor:.0f} or more ({low * factor:.3g} to {high * factor:.3g} s){where}: correct them"
    )


def of_variance(slope: Value, of_mean: Value) -> Value:
    """The slope of the dark variance, or why it is none where the level's was implausible_warnings.

    A camera that holds its dark level shows its dark current in the variance alone (EMVA 1288 R4.0, dark current): then
    the variance grows beyond chance. What does not is no better than the level's.

    Parameters
    ----------
    slope, of_mean
        DN^2/s of the variance and DN/s of the level, as `screen_dark_slope` gave them.
    """
    if isinstance(slope, Missing) or not isinstance(of_mean, Implausible):
        return slope
    if slope.value > BEYOND_CHANCE * (slope.value - slope.interval_95[0]):
        return slope
    return Implausible(f"the dark temporal variance does not grow beyond chance, and {of_mean.reason}")


def screen_responsivity(responsivity: Value, gain: Value) -> Value:
    """The responsivity in DN per photon, or why it is none: a photon frees one electron at most.

    Parameters
    ----------
    responsivity, gain
        DN per photon and DN per electron.
    """
    if isinstance(responsivity, Missing) or isinstance(gain, Missing):
        return responsivity
    efficiency = responsivity / gain
    below = efficiency.value - efficiency.interval_95[0]
    if efficiency.value - BEYOND_CHANCE * below <= 1.0:
        return responsivity
    return Implausible(
        f"the stated photons would make a quantum efficiency of {100 * efficiency.value:.4g} %, and none is above "
        f"100 %: the photons per pixel are too few by a factor of {efficiency.value:.2g} or more (photons for another "
        f"pixel area, time or wavelength, or irradiance in another unit)"
    )


def check_step(frames: FrameSet, group: GroupStatistics, sums: NDArray[np.unsignedinteger]) -> None:
    """Refuse numbers that all are multiples of a power of two: a converter's bits, moved up.

    Parameters
    ----------
    group
        A group of frames with noise.
    sums
        (rows, cols) the sum of its frames.

    Raises
    ------
    CalibrationError
        With the step.
    """
    together = int(np.bitwise_or.reduce(sums, axis=None))
    step = together & -together
    if together == 0 or step == 1 or not _differ(group):
        return
    moved = step.bit_length() - 1
    raise CalibrationError(
        f"{frames.source}: {group.label}: all numbers add up to multiples of {step}: they are those of a "
        f"{frames.bits - moved}-bit converter moved up by {moved} bits, not of {frames.bits} bits; divide them by "
        f"{step} and say {frames.bits - moved} bits"
    )


def _differ(group: GroupStatistics) -> bool:
    """Whether the numbers vary, so that a step between them is not one number's own."""
    return any(level.spatial_variance > 0.0 for level in group.levels)


def check_flats(
    frames: FrameSet,
    names: Sequence[str],
    darks: Sequence[GroupStatistics],
    channels: Sequence[Channel],
    tops: Sequence[Sequence[tuple[float, float]]],
) -> None:
    """Refuse flats that cannot be what they were said to be: bits, light levels, and darks among them.

    Raises
    ------
    CalibrationError
        See `check_bits`, `check_proportion` and `check_dark_levels`.
    """
    check_bits(frames, names, tops)
    check_dark_levels(frames, darks, max(float(channel.levels.signal.max()) for channel in channels))
    check_proportion(frames, names, channels)


def check_bits(frames: FrameSet, names: Sequence[str], tops: Sequence[Sequence[tuple[float, float]]]) -> None:
    """Refuse flats that end at the top of a smaller converter than is said.

    Clipped by a converter pixels read the same; by a well they spread round any number. Some pixels may respond less.

    Parameters
    ----------
    tops
        Of each light level, per channel: `photosite.calibration.checks.frame_screening.top_value_shares`.

    Raises
    ------
    CalibrationError
        With where they end.
    """
    for k, name in enumerate(names):
        highest, share = max((level[k] for level in tops), default=(0.0, 0.0))
        top = int(highest)
        if share >= AT_THE_TOP and 0 < top < (1 << frames.bits) - 1:
            of_channel = f" of channel {name}" if len(names) > 1 else ""
            pixels = "every pixel" if share == 1.0 else f"{100 * share:.3g} % of the pixels"
            raise CalibrationError(
                f"{frames.source}: the brightest flats{of_channel} read {top} DN in {pixels}, the top of a "
                f"{top.bit_length()}-bit converter, and {frames.bits} bits are stated or assumed; correct the bits"
            )


@dataclass(frozen=True)
class _Proportion:
    """A channel's levels that can show proportion: signal per unit of an axis, relative to their median."""

    x: NDArray[np.float64]
    ratio: NDArray[np.float64]
    beyond: NDArray[np.bool_]

    @classmethod
    def of(cls, x: NDArray[np.float64], signal: NDArray[np.float64], uncertainty: NDArray[np.float64]) -> _Proportion:
        per_unit = signal / x
        ratio = per_unit / np.median(per_unit)
        # Both ends: a signal that is there and should not be, and one that is missing.
        off = np.abs(signal - np.median(per_unit) * x) > 5.0 * uncertainty
        return cls(x, ratio, ((ratio > FARTHEST) | (ratio < 1.0 / FARTHEST)) & off)


def check_proportion(frames: FrameSet, names: Sequence[str], channels: Sequence[Channel]) -> None:
    """Refuse flats whose signal does not go with the light that was said to fall on them.

    Within the linear range, signals are compared with the one proportion that most of them keep. What misses it by half
    and more is no non-linearity: exposures are in mixed units, exchanged or made up, or the lamp was another.

    Raises
    ------
    CalibrationError
        With the level, by how much it is off, and what fits better, where something does.
    """
    for name, channel in zip(names, channels, strict=True):
        levels = channel.levels
        take = channel.used & (levels.x > 0.0)
        take &= levels.signal > LEAST_SIGNAL * levels.signal[take].max(initial=0.0)
        if take.sum() < 3:
            continue
        signal, uncertainty = levels.signal[take], np.sqrt(np.diag(levels.signal_covariance)[take])
        found = _Proportion.of(levels.x[take], signal, uncertainty)
        if not found.beyond.any():
            continue
        by_photons = levels.abscissa == "photons_per_pixel"
        worst = int(np.argmax(np.abs(np.log(found.ratio)) * found.beyond))
        where = f"{found.x[worst]:g} photons" if by_photons else f"{format_exposure(float(found.x[worst]))} s"
        of_channel = f" (channel {name})" if len(names) > 1 else ""
        raise CalibrationError(
            f"{frames.source}: the signal does not go with the stated {'photons' if by_photons else 'exposure times'}: "
            f"flats at {where}{of_channel} read {signal[worst]:.4g} DN above dark, {found.ratio[worst]:.3g} times what "
            f"the others make of it, and {int(found.beyond.sum())} of {len(signal)} levels are off like that; "
            f"{_likely_cause(found, levels.exposure_s[take], signal, uncertainty, by_photons)}"
        )


def _likely_cause(
    found: _Proportion,
    exposure_s: NDArray[np.float64],
    signal: NDArray[np.float64],
    uncertainty: NDArray[np.float64],
    by_photons: bool,
) -> str:
    if by_photons and len(np.unique(exposure_s)) > 1:
        by_time = _Proportion.of(exposure_s, signal, uncertainty)
        if not by_time.beyond.any():
            return "it goes with the exposure times instead: correct the photons"
    off = found.ratio[found.beyond]
    for factor, words in _FACTORS.items():
        if np.all(np.abs(np.log(off) / math.log(factor)) > 0.9) and np.all(
            np.abs(np.log(off) / math.log(factor)) < 1.1
        ):
            return f"these are off by {words}: units are mixed (s, ms, us, ns), state all in one"
    if float(signal.max()) < FARTHEST * float(signal.min()):
        return "the signal is the same whatever is stated: automatic exposure, or the lamp was dimmed against it"
    order = np.argsort(signal)
    if (
        not np.array_equal(order, np.argsort(found.x))
        and not _Proportion.of(np.sort(found.x), signal[order], uncertainty[order]).beyond.any()
    ):
        return "put in the order of the signals they fit: levels were exchanged, correct the listing"
    return "check the list of files and levels, the lamp, and that nothing adjusted itself (aperture, gain, exposure)"


def check_dark_levels(frames: FrameSet, darks: Sequence[GroupStatistics], brightest_dn: float) -> None:
    """Refuse darks among which one group was lit: far brighter than the darks of shorter and of longer exposure.

    Parameters
    ----------
    brightest_dn
        What the brightest flats read above the darks, of any channel.

    Raises
    ------
    CalibrationError
        With the group.
    """
    order = sorted(darks, key=lambda entry: entry.group.exposure_s)
    for index, entry in enumerate(order):
        for k, level in enumerate(entry.levels):
            others = [other.levels[k].mean for other in order[index + 1 :]]
            if not others:
                continue
            fall = level.mean - max(others)
            if fall > max(LEAST_SIGNAL * brightest_dn, 5.0 * math.sqrt(level.spatial_variance)):
                raise CalibrationError(
                    f"{frames.source}: {entry.label} read {level.mean:.4g} DN, and all darks of longer exposure "
                    f"{max(others):.4g} DN or less: light fell on them, or flats are listed as darks"
                )


def warnings(frames: FrameSet, darks: Sequence[GroupStatistics], channels: Sequence[Channel]) -> list[str]:
    """What may be another unit than was said, or light where there should be none."""
    return _fast_shutter(frames) + _light_leak(darks, channels)


def _fast_shutter(frames: FrameSet) -> list[str]:
    exposures = [group.exposure_s for group in frames.groups]
    shortest, longest = min(exposures), max(exposures)
    darks = np.unique([group.exposure_s for group in frames.of_kind("dark")])
    if shortest >= SHORTEST_S or (len(darks) > 1 and too_short_for_dark_current(darks) is not None):
        return []
    return [
        f"exposures from {shortest:.3g} to {longest:.3g} s: hardly a shutter is as fast as the shortest; if the times "
        f"are in another unit than the protocol or descriptor says (an EMVA descriptor's are nanoseconds), dark "
        f"current and dark voltage are wrong by the same factor"
    ]


def _light_leak(darks: Sequence[GroupStatistics], channels: Sequence[Channel]) -> list[str]:
    """A warning where dark frames gain with time as flats do: a light leak cannot be told from dark current.

    The darks' slope is compared with the least that flats gain per second in their linear range.
    """
    for channel in channels:
        _, slope = channel.dark.mean.line
        levels = channel.levels
        take = channel.used & (levels.signal > 0.0)
        if isinstance(slope, Missing) or not take.any():
            continue
        gain = float(np.min(levels.signal[take] / levels.exposure_s[take]))
        if slope.value > LEAK_SHARE * gain and slope.value > BEYOND_CHANCE * (slope.value - slope.interval_95[0]):
            longest = max(darks, key=lambda entry: entry.group.exposure_s)
            return [
                f"the darks gain {slope.value:.3g} DN/s, {100 * slope.value / gain:.2g} % of what the dimmest flats do "
                f"(to {longest.levels[channel.index].mean:.4g} DN at {format_exposure(longest.group.exposure_s)} s): "
                f"that is much for dark current; if light leaked in, dark current and DCNU are the leak's"
            ]
    return []


def implausible_warnings(named: Sequence[tuple[str, Value]]) -> list[str]:
    """Warnings that say aloud which figures were implausible_warnings: name and value with the reason."""
    return [f"{name} could not be true: {value.reason}" for name, value in named if isinstance(value, Implausible)]
