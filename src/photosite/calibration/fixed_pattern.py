"""Stage "spatial": the fixed pattern, from mean frames of the linear range.

The linear range is known once all light levels have been read. Keeping the mean frame of each until then would take
memory that grows with their number. So mean frames are kept up to a fixed size, and the others that lie in the linear
range are read again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.dark import DarkResult
from photosite.calibration.light import LightResult
from photosite.calibration.measurements import NO_LIGHT
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.dark_lines import same_exposure
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.spatial.line_noise import TemporalParts, mean_frame_parts
from photosite.calibration.spatial.parts import Parts, channel_parts
from photosite.calibration.spatial.pixel_slopes import (
    PixelSlopes,
    SlopeSpread,
    relative_response_variance,
    slope_coefficients,
    slope_noise,
)
from photosite.calibration.spatial.spatial_analysis import (
    MeanPlanes,
    OutlierThresholds,
    SpatialAnalysis,
    spatial_analysis,
)
from photosite.values.uncertain import Missing, Uncertain, Value

HALF_SATURATION = (0.3, 0.7)
"""Signal, as a share of that at saturation, that counts as EMVA 1288's 50 % where no level is nearer."""


@dataclass(frozen=True)
class FixedPattern:
    """One channel's fixed pattern; the variances are those of `Measurements`."""

    response_variance: Value
    dsnu1288: Parts | Missing
    dsnu1288_filtered: Parts | Missing
    prnu1288: Parts | Missing
    prnu1288_unfiltered: Parts | Missing
    spatial: SpatialAnalysis | Missing


@dataclass(frozen=True)
class SlopePlan:
    """How a channel's map of slopes is made.

    Parameters
    ----------
    coefficients
        Weight of each light group's mean frame, by the index of the group.
    noise
        Variance of the slopes from temporal noise.
    seconds_per_unit
        Exposure time per unit of the light levels' axis.
    """

    coefficients: dict[int, float]
    noise: Uncertain
    seconds_per_unit: float


def plan_slopes(channel: Channel, lights: Sequence[GroupStatistics]) -> SlopePlan | Missing:
    """Plan a channel's map of slopes from the light groups in its linear range."""
    levels, used = channel.levels, channel.used
    if len(np.unique(levels.x[used])) < 2:
        return Missing(
            f"{int(used.sum())} light level in the linear range; slopes need two or more: take shorter exposures"
        )
    groups = levels.group[used]
    chosen = [lights[i].levels[channel.index] for i in groups]
    variance = np.array([level.variance for level in chosen])
    uncertainty = np.array([level.variance_uncertainty for level in chosen])
    single = ~levels.repeated[used]
    if single.any():
        # The noise of a single frame is taken from the photon transfer curve.
        if isinstance(channel.gain, Missing):
            return Missing(f"some light levels have one frame, and their noise is unknown: {channel.gain.reason}")
        dark = channel.dark.variance.weights_at(levels.exposure_s[used]) @ channel.dark.variance.y
        variance[single] = (dark + channel.gain.value * levels.signal[used])[single]
        uncertainty[single] = (channel.gain.standard_uncertainty * levels.signal[used])[single]
    frames = np.array([level.frames for level in chosen])
    coefficients = slope_coefficients(levels.x[used], frames / variance)
    return SlopePlan(
        dict(zip(groups.tolist(), coefficients.tolist(), strict=True)),
        slope_noise(coefficients, frames, variance, uncertainty),
        float(coefficients @ levels.exposure_s[used]),
    )


@dataclass(frozen=True)
class _MeanFrame:
    """The mean frame of a group, with the temporal variance left in it per channel."""

    statistics: GroupStatistics
    mean: NDArray[np.float64]
    tile: NDArray[np.int64]
    noise: Sequence[TemporalParts]

    def parts(self, channel: int) -> tuple[Parts | Missing, Parts | Missing]:
        """Return a channel's row, column and pixel parts, plain and high-passed."""
        plain, filtered = (
            channel_parts(self.mean, self.tile, channel, self.noise[channel], filtered=filtered)
            for filtered in (False, True)
        )
        return plain, filtered

    def planes(self, channel: int) -> MeanPlanes:
        """Return a channel's planes."""
        group = self.statistics
        return MeanPlanes.of(self.mean, self.tile, channel, group.frames, group.group.exposure_s, self.noise[channel])


@dataclass(frozen=True)
class _DarkPattern:
    """The dark frames that belong to a channel's half-saturated flats."""

    parts: tuple[Parts | Missing, Parts | Missing]
    planes: MeanPlanes


