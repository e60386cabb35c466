"""Stage "light": saturation, linear range, system gain and response of each channel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from photosite.calibration.dark.dark_gain import DarkGain, measure_dark_gain
from photosite.calibration.dark.dark_result import DarkResult
from photosite.calibration.measurements import NO_LIGHT
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.dark_noise_ratio import (
    PROCESSED_FRAMES,
    DarkNoiseRatio,
    find_dark_noise_ratio,
)
from photosite.calibration.photon_transfer.knees import check_knees
from photosite.calibration.photon_transfer.level_outliers import LightOutlier, find_light_outliers
from photosite.calibration.photon_transfer.noise_covariance import SharedNoise
from photosite.calibration.photon_transfer.noise_structure import NoiseStructure, without_flicker
from photosite.calibration.photon_transfer.photon_transfer import (
    GainFit,
    LightLevels,
    fit_gain,
    gain_value,
    light_levels,
    with_rounded_darks,
)
from photosite.calibration.photon_transfer.response_curve import fit_bent_gain, unseen_fall
from photosite.calibration.photon_transfer.response_shape import TONE_CURVE, ToneCurve, find_tone_curve
from photosite.calibration.photon_transfer.without_darks import brighter_fatter, straightening
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import CLIPPED_FRACTION, GroupStatistics
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.withheld import SINGLE_FLATS
from photosite.sensor.model import Sensor
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.uncertain import COVERAGE_95, Missing, Source, Uncertain, Value, derive

EQUAL_GAINS = 0.01
"""Relative difference up to which the digital gains of two channels are equal."""


UNEQUAL_DIGITAL_GAINS = DiagnosticKind(
    "unequal-digital-gains",
    "withheld",
    "The channels have different digital gains.",
    "There is no common system gain; it is stated for each channel.",
    "Use raw numbers, before the white balance.",
    ("system_gain_dn_per_e", "conversion_gain_*"),
)


@dataclass(frozen=True)
class LightResult:
    """The light frames.

    Parameters
    ----------
    channels
        The channels, empty without light frames.
    gain_fit
        Photon transfer of all channels pooled, with the response curve where there is one.
    gain, line_gain
        System gain of all channels pooled, DN/e-: at small signal, and the slope of the standard's line, which does not
        know noise that pixels or frames share.
    noise
        Structure of the noise, which the gain takes into account.
    tone
        A tone curve, with which no figure of the light holds.
    processed
        How the noise of flat fields and dark frames differs, where they do not belong to one mode of the camera.
    outliers
        The levels whose stated light contradicts the others; only their noise is used.
    bend
        Without dark frames, the factor of the gain for a bend of the means (`straightening`), if they bend.
    straight_gain
        System gain of a straight response with shared noise, DN/e-.
    dark_gain
        Without light frames, the source of the gain, where dark frames give one.
    """

    channels: tuple[Channel, ...]
    gain_fit: GainFit | None
    gain: Value
    line_gain: Value
    noise: NoiseStructure
    tone: ToneCurve | None = None
    processed: DarkNoiseRatio | None = None
    outliers: tuple[LightOutlier, ...] = ()
    bend: Uncertain | None = None
    straight_gain: Value = NO_LIGHT
    dark_gain: DarkGain | None = None


def measure_light_frames(
    reduction: Reduction, dark: DarkResult, noise: NoiseStructure, reader: FrameReader, sensor: Sensor | None
) -> LightResult:
    """Analyze the light levels of each channel, and fit the system gain to all of them.

    The sensor as known before gives the line time, for the frequency of flicker.
    """
    if not reduction.lights:
        found = measure_dark_gain(reduction, dark)
        if isinstance(found, Missing):
            return LightResult((), None, found, NO_LIGHT, noise)
        return LightResult((), None, found.gain, NO_LIGHT, noise, dark_gain=found)
    if noise.flicker is not None:
        assert dark.mean is not None  # flicker is found against the reference dark frames
        reduction, flicker = without_flicker(
            reduction, reader, dark.mean, noise.flicker, None if sensor is None else sensor.line_time_us
        )
        noise = replace(noise, flicker=flicker)
    levels = [light_levels(reduction.lights, k, line) for k, line in enumerate(dark.lines)]
    if any(_light_differs(reduction.lights, each) for each in levels):
        reduction = replace(reduction, lights=tuple(replace(entry, light_known=False) for entry in reduction.lights))
        levels = [light_levels(reduction.lights, k, line) for k, line in enumerate(dark.lines)]
    outliers = [] if dark.level_unknown else find_light_outliers(levels, reduction.whites)
    wrong = {outlier.group for outlier in outliers}
    lights = [replace(group, light_trusted=i not in wrong) for i, group in enumerate(reduction.lights)]
    channels = [Channel.of(k, lights, lines, reduction.whites[k]) for k, lines in enumerate(dark.lines)]
    channels = _below_known_wells(channels)
    if not dark.level_unknown:
        check_knees(channels, reduction.frames.source, _distances_of_codes(reduction))
    if noise.shared is not None:
        channels = [replace(each, levels=noise.shared.means(each.levels, each.index)) for each in channels]
        if noise.shared.neighbors is not None:
            channels = _with_unsaturated_neighbors(channels)
    if not dark.level_unknown and (tone := find_tone_curve([channel.levels for channel in channels])) is not None:
        return _withheld(channels, noise, tone=tone)
    pooled = _photon_transfer(channels, noise.shared)
    single = [pooled] if len(channels) == 1 else [_photon_transfer([channel], noise.shared) for channel in channels]
    measured = tuple(
        replace(
            channel,
            gain=own.gain,
            line_gain=own.line_gain,
            straight_gain=own.straight_gain,
            curve=own.channels[0].curve,
        )
        for channel, own in zip(channels, single, strict=True)
    )
    if not dark.noise_unknown and (ratio := find_dark_noise_ratio(measured)) is not None:
        return _withheld(channels, noise, ratio=ratio)
    if (unequal := _unequal_gains(reduction)) is not None:
        pooled = replace(pooled, gain=unequal, line_gain=unequal)
    return replace(pooled, channels=measured, noise=noise, outliers=tuple(outliers))


def _distances_of_codes(reduction: Reduction) -> list[tuple[float, NDArray[np.float64]]] | None:
    """Return the distance of the numbers of each channel in the dark, and in each light group; None if it is one."""
    if all(steps is None or steps.uniform for steps in reduction.steps):
        return None
    darks, groups = len(reduction.darks), len(reduction.darks) + len(reduction.lights)
    distances = [np.ones(groups) if steps is None else np.array(steps.by_group) for steps in reduction.steps]
    return [(float(each[:darks].min(initial=1.0)), each[darks:]) for each in distances]


SAME_LIGHT, LIGHT_SIGMA = 0.02, 5.0
"""Relative difference of the signals up to which levels of one exposure time received the same light, and standard
uncertainties up to which it is by chance."""


def _light_differs(lights: Sequence[GroupStatistics], levels: LightLevels) -> bool:
    """Return whether levels of one exposure time and unstated photons received different light."""
    spread = LIGHT_SIGMA * np.sqrt(np.diag(levels.signal_covariance))
    named = np.array([lights[group].group.level is not None for group in levels.group], np.bool_)
    for exposure_s in np.unique(levels.exposure_s[named]):
        same = named & (levels.exposure_s == exposure_s)
        signal, by_chance = levels.signal[same], spread[same].max()
        if np.ptp(signal) > max(SAME_LIGHT * signal.max(), by_chance):
            return True
    return False


def _below_known_wells(channels: Sequence[Channel]) -> list[Channel]:
    """Return the channels without levels at which pixels reach the full well that another channel shows.

    Few full pixels change the variance by less than a bend may.
    """
    blacks = [channel.dark.mean.y[np.argmin(channel.dark.mean.exposure_s)] for channel in channels]
    tops = [channel.saturation.level_dn for channel in channels]
    wells = [
        top.value - black
        for top, black in zip(tops, blacks, strict=True)
        if isinstance(top, Uncertain) and top.standard_uncertainty > 0.0  # not the converter's limit
    ]
    if not wells or any(channel.dark.mean.reason for channel in channels):
        return list(channels)
    reach = -float(ndtri(CLIPPED_FRACTION))
    return [
        channel
        if channel.saturation.signal is not None
        else channel.without(levels.mean - black + reach * np.sqrt(levels.pattern_variance + levels.noise) > min(wells))
        for channel, black in zip(channels, blacks, strict=True)
        for levels in [channel.levels]
    ]


def _with_unsaturated_neighbors(channels: Sequence[Channel]) -> list[Channel]:
    """Return the channels without levels at which another one saturates, whose charge is a part of theirs.

    Its fraction stops growing there, as if their response bent. Channels that have fewer than two levels left keep
    theirs.
    """
    below = np.logical_and.reduce([channel.unsaturated for channel in channels])
    left = [channel.used & below for channel in channels]
    return [
        replace(channel, used=used) if np.count_nonzero(used) > 1 else channel
        for channel, used in zip(channels, left, strict=True)
    ]


def _withheld(
    channels: Sequence[Channel],
    noise: NoiseStructure,
    *,
    tone: ToneCurve | None = None,
    ratio: DarkNoiseRatio | None = None,
) -> LightResult:
    """Return the channels without gain, because of a tone curve or of another mode of the dark frames."""
    why = PROCESSED_FRAMES.missing(str(ratio)) if tone is None else TONE_CURVE.missing(str(tone))
    without = tuple(replace(channel, gain=why, line_gain=why, straight_gain=why) for channel in channels)
    return LightResult(without, None, why, why, noise, tone, ratio)


def _photon_transfer(channels: Sequence[Channel], shared: SharedNoise | None) -> LightResult:
    """Return the gains and curves that fit some channels."""
    if (why := _no_photon_transfer(channels)) is not None:
        return LightResult(tuple(channels), None, why, why, NoiseStructure())
    used, levels = [channel.used for channel in channels], _with_rounded_darks(channels)
    rounded = any(each is not channel.levels for each, channel in zip(levels, channels, strict=True))
    factor: Value = Uncertain(1.0)
    if shared is not None:
        levels, factor = shared.summed_covariances(levels, [channel.index for channel in channels])
    of_single: Value = factor if isinstance(factor, Missing) else Uncertain(1.0)
    bend: Value | None = None
    if channels[0].dark.mean.reason:
        bends = [straightening(*each) for each in zip(levels, used, strict=True)]
        bend = max(bends, key=lambda found: math.inf if isinstance(found, Missing) else found.standard_uncertainty)
        if isinstance(bend, Missing) or bend.parts:
            factor, of_single = (derive(lambda a, b: a * b, each, bend) for each in (factor, of_single))
        else:
            bend = None
    line, bent = fit_gain(levels, used), None
    if not isinstance(factor, Missing) and bend is None:
        bent = fit_bent_gain(levels, used, [c.saturation_signal for c in channels])
    if isinstance(bent, Missing):
        return LightResult(tuple(channels), line, bent, bent, NoiseStructure())
    if bent is None and channels[0].dark.mean.reason:
        shared_by_charge = brighter_fatter(levels, used)
        factor, of_single = (derive(lambda a: a * shared_by_charge, each) for each in (factor, of_single))
    gain = straight = _times(gain_value(line), factor)
    if bent is not None:
        gain = _times(gain_value(bent.fit, bent.gain), factor)
    elif line is not None and isinstance(straight, Uncertain) and not (channels[0].dark.mean.reason or rounded):
        fall = unseen_fall(levels, used, float(line.parameters[0]))
        if fall > 0.0:  # makes the gain of the line too low, never too high
            gain = straight + Uncertain.of(0.0, fall * straight.value, Source(0.0, COVERAGE_95))
    # The standard takes the variances of single pixels, and those of the dark frames as they are.
    in_series = [channel.in_series for channel in channels]
    line_gain = _times(gain_value(fit_gain([channel.levels for channel in channels], in_series, plain=True)), of_single)
    if bent is None or isinstance(gain, Missing):
        return LightResult(
            tuple(channels),
            line,
            gain,
            line_gain,
            NoiseStructure(),
            bend=None if isinstance(bend, Missing) else bend,
            straight_gain=straight,
        )
    curves = (replace(curve, gain=gain) for curve in bent.curves)
    curved = tuple(replace(channel, curve=curve) for channel, curve in zip(channels, curves, strict=True))
    return LightResult(curved, bent.fit, gain, line_gain, NoiseStructure(), straight_gain=straight)


def _with_rounded_darks(channels: Sequence[Channel]) -> list[LightLevels]:
    """Return the levels of some channels, with one dark variance where rounding makes the measured ones differ."""
    levels, used = [channel.levels for channel in channels], [channel.used for channel in channels]
    if not any(channel.dark.variance.depends_on_mean for channel in channels):
        return levels
    for _ in range(3):  # the shot noise of the dark signal needs the gain
        line = fit_gain(levels, used)
        if line is None:
            break
        gain = float(line.parameters[0])
        levels = [with_rounded_darks(channel.levels, channel.dark, gain) for channel in channels]
    return levels


def _times(gain: Value, factor: Value) -> Value:
    """Return a gain with a factor; an exact one is 1."""
    if isinstance(factor, Missing):
        return factor
    return derive(lambda k: k * factor, gain) if factor.parts else gain


def _no_photon_transfer(channels: Sequence[Channel]) -> Missing | None:
    """Return why the levels of light give no system gain without the dark variance; None where they do."""
    why = channels[0].dark.variance.reason
    if not why:
        return None
    levels = max(len(np.unique(c.levels.mean[c.used & c.levels.repeated])) for c in channels)
    if levels > 1:
        return None
    lights = f"{'no level' if levels == 0 else 'one level'} of light in the linear range has two frames"
    return SINGLE_FLATS.missing(
        f"{lights}; photon transfer needs two such levels, or one and the noise of dark frames; {why}"
    )


def _unequal_gains(reduction: Reduction) -> Missing | None:
    """Return why the channels have no common system gain; None where they have."""
    gains = [1.0 if steps is None else steps.by_group[reduction.reference or 0] for steps in reduction.steps]
    if max(gains) < (1.0 + EQUAL_GAINS) * min(gains):
        return None
    each = ", ".join(f"{name} {gain:.3g}" for name, gain in zip(reduction.names, gains, strict=True))
    return UNEQUAL_DIGITAL_GAINS.missing(
        f"the channels have different digital gains ({each}); the system gain is stated for each of them"
    )
