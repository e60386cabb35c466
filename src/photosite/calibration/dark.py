"""Stage "dark": what the dark frames show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.checks.black_level import BlackLevelChange, Contradiction, black_level_change
from photosite.calibration.checks.result_screening import screen_dark_slope, screen_variance_slope
from photosite.calibration.clipped_blacks.clipped_darks import (
    METHOD,
    NO_PIXEL_SLOPES,
    ClippedDarks,
    DarkEstimates,
    correct_clipped_darks,
)
from photosite.calibration.measurements import Measurements, mean_for_sensor
from photosite.calibration.photon_transfer.dark_lines import DarkLine, DarkLines, temporal_variances
from photosite.calibration.photon_transfer.noise_covariance import SharedNoise
from photosite.calibration.photon_transfer.unknown_darks import (
    NO_DARK_FRAMES,
    SINGLE_DARK_FRAMES,
    unknown_level,
    unknown_variance,
)
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import CLIPPED_DARK_SHARE, GroupStatistics, Level, pooled_level
from photosite.calibration.reduction.quantisation import differing_share, with_rounding
from photosite.calibration.reduction.reduce import Reduction, dark_slope_coefficients
from photosite.calibration.spatial.line_noise import TemporalParts, mean_frame_parts, pool_temporal
from photosite.calibration.spatial.nonuniformity import Parts, channel_parts
from photosite.calibration.spatial.pixel_slopes import (
    PixelSlopes,
    SlopeSpread,
    excess_variance,
    mean_frame_noise,
    slope_noise,
)
from photosite.calibration.spatial.spatial_analysis import MeanPlanes
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.map_statistics import Moments, label_moments
from photosite.sensor.noise_profile import QUANTISATION_DN2
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Missing, Source, Uncertain, Value, derive, weighted_mean

PartsPair = tuple[Parts | Missing, Parts | Missing]
"""Row, column and pixel parts of a channel: plain and high-passed."""


BEYOND_CHANCE = 3.0
"""Spread of the dark slopes, in standard uncertainties, from which it is taken into account."""

NEGLIGIBLE = 0.1
"""Variance from the spread of the dark slopes, over the uncertainty of DSNU squared, up to which it is not."""

_SPREAD = "spread over pixels of the mean dark frame less its temporal noise"
_AT_EXPOSURE = "{}, at {} s: dark current nonuniformity of that time is included"
_AT_ZERO = "spread over pixels of the dark level extrapolated to exposure zero, less its temporal noise"


@dataclass(frozen=True)
class GroupMean:
    """The (rows, cols) mean frame of a group, with the temporal variance left in it per channel.

    `exposure_s` is another exposure time than the group's where the mean was extrapolated (`DarkResult.at`).
    """

    statistics: GroupStatistics
    mean: NDArray[np.float64]
    tile: NDArray[np.int64]
    noise: Sequence[TemporalParts]
    total_noise: Sequence[Uncertain]  # the sum of the parts, without the uncertainty of the division
    rounding: Sequence[float]  # standard uncertainty of a pixel's mean from rounding, per channel
    exposure_s: float

    @classmethod
    def of(cls, reader: FrameReader, statistics: GroupStatistics, mean: MeanFrame, scatter: float) -> GroupMean:
        """Read some frames of the group again for the sums of their rows and columns (`mean_frame_parts`)."""
        noise = mean_frame_parts(reader, statistics, scatter)
        total = [mean_frame_noise(level, scatter) for level in statistics.levels]
        rounding = [level.rounding_pixel for level in statistics.levels]
        return cls(statistics, mean.mean(), mean.labels, noise, total, rounding, statistics.group.exposure_s)

    def parts(self, channel: int) -> PartsPair:
        """Return the parts of a channel."""
        return self.part(channel), self.part(channel, filtered=True)

    def part(self, channel: int, *, filtered: bool = False) -> Parts | Missing:
        """Return the parts of a channel, plain or high-passed."""
        parts = channel_parts(self.mean, self.tile, channel, self.noise[channel], filtered=filtered)
        if isinstance(parts, Missing):
            return parts
        digital_gain = Uncertain.of(1.0, self.statistics.levels[channel].scale_uncertainty)
        return parts.with_rounding(self.rounding[channel]).scaled(digital_gain)

    def planes(self, channel: int) -> MeanPlanes:
        """Return the planes of a channel."""
        frames, moved = self.statistics.frames, self.exposure_s != self.statistics.group.exposure_s
        return MeanPlanes.of(
            self.mean, self.tile, channel, frames, self.exposure_s, self.noise[channel], extrapolated=moved
        )


@dataclass(frozen=True)
class SlopeMap:
    """The map of per-pixel dark slopes: a linear combination of the mean frames of all dark groups."""

    slopes: PixelSlopes
    coefficients: NDArray[np.float64]  # (groups,) 1/s
    groups: Sequence[GroupStatistics]
    scatter: float

    def noise(self, weights: NDArray[np.float64], channel: int) -> Uncertain:
        """Return the temporal variance in a linear combination of the groups' mean frames."""
        levels = [entry.levels[channel] for entry in self.groups]
        exposure_s = np.array([entry.group.exposure_s for entry in self.groups])
        return slope_noise(weights, self._frames, *temporal_variances(exposure_s, levels), self.scatter)

    def rounding(self, weights: NDArray[np.float64], channel: int) -> float:
        """Return the largest standard uncertainty of such a combination from rounding, for a pixel."""
        return float(np.abs(weights) @ [entry.levels[channel].rounding_pixel for entry in self.groups])

    @property
    def _frames(self) -> NDArray[np.int64]:
        return np.array([entry.frames for entry in self.groups])

    def spreads(self) -> tuple[SlopeSpread, ...]:
        """Return the spread of the slopes per channel."""
        channels = range(len(self.groups[0].levels))
        spreads = self.slopes.spreads([self.noise(self.coefficients, k) for k in channels])
        return tuple(replace(spread, variance=self._rounded(spread.variance, k)) for k, spread in enumerate(spreads))

    def _rounded(self, variance: Uncertain, channel: int) -> Uncertain:
        levels = [entry.levels[channel] for entry in self.groups]
        share = differing_share(
            np.array([level.mean for level in levels]), max(level.rounding_pixel for level in levels)
        )
        return with_rounding(variance, share * self.rounding(self.coefficients, channel))

    def moved(self, mean: GroupMean, exposure_s: float) -> GroupMean:
        """Return the mean frame of one of the groups, extrapolated to another exposure time.

        A pixel's mean and its slope share the noise of the group, so the noise is that of the linear combination of all
        mean frames. Rows and columns have the group's noise at all exposure times.
        """
        seconds = exposure_s - mean.exposure_s
        if seconds == 0.0:
            return mean
        own = np.array([entry is mean.statistics for entry in self.groups])
        weights = own + seconds * self.coefficients
        lines = float((weights**2 / self._frames).sum()) * mean.statistics.frames
        total = [self.noise(weights, k) for k in range(len(mean.noise))]
        noise = []
        for whole, parts in zip(total, mean.noise, strict=True):
            row, column = parts.row * lines, parts.column * lines
            noise.append(TemporalParts(whole - row - column, row, column))
        return replace(
            mean,
            mean=mean.mean + seconds * self.slopes.slopes,
            noise=noise,
            total_noise=total,
            rounding=[self.rounding(weights, k) for k in range(len(noise))],
            exposure_s=exposure_s,
        )


