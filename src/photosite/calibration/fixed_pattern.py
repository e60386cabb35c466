"""The second look at the frames: fixed-pattern maps that need to know the linear range first.

The linear range shows when all light levels have been read, and keeping the mean frame of each until then would
take memory that grows with their number. So some are kept, as many as a fixed room holds; of the others, those
inside the linear range are read once more. One map of slopes is built from them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.dark_lines import same_exposure
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.calibration.spatial.line_noise import TemporalParts, mean_frame_parts
from photosite.calibration.spatial.parts import Parts, channel_parts
from photosite.calibration.spatial.pixel_slopes import (
    PixelSlopes,
    SlopeSpread,
    relative_response_variance,
    slope_coefficients,
    slope_noise,
)
from photosite.calibration.spatial.spatial_analysis import FarThresholds, MeanPlanes, SpatialAnalysis, spatial_analysis
from photosite.engine.frame_sums import MeanFrame
from photosite.values.uncertain import Missing, Uncertain, Value

HALF_SATURATION = (0.3, 0.7)
"""Signal, as a share of that at saturation, that counts as EMVA 1288's 50 % where no level is nearer."""


@dataclass(frozen=True)
class Patterns:
    """One channel's fixed pattern: see `figures.Measurements`."""

    response_variance: Value
    dsnu1288: Parts | Missing
    dsnu1288_filtered: Parts | Missing
    prnu1288: Parts | Missing
    prnu1288_unfiltered: Parts | Missing
    spatial: SpatialAnalysis | Missing


@dataclass(frozen=True)
class SlopePlan:
    """One channel's coefficient per light group, the noise its slopes will hold, and seconds per unit of the axis."""

    coefficients: dict[int, float]
    noise: Uncertain
    seconds_per_unit: float


def plan_slopes(channel: Channel, lights: Sequence[GroupStatistics]) -> SlopePlan | Missing:
    """How a channel's map of slopes will be made of the light groups in its linear range."""
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
        # One frame does not show its noise; the photon transfer curve says what it is.
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


def _half_saturated(channel: Channel, lights: Sequence[GroupStatistics]) -> int | Missing:
    """The light group for PRNU after EMVA 1288: the most frames near half saturation, then the nearest."""
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
    """The dark group of the same exposure with the most frames, else the reference."""
    same = [
        i
        for i, entry in enumerate(darks)
        if entry.frames > 1 and same_exposure(entry.group.exposure_s, light.group.exposure_s)
    ]
    return max(same, key=lambda i: darks[i].frames) if same else reference


def mean_planes(
    statistics: GroupStatistics, mean: NDArray[np.float64], tile: NDArray[np.int64], channel: int, noise: TemporalParts
) -> MeanPlanes:
    """A channel's planes of a group's mean frame, with the temporal variance left in it."""
    return MeanPlanes.of(mean, tile, channel, statistics.frames, statistics.group.exposure_s, noise)


