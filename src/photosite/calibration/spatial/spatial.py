"""Non-uniformity after EMVA 1288: row, column and pixel parts, and the standard's high-pass filter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spatial.line_noise import TemporalParts
from photosite.engine.map_statistics import line_means, residual_moments, smooth_separable
from photosite.values.uncertain import Missing, Source, Uncertain, weighted_mean

MARGIN = 9
"""Pixels at each border that the filter's 19 x 19 kernel does not reach; they are left out."""

SMALLEST_SIDE = 2 * MARGIN + 16
"""Rows and columns that a colour plane needs for the filter and for row and column means after it."""


@dataclass(frozen=True)
class Parts:
    """Spatial variance, DN^2 or relative to a squared signal, temporal noise off: total = row + column + pixel."""

    total: Uncertain
    row: Uncertain
    column: Uncertain
    pixel: Uncertain

    def __sub__(self, other: Parts) -> Parts:
        return Parts(
            self.total - other.total, self.row - other.row, self.column - other.column, self.pixel - other.pixel
        )

    def scaled(self, factor: Uncertain | float) -> Parts:
        """All parts times a factor."""
        return Parts(self.total * factor, self.row * factor, self.column * factor, self.pixel * factor)


def pool_parts(parts: list[Parts], weights: list[float]) -> Parts:
    """Weighted mean of each part."""
    return Parts(
        *(
            weighted_mean([getattr(entry, name) for entry in parts], weights)
            for name in ("total", "row", "column", "pixel")
        )
    )


@cache
def _kernel() -> NDArray[np.float64]:
    """(19,) one direction of the smoothing: a box of 7, a box of 11, the binomial 1 2 1."""
    kernel = np.convolve(np.full(7, 1 / 7), np.full(11, 1 / 11))
    return np.convolve(kernel, np.array([0.25, 0.5, 0.25]))


def smooth(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """The low-pass image, without the border that the kernel does not reach.

    Parameters
    ----------
    plane
        (rows, cols).

    Returns
    -------
    ndarray
        (rows - 18, cols - 18).
    """
    return smooth_separable(np.ascontiguousarray(plane), _kernel())


def high_pass(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """The plane less its low-pass image (EMVA 1288 R4.0: 7 x 7 box, 11 x 11 box, 3 x 3 binomial), border left out.

    It takes away what varies over many pixels: uneven illumination, vignetting.

    Examples
    --------
    >>> ramp = np.add.outer(np.arange(40.0), np.arange(50.0))
    >>> bool(abs(high_pass(ramp)).max() < 1e-12)
    True
    """
    return plane[MARGIN:-MARGIN, MARGIN:-MARGIN] - smooth(plane)


def line_gain() -> float:
    """Share of the variance of independent columns (or rows) that the filter leaves: 1 - 2 h(0) + sum h^2.

    Examples
    --------
    >>> round(line_gain(), 4)
    0.8891
    """
    kernel = _kernel()
    return float(1.0 - 2.0 * kernel[MARGIN] + kernel @ kernel)


def pixel_gain() -> float:
    """Share of the variance of independent pixels that the filter leaves: 1 - 2 h(0)^2 + (sum h^2)^2.

    Examples
    --------
    >>> round(pixel_gain(), 4)
    0.9885
    """
    kernel = _kernel()
    return float(1.0 - 2.0 * kernel[MARGIN] ** 2 + (kernel @ kernel) ** 2)


@dataclass(frozen=True)
class _Shares:
    """What is left of independent pixels and lines of variance 1 in a plane and in its means.

    Parameters
    ----------
    pixel, line
        Variance of a pixel of the plane from pixels, and from columns (or rows).
    column_mean, row_mean, mean
        Variance, from pixels, of a column's mean, of a row's mean, of the plane's mean.
    columns_mean, rows_mean
        Variance of the plane's mean from columns, and from rows.
    """

    pixel: float
    line: float
    column_mean: float
    row_mean: float
    mean: float
    columns_mean: float
    rows_mean: float

    @classmethod
    def plain(cls, rows: int, cols: int) -> _Shares:
        """Nothing filtered: the two-way analysis of variance."""
        return cls(1.0, 1.0, 1 / rows, 1 / cols, 1 / (rows * cols), 1 / cols, 1 / rows)

    @classmethod
    def filtered(cls, rows: int, cols: int) -> _Shares:
        """After the high-pass, exact on the pixels it leaves."""
        centre, power = _kernel()[MARGIN], float(_kernel() @ _kernel())
        # Inner products of the mean over n values with itself, with its smoothed self, and of that with itself.
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
    smoothed = np.convolve(np.full(n, 1.0 / n), _kernel())
    return float(straight @ straight), float(straight @ smoothed), float(smoothed @ smoothed)


def split_parts(plane: NDArray[np.float64], noise: TemporalParts, *, filtered: bool) -> Parts:
    """Row, column and pixel parts of a mean frame's spatial variance.

    EMVA 1288 R4.0 has three equations for the three parts: the variance of the plane, of its column means and
    of its row means. Here they are those of the two-way analysis of variance, which are the same up to 1 / rows and
    1 / cols, without bias, and with independent left sides. For the high-passed plane each part enters with
    the share of it that the filter leaves, so that the parts come out unattenuated.

    Parameters
    ----------
    plane
        (rows, cols) mean frame of one colour plane, DN.
    noise
        Temporal variance in it, DN^2: each part is taken off its own.
    filtered
        Whether to take the high-pass first.
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

    def of_lines(means: NDArray[np.float64], from_pixels: float, lost: float) -> Uncertain:
        found = float((means**2).mean())
        pixels = of_pixels * (from_pixels - share.mean)
        # The variance of few means scatters much: where there is no pattern, what the pixels alone lead to expect
        # says better how well it is known than the number that came out.
        expected = max(found, pixels.value)
        # The interval is chi-square's of the number itself.
        source = Source.mean_square(means.size - 1).scaled(found / expected) if expected > 0.0 else None
        line = Uncertain.of(found, expected * math.sqrt(2.0 / (means.size - 1)), source)
        return (line - pixels) * (1.0 / (share.line - lost))

    column = of_lines(columns, share.column_mean, share.columns_mean) - noise.column
    row = of_lines(lines, share.row_mean, share.rows_mean) - noise.row
    alone = of_pixels - noise.pixel
    return Parts(total=alone + column + row, row=row, column=column, pixel=alone)


def channel_parts(
    mean: NDArray[np.float64], tile: NDArray[np.int64], channel: int, noise: TemporalParts, *, filtered: bool
) -> Parts | Missing:
    """The parts of one channel: each of its sites in the tile is a plane of its own; their mean.

    Returns
    -------
    Parts or Missing
        Missing where the planes are too small for the filter.
    """
    tile_rows, tile_cols = tile.shape
    planes = [mean[r::tile_rows, c::tile_cols] for r, c in np.argwhere(tile == channel)]
    smallest = min(min(plane.shape) for plane in planes)
    needed = SMALLEST_SIDE if filtered else 2
    if smallest < needed:
        return Missing(f"a colour plane has {smallest} pixels on its short side; the high-pass needs {needed}")
    parts = [split_parts(plane, noise, filtered=filtered) for plane in planes]
    return pool_parts(parts, [float(plane.size) for plane in planes])