@dataclass(frozen=True)
class DarkResult:
    """What the dark frames show, per channel where not stated otherwise."""

    groups: tuple[GroupStatistics, ...]  # all dark groups, corrected for clipping at 0
    change: BlackLevelChange  # between dark frames
    lines: tuple[DarkLines, ...]  # dark signal and dark variance against exposure
    scatter: float  # relative scatter of the noise between combinations of frames (`DarkLine.scatter`)
    mean: GroupMean | None  # of the reference group; None without dark frames
    slope_map: SlopeMap | None  # per-pixel dark slopes; None with one dark exposure or dark frames clipped at 0
    slopes: tuple[SlopeSpread, ...] | None  # their spread, also of clipped dark frames
    clipped: ClippedDarks | None  # censored fit; None where no dark frames are clipped at 0
    channels: tuple[Measurements, ...]
    together: Measurements  # of all pixels together
    slope_sampling: float  # standard uncertainty of their dark slope from sampling alone

    @property
    def reference_exposure_s(self) -> float:
        """Exposure time of the reference group, seconds; 0 without dark frames."""
        return 0.0 if self.mean is None else self.mean.exposure_s

    @property
    def noise_unknown(self) -> str:
        """Why the temporal noise of the dark frames is unknown; empty where it is known."""
        return self.lines[0].variance.reason

    @property
    def level_unknown(self) -> str:
        """Why the level of the dark frames is unknown; empty where it is known."""
        return self.lines[0].mean.reason

    def at(self, exposure_s: float) -> GroupMean | None:
        """Return the mean dark frame at an exposure time within the range of the dark frames.

        It is that of the reference group, moved along each pixel's dark slope where the spread of the slopes is known
        and not negligible. None without dark frames.
        """
        if self.mean is None or self.slope_map is None or self.slopes is None:
            return self.mean
        times = [entry.group.exposure_s for entry in self.groups]
        exposure_s = min(max(exposure_s, min(times)), max(times))
        square = (exposure_s - self.mean.exposure_s) ** 2
        for slope, m in zip(self.slopes, self.channels, strict=True):
            dsnu, spread = m.dsnu_variance, slope.variance
            assert isinstance(dsnu, Uncertain)
            seen = spread.value > BEYOND_CHANCE * spread.standard_uncertainty
            if seen and square * spread.value > NEGLIGIBLE * dsnu.standard_uncertainty:
                return self.slope_map.moved(self.mean, exposure_s)
        return self.mean


