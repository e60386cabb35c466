"""Stage "reduce": a frame set becomes statistics per group and channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics, Level, reference_dark
from photosite.calibration.reduction.provenance import UsedFrame
from photosite.calibration.spatial.pixel_slopes import PixelSlopes, slope_coefficients
from photosite.engine.frame_sums import FrameSums, MeanFrame
from photosite.errors import CalibrationError
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.values.cfa import channel_names


@dataclass(frozen=True)
class Reduction:
    """A frame set reduced to statistics."""

    frames: FrameSet
    darks: tuple[GroupStatistics, ...]
    lights: tuple[GroupStatistics, ...]
    reference: int  # index of the dark group for read noise and DSNU (`reference_dark`)
    reference_mean: MeanFrame
    dark_slopes: PixelSlopes | None  # map of per-pixel dark slopes, DN/s; None with one dark exposure
    top_shares: tuple[tuple[tuple[float, float], ...], ...]  # `top_value_shares` per light group and channel
    rejected: tuple[str, ...]  # frames left out, each with the reason
    used: tuple[UsedFrame, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return channel_names(self.frames.cfa)

    @property
    def reference_group(self) -> GroupStatistics:
        """The dark group for read noise and DSNU."""
        return self.darks[self.reference]

    def of_channel(self, name: str, text: str = ", channel {}") -> str:
        """Return the channel's name in a text, "" for a monochrome chip."""
        return text.format(name) if len(self.names) > 1 else ""

    def error(
        self, what: str, hint: str | None = None, group: GroupStatistics | None = None, channel: str = ""
    ) -> CalibrationError:
        """Return an error about these frames, or about one of the groups and a channel of it."""
        where = self.frames.source
        if group is not None:
            where += f": {group.label}" + (self.of_channel(channel) if channel else "")
        return CalibrationError(what, where=where, hint=hint)


def reduce_frames(reader: FrameReader) -> Reduction:
    """Read every frame once and return the statistics of each group.

    Mean frames of light groups that may be needed again are kept within `KEPT_BYTES`.
    """
    planned = reader.frames.of_kind("dark")
    slopes, coefficients = None, dark_slope_coefficients(planned)
    if coefficients is not None:
        slopes = PixelSlopes((reader.frames.rows, reader.frames.cols), reader.tile)
    wanted = reference_dark(planned)
    darks: list[GroupStatistics] = []
    mean: MeanFrame | None = None
    for index, group in enumerate(planned):
        statistics, sums = read_group(reader, group)
        darks.append(statistics)
        if index == wanted:
            mean = sums.mean_frame()
        if slopes is not None and coefficients is not None:
            slopes.add(sums.mean_frame(), [float(coefficients[index])] * len(statistics.levels))
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
    top_shares = tuple(reader.tops[id(entry.group)] for entry in lights)
    rejected, used = tuple(reader.rejected), tuple(reader.used_frames)
    return Reduction(reader.frames, tuple(darks), tuple(lights), reference, mean, slopes, top_shares, rejected, used)


def dark_slope_coefficients(darks: Sequence[FrameGroup]) -> NDArray[np.float64] | None:
    """Return the (groups,) weights of mean dark frames in the map of dark slopes, 1/s; None with one exposure.

    Groups count by their number of frames, because the weights must be known before the first frame is read. The dark
    variance grows little with exposure, so better weights would gain little precision.
    """
    exposure = np.array([group.exposure_s for group in darks])
    if len(np.unique(exposure)) < 2:
        return None
    return slope_coefficients(exposure, np.array([float(len(group)) for group in darks]))


def read_group(reader: FrameReader, group: FrameGroup) -> tuple[GroupStatistics, FrameSums]:
    """Return a group's statistics, and its sums, which are valid until the next group is read."""
    sums = reader.sums(group)
    return GroupStatistics(group, tuple(Level.of(totals) for totals in sums.label_totals())), sums
