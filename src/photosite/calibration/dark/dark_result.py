"""What the dark frames show: mean frames and their extrapolation to other exposure times, levels and noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.dark.black_level_change import STEADY, BlackLevelChange, Contradiction
from photosite.calibration.dark.clipped_darks import ClippedDarks
from photosite.calibration.dark.cut_tail import CutTail
from photosite.calibration.dark.dark_lines import DarkLines, temporal_variances
from photosite.calibration.measurements import Measurements
from photosite.calibration.photon_transfer.noise_covariance import SharedNoise
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import LEAST_DARK_VARIANCE, GroupStatistics
from photosite.calibration.reduction.quantization import differing_fraction, with_rounding
from photosite.calibration.spatial.line_noise import TemporalComponents, mean_frame_components
from photosite.calibration.spatial.nonuniformity import MapPlanes, VarianceComponents, channel_components
from photosite.calibration.spatial.pixel_slopes import PixelSlopes, SlopeSpread, mean_frame_noise, slope_noise
from photosite.calibration.spatial.spatial_analysis import MeanPlanes
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.lazy_maps import Map, MovedMap, held
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Missing, Uncertain, derive

ComponentsPair = tuple[VarianceComponents | Missing, VarianceComponents | Missing]
"""Row, column and pixel parts of a channel: plain and high-passed."""


SLOPE_SPREAD_SIGMA = 3.0
"""Spread of the dark slopes, in standard uncertainties, from which it is taken into account."""

NEGLIGIBLE_SPREAD = 0.1
"""Variance from the spread of the dark slopes, over the uncertainty of DSNU squared, up to which it is not."""


class Rounding(NamedTuple):
    """Standard uncertainties from rounding of a pixel's mean, and of the mean over pixels, DN."""

    pixel: float
    mean: float


@dataclass(frozen=True)
class GroupMean:
    """The (rows, cols) mean frame of a group, with the temporal variance left in it per channel.

    `exposure_s` is another exposure time than the group's where the mean was extrapolated (`DarkResult.at`).
    """

    statistics: GroupStatistics
    mean: Map
    tile: NDArray[np.int64]
    noise: Sequence[TemporalComponents]
    total_noise: Sequence[Uncertain]  # the sum of the parts, without the uncertainty of the division
    rounding: Sequence[Rounding]
    exposure_s: float

    @classmethod
    def of(
        cls,
        reader: FrameReader,
        statistics: GroupStatistics,
        mean: MeanFrame,
        scatter: float,
        values: Map | None = None,
    ) -> GroupMean:
        """Read some frames of the group again for the sums of their rows and columns (`mean_frame_components`).

        `values` is `held(mean)`, where it is known.
        """
        noise = mean_frame_components(reader, statistics, scatter)
        total = [mean_frame_noise(level, scatter) for level in statistics.levels]
        rounding = [Rounding(level.rounding_pixel, level.rounding_mean) for level in statistics.levels]
        return cls(
            statistics,
            held(mean) if values is None else values,
            mean.labels,
            noise,
            total,
            rounding,
            statistics.group.exposure_s,
        )

    @cached_property
    def _planes(self) -> MapPlanes:
        return MapPlanes(self.mean, self.tile)

    def both_components(self, channel: int) -> ComponentsPair:
        """Return the components of a channel, plain and high-passed."""
        return self.components(channel), self.components(channel, filtered=True)

    def components(self, channel: int, *, filtered: bool = False) -> VarianceComponents | Missing:
        """Return the components of a channel."""
        parts = channel_components(self._planes, channel, self.noise[channel], filtered=filtered)
        if isinstance(parts, Missing):
            return parts
        digital_gain = Uncertain.of(1.0, self.statistics.levels[channel].scale_uncertainty)
        return parts.with_rounding(*self.rounding[channel]).scaled(digital_gain)

    def planes(self, channel: int, *, own: bool = False) -> MeanPlanes:
        """Return the planes of a channel, with their `own` memory where the mean frame is not needed for others."""
        frames, moved = self.statistics.frames, self.exposure_s != self.statistics.group.exposure_s
        found = MeanPlanes.of(
            self.mean, self.tile, channel, frames, self.exposure_s, self.noise[channel], extrapolated=moved
        )
        return found.copied() if own else found


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

    def rounding(self, weights: NDArray[np.float64], channel: int) -> Rounding:
        """Return the largest standard uncertainties of such a combination from rounding."""
        levels = [entry.levels[channel] for entry in self.groups]
        of_pixel, of_mean = ([getattr(level, name) for level in levels] for name in ("rounding_pixel", "rounding_mean"))
        return Rounding(float(np.abs(weights) @ of_pixel), float(np.abs(weights) @ of_mean))

    @property
    def _frames(self) -> NDArray[np.int64]:
        return np.array([entry.frames for entry in self.groups])

    def spreads(self, readout: ReadoutChannels | None = None) -> tuple[SlopeSpread, ...]:
        """Return the spread of the slopes per channel; with `readout`, that of readout channels that are alike."""
        channels = range(len(self.groups[0].levels))
        spreads = self.slopes.spreads([self.noise(self.coefficients, k) for k in channels], readout)
        return tuple(replace(spread, variance=self._rounded(spread.variance, k)) for k, spread in enumerate(spreads))

    def _rounded(self, variance: Uncertain, channel: int) -> Uncertain:
        levels = [entry.levels[channel] for entry in self.groups]
        fraction = differing_fraction(
            np.array([level.mean for level in levels]), max(level.rounding_pixel for level in levels)
        )
        return with_rounding(variance, fraction * self.rounding(self.coefficients, channel).pixel)

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
            noise.append(TemporalComponents(whole - row - column, row, column))
        return replace(
            mean,
            mean=held(MovedMap(mean.mean, self.slopes.slopes, seconds)),
            noise=noise,
            total_noise=total,
            rounding=[self.rounding(weights, k) for k in range(len(noise))],
            exposure_s=exposure_s,
        )


