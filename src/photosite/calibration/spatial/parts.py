"""Row, column and pixel parts of the nonuniformity (EMVA 1288 R4.0)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.quantisation import with_rounding
from photosite.calibration.spatial.line_noise import TemporalParts
from photosite.calibration.spatial.planes import (
    MARGIN,
    SMALLEST_SIDE,
    high_pass,
    high_pass_kernel,
    line_gain,
    pixel_gain,
)
from photosite.engine.map_statistics import line_means, residual_moments
from photosite.values.uncertain import Missing, Source, Uncertain, weighted_mean


@dataclass(frozen=True)
class Parts:
    """Spatial variance less temporal noise, in DN^2 or relative to a squared signal: total = row + column + pixel."""

    total: Uncertain
    row: Uncertain
    column: Uncertain
    pixel: Uncertain

    def __sub__(self, other: Parts) -> Parts:
        return Parts(*(one - two for one, two in zip(self.values, other.values, strict=True)))

    def scaled(self, factor: Uncertain | float) -> Parts:
        """Return all parts multiplied by a factor."""
        return Parts(*(part * factor for part in self.values))

    def with_rounding(self, of_pixels: float) -> Parts:
        """Return all parts with the uncertainty from rounding (`quantisation.with_rounding`)."""
        return Parts(*(with_rounding(part, of_pixels) for part in self.values))

    @property
    def values(self) -> tuple[Uncertain, ...]:
        """Total, row, column, and pixel part."""
        return self.total, self.row, self.column, self.pixel


def pool_parts(parts: list[Parts], weights: list[float]) -> Parts:
    """Return the weighted mean of each part."""
    return Parts(*(weighted_mean(one, weights) for one in zip(*(entry.values for entry in parts), strict=True)))


@dataclass(frozen=True)
class _Shares:
    """Variance that independent pixels and lines of variance 1 produce in a plane and in its means."""

    pixel: float  # of a pixel of the plane, due to pixels
    line: float  # of a pixel of the plane, due to columns (or rows)
    column_mean: float  # due to pixels, as the next two
    row_mean: float
    mean: float
    columns_mean: float  # of the plane's mean, due to columns
    rows_mean: float

    @classmethod
    def plain(cls, rows: int, cols: int) -> _Shares:
        """Return the shares of an unfiltered plane: the two-way analysis of variance."""
        return cls(1.0, 1.0, 1 / rows, 1 / cols, 1 / (rows * cols), 1 / cols, 1 / rows)

    @classmethod
    def filtered(cls, rows: int, cols: int) -> _Shares:
        """Return the shares of a high-pass filtered plane, without its border."""
        centre, power = high_pass_kernel()[MARGIN], float(high_pass_kernel() @ high_pass_kernel())
        # Inner products for the mean over n values: plain x plain, plain x smoothed, smoothed x smoothed.
        (r1, r2, r3), (c1, c2, c3) = _mean_products(rows), _mean_products(cols)
        return cls(
            pixel=pixel_gain(),
            line=line_gain(),
            column_mean=r1 - 2.0 * centre * r2 + power * r3,
            row_mean=c1 - 2.0 * centre * c2 + power * c3,
            mean=r1 * c1 - 2.0 * r2 * c2 + r3 * c3,
            columns_mean=c1 - 2.0 * c2 + c3,
            rows_mean=r1 - 2.0 * r2 + r3,
        )


def _mean_products(n: int) -> tuple[float, float, float]:
    straight = np.pad(np.full(n, 1.0 / n), MARGIN)
    smoothed = np.convolve(np.full(n, 1.0 / n), high_pass_kernel())
    return float(straight @ straight), float(straight @ smoothed), float(smoothed @ smoothed)


def split_parts(plane: NDArray[np.float64], noise: TemporalParts, *, filtered: bool) -> Parts:
    """Split the spatial variance of a color plane of a mean frame, (rows, cols), into row, column and pixel parts.

    EMVA 1288 R4.0 solves three equations: the variance of the plane, of its column means and of its row means. This
    function uses the equations of the two-way analysis of variance. They agree up to 1 / rows and 1 / cols, are
    unbiased, and have independent left sides. If the plane is to be high-pass filtered first, the equations contain
    the gains of the filter, so that the parts are not attenuated. The temporal noise in the mean frame, DN^2, is
    subtracted part by part.
    """
    values = np.ascontiguousarray(high_pass(plane) if filtered else plane)
    rows, cols = values.shape
    share = (_Shares.filtered if filtered else _Shares.plain)(rows, cols)

    mean, line_mean, column_mean = line_means(values)
    columns, lines = column_mean - mean, line_mean - mean
    square, fourth = residual_moments(values, line_mean, columns)
    sampling = max(fourth - square**2, 0.0) / values.size  # rounding, on constant planes
    left = share.pixel - share.column_mean - share.row_mean + share.mean
    of_pixels = Uncertain.of_variance(square, math.sqrt(sampling)) * (1.0 / left)

    def line_variance(means: NDArray[np.float64], from_pixels: float, lost: float) -> Uncertain:
        found = float((means**2).mean())
        pixels = of_pixels * (from_pixels - share.mean)
        # The variance of few means scatters strongly. Without a pattern, the value expected from the pixels alone gives
        # the better uncertainty.
        expected = max(found, pixels.value)
        # The interval is the chi-square interval of the found value.
        source = Source.mean_square(means.size - 1).scaled(found / expected) if expected > 0.0 else None
        line = Uncertain.of(found, expected * math.sqrt(2.0 / (means.size - 1)), source)
        return (line - pixels) * (1.0 / (share.line - lost))

    column = line_variance(columns, share.column_mean, share.columns_mean) - noise.column
    row = line_variance(lines, share.row_mean, share.rows_mean) - noise.row
    alone = of_pixels - noise.pixel
    return Parts(total=alone + column + row, row=row, column=column, pixel=alone)


def channel_parts(
    mean: NDArray[np.float64], tile: NDArray[np.int64], channel: int, noise: TemporalParts, *, filtered: bool
) -> Parts | Missing:
    """Split the spatial variance of one channel: the mean over its sites in the tile, each a separate plane.

    Missing if the planes are too small for the filter.
    """
    tile_rows, tile_cols = tile.shape
    planes = [mean[r::tile_rows, c::tile_cols] for r, c in np.argwhere(tile == channel)]
    smallest = min(min(plane.shape) for plane in planes)
    needed = SMALLEST_SIDE if filtered else 2
    if smallest < needed:
        return Missing(f"a color plane has {smallest} pixels on its short side; the high-pass needs {needed}")
    parts = [split_parts(plane, noise, filtered=filtered) for plane in planes]
    return pool_parts(parts, [float(plane.size) for plane in planes])
