"""Dark frames that do not show their noise: single frames, or none."""

from __future__ import annotations

from dataclasses import replace

from photosite.calibration.checks.result_screening import screen_dark_slope
from photosite.calibration.dark.dark_lines import DarkLine, DarkLines
from photosite.calibration.dark.dark_result import DarkResult, GroupMean, Rounding, dark_exposure
from photosite.calibration.measurements import Measurements
from photosite.calibration.photon_transfer.without_darks import SINGLE_DARK_FRAMES, unknown_level, unknown_variance
from photosite.calibration.reduction.groups import CLIPPED_DARK_FRACTION, GroupStatistics, pooled_level
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.spatial.line_noise import TemporalComponents
from photosite.calibration.spatial.nonuniformity import MapPlanes, VarianceComponents, channel_components
from photosite.calibration.spatial.pixel_slopes import excess_variance
from photosite.calibration.withheld import UNKNOWN_DARK_NOISE
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.lazy_maps import held
from photosite.engine.map_statistics import label_moments
from photosite.values.uncertain import Missing, Uncertain, weighted_mean

_NO_NOISE = TemporalComponents(Uncertain(0.0), Uncertain(0.0), Uncertain(0.0))


def unknown_darks(reduction: Reduction, why: Missing) -> DarkResult:
    """Return that level and noise of the dark are unknown, for a reason."""
    lights = reduction.lights
    levels = [unknown_level(lights, k, why.reason) for k in range(len(reduction.names))]
    lines = tuple(
        DarkLines(level, unknown_variance(lights, k, float(level.y[0]), why.reason)) for k, level in enumerate(levels)
    )
    pixels = [level.pixels for level in reduction.first_group.levels]
    measured = tuple(_unknown(why, count) for count in pixels)
    return DarkResult(groups=(), lines=lines, channels=measured, pooled=_unknown(why, sum(pixels)))


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


def measure_single_darks(reduction: Reduction, reference: GroupStatistics, frame: MeanFrame) -> DarkResult:
    """Return level and dark current of dark exposures with one frame each; their noise is an upper limit."""
    darks, channels = reduction.darks, range(len(reduction.names))
    if any(level.low_fraction > CLIPPED_DARK_FRACTION for entry in darks for level in entry.levels):
        return unknown_darks(
            reduction, UNKNOWN_DARK_NOISE.missing(f"the dark frames are clipped at 0, and {SINGLE_DARK_FRAMES}")
        )
    values, tile = held(frame), frame.labels
    mean = GroupMean(
        statistics=reference,
        mean=values,
        tile=tile,
        noise=[_NO_NOISE] * len(channels),
        total_noise=[_NO_NOISE.total] * len(channels),
        rounding=[Rounding(0.0, 0.0)] * len(channels),
        exposure_s=reference.group.exposure_s,
    )
    spreads, planes = [], MapPlanes(values, tile)
    for k, moments in enumerate(label_moments(values, tile)):
        spread = excess_variance(moments, _NO_NOISE.total)
        parts = channel_components(planes, k, _NO_NOISE, filtered=False)
        if isinstance(parts, VarianceComponents):
            uncertainty = max(spread.standard_uncertainty, parts.total.standard_uncertainty)
            spread = Uncertain.of(spread.value, uncertainty)
        spreads.append(spread)
    slopes = None
    if reduction.dark_slopes is not None:
        # Their spread holds the noise of the frames: that of the dark current is between 0 and the whole of it.
        slopes = tuple(
            replace(spread, variance=Uncertain.of(0.5 * spread.variance.value, 0.5 * spread.variance.value))
            for spread in reduction.dark_slopes.spreads([_NO_NOISE.total] * len(channels))
        )
    pixels = [level.pixels for level in reference.levels]
    lines, pooled = tuple(_single_lines(reduction, k) for k in channels), _single_lines(reduction, None)
    return DarkResult(
        groups=darks,
        lines=lines,
        channels=tuple(_measure_level(*each) for each in zip(lines, spreads, pixels, strict=True)),
        pooled=_measure_level(pooled, weighted_mean(spreads, [float(count) for count in pixels]), sum(pixels)),
        mean=mean,
        slopes=slopes,
        slope_sampling=pooled.mean.sampling,
    )


def _measure_level(dark: DarkLines, spread: Uncertain, pixels: int) -> Measurements:
    why, (black, slope) = UNKNOWN_DARK_NOISE.missing(SINGLE_DARK_FRAMES), dark.mean.line
    slope = screen_dark_slope(slope, dark.mean.exposure_s)
    return replace(
        _unknown(why, pixels),
        black_level=dark.mean.at_zero if isinstance(black, Missing) else black,
        dark_slope=slope,
        dark_slope_variance=slope if isinstance(slope, Missing) else why,
        noise_and_pattern=spread,
        dark_exposure=dark_exposure(dark),
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
    return DarkLines.through_single([entry.group.exposure_s for entry in darks], levels, variance)
