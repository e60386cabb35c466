"""Nonuniformity of a mean frame: its row, column and pixel parts (EMVA 1288 R4.0), and shading."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.quantization import with_rounding
from photosite.calibration.spatial.line_noise import TemporalComponents
from photosite.calibration.spatial.pixel_slopes import SlopeSpread
from photosite.calibration.withheld import SMALL_FRAMES
from photosite.engine.lazy_maps import STRIP_VALUES, LazyMap, Map
from photosite.engine.site_planes import MARGIN, PlaneMoments, high_passed_planes, plane_moments, plane_shape
from photosite.values.uncertain import SIGMA_1_IN_1000, Missing, Source, Uncertain, Value, weighted_mean

Array = NDArray[np.float64]

SMALLEST_SIDE = 2 * MARGIN + 16
"""Smallest number of rows and columns of a color plane that can be high-pass filtered."""


@cache
def high_pass_kernel() -> Array:
    """Return the one-dimensional smoothing kernel (19,): a box of 7, a box of 11 and the binomial 1 2 1, convolved."""
    kernel = np.convolve(np.full(7, 1 / 7), np.full(11, 1 / 11))
    return np.convolve(kernel, np.array([0.25, 0.5, 0.25]))


def high_pass(plane: Array) -> Array:
    """Return the plane less the low-pass filtered plane, (rows - 18, cols - 18), without the border.

    The filter removes slow variation such as uneven illumination and vignetting. It is that of EMVA 1288 R4.0: 7 x 7
    box, 11 x 11 box, 3 x 3 binomial.

    Examples
    --------
    >>> ramp = np.add.outer(np.arange(40.0), np.arange(50.0))
    >>> bool(abs(high_pass(ramp)).max() < 1e-12)
    True
    """
    return high_passed_planes(plane, (1, 1))


def line_gain() -> float:
    """Return the factor by which the filter scales the variance of independent columns or rows: 1 - 2 h(0) + sum h^2.

    Examples
    --------
    >>> round(line_gain(), 4)
    0.8891
    """
    kernel = high_pass_kernel()
    return float(1.0 - 2.0 * kernel[MARGIN] + kernel @ kernel)


def pixel_gain() -> float:
    """Return the factor by which the filter scales the variance of independent pixels: 1 - 2 h(0)^2 + (sum h^2)^2.

    Examples
    --------
    >>> round(pixel_gain(), 4)
    0.9885
    """
    kernel = high_pass_kernel()
    return float(1.0 - 2.0 * kernel[MARGIN] ** 2 + (kernel @ kernel) ** 2)


@dataclass(frozen=True, eq=False)
class Difference(LazyMap):
    """The difference of two maps, computed only for the part that is sliced.

    Examples
    --------
    >>> Difference(np.full((2, 2), 5.0), np.eye(2))[0:1, :]
    array([[4., 5.]])
    """

    bright: Map
    dark: Map

    @property
    def shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """Number of rows and columns."""
        return self.bright.shape

    def __getitem__(self, part: Any, /) -> Array:
        return np.asarray(self.bright[part] - self.dark[part])


def strips(plane: Map, axis: int = 1) -> Iterator[tuple[slice, NDArray[np.floating]]]:
    """Yield a map in strips of whole lines, so that derived values do not need memory for a second map.

    Each is the slice of its lines and their values (lines, values): rows for axis 1, columns for axis 0.

    Examples
    --------
    >>> [(part.start, lines.tolist()) for part, lines in strips(np.array([[1.0, 2.0], [3.0, 4.0]]), axis=0)]
    [(0, [[1.0, 3.0], [2.0, 4.0]])]
    """
    across = plane.shape[1 - axis]
    step = max(1, STRIP_VALUES // plane.shape[axis])
    for first in range(0, across, step):
        part = slice(first, min(first + step, across))
        lines = plane[part, :] if axis == 1 else plane[:, part].T
        yield part, np.ascontiguousarray(lines)


def plane_mean(plane: Map) -> float:
    """Return the mean of a map."""
    rows, cols = plane.shape
    return sum(float(lines.sum(dtype=np.float64)) for _, lines in strips(plane)) / (rows * cols)


def high_passed(plane: Map, scale: float = 1.0) -> NDArray[np.float32]:
    """Return the high-pass filtered map, without the border, multiplied by `scale`.

    Single precision is enough: the filtered values are close to zero.
    """
    rows, cols = plane.shape
    out = np.empty((rows - 2 * MARGIN, cols - 2 * MARGIN), np.float32)
    step = max(1, STRIP_VALUES // cols)
    for first in range(0, out.shape[0], step):
        last = min(first + step, out.shape[0])
        lines = np.ascontiguousarray(plane[first : last + 2 * MARGIN, :], dtype=np.float64)
        np.multiply(high_pass(lines), scale, out=out[first:last], casting="same_kind")
    return out


def spread_sample(plane: Map, most: int = 1 << 18) -> NDArray[np.floating]:
    """Return values (n,) of evenly spaced rows, or all values if there are at most `most`."""
    rows, cols = plane.shape
    step = -(-rows * cols // most)
    return np.asarray(plane[slice(None, None, step), slice(None)]).ravel()


@dataclass(frozen=True)
class VarianceComponents:
    """Spatial variance less temporal noise, in DN^2 or relative to a squared signal: total = row + column + pixel.

    `standard` holds the parts by the equations of EMVA 1288 R4.0, which count the noise of rows and columns as that of
    pixels; None where they are the same.
    """

    total: Uncertain
    row: Uncertain
    column: Uncertain
    pixel: Uncertain
    standard: VarianceComponents | None = None

    @property
    def by_standard(self) -> VarianceComponents:
        """The parts by the equations of EMVA 1288 R4.0."""
        return self.standard or self

    def each(
        self, change: Callable[[Uncertain, Uncertain], Uncertain], other: VarianceComponents | None = None
    ) -> VarianceComponents:
        """Return all parts changed, each with the same part of other components."""
        other = other or self
        total, row, column, pixel = (change(one, two) for one, two in zip(self.values, other.values, strict=True))
        differs = self.standard is not None or other.standard is not None
        standard = self.by_standard.each(change, other.by_standard) if differs else None
        return VarianceComponents(total, row, column, pixel, standard)

    def __sub__(self, other: VarianceComponents) -> VarianceComponents:
        return self.each(lambda one, two: one - two, other)

    def scaled(self, factor: Uncertain | float) -> VarianceComponents:
        """Return all parts multiplied by a factor."""
        return self.each(lambda part, _: part * factor)

    def with_rounding(self, pixel_error: float, mean_error: float) -> VarianceComponents:
        """Return all parts with the uncertainty from rounding (`quantization.with_rounding`).

        The errors of a line's pixels average out as those of all pixels do. What is left by chance belongs to pixels.
        """
        standard = None if self.standard is None else self.standard.with_rounding(pixel_error, mean_error)
        total, pixel = (with_rounding(part, pixel_error) for part in (self.total, self.pixel))
        row, column = (with_rounding(part, mean_error) for part in (self.row, self.column))
        return VarianceComponents(total, row, column, pixel, standard)

    @property
    def values(self) -> tuple[Uncertain, ...]:
        """Total, row, column, and pixel part."""
        return self.total, self.row, self.column, self.pixel


def pool_components(parts: list[VarianceComponents], weights: list[float]) -> VarianceComponents:
    """Return the weighted mean of each part."""
    values = zip(*(entry.values for entry in parts), strict=True)
    total, row, column, pixel = (weighted_mean(one, weights) for one in values)
    differs = any(entry.standard is not None for entry in parts)
    standard = pool_components([entry.by_standard for entry in parts], weights) if differs else None
    return VarianceComponents(total, row, column, pixel, standard)


@dataclass(frozen=True)
class _Fractions:
    """Variance that independent pixels and lines of variance 1 produce in a plane and in its means."""

    pixel: float  # of a pixel of the plane, due to pixels
    line: float  # of a pixel of the plane, due to columns (or rows)
    column_mean: float  # due to pixels, as the next two
    row_mean: float
    mean: float
    columns_mean: float  # of the plane's mean, due to columns
    rows_mean: float

    @classmethod
    def plain(cls, rows: int, cols: int) -> _Fractions:
        """Return the fractions of an unfiltered plane: the two-way analysis of variance."""
        return cls(1.0, 1.0, 1 / rows, 1 / cols, 1 / (rows * cols), 1 / cols, 1 / rows)

    @classmethod
    def standard(cls, rows: int, cols: int) -> _Fractions:
        """Return the fractions in the equations of EMVA 1288 R4.0, which leave the variance of the mean out."""
        return cls(1.0, 1.0, 1 / rows, 1 / cols, 0.0, 0.0, 0.0)

    @classmethod
    def filtered(cls, rows: int, cols: int) -> _Fractions:
        """Return the fractions of a high-pass filtered plane, without its border."""
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


class MapPlanes:
    """The color planes of a map, one for each site of a tile, and their moments, which are computed once.

    Parameters
    ----------
    values
        (rows, cols) map.
    tile
        The repeating tile of channel indices.
    """

    def __init__(self, values: Map, tile: NDArray[np.int64]) -> None:
        self.values, self.tile = values, tile

    @cached_property
    def plain(self) -> dict[tuple[int, int], PlaneMoments]:
        """Moments of the planes, by site."""
        return plane_moments(self.values, self.tile.shape)

    @cached_property
    def filtered(self) -> dict[tuple[int, int], PlaneMoments]:
        """Moments of the high-pass filtered planes, by site."""
        return plane_moments(self.values, self.tile.shape, high_passed=True)

    def sites(self, channel: int) -> list[tuple[int, int]]:
        """Return the sites of a channel."""
        return [(int(r), int(c)) for r, c in np.argwhere(self.tile == channel)]


def _site_components(moments: PlaneMoments, noise: TemporalComponents, *, filtered: bool) -> VarianceComponents:
    """Split the spatial variance of the color plane of one site of the tile into row, column and pixel parts.

    EMVA 1288 R4.0 solves three equations: the variance of the plane, of its column means and of its row means. The best
    estimates use the equations of the two-way analysis of variance. They agree up to 1 / rows and 1 / cols, are
    unbiased, and have independent left sides. If the plane was high-pass filtered, the equations contain the gains of
    the filter, so that the parts are not attenuated. The temporal noise in the mean frame, DN^2, is subtracted part by
    part; the standard's equations subtract all of it from the pixels.
    """
    rows, cols = moments[0]
    if filtered:
        return _solved(moments, noise, _Fractions.filtered(rows, cols))
    none = noise.pixel * 0.0
    pixels_only = TemporalComponents(noise.total, none, none)
    return replace(
        _solved(moments, noise, _Fractions.plain(rows, cols)),
        standard=_solved(moments, pixels_only, _Fractions.standard(rows, cols)),
    )


def _solved(moments: PlaneMoments, noise: TemporalComponents, fraction: _Fractions) -> VarianceComponents:
    (rows, cols), lines, columns, square, fourth = moments
    sampling = max(fourth - square**2, 0.0) / (rows * cols)  # rounding, on constant planes
    left = fraction.pixel - fraction.column_mean - fraction.row_mean + fraction.mean
    pixel_variance = Uncertain.of_variance(square, math.sqrt(sampling)) * (1.0 / left)

    def line_variance(means: NDArray[np.float64], from_pixels: float, lost: float) -> Uncertain:
        found = float((means**2).mean())
        pixels = pixel_variance * (from_pixels - fraction.mean)
        # The variance of few means scatters strongly. Without a pattern, the value expected from the pixels alone gives
        # the better uncertainty.
        expected = max(found, pixels.value)
        # The interval is the chi-square interval of the found value.
        source = Source.mean_square(means.size - 1).scaled(found / expected) if expected > 0.0 else None
        line = Uncertain.of(found, expected * math.sqrt(2.0 / (means.size - 1)), source)
        return (line - pixels) * (1.0 / (fraction.line - lost))

    column = line_variance(columns, fraction.column_mean, fraction.columns_mean) - noise.column
    row = line_variance(lines, fraction.row_mean, fraction.rows_mean) - noise.row
    pixel = pixel_variance - noise.pixel
    return VarianceComponents(total=pixel + column + row, row=row, column=column, pixel=pixel)


def without_neighbors(
    parts: VarianceComponents, shape: tuple[int, ...], correlation: tuple[float, float], *, filtered: bool
) -> VarianceComponents:
    """Return the parts of a plane whose pixels are correlated with their neighbors, as by charge that they share.

    The mean of n such pixels of a row has the variance (1 + 2 c) / n, with the correlation c of next pixels: the part
    beyond that of independent pixels belongs to the pixels, not to rows or columns.

    Parameters
    ----------
    parts, shape, filtered
        The parts as for independent pixels; rows and columns of the plane; whether it was high-pass filtered.
    correlation
        With the next pixel of the row, and of the column.

    Examples
    --------
    >>> whole = VarianceComponents(*(Uncertain(value) for value in (1.0, 0.0004, 0.0, 0.9996)))
    >>> found = without_neighbors(whole, (100, 200), (0.04, 0.0), filtered=False)
    >>> [round(part.value, 6) for part in found.values]
    [1.0, -4e-06, 0.0, 1.000004]
    """
    rows, cols = (length - 2 * MARGIN * filtered for length in shape)
    fraction = (_Fractions.filtered if filtered else _Fractions.plain)(rows, cols)
    across, down = correlation
    row = parts.pixel * (2.0 * across * fraction.row_mean / (fraction.line - fraction.rows_mean))
    column = parts.pixel * (2.0 * down * fraction.column_mean / (fraction.line - fraction.columns_mean))
    without = parts.row - row, parts.column - column, parts.pixel + row + column
    return VarianceComponents(parts.total, *without, parts.standard)


def channel_components(
    planes: MapPlanes, channel: int, noise: TemporalComponents, *, filtered: bool
) -> VarianceComponents | Missing:
    """Split the spatial variance of one channel: the mean over its sites in the tile, each a separate plane.

    Missing if the planes are too small for the filter.
    """
    sites = planes.sites(channel)
    shapes = [plane_shape(planes.values.shape, site, planes.tile.shape) for site in sites]
    smallest = min(min(shape) for shape in shapes)
    needed = SMALLEST_SIDE if filtered else 2
    if smallest < needed:
        return SMALL_FRAMES.missing(
            f"a color plane has {smallest} pixels on its short side; the high-pass needs {needed}"
        )
    moments = planes.filtered if filtered else planes.plain
    parts = [_site_components(moments[site], noise, filtered=filtered) for site in sites]
    return pool_components(parts, [float(rows * cols) for rows, cols in shapes])


SHADING_FRACTION = 0.1
"""Shading, as a fraction of PRNU, above which a warning is given."""


def shading_variance(slopes: MapPlanes, channel: int, spread: SlopeSpread, noise: Uncertain, response: float) -> Value:
    """Return the relative variance of a channel's slopes that the high-pass filter of EMVA 1288 removes.

    The filtered parts of pixels, rows and columns are free of the filter's gain (`channel_components`), so independent
    pixels have no shading. The uncertainty is that of the filtered variance, which is larger than that of the
    difference, and that of the chance covariance of shading with pixels, rows and columns.

    Parameters
    ----------
    slopes, channel
        Map of slopes, and the index of the channel.
    spread, noise
        Statistics of the channel's slopes, and the temporal noise that was subtracted from their variance.
    response
        Mean slope, without dark current.
    """
    none = Uncertain(0.0)
    parts = channel_components(slopes, channel, TemporalComponents(noise, none, none), filtered=True)
    if isinstance(parts, Missing):
        return parts
    left = spread.variance.value - parts.total.value
    lengths = (length // period for length, period in zip(slopes.values.shape, slopes.tile.shape, strict=True))
    samples = spread.pixels, *lengths
    fine = parts.pixel.value + noise.value, parts.row.value, parts.column.value
    by_chance = sum(max(variance, 0.0) / count for variance, count in zip(fine, samples, strict=True))
    chance_part = 2.0 * math.sqrt(max(left, 0.0) * by_chance)
    uncertainty = math.hypot(parts.total.standard_uncertainty, chance_part)
    return Uncertain.of(left / response**2, uncertainty / response**2)


def is_large(shading: Value, prnu: Value) -> bool:
    """Return whether shading is beyond chance, and more than a tenth of PRNU; both are variances."""
    if isinstance(shading, Missing) or isinstance(prnu, Missing):
        return False
    return shading.value > max(SIGMA_1_IN_1000 * shading.standard_uncertainty, SHADING_FRACTION**2 * prnu.value)
