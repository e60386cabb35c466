"""Stage "dark": what the dark frames show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from photosite.calibration.checks.result_screening import screen_dark_slope, screen_variance_slope
from photosite.calibration.dark.black_level_change import BlackLevelChange, black_level_change
from photosite.calibration.dark.clipped_darks import (
    METHOD,
    NO_PIXEL_SLOPES,
    ClippedDarks,
    DarkEstimates,
    correct_clipped_darks,
)
from photosite.calibration.dark.cut_tail import CutTail, measure_cut_tail
from photosite.calibration.dark.dark_lines import DarkLines
from photosite.calibration.dark.dark_result import DarkResult, GroupMean, SlopeMap, dark_exposure
from photosite.calibration.dark.single_frames import measure_single_darks, unknown_darks
from photosite.calibration.measurements import Measurements, mean_for_sensor
from photosite.calibration.photon_transfer.photon_transfer import temporal_series
from photosite.calibration.photon_transfer.without_darks import NO_DARK_FRAMES
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics, Level, pooled_level
from photosite.calibration.reduction.quantization import with_rounding
from photosite.calibration.reduction.reduce import Reduction, dark_slope_coefficients
from photosite.calibration.spatial.channel_tables import alike_levels, alike_noise
from photosite.calibration.spatial.line_noise import TemporalComponents, pool_temporal
from photosite.calibration.spatial.pixel_slopes import SlopeSpread, excess_variance
from photosite.calibration.withheld import UNKNOWN_DARK_NOISE
from photosite.engine.lazy_maps import held
from photosite.engine.map_statistics import Moments, label_moments
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Missing, Source, Uncertain, Value, derive, weighted_mean

_SPREAD = "spread over pixels of the mean dark frame less its temporal noise"
_AT_EXPOSURE = "{}, at {} s: dark current nonuniformity of that time is included"
_AT_ZERO = "spread over pixels of the dark level extrapolated to exposure zero, less its temporal noise"


@dataclass(frozen=True)
class _Darks:
    """Dark frames with at least two frames in the reference group."""

    reference: GroupStatistics  # corrected for clipping
    lines: tuple[DarkLines, ...]  # per channel
    mean: GroupMean
    mean_at_zero: GroupMean  # extrapolated to exposure zero, where the slopes of the pixels are known
    slopes: tuple[SlopeSpread, ...] | None
    clipped: ClippedDarks | None
    cut: CutTail | None

    @property
    def exposure_s(self) -> float:
        return self.reference.group.exposure_s


def measure_dark_frames(reduction: Reduction, reader: FrameReader) -> DarkResult:
    """Analyze the dark frames.

    Some frames of the reference group are read again, for the sums of their rows and columns and, where it is clipped
    at 0, for its zeros and its tails.
    """
    group, mean_frame = reduction.reference_group, reduction.reference_mean
    if group is None or mean_frame is None:
        return unknown_darks(reduction, UNKNOWN_DARK_NOISE.missing(NO_DARK_FRAMES))
    if group.frames == 1:
        return measure_single_darks(reduction, group, mean_frame)
    clipped = correct_clipped_darks(reduction, group, reader)
    groups = reduction.darks if clipped is None else clipped.groups
    cut = None if clipped is not None else measure_cut_tail(reduction, group, mean_frame, reader)
    change = black_level_change(groups)
    scatter = dark_lines(groups, None, change).variance.scatter
    mean = GroupMean.of(reader, group, mean_frame, scatter)
    if clipped is None:
        groups = _with_line_noise(groups, mean.noise, group.frames, reader)
    lines = tuple(dark_lines(groups, k, change) for k in range(len(reduction.names)))
    pooled = dark_lines(groups, None, change)
    coefficients, slope_map = dark_slope_coefficients([entry.group for entry in reduction.darks]), None
    if reduction.dark_slopes is not None and coefficients is not None:
        slope_map = SlopeMap(reduction.dark_slopes, coefficients, reduction.darks, scatter)
    slopes = None if slope_map is None else slope_map.spreads()
    if clipped is not None:
        slope_map = None  # clipped pixels do not show their slopes
        if slopes is not None:
            slopes = tuple(_clipped_slope(slopes[k], lines[k], clipped.scale(k)) for k in range(len(slopes)))
    reference = next(entry for entry in groups if entry.group is group.group)
    mean_at_zero = mean if slope_map is None else slope_map.moved(mean, 0.0)
    darks = _Darks(reference, lines, mean, mean_at_zero, slopes, clipped, cut)
    moments = label_moments(mean_at_zero.mean, mean_at_zero.tile)
    return DarkResult(
        groups=tuple(groups),
        lines=lines,
        channels=tuple(_measure_channel(darks, k, entry) for k, entry in enumerate(moments)),
        pooled=_measure_pooled(darks, pooled),
        change=change,
        scatter=scatter,
        mean=mean,
        slope_map=slope_map,
        slopes=slopes,
        slope_sampling=pooled.mean.sampling,
        clipped=clipped,
        cut=cut,
    )


def _measure_channel(darks: _Darks, k: int, moments: Moments) -> Measurements:
    level, exposure_s, slopes = darks.reference.levels[k], darks.exposure_s, darks.slopes
    dsnu, method = _dsnu_variance(moments, darks.mean_at_zero, k), _AT_ZERO
    if darks.mean_at_zero is darks.mean:
        method = _AT_EXPOSURE.format(_SPREAD, format_exposure(exposure_s))
    elif slopes is not None:
        charge = _spread_of_charge(darks.lines[k], slopes[k])
        dsnu += Uncertain.of(0.0, min(charge, max(level.spatial_variance, dsnu.value)))
    measured = measure_dark_level(darks.lines[k], level, darks.reference.label)
    measured = replace(measured, dsnu_variance=dsnu, dsnu_method=method)
    if slopes is not None:
        measured = replace(measured, dark_slope_variance=slopes[k].variance, dark_slope_third=slopes[k].third)
    if darks.clipped is None:
        measured = replace(measured, **_line_variances(darks.mean, [k]))
        return measured if darks.cut is None else _restored(measured, darks.cut.variance[k])
    plain, filtered = darks.clipped.components(k, *darks.mean.both_components(k))
    measured = replace(measured, dsnu1288=plain, dsnu1288_filtered=filtered)
    return _with_censored_fit(measured, darks.clipped.estimates[k], measured.dark_slope_variance, exposure_s)


def _spread_of_charge(lines: DarkLines, slope: SlopeSpread) -> float:
    """Return the variance over pixels of a dark charge that is off: it spreads as the slopes do."""
    if slope.mean == 0.0:
        return 0.0
    return lines.mean.charge_uncertainty_dn**2 * max(slope.variance.value, 0.0) / slope.mean**2


def measure_alike(dark: DarkResult, readout: ReadoutChannels) -> list[dict[str, Value]]:
    """Return the variances of the dark level and of the dark slope as with readout channels that are alike.

    Offsets of `readout` are in DN. The variances are those of each channel of colors, by the names of `Measurements`.
    Where noise is unknown or clipped, those of the readout channels are subtracted.
    """
    gain, offset = readout.tables()
    if dark.mean is None or dark.noise_unknown or dark.clipped is not None or dark.cut is not None:
        offsets, gains = float((gain * offset).var()), float(gain.var())
        return [
            {
                "dsnu_variance": derive(lambda v: v - offsets, m.dsnu_variance),
                "dark_slope_variance": derive(lambda v, s: v - s * s * gains, m.dark_slope_variance, m.dark_slope),
            }
            for m in dark.channels
        ]
    mean = dark.mean if dark.slope_map is None else dark.slope_map.moved(dark.mean, 0.0)
    factor, found = alike_noise(readout), list[dict[str, Value]]()
    alike = replace(
        mean,
        mean=held(alike_levels(mean.mean, readout)),
        noise=[parts.scaled(factor) for parts in mean.noise],
        total_noise=[noise * factor for noise in mean.total_noise],
    )
    slopes = None if dark.slope_map is None else dark.slope_map.spreads(readout)
    for k, moments in enumerate(label_moments(alike.mean, alike.tile)):
        dsnu = _dsnu_variance(moments, alike, k)
        if slopes is None:
            found.append({"dsnu_variance": dsnu})
            continue
        dsnu += Uncertain.of(0.0, _spread_of_charge(dark.lines[k], slopes[k]))
        found.append({"dsnu_variance": dsnu, "dark_slope_variance": slopes[k].variance})
    return found


def _measure_pooled(darks: _Darks, lines: DarkLines) -> Measurements:
    measured = measure_dark_level(lines, pooled_level(darks.reference.levels), darks.reference.label)
    if darks.clipped is None:
        measured = replace(measured, **_line_variances(darks.mean, range(len(darks.mean.noise))))
        return measured if darks.cut is None else _restored(measured, darks.cut.pooled)
    spread: Value = NO_PIXEL_SLOPES
    if darks.slopes is not None:
        pixels = [float(entry.pixels) for entry in darks.slopes]
        spread = weighted_mean([entry.variance for entry in darks.slopes], pixels)
    return _with_censored_fit(measured, darks.clipped.pooled(), spread, darks.exposure_s)


def _restored(measured: Measurements, cut: Uncertain) -> Measurements:
    """Return the measurements with the variance that was cut off at 0, the same in all dark frames."""
    read, dark = (derive(lambda v: v + cut, value) for value in (measured.read_variance, measured.dark_variance))
    return replace(measured, read_variance=read, dark_variance=dark)


def _with_line_noise(
    groups: Sequence[GroupStatistics], noise: Sequence[TemporalComponents], frames: int, reader: FrameReader
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


def _line_variances(mean: GroupMean, channels: Sequence[int]) -> dict[str, Any]:
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
    noise_slope = screen_dark_slope(lines.variance.line[1], lines.variance.exposure_s, variance=True)
    read = level.noise + Uncertain.of(-QUANTIZATION_DN2, level.clipping_uncertainty)
    # The sensor's mean noise is that of its pixels, which are the same in all groups: only sampling averages out.
    spread = level.variance_spread
    pixel_sampling = Uncertain.of(0.0, spread and spread * math.sqrt(max(1.0 - lines.variance.repetition, 0.0)))
    return Measurements(
        pixels=level.pixels,
        read_variance=read + Uncertain.of(0.0, level.rounding_variance),
        black_level=lines.mean.at_zero if isinstance(black, Missing) else black,
        dark_slope=slope,
        dark_slope_variance=slope if isinstance(slope, Missing) else Uncertain(0.0),
        dark_variance=derive(lambda variance: variance + pixel_sampling, lines.variance.at_zero),
        dark_variance_slope=screen_variance_slope(noise_slope, slope),
        read_method=f"{level.frames} {label}",
        charge_uncertainty_dn=lines.mean.charge_uncertainty_dn,
        step=level.step,
        dark_exposure=dark_exposure(lines),
    )


def dark_lines(
    groups: Sequence[GroupStatistics],
    channel: int | None,
    change: BlackLevelChange | None = None,
    *,
    plain: bool = False,
) -> DarkLines:
    """Return the dark lines of one channel, or of all pixels together (None); with equal weights if `plain`."""
    levels = [pooled_level(entry.levels) if channel is None else entry.levels[channel] for entry in groups]
    moved = 0.0 if change is None else change.variance(np.array([entry.frames for entry in groups]))
    return DarkLines.of([entry.group.exposure_s for entry in groups], levels, moved, plain=plain)


def with_standard_lines(dark: DarkResult) -> DarkResult:
    """Return the result with dark variance and slopes by EMVA 1288's lines: its temporal series, with equal weights.

    Measurements of clipped dark frames, and those withheld, stay as they are.
    """
    series = temporal_series(np.array([entry.frames for entry in dark.groups]))
    groups = [entry for entry, taken in zip(dark.groups, series, strict=True) if taken]
    known = dark.clipped is None and dark.cut is None and not dark.noise_unknown and not dark.level_unknown
    if not known or len({entry.group.exposure_s for entry in groups}) < 2:
        return dark

    def by_line(measured: Measurements, k: int | None) -> Measurements:
        lines = dark_lines(groups, k, dark.change, plain=True)
        values: dict[str, Any] = {
            "dark_slope": lines.mean.line[1],
            "dark_variance": lines.variance.at_zero,
            "dark_variance_slope": lines.variance.line[1],
        }
        shown = [name for name in values if isinstance(getattr(measured, name), Uncertain)]
        return replace(measured, **{name: values[name] for name in shown})

    channels = tuple(by_line(measured, k) for k, measured in enumerate(dark.channels))
    return replace(dark, channels=channels, pooled=by_line(dark.pooled, None))


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
    dsnu, parts = excess_variance(moments, dark.total_noise[channel]), dark.components(channel)
    dsnu = with_rounding(dsnu, dark.rounding[channel].pixel)
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
