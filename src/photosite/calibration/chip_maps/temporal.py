"""Temporal noise of the dark: pixels, rows, columns, its tail, and bands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.chip_maps.banding import Band, find_bands
from photosite.calibration.chip_maps.second_look import SecondLook
from photosite.calibration.chip_maps.tail import Tail, measure_tail
from photosite.calibration.reduction.groups import GroupStatistics, pooled_level
from photosite.calibration.spatial.line_noise import TemporalParts, temporal_parts
from photosite.calibration.spatial.spread import spread, spread_interval_95, upper_limit_95
from photosite.engine.frame_sums import MeanFrame
from photosite.sensor.noise_profile import QUANTISATION_DN2
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain, weighted_mean


@dataclass(frozen=True)
class Trace:
    """The readings of a blinking pixel, frame by frame.

    Parameters
    ----------
    row, col
        Its place.
    dn
        (frames,) readings, shifts of whole frames taken off.
    lower_dn, upper_dn
        Its levels.
    """

    row: int
    col: int
    dn: NDArray[np.float32]
    lower_dn: float
    upper_dn: float


@dataclass(frozen=True)
class TemporalNoise:
    """How the readings of a chip in the dark scatter from frame to frame.

    Parameters
    ----------
    frames, exposure_s
        The stack it was seen in.
    pixel_noise_dn, row_noise_dn, column_noise_dn
        Standard deviation of what a pixel has by itself (rounding off, shot noise of the dark current in it), and of
        what a whole row or column shares. Where the variance came out negative, minus the root of its size.
    frame_noise_dn
        Standard deviation of shifts common to a whole frame.
    tail
        How far the noise is from normal.
    bands
        "fixed rows", "fixed columns": periods in the mean frame; "temporal rows", "temporal columns": periods that come
        with any phase in each frame. Rows are horizontal bands.
    residual_dn, residual_count
        (bins,) the histogram of all readings about their pixels' means, shifts of frames, rows and columns taken off:
        middle of the bin, and how many.
    traces
        Readings of some blinking pixels, those whose levels are farthest apart for their noise.
    """

    frames: int
    exposure_s: float
    pixel_noise_dn: Estimate
    row_noise_dn: Estimate
    column_noise_dn: Estimate
    frame_noise_dn: Estimate
    tail: Tail
    bands: Mapping[str, tuple[Band, ...]]
    residual_dn: NDArray[np.float64]
    residual_count: NDArray[np.int64]
    traces: tuple[Trace, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The numbers, without histogram and traces."""
        return {
            "frames": self.frames,
            "exposure_s": self.exposure_s,
            **{
                name: getattr(self, name).to_dict()
                for name in ("pixel_noise_dn", "row_noise_dn", "column_noise_dn", "frame_noise_dn")
            },
            **{entry.name: getattr(self.tail, entry.name).to_dict() for entry in fields(Tail)},
            "bands": {
                name: [{entry.name: getattr(band, entry.name) for entry in fields(Band)} for band in bands]
                for name, bands in self.bands.items()
            },
        }


def measure_temporal(
    stack: GroupStatistics,
    look: SecondLook,
    variance: NDArray[np.float32],
    mean: MeanFrame,
    tile: NDArray[np.int64],
) -> TemporalNoise:
    """The temporal noise of a stack of darks.

    Parameters
    ----------
    stack
        Its statistics.
    look
        What reading it again told.
    variance
        (rows, cols) each pixel's temporal variance.
    mean
        The mean frame.
    tile
        The repeating tile of channel indices.
    """
    parts = _pooled(stack, [temporal_parts(level, look.lines, tile, k) for k, level in enumerate(stack.levels)])
    method = f"{stack.frames} {stack.label}, two-way analysis of variance"
    rounding = pooled_level(stack.levels).rounding_variance
    histogram = look.histogram.sum(axis=0)
    bins = len(histogram)
    return TemporalNoise(
        frames=stack.frames,
        exposure_s=stack.group.exposure_s,
        pixel_noise_dn=_deviation(parts.pixel - QUANTISATION_DN2 + Uncertain.of(0.0, rounding), method),
        row_noise_dn=_deviation(parts.row, method),
        column_noise_dn=_deviation(parts.column, method),
        frame_noise_dn=_frame_noise(look, mean.sum.size, parts, method),
        tail=measure_tail(variance, look.fourth, stack.frames, look.histogram, look.bin_dn),
        bands=_bands(look, mean, tile),
        residual_dn=np.asarray((np.arange(bins) + 0.5 - bins / 2) * look.bin_dn, np.float64),
        residual_count=histogram,
    )


def _pooled(stack: GroupStatistics, parts: Sequence[TemporalParts]) -> TemporalParts:
    weights = [float(level.pixels) for level in stack.levels]
    return TemporalParts(
        *(weighted_mean([getattr(entry, name) for entry in parts], weights) for name in ("pixel", "row", "column"))
    )


def _deviation(variance: Uncertain, method: str) -> Estimate:
    return Estimate.of(spread(variance), method, upper_limit_95(variance), spread_interval_95(variance))


def _frame_noise(look: SecondLook, pixels: int, parts: TemporalParts, method: str) -> Estimate:
    """The spread of the frames' means less what their pixels, rows and columns explain of it."""
    row_sums, column_sums = look.lines
    means = row_sums.sum(axis=(1, 2), dtype=np.float64) / pixels
    variance = float(means.var(ddof=1))
    rows, cols = row_sums.shape[1], column_sums.shape[2]
    explained = parts.pixel * (1.0 / pixels) + parts.row * (1.0 / rows) + parts.column * (1.0 / cols)
    of_means = Uncertain.of_variance(variance, variance * math.sqrt(2.0 / (len(means) - 1)))
    return _deviation(of_means - explained, method)


def _bands(look: SecondLook, mean: MeanFrame, tile: NDArray[np.int64]) -> dict[str, tuple[Band, ...]]:
    """Periods of the mean frame's lines, and of single frames' lines about those."""
    rows, cols = mean.sum.shape
    height, width = tile.shape
    row_means = look.lines[0].sum(axis=2, dtype=np.float64) / cols
    column_means = look.lines[1].sum(axis=1, dtype=np.float64) / rows
    found = {}
    for name, means, period in (("rows", row_means, height), ("columns", column_means, width)):
        fixed = means.mean(axis=0)
        # The channels' own levels repeat with the tile.
        channels = np.array([fixed[phase::period].mean() for phase in range(period)])
        found[f"fixed {name}"] = find_bands((fixed - channels[np.arange(len(fixed)) % period])[None])
        found[f"temporal {name}"] = find_bands(means - fixed) if len(means) > 1 else ()
    return found
