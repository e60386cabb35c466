"""The steps of a calibration between reading frames and giving parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photosite.calibration.checks.frame_set_checks import check_darks
from photosite.calibration.checks.result_screening import (
    Implausible,
    check_step,
    of_variance,
    screen_dark_slope,
    screen_responsivity,
)
from photosite.calibration.clipped_blacks.clipped_darks import (
    METHOD,
    NO_PIXEL_SLOPES,
    ClippedDarks,
    are_clipped,
    correct_clipped_darks,
)
from photosite.calibration.fixed_pattern import Patterns, mean_planes
from photosite.calibration.measurements import Measurements, pool
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.dark_lines import DarkLines, temporal_variances
from photosite.calibration.photon_transfer.linearity import channel_linearity
from photosite.calibration.photon_transfer.photon_transfer import (
    find_saturation,
    fit_gain,
    fit_response,
    gain_value,
    light_levels,
    linear_levels,
)
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics, Level, pooled_level, reference_dark
from photosite.calibration.spatial.line_noise import TemporalParts, mean_frame_parts
from photosite.calibration.spatial.parts import Parts, channel_parts
from photosite.calibration.spatial.pixel_slopes import (
    PixelSlopes,
    SlopeSpread,
    excess_variance,
    mean_frame_noise,
    of_one_sample,
    slope_coefficients,
    slope_noise,
)
from photosite.calibration.spatial.spatial_analysis import FarThresholds, SpatialAnalysis, spatial_analysis
from photosite.engine.frame_sums import FrameSums, MeanFrame
from photosite.engine.map_statistics import Moments, label_moments
from photosite.frames.frame_set import FrameGroup
from photosite.sensor.noise_profile import QUANTISATION_DN2
from photosite.values.uncertain import Missing, Uncertain, Value, weighted_mean

NO_LIGHT = Missing("no light frames")
NO_PHOTONS = Missing("the photons per pixel are not known; a descriptor or a protocol says them")


@dataclass(frozen=True)
class DarkSide:
    """The dark groups as read.

    Parameters
    ----------
    groups
        Statistics by exposure.
    reference, mean
        The group of read noise and DSNU: the most frames, then the shortest exposure; and its mean frame.
    slopes
        Per channel, mean and spread of the pixels' dark slopes; None with one dark exposure.
    scatter
        By how much, relatively, the noise differs between combinations of frames beyond sampling (`DarkLine.scatter`).
    noise
        Per channel, the temporal variance left in `mean`.
    clipped
        What stands for darks that clip at 0, whose `groups` are those without the clipping; None where none do.
    """

    groups: list[GroupStatistics]
    reference: int
    mean: MeanFrame
    slopes: tuple[SlopeSpread, ...] | None
    scatter: float
    noise: list[TemporalParts]
    clipped: ClippedDarks | None = None

    @property
    def as_read(self) -> Sequence[GroupStatistics]:
        """The groups with their clipping."""
        return self.groups if self.clipped is None else self.clipped.as_read


def read_statistics(reader: FrameReader, group: FrameGroup) -> tuple[GroupStatistics, FrameSums]:
    """Read a group: what it says in numbers, and its sums."""
    sums = reader.sums(group)
    return GroupStatistics(group, tuple(Level.of(totals) for totals in sums.label_totals())), sums


def read_darks(reader: FrameReader) -> DarkSide:
    """Read the dark groups once, building the map of dark slopes on the way, and judge them.

    The slopes weigh a group by its frames: weights must be known before the first frame is read, and the dark
    variance grows little with exposure. Other weights would be a little more precise, not more right.

    Raises
    ------
    CalibrationError
        If the frames are still, copies of each other, or so clipped that too little is left.
    """
    planned = reader.frames.of_kind("dark")
    exposure = np.array([group.exposure_s for group in planned])
    slopes = coefficients = None
    if len(np.unique(exposure)) > 1:
        slopes = PixelSlopes((reader.frames.rows, reader.frames.cols), reader.tile)
        coefficients = slope_coefficients(exposure, np.array([float(len(group)) for group in planned]))
    wanted = reference_dark(planned)
    groups: list[GroupStatistics] = []
    kept: MeanFrame | None = None
    for index, group in enumerate(planned):
        statistics, sums = read_statistics(reader, group)
        groups.append(statistics)
        if index == wanted:
            check_step(reader.frames, statistics, sums.sum)
            kept = sums.mean_frame()
        if slopes is not None and coefficients is not None:
            slopes.add(sums.mean_frame(), [float(coefficients[index])] * len(statistics.levels))
    check_darks(reader.frames, groups, reader.rejected)
    if kept is None or (reference := reference_dark(groups)) != wanted:
        # Repeats were left out of the group that had the most frames.
        reader.expect(len(planned[reference]))
        kept = reader.mean(planned[reference])
    seconds = [entry.group.exposure_s for entry in groups]
    as_read, clipped = groups, None
    if are_clipped(groups):
        clipped = correct_clipped_darks(reader, groups, reference)
        groups = list(clipped.groups)
    scatter = DarkLines.of(seconds, [pooled_level(entry.levels) for entry in groups]).variance.scatter
    noise = mean_frame_parts(reader, as_read[reference], scatter)
    if slopes is None or coefficients is None:
        return DarkSide(groups, reference, kept, None, scatter, noise, clipped)
    of_slopes = []
    for k in range(len(groups[0].levels)):
        levels = [entry.levels[k] for entry in as_read]
        frames = np.array([level.frames for level in levels])
        of_slopes.append(slope_noise(coefficients, frames, *temporal_variances(exposure, levels), scatter))
    spreads = slopes.spreads(of_slopes)
    side = DarkSide(groups, reference, kept, spreads, scatter, noise, clipped)
    return side if clipped is None else replace(side, slopes=_clipped_slopes(side, spreads))


def _clipped_slopes(dark: DarkSide, spreads: Sequence[SlopeSpread]) -> tuple[SlopeSpread, ...]:
    """The pixels' dark slopes where darks are clipped: the mean is that of the levels turned back, and their spread, of
    which the clipped half is not seen, stands with an uncertainty of its own size."""
    assert dark.clipped is not None
    result = []
    for k, entry in enumerate(spreads):
        _, slope = darkness(dark, k).mean.line
        mean = entry.mean if isinstance(slope, Missing) else slope.value
        variance = entry.variance * dark.clipped.scale(k)
        result.append(replace(entry, mean=mean, variance=variance + Uncertain.of(0.0, abs(variance.value))))
    return tuple(result)


def _mean_variance(spreads: Sequence[SlopeSpread]) -> Uncertain:
    return weighted_mean([entry.variance for entry in spreads], [float(entry.pixels) for entry in spreads])


def reference_parts(dark: DarkSide, channel: int) -> tuple[Parts | Missing, Parts | Missing]:
    """Parts of a channel's mean reference dark, plain and high-passed."""
    mean, tile = dark.mean.mean(), dark.mean.labels
    plain, filtered = (
        channel_parts(mean, tile, channel, dark.noise[channel], filtered=filtered) for filtered in (False, True)
    )
    return (plain, filtered) if dark.clipped is None else dark.clipped.parts(channel, plain, filtered)