def with_shared_charge(dark: DarkResult, shared: SharedNoise | None) -> DarkResult:
    """Return the result with summed covariances of the dark charge, which pixels share as they share that of light.

    Where a filter in the camera may be the cause, the noise of the dark frames may be less than the sensor's.
    """
    if shared is None or isinstance(shared.charge, Missing):
        return dark

    def of(m: Measurements, factor: Uncertain, doubt: float) -> Measurements:
        found = replace(m, dark_variance_slope=derive(lambda slope: slope * factor, m.dark_variance_slope))
        if not shared.doubt:
            return found
        noise = {name: getattr(m, name) for name in ("read_variance", "dark_variance", "dsnu_variance")}
        of_filter = Uncertain.of(1.0, doubt)
        return replace(found, **{name: derive(lambda v: v * of_filter, value) for name, value in noise.items()})

    factors, doubts = ([getattr(entry, name) for entry in shared.charge] for name in ("factor", "doubt"))
    channels = tuple(map(of, dark.channels, factors, doubts))
    mean = Uncertain.of(
        float(np.mean([factor.value for factor in factors])),
        float(np.mean([factor.standard_uncertainty for factor in factors])),
    )
    return replace(dark, channels=channels, together=of(dark.together, mean, float(np.mean(doubts))))


def without_mean_slope(dark: DarkResult, found: Contradiction | None) -> DarkResult:
    """Return the result without the dark current from the mean, where that from the variance contradicts it."""
    if found is None:
        return dark
    channels = tuple(replace(m, dark_slope=found.withheld) for m in dark.channels)
    return replace(dark, channels=channels, together=replace(dark.together, dark_slope=found.withheld))


