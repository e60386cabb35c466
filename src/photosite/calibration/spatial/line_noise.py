"""Temporal noise that a whole row or column shares: how much there is, and what of it is left in a mean frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics, Level
from photosite.engine.frame_statistics import line_sums
from photosite.values.uncertain import Uncertain, weighted_mean

LINE_FRAMES = 8
"""Frames of a group whose rows and columns are looked at: with some thousand rows in each, the line noise is known to a
percent, and what is left of it in the mean frame better than the fixed pattern beside it."""

LineSums = tuple[NDArray[np.uint32], NDArray[np.uint32]]
"""(frames, rows, tile cols) and (frames, tile rows, cols), as `line_sums` gives them."""


@dataclass(frozen=True)
class TemporalParts:
    """Temporal variance in DN^2: of a pixel by itself, of what its row shares, of what its column shares."""

    pixel: Uncertain
    row: Uncertain
    column: Uncertain

    @property
    def total(self) -> Uncertain:
        """All three together: the temporal variance of a pixel."""
        return self.pixel + self.row + self.column

    def scaled(self, factor: float) -> TemporalParts:
        """All three times a factor: 1 / n for the mean of n frames."""
        return TemporalParts(self.pixel * factor, self.row * factor, self.column * factor)


def mean_frame_parts(reader: FrameReader, statistics: GroupStatistics, scatter: float = 0.0) -> list[TemporalParts]:
    """Per channel, the temporal variance left in the mean of a group's frames, by parts.

    A few of the frames, spread over the group, are read again for the sums of their rows and columns.

    Parameters
    ----------
    reader
        Which read the group.
    statistics
        The group; of two frames or more.
    scatter
        By how much, relatively, the noise differs from one combination of frames to the next beyond sampling
        (`DarkLine.scatter`): the mean frame is such a combination.

    Raises
    ------
    FileError
        If a frame cannot be read again.
    """
    there = {id(source) for source in statistics.group.frames}
    # Sorted by what is in them, so that the order in which frames were listed changes nothing.
    used = sorted((entry for entry in reader.used_frames if id(entry.source) in there), key=lambda entry: entry.total)
    chosen = np.linspace(0, len(used) - 1, min(LINE_FRAMES, len(used))).round().astype(int)
    tile = reader.tile
    lines = line_sums((used[i].source.read() for i in chosen), (tile.shape[0], tile.shape[1]))
    result = []
    for k, level in enumerate(statistics.levels):
        parts = temporal_parts(level, lines, tile, k).scaled(1.0 / level.frames)
        result.append(replace(parts, pixel=parts.pixel + Uncertain.of(0.0, scatter * abs(parts.total.value))))
    return result


def independent(level: Level) -> TemporalParts:
    """All of a level's temporal variance as that of independent pixels: what EMVA 1288 assumes."""
    return TemporalParts(Uncertain.of(level.variance, level.variance_uncertainty), Uncertain(0.0), Uncertain(0.0))


def temporal_parts(level: Level, lines: LineSums, tile: NDArray[np.int64], channel: int) -> TemporalParts:
    """Split a channel's temporal variance into pixel, row and column parts.

    The means of a plane's rows have, shifts of whole frames and the fixed pattern taken off (the residual of the
    two-way analysis of variance, frames by rows), the variance s_row + s_pixel / cols; column means have
    s_column + s_pixel / rows; a pixel's own residual has all three parts but for what the frame's mean takes along.
    Three equations for three parts, each without bias; a part may come out negative. EMVA 1288 R4.0 splits spatial
    variances in this way; it takes temporal noise as independent from pixel to pixel.

    Parameters
    ----------
    level
        The channel's level; of two frames or more.
    lines
        The row and column sums of some of the level's frames, two or more.
    tile
        The repeating tile of channel indices.
    channel
        Which.

    Examples
    --------
    >>> from photosite.engine.frame_sums import FrameSums
    >>> from photosite.engine.frame_statistics import line_sums
    >>> rng = np.random.default_rng(1)
    >>> noise = rng.normal(100, 4, (40, 64, 64)) + rng.normal(0, 2, (40, 64, 1))
    >>> stack = noise.round().astype(np.uint16)
    >>> level = Level.of(FrameSums((64, 64)).add(stack).label_totals()[0])
    >>> parts = temporal_parts(level, line_sums(stack), np.zeros((1, 1), np.int64), 0)
    >>> [round(part.value, 1) for part in (parts.pixel, parts.row, parts.column)]
    [16.0, 4.1, 0.0]
    """
    row_sums, column_sums = lines
    tile_rows, tile_cols = tile.shape
    found = []
    for r, c in np.argwhere(tile == channel):
        rows, columns = row_sums[:, r::tile_rows, c], column_sums[:, r, c::tile_cols]
        found.append(_plane_parts(level, rows / columns.shape[1], columns / rows.shape[1]))
    even = [1.0] * len(found)
    return TemporalParts(
        weighted_mean([parts.pixel for parts in found], even),
        weighted_mean([parts.row for parts in found], even),
        weighted_mean([parts.column for parts in found], even),
    )


def _plane_parts(level: Level, row_means: NDArray[np.float64], column_means: NDArray[np.float64]) -> TemporalParts:
    rows, cols = row_means.shape[1], column_means.shape[1]
    if min(rows, cols) < 2:
        return independent(level)
    of_pixels = Uncertain.of(level.variance, level.variance_uncertainty)
    of_rows, of_columns = _residual_variance(row_means), _residual_variance(column_means)
    # Unknowns: pixel, row, column. What a line shares counts in a pixel's residual but for the frame's mean.
    pixels = rows * cols
    equations = np.array(
        [
            [1.0, (rows - 1) * cols / (pixels - 1), (cols - 1) * rows / (pixels - 1)],
            [1.0 / cols, 1.0, 0.0],
            [1.0 / rows, 0.0, 1.0],
        ]
    )
    solve = np.linalg.inv(equations)
    known = (of_pixels, of_rows, of_columns)
    pixel, row, column = (
        sum((value * float(weight) for value, weight in zip(known, weights, strict=True)), Uncertain(0.0))
        for weights in solve
    )
    return TemporalParts(pixel, row, column)


def _residual_variance(means: NDArray[np.float64]) -> Uncertain:
    """Variance of (frames, lines) means, each line's and each frame's mean taken off; chi-square sampling."""
    frames, lines = means.shape
    residual = means - means.mean(axis=0) - means.mean(axis=1, keepdims=True) + means.mean()
    freedom = (frames - 1) * (lines - 1)
    variance = float(np.sum(residual**2)) / freedom
    return Uncertain.of(variance, variance * math.sqrt(2.0 / freedom))
