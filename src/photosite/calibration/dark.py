"""Stage "dark": what the dark frames show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.checks.result_screening import screen_dark_slope, screen_variance_slope
from photosite.calibration.clipped_blacks.clipped_darks import (
    METHOD,
    NO_PIXEL_SLOPES,
    ClippedDarks,
    DarkEstimates,
    correct_clipped_darks,
)
from photosite.calibration.measurements import Measurements, mean_for_sensor
from photosite.calibration.photon_transfer.dark_lines import DarkLines, temporal_variances
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics, Level, pooled_level
from photosite.calibration.reduction.reduce import Reduction, dark_slope_coefficients
from photosite.calibration.spatial.line_noise import TemporalParts, mean_frame_parts
from photosite.calibration.spatial.parts import Parts, channel_parts
from photosite.calibration.spatial.pixel_slopes import SlopeSpread, excess_variance, mean_frame_noise, slope_noise
from photosite.calibration.spatial.spatial_analysis import MeanPlanes
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.map_statistics import Moments, label_moments
from photosite.sensor.noise_profile import QUANTISATION_DN2
from photosite.values.uncertain import Missing, Uncertain, Value, weighted_mean

PartsPair = tuple[Parts | Missing, Parts | Missing]
"""Row, column and pixel parts of a channel: plain and high-passed."""


@dataclass(frozen=True)
class GroupMean:
    """The (rows, cols) mean frame of a group, with the temporal variance left in it per channel."""

    statistics: GroupStatistics
    mean: NDArray[np.float64]
    tile: NDArray[np.int64]
    noise: Sequence[TemporalParts]

    @classmethod
    def of(cls, reader: FrameReader, statistics: GroupStatistics, mean: MeanFrame, scatter: float) -> GroupMean:
        """Read some frames of the group again for the sums of their rows and columns (`mean_frame_parts`)."""
        return cls(statistics, mean.mean(), mean.labels, mean_frame_parts(reader, statistics, scatter))

    def parts(self, channel: int) -> PartsPair:
        """Return the parts of a channel."""
        mean, tile, noise = self.mean, self.tile, self.noise[channel]
        plain, filtered = (channel_parts(mean, tile, channel, noise, filtered=high_pass) for high_pass in (False, True))
        return plain, filtered

    def planes(self, channel: int) -> MeanPlanes:
        """Return the planes of a channel."""
        exposure_s = self.statistics.group.exposure_s
        return MeanPlanes.of(self.mean, self.tile, channel, self.statistics.frames, exposure_s, self.noise[channel])


@dataclass(frozen=True)
class DarkResult:
    """What the dark frames show, per channel where not stated otherwise."""

    groups: tuple[GroupStatistics, ...]  # all dark groups, corrected for clipping at 0
    lines: tuple[DarkLines, ...]  # dark signal and dark variance against exposure
    scatter: float  # relative scatter of the noise between combinations of frames (`DarkLine.scatter`)
    mean: GroupMean  # of the reference group
    slopes: tuple[SlopeSpread, ...] | None  # of the per-pixel dark slopes; None with one dark exposure
    clipped: ClippedDarks | None  # censored fit; None where no dark frames are clipped at 0
    channels: tuple[Measurements, ...]
    together: Measurements  # of all pixels together

    @property
    def reference_exposure_s(self) -> float:
        """Exposure time of the reference group, seconds."""
        return self.mean.statistics.group.exposure_s


def measure_dark_frames(reduction: Reduction, reader: FrameReader) -> DarkResult:
    """Analyze the dark frames.

    Some frames of the reference group are read again, for the sums of their rows and columns and, where it is clipped
    at 0, for its zeros.
    """
    clipped = correct_clipped_darks(reduction, reader)
    groups = reduction.darks if clipped is None else clipped.groups
    lines = tuple(dark_lines(groups, k) for k in range(len(reduction.names)))
    pooled = dark_lines(groups, None)
    scatter = pooled.variance.scatter
    mean = GroupMean.of(reader, reduction.reference_group, reduction.reference_mean, scatter)
    slopes = _slope_spreads(reduction, scatter)
    if clipped is not None and slopes is not None:
        slopes = tuple(_clipped_slope(slopes[k], lines[k], clipped.scale(k)) for k in range(len(slopes)))

    reference = groups[reduction.reference]
    exposure_s = reference.group.exposure_s
    channels = []
    for k, moments in enumerate(label_moments(mean.mean, mean.tile)):
        level = reference.levels[k]
        plain, filtered = mean.parts(k) if clipped is None else clipped.parts(k, *mean.parts(k))
        if level.scale_uncertainty > 0.0:
            scale = Uncertain.of(1.0, level.scale_uncertainty)
            plain, filtered = (
                parts if isinstance(parts, Missing) else parts.scaled(scale) for parts in (plain, filtered)
            )
        measured = replace(
            measure_dark_level(lines[k], level, reference.label),
            dsnu_variance=_of_digital_gain(_dsnu_variance(moments, level, scatter, plain), level),
            dsnu1288=plain,
            dsnu1288_filtered=filtered,
        )
        if slopes is not None:
            measured = replace(measured, dark_slope_variance=slopes[k].variance, dark_slope_third=slopes[k].third)
        if clipped is not None:
            measured = _with_censored_fit(measured, clipped.estimates[k], measured.dark_slope_variance, exposure_s)
        channels.append(measured)
    together = measure_dark_level(pooled, pooled_level(reference.levels), reference.label)
    if clipped is not None:
        spread: Value = NO_PIXEL_SLOPES
        if slopes is not None:
            spread = weighted_mean([entry.variance for entry in slopes], [float(entry.pixels) for entry in slopes])
        together = _with_censored_fit(together, clipped.together(), spread, exposure_s)
    return DarkResult(tuple(groups), lines, scatter, mean, slopes, clipped, tuple(channels), together)


def measure_dark_level(lines: DarkLines, level: Level, label: str) -> Measurements:
    """Return what the dark lines and the reference level of one channel show."""
    black, slope = lines.mean.line
    slope = screen_dark_slope(slope, lines.mean.exposure_s)
    noise_slope = screen_dark_slope(lines.variance.line[1], lines.variance.exposure_s, of_variance=True)
    read = level.noise + Uncertain.of(-QUANTISATION_DN2, level.clipping_uncertainty)
    return Measurements(
        pixels=level.pixels,
        read_variance=read + Uncertain.of(0.0, level.rounding_variance),
        black_level=lines.mean.at_zero if isinstance(black, Missing) else black,
        dark_slope=slope,
        dark_slope_variance=slope if isinstance(slope, Missing) else Uncertain(0.0),
        dark_variance=lines.variance.at_zero,
        dark_variance_slope=screen_variance_slope(noise_slope, slope),
        read_method=f"{level.frames} {label}",
        step=level.step,
    )


def dark_lines(groups: Sequence[GroupStatistics], channel: int | None) -> DarkLines:
    """Return the dark lines of one channel, or of all pixels together (None)."""
    levels = [pooled_level(entry.levels) if channel is None else entry.levels[channel] for entry in groups]
    return DarkLines.of([entry.group.exposure_s for entry in groups], levels)


def _slope_spreads(reduction: Reduction, scatter: float) -> tuple[SlopeSpread, ...] | None:
    coefficients = dark_slope_coefficients([entry.group for entry in reduction.darks])
    if reduction.dark_slopes is None or coefficients is None:
        return None
    exposure = np.array([entry.group.exposure_s for entry in reduction.darks])
    noise = []
    for k in range(len(reduction.names)):
        levels = [entry.levels[k] for entry in reduction.darks]
        frames = np.array([level.frames for level in levels])
        noise.append(slope_noise(coefficients, frames, *temporal_variances(exposure, levels), scatter))
    return reduction.dark_slopes.spreads(noise)


def _clipped_slope(spread: SlopeSpread, lines: DarkLines, scale: float) -> SlopeSpread:
    """Return the dark slopes of a clipped channel, with the mean of the corrected levels.

    The spread does not contain the clipped half, so its uncertainty is as large as the spread itself.
    """
    _, slope = lines.mean.line
    mean = spread.mean if isinstance(slope, Missing) else slope.value
    variance = spread.variance * scale
    return replace(spread, mean=mean, variance=variance + Uncertain.of(0.0, abs(variance.value)))


def _dsnu_variance(moments: Moments, level: Level, scatter: float, parts: Parts | Missing) -> Uncertain:
    dsnu = excess_variance(moments, mean_frame_noise(level, scatter))
    if isinstance(parts, Missing):
        return dsnu
    # With a row or column pattern there are fewer independent samples than pixels.
    return Uncertain.of(dsnu.value, max(dsnu.standard_uncertainty, parts.total.standard_uncertainty))


def _of_digital_gain(value: Value, level: Level) -> Value:
    """Return a spatial variance with the uncertainty from a digital gain."""
    if isinstance(value, Missing) or level.scale_uncertainty == 0.0:
        return value
    return value * Uncertain.of(1.0, level.scale_uncertainty)


def _with_censored_fit(
    measured: Measurements, estimates: DarkEstimates, slope_variance: Value, exposure_s: float
) -> Measurements:
    """Return the measurements with the censored fit of the reference group; per-pixel dark slopes are unknown."""
    black, dsnu, read = estimates
    slope = measured.dark_slope
    return replace(
        measured,
        read_variance=read,
        dsnu_variance=dsnu,
        black_level=black if isinstance(slope, Missing) else black - slope * exposure_s,
        dark_slope=mean_for_sensor(slope, slope_variance, measured.pixels),
        dark_slope_variance=slope if isinstance(slope, Missing) else NO_PIXEL_SLOPES,
        dark_method=METHOD,
    )
