"""What each group of frames says in numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.rounding import rounding_uncertainty
from photosite.engine.frame_sums import LabelTotals
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.values.cfa import channel_names
from photosite.values.uncertain import Source, Uncertain

CLIPPED_SHARE = 0.001
"""Share of numbers at 0 or at the top from which on a light level is not linear any more."""


@dataclass(frozen=True)
class Level:
    """One channel of one group: its mean, its temporal variance, and how well each is known. All in DN, DN^2.

    Parameters
    ----------
    pixels, frames
        How many of each are behind it.
    mean
        Mean digital number.
    mean_variance
        Sampling variance of the mean (temporal noise only).
    variance
        Temporal variance of a pixel, quantisation included, shifts common to a frame left out; NaN for one frame.
    variance_uncertainty
        Its standard uncertainty, from the spread of the pixels' own variances, so that it holds whatever the
        distribution of the noise is.
    spatial_variance
        Variance over pixels of the mean frame, temporal noise included.
    low_fraction, high_fraction
        Share of the digital numbers at 0 and at the converter's highest number.
    frame_shift
        Standard deviation of the shifts common to a whole frame, signed where its variance came out negative.
    shared_mean, shared_variance
        Standard uncertainties that all clipped dark levels of the channel share: they do not drop out of a difference
        with a light level, and do out of one between two of them. 0 where nothing was clipped.
    rounding_mean, rounding_variance
        Standard uncertainties of mean and variance from rounding (`calibration/reduction/rounding.py`), which are
        not among the
        others: levels of one mean share them.
    sources
        Shares of `variance_uncertainty`, in squares, by independent source: what is found with this level is
        correlated with what else is.
    """

    pixels: int
    frames: int
    mean: float
    mean_variance: float
    variance: float
    variance_uncertainty: float
    spatial_variance: float
    low_fraction: float
    high_fraction: float
    frame_shift: float
    shared_mean: float = 0.0
    shared_variance: float = 0.0
    rounding_mean: float = 0.0
    rounding_variance: float = 0.0
    sources: Mapping[Source, float] = field(default_factory=lambda: {Source(): 1.0}, repr=False, compare=False)

    @classmethod
    def of(cls, totals: LabelTotals) -> Level:
        """From the exact totals."""
        samples = totals.frames * totals.pixels
        variance = totals.pixel_variance if totals.frames > 1 else math.nan
        shift = totals.frame_mean_variance - variance / totals.pixels if totals.frames > 1 else math.nan
        level = cls(
            pixels=totals.pixels,
            frames=totals.frames,
            mean=totals.mean,
            mean_variance=variance / samples,
            variance=variance,
            variance_uncertainty=(math.sqrt(totals.variance_spread / totals.pixels) if totals.frames > 1 else math.nan),
            spatial_variance=totals.spatial_variance,
            low_fraction=totals.low / samples,
            high_fraction=totals.high / samples,
            frame_shift=math.copysign(math.sqrt(abs(shift)), shift) if totals.frames > 1 else math.nan,
        )
        return level.with_rounding()

    def with_rounding(self) -> Level:
        """The level with what rounding may have done to its mean and variance."""
        spatial = self.spatial_variance - self.variance / self.frames
        of_mean, of_variance = rounding_uncertainty(self.variance, self.variance_uncertainty, spatial)
        return replace(self, rounding_mean=of_mean, rounding_variance=of_variance)

    @property
    def noise(self) -> Uncertain:
        """`variance` as an input that all results share which use it."""
        u = self.variance_uncertainty
        return Uncertain(self.variance, {source: u * math.sqrt(share) for source, share in self.sources.items()})

    @property
    def clipped(self) -> bool:
        """Whether so many numbers are at an end of the range that the level is not linear."""
        return max(self.low_fraction, self.high_fraction) > CLIPPED_SHARE

    @property
    def repeated(self) -> bool:
        """Whether there is a temporal variance."""
        return self.frames > 1

    def shifts_beyond_chance(self, false_alarms: float) -> bool:
        """Whether the means of the frames scatter by more than the noise of their pixels explains.

        Over steady frames the variance of the frame means is variance / pixels, and the quotient of their estimates
        follows Fisher's F of n - 1 and (n - 1)(P - 1) degrees of freedom (two-way analysis of variance, n frames by P
        pixels). Noise that a row shares counts as a shift here: its frame means do scatter more.

        Parameters
        ----------
        false_alarms
            Share of steady levels for which the answer may be yes.
        """
        from scipy.stats import f

        freedom = self.frames - 1
        if freedom == 0 or self.pixels < 2:
            return False
        explained = self.variance / self.pixels
        limit = float(f.isf(false_alarms, freedom, freedom * (self.pixels - 1)))
        return explained + math.copysign(self.frame_shift**2, self.frame_shift) > limit * explained


def pooled_level(levels: list[Level] | tuple[Level, ...]) -> Level:
    """All channels of a group as one: means over pixels, spreads within the channels."""
    pixels = sum(level.pixels for level in levels)
    share = [level.pixels / pixels for level in levels]

    def mean(name: str, power: int = 1) -> float:
        return float(sum(s**power * getattr(level, name) for s, level in zip(share, levels, strict=True)))

    def independent(name: str) -> float:
        return math.hypot(*(s * getattr(level, name) for s, level in zip(share, levels, strict=True)))

    whole = independent("variance_uncertainty")
    sources = {
        source: part * (s * level.variance_uncertainty / whole) ** 2
        for s, level in zip(share, levels, strict=True)
        for source, part in level.sources.items()
        if whole > 0.0
    }
    return Level(
        pixels=pixels,
        frames=levels[0].frames,
        mean=mean("mean"),
        mean_variance=mean("mean_variance", 2),
        variance=mean("variance"),
        variance_uncertainty=whole,
        spatial_variance=mean("spatial_variance"),
        low_fraction=mean("low_fraction"),
        high_fraction=mean("high_fraction"),
        frame_shift=mean("frame_shift"),
        shared_mean=independent("shared_mean"),
        shared_variance=independent("shared_variance"),
        rounding_mean=mean("rounding_mean"),
        rounding_variance=mean("rounding_variance"),
        sources=sources,
    )


@dataclass(frozen=True)
class GroupStatistics:
    """A group and its levels, one per channel."""

    group: FrameGroup
    levels: tuple[Level, ...]

    @property
    def frames(self) -> int:
        """Frames used, repeats left out."""
        return self.levels[0].frames

    @property
    def label(self) -> str:
        """How to call the group in a message."""
        return group_label(self.group)


def group_label(group: FrameGroup) -> str:
    """How to call a group in a message: "dark frames at 0.01 s"."""
    text = f"{group.kind} frames at {group.exposure_s:g} s"
    if group.kind == "light" and group.photons_per_pixel is not None:
        text += f" ({group.photons_per_pixel:g} photons)"
    return text


def label_tile(frames: FrameSet) -> NDArray[np.int64]:
    """The CFA's tile as integers, in the order of `channel_names`."""
    names = channel_names(frames.cfa)
    return np.array([[names.index(name) for name in row] for row in frames.cfa], dtype=np.int64)