@dataclass(frozen=True, kw_only=True)
class DarkResult:
    """What the dark frames show, per channel where not stated otherwise.

    Parameters
    ----------
    groups
        All dark groups, corrected for clipping at 0.
    lines
        Dark signal and dark variance against exposure.
    channels, pooled
        The measurements of each channel, and of all pixels together.
    change
        Change of the black level between dark frames.
    scatter
        Relative scatter of the noise between combinations of frames (`DarkLine.scatter`).
    mean
        Mean frame of the reference group; None without dark frames.
    slope_map
        Per-pixel dark slopes; None with one dark exposure, single frames or dark frames clipped at 0.
    slopes
        Their spread, also of clipped dark frames.
    slope_sampling
        Standard uncertainty of the dark slope of all pixels together from sampling alone.
    clipped
        Censored fit; None where no dark frames are clipped at 0.
    cut
        Noise that is cut off where only a few noisy pixels reach 0.
    """

    groups: tuple[GroupStatistics, ...]
    lines: tuple[DarkLines, ...]
    channels: tuple[Measurements, ...]
    pooled: Measurements
    change: BlackLevelChange = STEADY
    scatter: float = 0.0
    mean: GroupMean | None = None
    slope_map: SlopeMap | None = None
    slopes: tuple[SlopeSpread, ...] | None = None
    slope_sampling: float = math.inf
    clipped: ClippedDarks | None = None
    cut: CutTail | None = None

    @property
    def reference_exposure_s(self) -> float:
        """Exposure time of the reference group, seconds; 0 without dark frames."""
        return 0.0 if self.mean is None else self.mean.exposure_s

    @property
    def rounding_shows(self) -> bool:
        """Whether the noise of some dark frames is too small to make their rounding even (EMVA 1288's limit)."""
        levels = [level for entry in self.groups for level in entry.levels if level.repeated]
        return any(level.noise.value < LEAST_DARK_VARIANCE for level in levels)

    @property
    def noise_unknown(self) -> str:
        """Why the temporal noise of the dark frames is unknown; empty where it is known."""
        return self.lines[0].variance.reason

    @property
    def level_unknown(self) -> str:
        """Why the level of the dark frames is unknown; empty where it is known."""
        return self.lines[0].mean.reason

    def at(self, exposure_s: float, *, beyond: bool = False) -> GroupMean | None:
        """Return the mean dark frame at an exposure time within the range of the dark frames, or `beyond` it.

        It is that of the reference group, moved along each pixel's dark slope where the spread of the slopes is known
        and not negligible. None without dark frames.
        """
        if self.mean is None or self.slope_map is None or self.slopes is None:
            return self.mean
        times = [entry.group.exposure_s for entry in self.groups]
        exposure_s = max(exposure_s, 0.0) if beyond else min(max(exposure_s, min(times)), max(times))
        square = (exposure_s - self.mean.exposure_s) ** 2
        for slope, m in zip(self.slopes, self.channels, strict=True):
            dsnu, spread = m.dsnu_variance, slope.variance
            assert isinstance(dsnu, Uncertain)
            seen = spread.value > SLOPE_SPREAD_SIGMA * spread.standard_uncertainty
            if seen and square * spread.value > NEGLIGIBLE_SPREAD * dsnu.standard_uncertainty:
                return self.slope_map.moved(self.mean, exposure_s)
        return self.mean


def with_shared_charge(dark: DarkResult, shared: SharedNoise | None) -> DarkResult:
    """Return the result with summed covariances of the dark charge, which pixels share as they share that of light.

    Where a filter in the camera may be the cause, the noise of the dark frames may be less than the sensor's.
    """
    if shared is None or isinstance(shared.charge, Missing):
        return dark

    def of(m: Measurements, factor: Uncertain, cause_uncertainty: float) -> Measurements:
        found = replace(m, dark_variance_slope=derive(lambda slope: slope * factor, m.dark_variance_slope))
        if not shared.unclear_cause:
            return found
        filter_factor = Uncertain.of(1.0, cause_uncertainty)
        noise: dict[str, Any] = {
            name: derive(lambda v: v * filter_factor, getattr(m, name))
            for name in ("read_variance", "dark_variance", "dsnu_variance")
        }
        return replace(found, **noise)

    factors, cause_uncertainties = (
        [getattr(entry, name) for entry in shared.charge] for name in ("factor", "cause_uncertainty")
    )
    channels = tuple(map(of, dark.channels, factors, cause_uncertainties))
    mean = Uncertain.of(
        float(np.mean([factor.value for factor in factors])),
        float(np.mean([factor.standard_uncertainty for factor in factors])),
    )
    return replace(dark, channels=channels, pooled=of(dark.pooled, mean, float(np.mean(cause_uncertainties))))


def without_mean_slope(dark: DarkResult, found: Contradiction | None) -> DarkResult:
    """Return the result without the dark current from the mean, where that from the variance contradicts it."""
    if found is None:
        return dark
    channels = tuple(replace(m, dark_slope=found.withheld) for m in dark.channels)
    return replace(dark, channels=channels, pooled=replace(dark.pooled, dark_slope=found.withheld))


def dark_exposure(lines: DarkLines) -> str:
    """Return the exposure time of black level and dark variance in words."""
    return Measurements.dark_exposure if lines.mean.fit else f"{format_exposure(lines.mean.exposure_s[0])} s"
