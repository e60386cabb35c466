"""Temporal noise that whole rows or columns share: its size, and what remains of it in a mean frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics, Level
from photosite.engine.map_statistics import line_sums
from photosite.values.uncertain import Source, Uncertain, combined, weighted_mean

LINE_FRAMES = 8
"""Frames of a group that are read for row and column noise.

With about a thousand rows in each frame, the row noise is then known to one percent.
"""

LineSums = tuple[NDArray[np.uint32], NDArray[np.uint32]]
"""(frames, rows, tile cols) and (frames, tile rows, cols), as returned by `line_sums`."""


@dataclass(frozen=True)
class TemporalComponents:
    """Temporal variance in DN^2: of single pixels, shared by a row, and shared by a column."""

    pixel: Uncertain
    row: Uncertain
    column: Uncertain

    @property
    def total(self) -> Uncertain:
        """Temporal variance of a pixel: the sum of the three parts."""
        return self.pixel + self.row + self.column

    def with_bands(self) -> TemporalComponents:
        """Return the parts with bands as the noise of rows: their mean over frames scatters by its own size."""
        return TemporalComponents(self.pixel, Uncertain.of(self.row.value, abs(self.row.value)), self.column)

    def scaled(self, factor: float) -> TemporalComponents:
        """Return all parts multiplied by a factor, such as 1 / n for the mean of n frames."""
        return TemporalComponents(self.pixel * factor, self.row * factor, self.column * factor)


def mean_frame_components(
    reader: FrameReader, statistics: GroupStatistics, scatter: float = 0.0
) -> list[TemporalComponents]:
    """Estimate, per channel, the temporal variance that remains in the mean of a group's frames.

    A few frames of the group, which has at least two, are read again for their row and column sums. `scatter` is that
    of the noise between combinations of frames beyond sampling (`DarkLine.scatter`); the mean frame is one of them.

    Raises
    ------
    FileError
        If a frame cannot be read.
    """
    result = []
    for parts in level_components(reader, statistics):
        parts = parts.scaled(1.0 / statistics.frames)
        result.append(replace(parts, pixel=parts.pixel + Uncertain.of(0.0, scatter * abs(parts.total.value))))
    return result


def level_components(
    reader: FrameReader, statistics: GroupStatistics, most: int = LINE_FRAMES
) -> list[TemporalComponents]:
    """Split, per channel, the temporal variance of a group's frames, from some frames spread evenly over the group."""
    return temporal_components(statistics.levels, group_lines(reader, statistics, most), reader.tile)


def group_lines(reader: FrameReader, statistics: GroupStatistics, most: int) -> LineSums:
    """Return the row and column sums of a group's frames, at most so many, spread evenly over the group."""
    members = {id(source) for source in statistics.group.frames}
    # Sort by content, so that the result does not depend on the order of the frames.
    used = sorted((entry for entry in reader.used_frames if id(entry.source) in members), key=lambda entry: entry.total)
    chosen = np.linspace(0, len(used) - 1, min(most, len(used))).round().astype(int)
    tile = (reader.tile.shape[0], reader.tile.shape[1])
    found = reader.each_in_strips((used[i].source for i in chosen), lambda dn: line_sums([dn], tile))
    rows = [np.concatenate([of_rows for of_rows, _ in strips], axis=1) for strips in found]
    columns = [np.sum([of_columns for _, of_columns in strips], axis=0, dtype=np.uint32) for strips in found]
    return np.concatenate(rows), np.concatenate(columns)


