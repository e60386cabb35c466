"""Non-uniformity after EMVA 1288: row, column and pixel parts, and the standard's high-pass filter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.nonuniformity import excess_variance
from photosite.calibration.uncertain import Missing, Uncertain, weighted_mean
from photosite.engine.moments import label_moments

MARGIN = 9
"""Pixels at each border that the filter's 19 x 19 kernel does not reach; they are left out."""

SMALLEST_SIDE = 2 * MARGIN + 16
"""Rows and columns that a colour plane needs for the filter and for row and column means after it."""


@dataclass(frozen=True)
class Parts:
    """Spatial variance, DN^2, temporal noise taken off: total = row + column + pixel."""

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
    kernel = _kernel()
    rows, cols = plane.shape
    n_rows, n_cols = rows - 2 * MARGIN, cols - 2 * MARGIN
    along = np.zeros((rows, n_cols))
    for k, weight in enumerate(kernel):
        along += weight * plane[:, k : k + n_cols]
    result = np.zeros((n_rows, n_cols))
    for k, weight in enumerate(kernel):
        result += weight * along[k : k + n_rows]
    return result


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


def _line_mean_share(lines: int) -> float:
    """Variance of the mean over `lines` of a filtered line of independent pixels of variance 1."""
    kernel = _kernel()
    straight = np.zeros(lines + 2 * MARGIN)
    straight[MARGIN:-MARGIN] = 1.0 / lines
    smoothed = np.convolve(np.full(lines, 1.0 / lines), kernel)
    return float(
        straight @ straight - 2.0 * kernel[MARGIN] * (straight @ smoothed) + (kernel @ kernel) * (smoothed @ smoothed)
    )


def split_parts(plane: NDArray[np.float64], noise: Uncertain, *, filtered: bool) -> Parts:
    """Row, column and pixel parts of a mean frame's spatial variance.

    With rows, columns and pixels independent, the variance of the plane, of its column means and of its row means
    are three equations for the three parts; those of EMVA 1288 R4.0 (8.2) for the plain plane. For the filtered
    one each part enters with the share of it that the filter leaves, so that the parts come out unattenuated.

    Parameters
    ----------
    plane
        (rows, cols) mean frame of one colour plane, DN.
    noise
        Temporal variance in it, DN^2.
    filtered
        Whether to take the high-pass first.
    """
    values = high_pass(plane) if filtered else plane
    rows, cols = values.shape
    # The filter fixes the mean at zero, so that no degree of freedom goes into it.
    ddof = 0 if filtered else 1
    line, pixel = (line_gain(), pixel_gain()) if filtered else (1.0, 1.0)
    in_columns = _line_mean_share(rows) if filtered else 1.0 / rows
    in_rows = _line_mean_share(cols) if filtered else 1.0 / cols

    moments = label_moments(values)[0]
    total = excess_variance(moments, Uncertain(0.0))
    columns = float(values.mean(axis=0).var(ddof=ddof))
    lines = float(values.mean(axis=1).var(ddof=ddof))
    column_means = Uncertain.of(columns, columns * math.sqrt(2.0 / (cols - 1)))
    row_means = Uncertain.of(lines, lines * math.sqrt(2.0 / (rows - 1)))

    of_pixels = (total - column_means - row_means) * (1.0 / (pixel - in_columns - in_rows))
    of_columns = (column_means - of_pixels * in_columns) * (1.0 / line)
    of_rows = (row_means - of_pixels * in_rows) * (1.0 / line)
    alone = of_pixels - noise
    return Parts(total=alone + of_columns + of_rows, row=of_rows, column=of_columns, pixel=alone)


def channel_parts(
    mean: NDArray[np.float64], tile: NDArray[np.int64], channel: int, noise: Uncertain, *, filtered: bool
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
