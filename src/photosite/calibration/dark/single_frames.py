"""Dark frames that do not show their noise: single frames, or none."""

from __future__ import annotations

from dataclasses import replace

from photosite.calibration.checks.result_screening import screen_dark_slope
from photosite.calibration.dark.dark_lines import DarkLine, DarkLines
from photosite.calibration.dark.dark_result import DarkResult, GroupMean, dark_exposure
from photosite.calibration.measurements import Measurements
from photosite.calibration.photon_transfer.without_darks import SINGLE_DARK_FRAMES, unknown_level, unknown_variance
from photosite.calibration.reduction.groups import CLIPPED_DARK_FRACTION, GroupStatistics, pooled_level
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.spatial.line_noise import TemporalParts
from photosite.calibration.spatial.nonuniformity import MapPlanes, Parts, channel_parts
from photosite.calibration.spatial.pixel_slopes import excess_variance
from photosite.calibration.withheld import UNKNOWN_DARK_NOISE
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.map_statistics import label_moments
from photosite.values.uncertain import Missing, Uncertain, weighted_mean


def unknown_darks(reduction: Reduction, why: Missing) -> DarkResult:
    """Return that level and noise of the dark are unknown, for a reason."""
    lights = reduction.lights
    levels = [unknown_level(lights, k, why.reason) for k in range(len(reduction.names))]
    lines = tuple(
        DarkLines(level, unknown_variance(lights, k, float(level.y[0]), why.reason)) for k, level in enumerate(levels)
    )
    pixels = [level.pixels for level in reduction.first_group.levels]
    measured = tuple(_unknown(why, of_channel) for of_channel in pixels)
    return DarkResult(groups=(), lines=lines, channels=measured, together=_unknown(why, sum(pixels)))


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
    why = UNKNOWN_DARK_NOISE.missing(SINGLE_DARK_FRAMES)
    exposure_s = reference.group.exposure_s
    values, tile = frame.mean(), frame.labels
    none = TemporalParts(Uncertain(0.0), Uncertain(0.0), Uncertain(0.0))
    noise = [none] * len(channels)
    mean = GroupMean(
        statistics=reference,
        mean=values,
        tile=tile,
        noise=noise,
        total_noise=[none.total] * len(channels),
        rounding=[0.0] * len(channels),
        exposure_s=exposure_s,
    )
    spreads, planes = [], MapPlanes(values, tile)
    for k, moments in enumerate(label_moments(values, tile)):
        spread, parts = excess_variance(moments, none.total), channel_parts(planes, k, none, filtered=False)
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
        groups=darks,
        lines=lines,
        channels=of_channels,
        together=measured(together, weighted_mean(spreads, [float(count) for count in pixels]), sum(pixels)),
        mean=mean,
        slopes=slopes,
        slope_sampling=together.mean.sampling,
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
