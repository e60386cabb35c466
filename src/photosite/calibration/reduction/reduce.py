"""Stage "reduce": a frame set becomes statistics per group and channel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics, Level, reference_dark
from photosite.calibration.reduction.provenance import UsedFrame
from photosite.calibration.spatial.pixel_slopes import PixelSlopes, slope_coefficients
from photosite.engine.frame_sums import FrameSums, MeanFrame
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.values.cfa import channel_names


@dataclass(frozen=True)
class DarkSlopeMap:
    """A map of per-pixel dark slopes.

    Parameters
    ----------
    slopes
        The map, DN/s.
    coefficients
        (dark groups,) weight of each group's mean frame in it, 1/s.
    """

    slopes: PixelSlopes
    coefficients: NDArray[np.float64]


@dataclass(frozen=True)
class Reduction:
    """A frame set reduced to statistics.

    Parameters
    ----------
    frames
        The frame set.
    darks, lights
        Statistics of the dark and the light groups, in the order of the set.
    reference
        Index of the dark group for read noise and DSNU: most frames, then shortest exposure.
    reference_mean
        Its mean frame.
    dark_slopes
        Map of per-pixel dark slopes; None with one dark exposure.
    top_shares
        Per light group and channel: the highest digital number, and the share of pixels that read it
        (`top_value_shares`).
    rejected
        Frames left out, each with the reason.
    used
        Frames used.
    """

    frames: FrameSet
    darks: tuple[GroupStatistics, ...]
    lights: tuple[GroupStatistics, ...]
    reference: int
    reference_mean: MeanFrame
    dark_slopes: DarkSlopeMap | None
    top_shares: tuple[tuple[tuple[float, float], ...], ...]
    rejected: tuple[str, ...]
    used: tuple[UsedFrame, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return tuple(channel_names(self.frames.cfa))


def reduce_frames(reader: FrameReader) -> Reduction:
    """Read every frame once and return the statistics of each group.

    Mean frames of light groups that may be needed again are kept within `KEPT_BYTES`. The map of dark slopes weights
    each group by its number of frames, because the weights must be known before the first frame is read. The dark
    variance grows little with exposure, so better weights would gain little precision.

    Raises
    ------
    CalibrationError
        If frames of one group differ so much that broken ones cannot be identified.
    FileError
        If a frame cannot be read, or has another size or range than the set.
    """
    planned = reader.frames.of_kind("dark")
    exposure = np.array([group.exposure_s for group in planned])
    slope_map = None
    if len(np.unique(exposure)) > 1:
        slopes = PixelSlopes((reader.frames.rows, reader.frames.cols), reader.tile)
        weights = np.array([float(len(group)) for group in planned])
        slope_map = DarkSlopeMap(slopes, slope_coefficients(exposure, weights))
    wanted = reference_dark(planned)
    darks: list[GroupStatistics] = []
    mean: MeanFrame | None = None
    for index, group in enumerate(planned):
        statistics, sums = read_group(reader, group)
        darks.append(statistics)
        if index == wanted:
            mean = sums.mean_frame()
        if slope_map is not None:
            coefficient = float(slope_map.coefficients[index])
            slope_map.slopes.add(sums.mean_frame(), [coefficient] * len(statistics.levels))
    reference = reference_dark(darks)
    if mean is None or reference != wanted:  # frames of the planned reference group were rejected
        reader.expect(len(planned[reference]))
        mean = reader.mean(planned[reference])

    lights = []
    for group in reader.frames.of_kind("light"):
        statistics, sums = read_group(reader, group)
        lights.append(statistics)
        if not all(level.clipped for level in statistics.levels):
            reader.keep(group, sums)
    return Reduction(
        frames=reader.frames,
        darks=tuple(darks),
        lights=tuple(lights),
        reference=reference,
        reference_mean=mean,
        dark_slopes=slope_map,
        top_shares=tuple(reader.tops[id(entry.group)] for entry in lights),
        rejected=tuple(reader.rejected),
        used=tuple(reader.used_frames),
    )


def read_group(reader: FrameReader, group: FrameGroup) -> tuple[GroupStatistics, FrameSums]:
    """Return a group's statistics, and its sums, which are valid until the next group is read."""
    sums = reader.sums(group)
    return GroupStatistics(group, tuple(Level.of(totals) for totals in sums.label_totals())), sums
