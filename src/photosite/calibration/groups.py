"""Reading a frame set group by group, and what each group says in numbers."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.cfa import channel_names
from photosite.engine.accumulate import FrameSums, LabelTotals
from photosite.errors import FileError
from photosite.frames.frame_set import FrameGroup, FrameSet

Progress = Callable[[int, int], None]
"""Called with (frames read, frames to read) after each frame."""


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

    @classmethod
    def of(cls, totals: LabelTotals) -> Level:
        """From the exact totals."""
        samples = totals.frames * totals.pixels
        variance = totals.pixel_variance if totals.frames > 1 else math.nan
        shift = totals.frame_mean_variance - variance / totals.pixels if totals.frames > 1 else math.nan
        return cls(
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

    @property
    def repeated(self) -> bool:
        """Whether there is a temporal variance."""
        return self.frames > 1


def pooled_level(levels: list[Level] | tuple[Level, ...]) -> Level:
    """All channels of a group as one: means over pixels, spreads within the channels."""
    pixels = sum(level.pixels for level in levels)
    share = [level.pixels / pixels for level in levels]

    def mean(name: str, power: int = 1) -> float:
        return float(sum(s**power * getattr(level, name) for s, level in zip(share, levels, strict=True)))

    return Level(
        pixels=pixels,
        frames=levels[0].frames,
        mean=mean("mean"),
        mean_variance=mean("mean_variance", 2),
        variance=mean("variance"),
        variance_uncertainty=math.hypot(
            *(s * level.variance_uncertainty for s, level in zip(share, levels, strict=True))
        ),
        spatial_variance=mean("spatial_variance"),
        low_fraction=mean("low_fraction"),
        high_fraction=mean("high_fraction"),
        frame_shift=mean("frame_shift"),
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


class FrameReader:
    """Reads groups of a frame set, one frame in memory at a time.

    It checks each frame against what the set promised, hashes it, and leaves out a frame whose pixels repeat an
    earlier one of its group to the last bit: a copy would pass for a frame without noise.

    Parameters
    ----------
    frames
        The set.
    progress
        Called after each frame.
    """

    def __init__(self, frames: FrameSet, progress: Progress | None = None) -> None:
        self.frames = frames
        self.tile = label_tile(frames)
        self.white = (1 << frames.bits) - 1
        self.sha256: list[str] = []
        self.rejected: list[str] = []
        self._progress = progress
        self._done = 0
        self._expected = frames.frame_count
        self._kept: dict[int, tuple[int, ...]] = {}

    def expect(self, frames: int) -> None:
        """Announce frames that will be read again."""
        self._expected += frames

    def sums(self, group: FrameGroup) -> FrameSums:
        """The exact sums of a group's frames.

        Raises
        ------
        FileError
            If a frame cannot be read, or has another size or range than the set.
        """
        result = FrameSums((self.frames.rows, self.frames.cols), self.tile, white=self.white)
        known = self._kept.get(id(group))
        kept: list[int] = []
        seen: dict[str, str] = {}
        for index, source in enumerate(group.frames):
            if known is None or index in known:
                dn = self._read(group, index)
                if known is not None or self._is_new(dn, source.name, seen, group):
                    result.add(dn)
                    kept.append(index)
                del dn  # before the next one is read
            self._done += 1
            if self._progress is not None:
                self._progress(self._done, self._expected)
        self._kept[id(group)] = tuple(kept)
        return result

    def _read(self, group: FrameGroup, index: int) -> NDArray[np.unsignedinteger]:
        source = group.frames[index]
        dn = source.read()
        shape = (self.frames.rows, self.frames.cols)
        if dn.shape != shape or dn.dtype not in (np.uint8, np.uint16):
            raise FileError(
                source.name,
                f"holds {dn.shape} of {dn.dtype}; the other frames hold {shape} of uint16; "
                f"take it out, or calibrate frames of one size",
            )
        if (highest := int(dn.max())) > self.white:
            raise FileError(
                source.name,
                f"holds {highest} DN, above {self.white}, the highest number of a {self.frames.bits}-bit "
                f"converter; correct the bits of the protocol",
            )
        return dn

    def _is_new(self, dn: NDArray[np.unsignedinteger], name: str, seen: dict[str, str], group: FrameGroup) -> bool:
        digest = hashlib.sha256(np.ascontiguousarray(dn, dtype="<u2").data).hexdigest()
        if (first := seen.get(digest)) is not None:
            # Frames that are all black or all white repeat lawfully; any other needs noise to differ.
            inside = np.count_nonzero((dn > 0) & (dn < self.white))
            if 2 * inside >= dn.size:
                self.rejected.append(f"{name} repeats {first} pixel for pixel ({group_label(group)})")
                return False
        seen[digest] = name
        self.sha256.append(digest)
        return True