def clipped_parts(dark: DarkSide) -> dict[tuple[int, bool], Parts | Missing]:
    """`reference_parts` of all channels of clipped darks, by channel and whether high-passed; else empty."""
    if dark.clipped is None:
        return {}
    return {
        (k, filtered): parts
        for k in range(len(dark.clipped.censored))
        for filtered, parts in zip((False, True), reference_parts(dark, k), strict=True)
    }


def read_lights(reader: FrameReader) -> list[GroupStatistics]:
    """Read the light groups once; mean frames that may be needed again are kept as far as there is room."""
    lights = []
    for group in reader.frames.of_kind("light"):
        statistics, sums = read_statistics(reader, group)
        lights.append(statistics)
        if not all(level.clipped for level in statistics.levels):
            reader.keep(group, sums)
    return lights


def darkness(dark: DarkSide, channel: int | None) -> DarkLines:
    """One channel in the dark, or all pixels together (None)."""
    levels = [pooled_level(entry.levels) if channel is None else entry.levels[channel] for entry in dark.groups]
    return DarkLines.of([entry.group.exposure_s for entry in dark.groups], levels)


def read_channel(channel: int, dark: DarkSide, lights: Sequence[GroupStatistics], white: int) -> Channel:
    """What the light levels tell of one channel: saturation, linear range, gain."""
    background = darkness(dark, channel)
    levels = light_levels(lights, channel, background)
    saturation = find_saturation(levels, white)
    used = linear_levels(levels, saturation)
    return Channel(channel, background, levels, saturation, used, gain_value(fit_gain([levels], [used])))