def measure_dark_frames(reduction: Reduction, reader: FrameReader) -> DarkResult:
    """Analyze the dark frames.

    Some frames of the reference group are read again, for the sums of their rows and columns and, where it is clipped
    at 0, for its zeros.
    """
    group, mean_frame = reduction.reference_group, reduction.reference_mean
    if group is None or mean_frame is None:
        return _unknown_darks(reduction, Missing(NO_DARK_FRAMES))
    if group.frames == 1:
        return _of_single_frames(reduction, group, mean_frame)
    clipped = correct_clipped_darks(reduction, group, reader)
    groups = reduction.darks if clipped is None else clipped.groups
    change = black_level_change(groups)
    scatter = dark_lines(groups, None, change).variance.scatter
    mean = GroupMean.of(reader, group, mean_frame, scatter)
    if clipped is None:
        groups = _with_line_noise(groups, mean.noise, group.frames, reader)
    lines = tuple(dark_lines(groups, k, change) for k in range(len(reduction.names)))
    pooled = dark_lines(groups, None, change)
    slope_map = _slope_map(reduction, scatter)
    slopes = None if slope_map is None else slope_map.spreads()
    if clipped is not None:
        slope_map = None  # clipped pixels do not show their slopes
        if slopes is not None:
            slopes = tuple(_clipped_slope(slopes[k], lines[k], clipped.scale(k)) for k in range(len(slopes)))

    reference = next(entry for entry in groups if entry.group is group.group)
    exposure_s = reference.group.exposure_s
    zero = mean if slope_map is None else slope_map.moved(mean, 0.0)
    channels = []
    for k, moments in enumerate(label_moments(zero.mean, zero.tile)):
        measured = replace(
            measure_dark_level(lines[k], reference.levels[k], reference.label),
            dsnu_variance=_dsnu_variance(moments, zero, k),
            dsnu_method=_AT_ZERO if zero is not mean else _AT_EXPOSURE.format(_SPREAD, format_exposure(exposure_s)),
        )
        if clipped is None:
            measured = replace(measured, **_line_variances(mean, [k]))
        if slopes is not None:
            spread = slopes[k]
            measured = replace(measured, dark_slope_variance=spread.variance, dark_slope_third=spread.third)
            if zero is not mean and spread.mean:
                # A charge that is off by u DN spreads as the dark current does, and not more than the frames.
                off = lines[k].mean.unsure ** 2 * max(spread.variance.value, 0.0) / spread.mean**2
                off = min(off, max(reference.levels[k].spatial_variance, measured.dsnu_variance.value))
                measured = replace(measured, dsnu_variance=measured.dsnu_variance + Uncertain.of(0.0, off))
        if clipped is not None:
            plain, filtered = clipped.parts(k, *mean.parts(k))
            measured = replace(measured, dsnu1288=plain, dsnu1288_filtered=filtered)
            measured = _with_censored_fit(measured, clipped.estimates[k], measured.dark_slope_variance, exposure_s)
        channels.append(measured)
    together = measure_dark_level(pooled, pooled_level(reference.levels), reference.label)
    if clipped is None:
        together = replace(together, **_line_variances(mean, range(len(mean.noise))))
    else:
        spread: Value = NO_PIXEL_SLOPES
        if slopes is not None:
            spread = weighted_mean([entry.variance for entry in slopes], [float(entry.pixels) for entry in slopes])
        together = _with_censored_fit(together, clipped.together(), spread, exposure_s)
    found = tuple(channels), together, pooled.mean.sampling
    return DarkResult(tuple(groups), change, lines, scatter, mean, slope_map, slopes, clipped, *found)


def _unknown_darks(reduction: Reduction, why: Missing) -> DarkResult:
    """Return that level and noise of the dark are unknown, for a reason."""
    lights = reduction.lights
    levels = [unknown_level(lights, k, why.reason) for k in range(len(reduction.names))]
    lines = tuple(
        DarkLines(level, unknown_variance(lights, k, float(level.y[0]), why.reason)) for k, level in enumerate(levels)
    )
    pixels = [level.pixels for level in reduction.first_group.levels]
    measured = tuple(_unknown(why, of_channel) for of_channel in pixels)
    return DarkResult(
        (),
        BlackLevelChange(0.0, 0.0, 0.0),
        lines,
        0.0,
        None,
        None,
        None,
        None,
        measured,
        _unknown(why, sum(pixels)),
        math.inf,
    )


