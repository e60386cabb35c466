"""The steps of a calibration between reading frames and giving parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photosite.calibration.dark import Darkness, temporal_variances
from photosite.calibration.figures import QUANTISATION, Measurements, pool
from photosite.calibration.fit import Fit
from photosite.calibration.groups import FrameReader, GroupStatistics, Level, pooled_level
from photosite.calibration.judge import check_darks, reference_dark, zero_clip_uncertainty
from photosite.calibration.nonuniformity import (
    PixelSlopes,
    SlopeSpread,
    excess_variance,
    mean_frame_noise,
    slope_coefficients,
    slope_noise,
)
from photosite.calibration.patterns import Channel, Patterns
from photosite.calibration.photon_transfer import (
    find_saturation,
    fit_gain,
    fit_response,
    gain_value,
    light_levels,
    linear_levels,
)
from photosite.calibration.spatial import channel_parts
from photosite.calibration.uncertain import Missing, Uncertain, Value
from photosite.engine.accumulate import FrameSums
from photosite.engine.moments import label_moments
from photosite.frames.frame_set import FrameGroup

NO_LIGHT = Missing("no light frames")
NO_PHOTONS = Missing("the photons per pixel are not known; a descriptor or a protocol says them")


@dataclass(frozen=True)
class DarkSide:
    """The dark groups as read.

    Parameters
    ----------
    groups
        Statistics by exposure.
    reference, sums
        The group of read noise and DSNU: the most frames, then the shortest exposure; and its sums.
    slopes
        Per channel, mean and spread of the pixels' dark slopes; None with one dark exposure.
    """

    groups: list[GroupStatistics]
    reference: int
    sums: FrameSums
    slopes: tuple[SlopeSpread, ...] | None


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
        If the frames are clipped, still, or copies of each other.
    """
    planned = reader.frames.of_kind("dark")
    exposure = np.array([group.exposure_s for group in planned])
    slopes = coefficients = None
    if len(np.unique(exposure)) > 1:
        slopes = PixelSlopes((reader.frames.rows, reader.frames.cols), reader.tile)
        coefficients = slope_coefficients(exposure, np.array([float(len(group)) for group in planned]))
    wanted = reference_dark(planned)
    groups: list[GroupStatistics] = []
    kept: FrameSums | None = None
    for index, group in enumerate(planned):
        statistics, sums = read_statistics(reader, group)
        groups.append(statistics)
        if index == wanted:
            kept = sums
        if slopes is not None and coefficients is not None:
            slopes.add(sums, [float(coefficients[index])] * len(statistics.levels))
    check_darks(reader.frames, groups, reader.rejected)
    if kept is None or (reference := reference_dark(groups)) != wanted:
        # Repeats were left out of the group that had the most frames.
        reader.expect(len(planned[reference]))
        kept = reader.sums(planned[reference])
    if slopes is None or coefficients is None:
        return DarkSide(groups, reference, kept, None)
    noise = []
    for k in range(len(groups[0].levels)):
        levels = [entry.levels[k] for entry in groups]
        frames = np.array([level.frames for level in levels])
        noise.append(slope_noise(coefficients, frames, *temporal_variances(exposure, levels)))
    return DarkSide(groups, reference, kept, slopes.spreads(noise))


def darkness(dark: DarkSide, channel: int | None) -> Darkness:
    """One channel in the dark, or all pixels together (None)."""
    levels = [pooled_level(entry.levels) if channel is None else entry.levels[channel] for entry in dark.groups]
    return Darkness.of([entry.group.exposure_s for entry in dark.groups], levels)


def read_channel(channel: int, dark: DarkSide, lights: Sequence[GroupStatistics], white: int) -> Channel:
    """What the light levels tell of one channel: saturation, linear range, gain."""
    background = darkness(dark, channel)
    levels = light_levels(lights, channel, background)
    saturation = find_saturation(levels, white)
    used = linear_levels(levels, saturation)
    return Channel(channel, background, levels, saturation, used, gain_value(fit_gain([levels], [used])))