def measure_fixed_pattern(
    reduction: Reduction, dark: DarkResult, light: LightResult, reader: FrameReader, outliers: OutlierThresholds | None
) -> tuple[FixedPattern, ...]:
    """Measure each channel's fixed pattern."""
    channels, lights = light.channels, reduction.lights
    half = [_half_saturated(channel, lights) for channel in channels]
    patterns = _dark_patterns(reduction, dark, half, reader)
    if not channels:
        return tuple(
            FixedPattern(NO_LIGHT, *entry.parts, NO_LIGHT, NO_LIGHT, spatial_analysis(entry.planes, NO_LIGHT, outliers))
            for entry in patterns
        )
    plans = [plan_slopes(channel, lights) for channel in channels]
    groups = [i for i in range(len(lights)) if i in half or any(_in_plan(plan, i) for plan in plans)]
    reader.expect(sum(len(lights[i].group) for i in groups if not reader.kept(lights[i].group)))
    slopes = PixelSlopes((reduction.frames.rows, reduction.frames.cols), reader.tile)
    prnu: dict[int, tuple[Parts | Missing, Parts | Missing]] = {}
    spatial: dict[int, SpatialAnalysis | Missing] = {}
    for i in groups:
        mean = reader.mean(lights[i].group)
        slopes.add(mean, [plan.coefficients.get(i, 0.0) if isinstance(plan, SlopePlan) else 0.0 for plan in plans])
        if i not in half:
            continue
        flat = _MeanFrame(lights[i], mean.mean(), reader.tile, mean_frame_parts(reader, lights[i], dark.scatter))
        for k in (k for k, group in enumerate(half) if group == i):
            plain, filtered = (
                _light_less_dark(part, dark_part, channels[k], i)
                for part, dark_part in zip(flat.parts(k), patterns[k].parts, strict=True)
            )
            prnu[k], spatial[k] = (filtered, plain), spatial_analysis(patterns[k].planes, flat.planes(k), outliers)
    spreads = slopes.spreads([plan.noise if isinstance(plan, SlopePlan) else Uncertain(0.0) for plan in plans])
    result = []
    for k, group in enumerate(half):
        if isinstance(group, Missing):
            prnu[k], spatial[k] = (group, group), spatial_analysis(patterns[k].planes, group, outliers)
        dark_slope = None if dark.slopes is None else dark.slopes[k]
        response = _response_variance(plans[k], spreads[k], dark_slope)
        result.append(FixedPattern(response, *patterns[k].parts, *prnu[k], spatial[k]))
    return tuple(result)


def _half_saturated(channel: Channel, lights: Sequence[GroupStatistics]) -> int | Missing:
    """Return the light group for PRNU of EMVA 1288: the most frames near half saturation, then the nearest."""
    levels, saturation = channel.levels, channel.saturation
    if saturation.signal is None:
        return Missing("PRNU at 50 % of saturation needs flats that reach saturation")
    share = levels.signal / saturation.signal
    near = levels.repeated & ~levels.clipped & (share >= HALF_SATURATION[0]) & (share <= HALF_SATURATION[1])
    if not near.any():
        return Missing(
            "no light level with two frames lies between 30 and 70 % of saturation; take a stack at 50 %, better of 50"
        )
    candidates = np.flatnonzero(near)
    best = min(candidates, key=lambda i: (-lights[int(levels.group[i])].frames, abs(share[i] - 0.5)))
    return int(levels.group[best])


def _matching_dark(light: GroupStatistics, darks: Sequence[GroupStatistics], reference: int) -> int:
    """Return the dark group of the same exposure with the most frames, else the reference."""
    same = [
        i
        for i, entry in enumerate(darks)
        if entry.frames > 1 and same_exposure(entry.group.exposure_s, light.group.exposure_s)
    ]
    return max(same, key=lambda i: darks[i].frames) if same else reference


def _dark_patterns(
    reduction: Reduction, dark: DarkResult, half: Sequence[int | Missing], reader: FrameReader
) -> list[_DarkPattern]:
    """Return per channel the dark pattern at the exposure of the half-saturated flats, else that of the reference."""
    reference, darks = reduction.reference, reduction.darks
    if dark.clipped is None and half:
        of_channel = [
            reference if isinstance(i, Missing) else _matching_dark(reduction.lights[i], darks, reference) for i in half
        ]
    else:
        of_channel = [reference] * len(reduction.names)
    mean = reduction.reference_mean
    frames = {reference: _MeanFrame(darks[reference], mean.mean(), mean.labels, dark.noise)}
    again = sorted(set(of_channel) - {reference})
    reader.expect(sum(len(darks[i].group) for i in again))
    for i in again:
        mean = reader.mean(darks[i].group)
        frames[i] = _MeanFrame(darks[i], mean.mean(), mean.labels, mean_frame_parts(reader, darks[i], dark.scatter))
    return [
        _DarkPattern(dark.parts[k] if i == reference else frames[i].parts(k), frames[i].planes(k))
        for k, i in enumerate(of_channel)
    ]


def _in_plan(plan: SlopePlan | Missing, group: int) -> bool:
    return isinstance(plan, SlopePlan) and group in plan.coefficients


def _response_variance(plan: SlopePlan | Missing, spread: SlopeSpread, dark: SlopeSpread | None) -> Value:
    if isinstance(plan, Missing):
        return plan
    if spread.mean <= 0.0:
        return Missing("the light frames do not get brighter with exposure")
    return relative_response_variance(spread, dark, plan.seconds_per_unit)


def _light_less_dark(light: Parts | Missing, dark: Parts | Missing, channel: Channel, group: int) -> Parts | Missing:
    """Return the parts of a light group less those of the dark, relative to the squared signal."""
    if isinstance(light, Missing) or isinstance(dark, Missing):
        return light if isinstance(light, Missing) else dark
    levels = channel.levels
    place = int(np.flatnonzero(levels.group == group)[0])
    signal = Uncertain.of(float(levels.signal[place]), float(np.sqrt(levels.signal_covariance[place, place])))
    relative = 1.0 / (signal * signal)
    if (curvature := channel.curvature) is not None:
        relative = curvature.widen(relative, -2.0 * curvature.contrast(float(levels.x[place])))
    return (light - dark).scaled(relative)