def dark_patterns(dark: DarkSide, far: FarThresholds | None) -> list[SpatialAnalysis | Missing]:
    """Per channel, the patterns of the dark where there is no light."""
    statistics, mean = dark.as_read[dark.reference], dark.mean.mean()
    tile = dark.mean.labels
    return [
        spatial_analysis(mean_planes(statistics, mean, tile, k, noise), NO_LIGHT, far)
        for k, noise in enumerate(dark.noise)
    ]


def measure_channels(dark: DarkSide, channels: Sequence[Channel], patterns: Sequence[Patterns]) -> list[Measurements]:
    """Each channel's measurements; without light frames there are no channels and no patterns."""
    mean = dark.mean.mean()
    moments = label_moments(mean, dark.mean.labels)
    measured = [
        _measure_channel(k, dark, moments[k], channels[k] if channels else None, patterns[k] if patterns else None)
        for k in range(len(moments))
    ]
    for entry in measured:
        if isinstance(why := entry.responsivity, Implausible):
            # One light fell on all channels: photons that are implausible_warnings for one are for all.
            return [replace(m, responsivity=why, saturation_responsivity=why, saturation_photons=why) for m in measured]
    return measured


def _measure_channel(
    index: int,
    dark: DarkSide,
    moments: Moments,
    channel: Channel | None,
    patterns: Patterns | None,
) -> Measurements:
    reference = dark.groups[dark.reference]
    level = reference.levels[index]
    dark_only = measure_dark(darkness(dark, index), level, reference.label)
    parts, filtered = reference_parts(dark, index)
    dsnu = excess_variance(moments, mean_frame_noise(level, dark.scatter))
    if isinstance(parts, Parts):
        # With a row or column pattern the pixels are fewer independent samples than they are pixels.
        dsnu = Uncertain.of(dsnu.value, max(dsnu.standard_uncertainty, parts.total.standard_uncertainty))
    measured = replace(dark_only, dsnu_variance=dsnu, dsnu1288=parts, dsnu1288_filtered=filtered)
    if dark.slopes is not None:
        slopes = dark.slopes[index]
        measured = replace(measured, dark_slope_variance=slopes.variance, dark_slope_third=slopes.third)
    if dark.clipped is not None:
        measured = _censored(measured, dark, dark.clipped.estimates[index], measured.dark_slope_variance)
    if channel is not None and patterns is not None:
        measured = _with_light(measured, channel, patterns)
    return stand_for_the_sensor(without_dark_shot(measured, reference.group.exposure_s))


def _censored(
    m: Measurements, dark: DarkSide, estimates: tuple[Uncertain, Uncertain, Uncertain], slope_variance: Value
) -> Measurements:
    """With what the censored likelihood says of the reference darks; the pixels' dark slopes are not seen."""
    black, dsnu, read = estimates
    slope, seconds = m.dark_slope, dark.groups[dark.reference].group.exposure_s
    return replace(
        m,
        read_variance=read,
        dsnu_variance=dsnu,
        black_level=black if isinstance(slope, Missing) else black - slope * seconds,
        dark_slope=_for_the_sensor(slope, slope_variance, m.pixels),
        dark_slope_variance=slope if isinstance(slope, Missing) else NO_PIXEL_SLOPES,
        dark_method=METHOD,
    )


def _with_light(measured: Measurements, channel: Channel, patterns: Patterns) -> Measurements:
    responsivity = _responsivity(channel)
    if channel.curvature is not None and isinstance(responsivity, Uncertain):
        responsivity = channel.curvature.widen(responsivity, channel.curvature.responsivity)
    responsivity = screen_responsivity(responsivity, channel.gain)
    return replace(
        measured,
        response_variance=patterns.response_variance,
        gain=channel.gain,
        saturation_dn=channel.saturation.level_dn,
        saturation_method=channel.saturation.level_method,
        saturation_photons=_photons(channel, channel.saturation.x),
        responsivity=responsivity,
        saturation_responsivity=responsivity,
        dsnu1288=patterns.dsnu1288,
        dsnu1288_filtered=patterns.dsnu1288_filtered,
        prnu1288=patterns.prnu1288,
        prnu1288_unfiltered=patterns.prnu1288_unfiltered,
        linearity=(channel_linearity(channel),),
    )