def measure_channel(index: int, dark: DarkSide, channel: Channel | None, patterns: Patterns | None) -> Measurements:
    """One channel's measurements."""
    reference = dark.groups[dark.reference]
    level = reference.levels[index]
    moments = label_moments(dark.sums.mean(), dark.sums.labels)[index]
    dark_only = _measure_dark(darkness(dark, index), level, reference.label)
    parts = channel_parts(dark.sums.mean(), dark.sums.labels, index, mean_frame_noise(level), filtered=False)
    measured = replace(
        dark_only,
        dsnu_variance=excess_variance(moments, mean_frame_noise(level)),
        dsnu1288=parts,
    )
    if dark.slopes is not None:
        slopes = dark.slopes[index]
        measured = replace(
            measured,
            dark_slope_variance=slopes.variance,
            dark_slope=_for_the_sensor(measured.dark_slope, slopes.variance, slopes.pixels),
        )
    if channel is None or patterns is None:
        return measured
    return replace(
        measured,
        response_variance=patterns.response_variance,
        gain=channel.gain,
        saturation_dn=channel.saturation.level_dn,
        saturation_method=channel.saturation.level_method,
        saturation_photons=_photons(channel, channel.saturation.x),
        responsivity=_responsivity(channel),
        dsnu1288=patterns.dsnu1288,
        prnu1288=patterns.prnu1288,
        prnu1288_unfiltered=patterns.prnu1288_unfiltered,
    )


def measure_together(dark: DarkSide, channels: list[Measurements], gain_fit: Fit | None) -> Measurements:
    """All channels together."""
    reference = dark.groups[dark.reference]
    together = _measure_dark(darkness(dark, None), pooled_level(reference.levels), reference.label)
    pooled = pool(channels, together, NO_LIGHT if gain_fit is None else gain_value(gain_fit))
    if len(channels) > 1:
        slope = _for_the_sensor(together.dark_slope, pooled.dark_slope_variance, pooled.pixels)
        pooled = replace(pooled, dark_slope=slope)
    return pooled


def _measure_dark(background: Darkness, level: Level, label: str) -> Measurements:
    """What the dark frames alone tell; the rest says that there is no light."""
    black, slope = background.mean.line
    clipping = zero_clip_uncertainty(level)
    read = Uncertain.of(level.variance - QUANTISATION, math.hypot(level.variance_uncertainty, clipping))
    return Measurements(
        pixels=level.pixels,
        read_variance=read,
        dsnu_variance=NO_LIGHT,
        black_level=background.mean.at_zero if isinstance(black, Missing) else black,
        dark_slope=slope,
        dark_slope_variance=slope if isinstance(slope, Missing) else Uncertain(0.0),
        dark_variance=background.variance.at_zero,
        response_variance=NO_LIGHT,
        gain=NO_LIGHT,
        saturation_dn=NO_LIGHT,
        saturation_photons=NO_LIGHT,
        responsivity=NO_LIGHT,
        dsnu1288=NO_LIGHT,
        prnu1288=NO_LIGHT,
        prnu1288_unfiltered=NO_LIGHT,
        read_method=f"{level.frames} {label}",
        saturation_method="fully clipped flats",
    )


def _for_the_sensor(slope: Value, variance: Value, pixels: int) -> Value:
    """A mean dark slope as that of the sensor, not of these pixels only: its spread / pixels comes in."""
    if isinstance(slope, Missing) or isinstance(variance, Missing):
        return slope
    return slope + Uncertain.of(0.0, math.sqrt(max(variance.value, 0.0) / pixels))


def _photons(channel: Channel, value: Value) -> Value:
    if isinstance(value, Uncertain) and channel.levels.abscissa != "photons_per_pixel":
        return NO_PHOTONS
    return value


def _responsivity(channel: Channel) -> Value:
    if channel.levels.abscissa != "photons_per_pixel":
        return NO_PHOTONS
    fit = fit_response(channel.levels, channel.used)
    if fit is None:
        return Missing("no light level lies in the linear range")
    return Uncertain.of(float(fit.parameters[0]), float(np.sqrt(fit.covariance[0, 0])))