class PatternReader:
    """Looks again at the mean frames that the fixed-pattern figures need, and works them out.

    Parameters
    ----------
    reader
        The reader of the first pass.
    darks, lights
        The groups as judged.
    reference, reference_mean
        The dark group of read noise and DSNU, and its mean frame.
    channels
        What the first pass told.
    dark_slopes
        Per channel, the spread of dark slopes; None with one dark exposure.
    dark_noise, scatter
        Per channel, the temporal variance left in `reference_mean`; see `DarkLine.scatter`.
    dark_parts
        The reference's parts where they are known beforehand, by channel and whether high-passed; empty where they
        are to be found here.
    """

    def __init__(
        self,
        reader: FrameReader,
        darks: Sequence[GroupStatistics],
        lights: Sequence[GroupStatistics],
        reference: int,
        reference_mean: MeanFrame,
        channels: Sequence[Channel],
        dark_slopes: Sequence[SlopeSpread] | None,
        dark_noise: Sequence[TemporalParts],
        scatter: float,
        dark_parts: Mapping[tuple[int, bool], Parts | Missing],
    ) -> None:
        self._reader = reader
        self._darks = darks
        self._lights = lights
        self._channels = channels
        self._dark_slopes = dark_slopes
        self._dark_noise = {reference: dark_noise}
        self._scatter = scatter
        self._plans = [plan_slopes(channel, lights) for channel in channels]
        self._half = [_half_saturated(channel, lights) for channel in channels]
        self._dark_of = [
            reference if isinstance(half, Missing) or dark_parts else _matching_dark(lights[half], darks, reference)
            for half in self._half
        ]
        self._dark_means = {reference: reference_mean.mean()}
        self._dark_found = dict(dark_parts)

    def read(self, far: FarThresholds | None = None) -> tuple[Patterns, ...]:
        """Per channel, its fixed pattern; `far` says which pixels are candidates for the list of defects."""
        again = [i for i in range(len(self._lights)) if self._needed(i)]
        dark_again = sorted(set(self._dark_of) - set(self._dark_means))
        self._reader.expect(
            sum(len(self._lights[i].group) for i in again if not self._reader.kept(self._lights[i].group))
            + sum(len(self._darks[i].group) for i in dark_again)
        )
        for i in dark_again:
            self._dark_means[i] = self._reader.mean(self._darks[i].group).mean()
            self._dark_noise[i] = mean_frame_parts(self._reader, self._darks[i], self._scatter)

        slopes = PixelSlopes((self._reader.frames.rows, self._reader.frames.cols), self._reader.tile)
        plans = [plan if isinstance(plan, SlopePlan) else None for plan in self._plans]
        filtered: dict[int, Parts | Missing] = {}
        plain: dict[int, Parts | Missing] = {}
        spatial: dict[int, SpatialAnalysis | Missing] = {}
        for i in again:
            level = self._reader.mean(self._lights[i].group)
            slopes.add(level, [plan.coefficients.get(i, 0.0) if plan else 0.0 for plan in plans])
            of_half = [k for k, half in enumerate(self._half) if half == i]
            if of_half:
                mean = level.mean()
                noise = mean_frame_parts(self._reader, self._lights[i], self._scatter)
            for k in of_half:
                filtered[k] = self._light_parts(k, i, mean, noise[k], filtered=True)
                plain[k] = self._light_parts(k, i, mean, noise[k], filtered=False)
                light = mean_planes(self._lights[i], mean, self._reader.tile, k, noise[k])
                spatial[k] = spatial_analysis(self._dark_planes(k), light, far)
        spreads = slopes.spreads([plan.noise if plan else Uncertain(0.0) for plan in plans])
        result = []
        for k, half in enumerate(self._half):
            why = half if isinstance(half, Missing) else None
            result.append(
                Patterns(
                    response_variance=self._response_variance(k, spreads[k]),
                    dsnu1288=self._dark_parts(k, filtered=False),
                    dsnu1288_filtered=self._dark_parts(k, filtered=True),
                    prnu1288=why or filtered[k],
                    prnu1288_unfiltered=why or plain[k],
                    spatial=spatial_analysis(self._dark_planes(k), why, far) if why else spatial[k],
                )
            )
        return tuple(result)

    def _needed(self, group: int) -> bool:
        return group in self._half or any(
            isinstance(plan, SlopePlan) and group in plan.coefficients for plan in self._plans
        )

    def _response_variance(self, k: int, spread: SlopeSpread) -> Value:
        plan = self._plans[k]
        if isinstance(plan, Missing):
            return plan
        if spread.mean <= 0.0:
            return Missing("the light frames do not get brighter with exposure")
        dark = self._dark_slopes[k] if self._dark_slopes is not None else None
        return relative_response_variance(spread, dark, plan.seconds_per_unit)

    def _dark_parts(self, k: int, *, filtered: bool) -> Parts | Missing:
        if (k, filtered) not in self._dark_found:
            dark = self._dark_of[k]
            noise = self._dark_noise[dark][k]
            found = channel_parts(self._dark_means[dark], self._reader.tile, k, noise, filtered=filtered)
            self._dark_found[k, filtered] = found
        return self._dark_found[k, filtered]

    def _dark_planes(self, k: int) -> MeanPlanes:
        dark = self._dark_of[k]
        noise = self._dark_noise[dark][k]
        return mean_planes(self._darks[dark], self._dark_means[dark], self._reader.tile, k, noise)

    def _light_parts(
        self, k: int, group: int, mean: NDArray[np.float64], noise: TemporalParts, *, filtered: bool
    ) -> Parts | Missing:
        """Light less dark, relative to the signal, squared."""
        light = channel_parts(mean, self._reader.tile, k, noise, filtered=filtered)
        dark = self._dark_parts(k, filtered=filtered)
        if isinstance(light, Missing) or isinstance(dark, Missing):
            return light if isinstance(light, Missing) else dark
        levels = self._channels[k].levels
        place = int(np.flatnonzero(levels.group == group)[0])
        signal = Uncertain.of(float(levels.signal[place]), float(np.sqrt(levels.signal_covariance[place, place])))
        relative = 1.0 / (signal * signal)
        if (curvature := self._channels[k].curvature) is not None:
            relative = curvature.widen(relative, -2.0 * curvature.contrast(float(levels.x[place])))
        return (light - dark).scaled(relative)