def measure_together(
    dark: DarkSide, names: Sequence[str], channels: Sequence[Measurements], gain: Value
) -> Measurements:
    """All channels together; `gain` was fitted to all of them."""
    reference = dark.groups[dark.reference]
    together = measure_dark(darkness(dark, None), pooled_level(reference.levels), reference.label)
    if dark.clipped is not None:
        spread = NO_PIXEL_SLOPES if dark.slopes is None else _mean_variance(dark.slopes)
        together = _censored(together, dark, dark.clipped.together(), spread)
    if len(channels) == 1:
        return replace(channels[0], gain=gain)
    pooled = without_dark_shot(pool(names, channels, together, gain), reference.group.exposure_s)
    # Black level and dark slope were measured on all pixels together; the other means bring their share along.
    return replace(stand_for_the_sensor(pooled), responsivity=pooled.responsivity)


def measure_dark(background: DarkLines, level: Level, label: str) -> Measurements:
    """What the dark frames alone tell; the rest says that there is no light."""
    black, slope = background.mean.line
    slope = screen_dark_slope(slope, background.mean.exposure_s)
    noise_slope = screen_dark_slope(background.variance.line[1], background.variance.exposure_s, of_variance=True)
    clipping = level.clipping_uncertainty
    read = level.noise + Uncertain.of(-QUANTISATION_DN2, clipping) + Uncertain.of(0.0, level.rounding_variance)
    return Measurements(
        pixels=level.pixels,
        read_variance=read,
        dsnu_variance=NO_LIGHT,
        black_level=background.mean.at_zero if isinstance(black, Missing) else black,
        dark_slope=slope,
        dark_slope_variance=slope if isinstance(slope, Missing) else Uncertain(0.0),
        dark_variance=background.variance.at_zero,
        dark_variance_slope=of_variance(noise_slope, slope),
        response_variance=NO_LIGHT,
        gain=NO_LIGHT,
        saturation_dn=NO_LIGHT,
        saturation_photons=NO_LIGHT,
        responsivity=NO_LIGHT,
        saturation_responsivity=NO_LIGHT,
        dsnu1288=NO_LIGHT,
        dsnu1288_filtered=NO_LIGHT,
        prnu1288=NO_LIGHT,
        prnu1288_unfiltered=NO_LIGHT,
        read_method=f"{level.frames} {label}",
        saturation_method="fully clipped flats",
    )


def without_dark_shot(m: Measurements, exposure_s: float) -> Measurements:
    """Read noise without the shot noise of the dark current in the same frames, K (dark slope) t, where both are known.

    A sensor file holds both, and a simulation adds both.
    """
    if isinstance(m.gain, Missing) or isinstance(m.dark_slope, Missing) or isinstance(m.read_variance, Missing):
        return m
    return replace(
        m,
        read_variance=m.read_variance - m.gain * m.dark_slope * exposure_s,
        read_method=f"{m.read_method}, shot noise of the dark current taken off",
    )


def _for_the_sensor(mean: Value, variance: Value, pixels: int) -> Value:
    """A mean over these pixels as that of the sensor they were drawn from: their variance / pixels comes in."""
    if isinstance(mean, Missing) or isinstance(variance, Missing):
        return mean
    return mean + Uncertain.of(0.0, math.sqrt(max(variance.value, 0.0) / pixels))


def stand_for_the_sensor(m: Measurements) -> Measurements:
    """The means among the measurements, with what their pixels' spread adds to their uncertainty."""
    response = m.responsivity
    if isinstance(response, Uncertain) and isinstance(m.response_variance, Uncertain):
        response = _for_the_sensor(response, m.response_variance * response.value**2, m.pixels)
    slope, slope_variance = m.dark_slope, m.dark_slope_variance
    if isinstance(slope, Uncertain) and isinstance(slope_variance, Uncertain):
        slope, slope_variance = of_one_sample(slope, slope_variance, m.dark_slope_third, m.pixels)
    return replace(
        m,
        black_level=_for_the_sensor(m.black_level, m.dsnu_variance, m.pixels),
        dark_slope=slope,
        dark_slope_variance=slope_variance,
        responsivity=response,
        # One channel's own responsivity; of channels together it already stands for the sensor.
        saturation_responsivity=response if m.saturation_responsivity is m.responsivity else m.saturation_responsivity,
    )


def _photons(channel: Channel, value: Value) -> Value:
    return value if channel.levels.abscissa == "photons_per_pixel" else NO_PHOTONS


def _responsivity(channel: Channel) -> Value:
    if channel.levels.abscissa != "photons_per_pixel":
        return NO_PHOTONS
    fit = fit_response(channel.levels, channel.used)
    if fit is None:
        return Missing("no light level lies in the linear range")
    return fit.uncertain[0]