def _unknown(why: Missing, pixels: int) -> Measurements:
    return Measurements(
        pixels=pixels,
        read_variance=why,
        row_variance=why,
        column_variance=why,
        black_level=why,
        dark_slope=why,
        dark_slope_variance=why,
        dark_variance=why,
        dark_variance_slope=why,
        read_method="",
        dsnu_variance=why,
        dsnu1288=why,
        dsnu1288_filtered=why,
    )


def _of_single_frames(reduction: Reduction, reference: GroupStatistics, frame: MeanFrame) -> DarkResult:
    """Return level and dark current of dark exposures with one frame each; their noise is an upper limit."""
    darks, channels = reduction.darks, range(len(reduction.names))
    if any(level.low_fraction > CLIPPED_DARK_SHARE for entry in darks for level in entry.levels):
        return _unknown_darks(reduction, Missing(f"the dark frames are clipped at 0, and {SINGLE_DARK_FRAMES}"))
    why = Missing(SINGLE_DARK_FRAMES)
    exposure_s = reference.group.exposure_s
    values, tile = frame.mean(), frame.labels
    none = TemporalParts(Uncertain(0.0), Uncertain(0.0), Uncertain(0.0))
    noise = [none] * len(channels)
    mean = GroupMean(reference, values, tile, noise, [none.total] * len(channels), [0.0] * len(channels), exposure_s)
    spreads = []
    for k, moments in enumerate(label_moments(values, tile)):
        spread, parts = excess_variance(moments, none.total), channel_parts(values, tile, k, none, filtered=False)
        if isinstance(parts, Parts):
            uncertainty = max(spread.standard_uncertainty, parts.total.standard_uncertainty)
            spread = Uncertain.of(spread.value, uncertainty)
        spreads.append(spread)
    lines = tuple(_single_lines(reduction, k) for k in channels)

    def measured(dark: DarkLines, spread: Uncertain, pixels: int) -> Measurements:
        black, slope = dark.mean.line
        slope = screen_dark_slope(slope, dark.mean.exposure_s)
        return replace(
            _unknown(why, pixels),
            black_level=dark.mean.at_zero if isinstance(black, Missing) else black,
            dark_slope=slope,
            dark_slope_variance=slope if isinstance(slope, Missing) else why,
            noise_and_pattern=spread,
            dark_exposure=dark_exposure(dark),
        )

    slopes = None
    if reduction.dark_slopes is not None:
        # Their spread holds the noise of the frames: that of the dark current is between 0 and the whole of it.
        slopes = tuple(
            replace(spread, variance=Uncertain.of(0.5 * spread.variance.value, 0.5 * spread.variance.value))
            for spread in reduction.dark_slopes.spreads([none.total] * len(channels))
        )
    pixels = [level.pixels for level in reference.levels]
    of_channels = tuple(measured(*each) for each in zip(lines, spreads, pixels, strict=True))
    together = _single_lines(reduction, None)
    return DarkResult(
        darks,
        BlackLevelChange(0.0, 0.0, 0.0),
        lines,
        0.0,
        mean,
        None,
        slopes,
        None,
        of_channels,
        measured(together, weighted_mean(spreads, [float(count) for count in pixels]), sum(pixels)),
        together.mean.sampling,
    )


def _single_lines(reduction: Reduction, channel: int | None) -> DarkLines:
    """Return the dark lines of one channel, or of all pixels together (None), from single frames."""
    darks = reduction.darks
    levels = [pooled_level(entry.levels) if channel is None else entry.levels[channel] for entry in darks]
    largest = min(level.spatial_variance for level in levels)
    variance = DarkLine.unknown(0.0, largest, SINGLE_DARK_FRAMES)
    if channel is not None:
        dimmest = min(levels, key=lambda level: level.spatial_variance)
        variance = unknown_variance(reduction.lights, channel, dimmest.mean, SINGLE_DARK_FRAMES, largest)
    return DarkLines.of_single([entry.group.exposure_s for entry in darks], levels, variance)