def temporal_components(levels: Sequence[Level], lines: LineSums, tile: NDArray[np.int64]) -> list[TemporalComponents]:
    """Split the temporal variance of each channel into pixel, row and column parts.

    The equations are those of the two-way analysis of variance, frames by lines. Shifts of whole frames and the fixed
    pattern are removed first. The means of rows then have the variance s_row + s_pixel / cols, and the means of columns
    s_column + s_pixel / rows. A pixel's residual contains all three parts, less what the frame mean removes. Each part
    is unbiased and may be negative. EMVA 1288 R4.0 splits spatial variances this way, but assumes that temporal noise
    is independent between pixels.

    Planes of a mosaic in the same rows have the row noise in common, not that of their pixels: the covariance of two
    mean squares with n degrees of freedom is 2 s_row^2 / n. The parts of the channels share sources for this.

    `levels` are those of the channels, and `lines` the row and column sums of at least two of their frames.

    Examples
    --------
    >>> from photosite.engine.frame_sums import FrameSums
    >>> from photosite.engine.map_statistics import line_sums
    >>> rng = np.random.default_rng(1)
    >>> noise = rng.normal(100, 4, (40, 64, 64)) + rng.normal(0, 2, (40, 64, 1))
    >>> stack = noise.round().astype(np.uint16)
    >>> level = Level.of(FrameSums((64, 64)).add(stack).label_totals()[0])
    >>> (parts,) = temporal_components([level], line_sums(stack), np.zeros((1, 1), np.int64))
    >>> [round(part.value, 1) for part in (parts.pixel, parts.row, parts.column)]
    [16.0, 4.1, 0.0]
    """
    row_sums, column_sums = lines
    tile_rows, tile_cols = tile.shape
    row_sources, column_sources = ([Source() for _ in range(length)] for length in tile.shape)
    result = []
    for channel, level in enumerate(levels):
        pixel_variance, found = Uncertain.of(level.variance, level.variance_uncertainty), []
        for r, c in np.argwhere(tile == channel):
            rows, columns = row_sums[:, r::tile_rows, c], column_sums[:, r, c::tile_cols]
            means = rows / columns.shape[1], columns / rows.shape[1]
            found.append(_plane_components(pixel_variance, *means, (row_sources[r], column_sources[c])))
        result.append(pool_temporal(found, [1.0] * len(found)))
    return result


def pool_temporal(parts: Sequence[TemporalComponents], weights: Sequence[float]) -> TemporalComponents:
    """Return the weighted mean of each part."""
    names = ("pixel", "row", "column")
    return TemporalComponents(*(weighted_mean([getattr(entry, name) for entry in parts], weights) for name in names))


def _plane_components(
    pixel_variance: Uncertain,
    row_means: NDArray[np.float64],
    column_means: NDArray[np.float64],
    shared: tuple[Source, Source],
) -> TemporalComponents:
    """Split the variance of a plane; `shared` are the sources of its rows and columns. One line counts as pixels."""
    rows, cols = row_means.shape[1], column_means.shape[1]
    if min(rows, cols) < 2:
        return TemporalComponents(pixel_variance, Uncertain(0.0), Uncertain(0.0))
    # Unknowns: pixel, row, column. The frame mean removes a fraction of the row and column noise from the residuals.
    pixels = rows * cols
    equations = np.array(
        [
            [1.0, (rows - 1) * cols / (pixels - 1), (cols - 1) * rows / (pixels - 1)],
            [1.0 / cols, 1.0, 0.0],
            [1.0 / rows, 0.0, 1.0],
        ]
    )
    solution = np.linalg.inv(equations)
    measured = [_residual_variance(means) for means in (row_means, column_means)]
    _, *line_variances = solution @ [pixel_variance.value, *(variance for variance, _ in measured)]
    inputs = [pixel_variance]
    for (variance, freedom), line, source in zip(measured, line_variances, shared, strict=True):
        common, relative = min(max(float(line), 0.0), variance), math.sqrt(2.0 / freedom)
        own = relative * math.sqrt(variance**2 - common**2)
        inputs.append(Uncertain(variance, {source: relative * common, Source(): own}))
    return TemporalComponents(*(combined(inputs, row) for row in solution))


def _residual_variance(means: NDArray[np.float64]) -> tuple[float, int]:
    """Return the variance of (frames, lines) means without each line's and each frame's mean; its freedom."""
    frames, lines = means.shape
    residual = means - means.mean(axis=0) - means.mean(axis=1, keepdims=True) + means.mean()
    freedom = (frames - 1) * (lines - 1)
    return float(np.sum(residual**2)) / freedom, freedom
