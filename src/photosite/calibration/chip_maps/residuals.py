"""Residuals of a stack of frames about its mean, from a second reading of the frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.chip_maps.noise_shape import BLOCKS
from photosite.calibration.spatial.line_noise import LineSums
from photosite.engine.frame_statistics import add_residuals, line_sums
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.jit import threads_for

BINS = 1024
"""Bins of the histogram of residuals, 8 per standard deviation: 64 standard deviations to each side."""

_BINS_PER_SIGMA = 8


@dataclass(frozen=True)
class StackResiduals:
    """Residuals of a stack about the means of its pixels.

    Parameters
    ----------
    lines
        Row and column sums of the frames, by site of the tile.
    fourth
        (rows, cols) float32 sum of the fourth powers of the residuals, DN^4.
    histogram, bin_dn
        (blocks, bins) residuals by block of rows, and the width of a bin. Shifts of frames, rows and columns are
        removed, and the residuals are scaled by sqrt(n / (n - 1)) to the standard deviation of the noise.
    series
        (pixels, frames) float32 values of selected pixels, without shifts of whole frames.
    """

    lines: LineSums
    fourth: NDArray[np.float32]
    histogram: NDArray[np.int64]
    bin_dn: float
    series: NDArray[np.float32]


def read_residuals(
    frames: Iterable[NDArray[np.unsignedinteger]],
    mean: MeanFrame,
    sigma_dn: float,
    place: tuple[NDArray[np.int64], NDArray[np.int64]],
) -> StackResiduals:
    """Read the frames of a mean again.

    Parameters
    ----------
    frames, mean
        The frames, and their mean.
    sigma_dn
        Typical temporal standard deviation, which sets the bin width of the histogram.
    place
        Rows and columns of the pixels whose series are kept.
    """
    rows, cols = mean.sum.shape
    tile, n = (mean.labels.shape[0], mean.labels.shape[1]), mean.count
    row_level = mean.sum.sum(axis=1, dtype=np.float64) / (cols * n)
    column_level = mean.sum.sum(axis=0, dtype=np.float64) / (rows * n)
    level = float(row_level.mean())
    bin_dn = sigma_dn / _BINS_PER_SIGMA
    # Each residual lacks 1 / n of the noise variance, because the mean contains the frame.
    bins_per_dn = float(np.sqrt(n / max(n - 1, 1))) / bin_dn
    fourth = np.zeros((rows, cols), np.float32)
    histogram = np.zeros((BLOCKS, BINS), np.int64)
    by_row, by_column, series = [], [], []
    for dn in frames:
        frame = np.ascontiguousarray(dn)
        row_sums, column_sums = (sums[0] for sums in line_sums([frame], tile))
        shift = float(row_sums.sum(dtype=np.float64)) / (rows * cols) - level
        row_shift = row_sums.sum(axis=1, dtype=np.float64) / cols - row_level
        column_shift = column_sums.sum(axis=0, dtype=np.float64) / rows - column_level - shift
        with threads_for(frame.size):
            add_residuals(frame, mean.sum, n, row_shift, column_shift, bins_per_dn, fourth, histogram)
        by_row.append(row_sums)
        by_column.append(column_sums)
        series.append(frame[place].astype(np.float32) - np.float32(shift))
    if len(series) != n:
        raise ValueError(f"expected the {n} frames of the mean, got {len(series)}")
    return StackResiduals((np.stack(by_row), np.stack(by_column)), fourth, histogram, bin_dn, np.stack(series, axis=1))