def dark_exposure(lines: DarkLines) -> str:
    """Return the exposure time of black level and dark variance in words."""
    return Measurements.dark_exposure if lines.mean.fit else f"{format_exposure(lines.mean.exposure_s[0])} s"


def _with_line_noise(
    groups: Sequence[GroupStatistics], noise: Sequence[TemporalParts], frames: int, reader: FrameReader
) -> tuple[GroupStatistics, ...]:
    """Return the groups with the uncertainty of their variances from the noise of rows and columns, which are few.

    `noise` is that left in a mean of so many frames, by channel. The channels share rows and columns.
    """
    shape, tile = (reader.frames.rows, reader.frames.cols), reader.tile.shape
    lines = [length // step for length, step in zip(shape, tile, strict=True)]
    scatter = [
        frames * math.hypot(*(part / math.sqrt(count / 2.0) for part, count in zip(each, lines, strict=True)))
        for each in ((parts.row.value, parts.column.value) for parts in noise)
    ]
    widened = []
    for group in groups:
        source, more = Source(), max(group.frames - 1, 1)
        levels = zip(group.levels, scatter, strict=True)
        widened.append(replace(group, levels=tuple(level.widened(u / math.sqrt(more), source) for level, u in levels)))
    return tuple(widened)


def _line_variances(mean: GroupMean, channels: Sequence[int]) -> dict[str, Value]:
    """Return the variances of a frame that rows and columns share, the means over some channels."""
    if min(np.array(mean.mean.shape) // mean.tile.shape) < 2:
        return {}
    pixels = [float(np.count_nonzero(mean.tile == k)) for k in channels]
    parts = pool_temporal([mean.noise[k] for k in channels], pixels).scaled(float(mean.statistics.frames))
    return {"row_variance": parts.row, "column_variance": parts.column}


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
        unsure_charge_dn=lines.mean.unsure,
        step=level.step,
        dark_exposure=dark_exposure(lines),
    )


def dark_lines(
    groups: Sequence[GroupStatistics], channel: int | None, change: BlackLevelChange | None = None
) -> DarkLines:
    """Return the dark lines of one channel, or of all pixels together (None)."""
    levels = [pooled_level(entry.levels) if channel is None else entry.levels[channel] for entry in groups]
    moved = 0.0 if change is None else change.variance(np.array([entry.frames for entry in groups]))
    return DarkLines.of([entry.group.exposure_s for entry in groups], levels, moved)


def _slope_map(reduction: Reduction, scatter: float) -> SlopeMap | None:
    coefficients = dark_slope_coefficients([entry.group for entry in reduction.darks])
    if reduction.dark_slopes is None or coefficients is None:
        return None
    return SlopeMap(reduction.dark_slopes, coefficients, reduction.darks, scatter)


def _clipped_slope(spread: SlopeSpread, lines: DarkLines, scale: float) -> SlopeSpread:
    """Return the dark slopes of a clipped channel, with the mean of the corrected levels.

    The spread does not contain the clipped half, so its uncertainty is as large as the spread itself.
    """
    _, slope = lines.mean.line
    mean = spread.mean if isinstance(slope, Missing) else slope.value
    variance = spread.variance * scale
    return replace(spread, mean=mean, variance=variance + Uncertain.of(0.0, abs(variance.value)))


def _dsnu_variance(moments: Moments, dark: GroupMean, channel: int) -> Uncertain:
    """Return the spread of a channel of a mean dark frame, with the uncertainties from rounding and digital gain."""
    dsnu, parts = excess_variance(moments, dark.total_noise[channel]), dark.part(channel)
    dsnu = with_rounding(dsnu, dark.rounding[channel])
    dsnu = dsnu * Uncertain.of(1.0, dark.statistics.levels[channel].scale_uncertainty)
    if isinstance(parts, Missing):
        return dsnu
    # With a row or column pattern there are fewer independent samples than pixels.
    return Uncertain.of(dsnu.value, max(dsnu.standard_uncertainty, parts.total.standard_uncertainty))


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
        dsnu_method=_AT_EXPOSURE.format(METHOD, format_exposure(exposure_s)),
    )
