"""Frames read while others are reduced: the calibration's way through the pixels."""

from __future__ import annotations

import hashlib
import os
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.checks.frame_screening import Grid, find_outlier_frames, top_value_shares
from photosite.calibration.reduction.checkpoint import Checkpoint, GroupProgress
from photosite.calibration.reduction.groups import group_label, label_tile
from photosite.calibration.reduction.provenance import UsedFrame
from photosite.engine.frame_sums import FrameSums, MeanFrame
from photosite.errors import CalibrationError, FileError
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource

Progress = Callable[[int, int], None]
"""Called with (frames read, frames to read) after each frame."""

_TOGETHER, _TOGETHER_BYTES = 8, 160 << 20
"""Frames that are added to the sums in one pass, and what they may take together."""

_AHEAD, _AHEAD_BYTES = 4, 80 << 20
"""Frames that are read ahead of those; two at least."""

_SAMPLED = 16
"""Rows that are looked at first, to tell frames apart."""

KEPT_BYTES = 240 << 20
"""What the mean frames may take that are kept for the second look; groups beyond are read again."""


def _frames_within(frame_bytes: int, most: int, limit: int, least: int) -> int:
    return max(least, min(most, limit // max(frame_bytes, 1)))


@dataclass(frozen=True)
class _Read:
    """A frame as read."""

    source: FrameSource
    dn: NDArray[np.unsignedinteger]


class FrameReader:
    """Reads groups of a frame set into exact sums; some frames in memory at a time, however many there are.

    Threads read the next frames while those that came are reduced. Each frame is checked against what the
    set promised, and one whose pixels repeat an earlier one of its group to the last bit is left out: a copy would pass
    for a frame without noise. Once a group is read, frames that are broken (`checks/frame_screening.py`) are left
    out, too,
    and the others summed again. To be used in a `with` statement, which ends the threads.

    Parameters
    ----------
    frames
        The set.
    progress
        Called after each frame.
    partial
        Where the sums of the first pass are kept in case it is broken off, and found again.
    """

    def __init__(self, frames: FrameSet, progress: Progress | None = None, partial: Checkpoint | None = None) -> None:
        self.frames = frames
        self.tile = label_tile(frames)
        self.white = (1 << frames.bits) - 1
        self.used_frames: list[UsedFrame] = []
        self.rejected: list[str] = []
        self.tops: dict[int, tuple[tuple[float, float], ...]] = {}
        """By `id` of a group, per channel: the highest number, and the share at it (`top_value_shares`)."""
        self._dark_dn: float | None = None
        self._progress = progress
        self._done = 0
        self._expected = frames.frame_count
        self._used: dict[int, tuple[int, ...]] = {}
        self._means: dict[int, MeanFrame] = {}
        self._kept_bytes = 0
        frame_bytes = 2 * frames.rows * frames.cols
        self._together = _frames_within(frame_bytes, _TOGETHER, _TOGETHER_BYTES, 1)
        self._ahead = _frames_within(frame_bytes, _AHEAD, _AHEAD_BYTES, 2)
        self._threads = ThreadPoolExecutor(min(4, os.cpu_count() or 1), "photosite-read")
        order = (*frames.of_kind("dark"), *frames.of_kind("light"))
        self._order = iter(order)
        self._partial = partial
        left = (
            source
            for group in order
            for source in group.frames[partial.looked_at(group) if partial is not None else 0 :]
        )
        self._first_pass = self._read_ahead(left)
        self._sums: FrameSums | None = None

    def __enter__(self) -> FrameReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._threads.shutdown(cancel_futures=True)

    def expect(self, frames: int) -> None:
        """Announce frames that will be read again."""
        self._expected += frames

    def sums(self, group: FrameGroup) -> FrameSums:
        """The exact sums of a group's frames. The first time, groups are asked for darks first, in the set's order.

        They are good until the next group is asked for: its sums take the same memory.

        Raises
        ------
        FileError
            If a frame cannot be read, or has another size or range than the set.
        CalibrationError
            If frames of the group differ so much that some are broken, and no majority tells which.
        """
        if self._sums is None:
            self._sums = FrameSums((self.frames.rows, self.frames.cols), self.tile, white=self.white)
        result = self._sums.clear()
        if (used := self._used.get(id(group))) is not None:
            self._add(result, self._read_ahead(group.frames[i] for i in used))
            self._count(len(group) - len(used))
            return result
        assert next(self._order) is group, "the first pass has its order"
        look = _FirstLook(group, Grid.of((self.frames.rows, self.frames.cols), len(group)))
        if self._partial is not None and (kept := self._partial.load(group, result)) is not None:
            look.resume(kept)
            self.rejected += kept.rejected
            self._count(kept.looked_at)
        self._add(result, self._new(look), look)
        if not look.judged:
            self._judge(look, result)
            if self._partial is not None:
                self._partial.save(group, result, look.progressed())
        self._used[id(group)] = tuple(look.used)
        self.tops[id(group)] = look.tops
        totals = result.frame_totals()
        if self._dark_dn is None and group.kind == "dark":
            self._dark_dn = sum(totals) / (len(totals) * result.sum.size)
        self.used_frames += [UsedFrame(group.frames[i], n) for i, n in zip(look.used, totals, strict=True)]
        return result

    def keep(self, group: FrameGroup, sums: FrameSums) -> None:
        """Keep a group's mean frame for `mean`, if there is room."""
        mean = sums.mean_frame()
        if self._kept_bytes + mean.sum.nbytes <= KEPT_BYTES:
            self._means[id(group)] = mean
            self._kept_bytes += mean.sum.nbytes

    def kept(self, group: FrameGroup) -> bool:
        """Whether a group's mean frame was kept, so that `mean` need not read it again."""
        return id(group) in self._means

    def mean(self, group: FrameGroup) -> MeanFrame:
        """A group's mean frame: the one kept, which is then let go, or from its frames read again.

        Raises
        ------
        FileError
            As `sums`.
        """
        if (mean := self._means.pop(id(group), None)) is not None:
            self._kept_bytes -= mean.sum.nbytes
            return mean
        return self.sums(group).mean_frame()

    def _judge(self, look: _FirstLook, sums: FrameSums) -> None:
        """Leave broken frames out of a group's sums."""
        if broken := find_outlier_frames(look.samples, self._dark_dn):
            label, n = group_label(look.group), len(look.used)
            named = [(look.group.frames[look.used[entry.place]].name, entry.reason) for entry in broken]
            if 2 * len(broken) >= n:
                shown = ", ".join(name for name, _ in named[:3]) + (f" and {len(named) - 3} more" * (len(named) > 3))
                raise CalibrationError(
                    f"{self.frames.source}: {label}: {shown} {'' if n == 2 else f'of {n} '}differ from each other "
                    f"far beyond noise, and no majority tells which are broken ({named[0][0]}: {named[0][1]}); look at "
                    f"them and take the broken ones out, or correct what is listed as one setting"
                )
            reasons = [f"{name} is not like the other {label}: {reason}" for name, reason in named]
            look.leave_out([entry.place for entry in broken], reasons)
            self.rejected += reasons
            self.expect(len(look.used))
            self._add(sums.clear(), self._read_ahead(look.group.frames[i] for i in look.used))
        rows, cols = np.ix_(look.grid.rows % self.tile.shape[0], look.grid.cols % self.tile.shape[1])
        look.tops = top_value_shares(look.samples, self.tile[rows, cols], self.frames.bits)
        look.judged, look.samples = True, []

    def _new(self, look: _FirstLook) -> Iterator[_Read]:
        """The frames of the first pass that are left of a group, repeats left out."""
        for read in islice(self._first_pass, len(look.group) - look.looked_at):
            if (first := self._repeated(read, look)) is None:
                look.used.append(look.looked_at)
                look.samples.append(look.grid.sample(read.dn))
                look.looked_at += 1
                yield read
            else:
                name = read.source.name
                look.rejected.append(f"{name} repeats {first.name} pixel for pixel ({group_label(look.group)})")
                self.rejected.append(look.rejected[-1])
                look.looked_at += 1
                self._count(1)

    def _add(self, sums: FrameSums, reads: Iterable[_Read], look: _FirstLook | None = None) -> None:
        left = iter(reads)
        while batch := list(islice(left, self._together)):
            sums.add([read.dn for read in batch])
            for read, highest in zip(batch, sums.highest[-len(batch) :], strict=True):
                if highest > self.white:
                    raise FileError(
                        read.source.name,
                        f"holds {highest} DN, above {self.white}, the highest number of a {self.frames.bits}-bit "
                        f"converter; correct the bits of the protocol",
                    )
                self._count(1)
            if look is not None and self._partial is not None and self._partial.due():
                self._partial.save(look.group, sums, look.progressed())
            del batch, read  # before the next ones are gathered

    def _count(self, frames: int) -> None:
        for _ in range(frames):
            self._done += 1
            if self._progress is not None:
                self._progress(self._done, self._expected)

    def _read_ahead(self, sources: Iterable[FrameSource]) -> Iterator[_Read]:
        """The frames in order, read in threads where that is safe."""
        pending: deque[Future[_Read]] = deque()
        for source in sources:
            if source.thread_safe:
                pending.append(self._threads.submit(lambda s: _Read(s, self._checked(s)), source))
            else:
                pending.append(Future())
                pending[-1].set_result(_Read(source, self._checked(source)))
            if len(pending) > self._ahead:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()

    def _checked(self, source: FrameSource) -> NDArray[np.unsignedinteger]:
        dn = source.read()
        shape = (self.frames.rows, self.frames.cols)
        if dn.shape != shape or dn.dtype not in (np.uint8, np.uint16):
            raise FileError(
                source.name,
                f"holds {dn.shape} of {dn.dtype}; the other frames hold {shape} of uint16; "
                f"take it out, or calibrate frames of one size",
            )
        return dn

    def _repeated(self, read: _Read, look: _FirstLook) -> FrameSource | None:
        """The earlier frame of the group that has the same pixels, if there is one: by some rows first, then by all."""
        some = read.dn[:: max(1, read.dn.shape[0] // _SAMPLED)]
        digest = hashlib.sha256(some.tobytes()).hexdigest()
        alike = look.alike(digest)
        # Frames that are all black or all white repeat lawfully; any other needs noise to differ.
        if alike and self._mostly_inside(read.dn):
            for first in alike:
                if np.array_equal(self._checked(first), read.dn):
                    return first
        look.seen.append(digest)
        return None

    def _mostly_inside(self, dn: NDArray[np.unsignedinteger]) -> bool:
        return bool(2 * np.count_nonzero((dn > 0) & (dn < self.white)) >= dn.size)


class _FirstLook:
    """The first pass over a group, as far as it got: see `GroupProgress`."""

    def __init__(self, group: FrameGroup, grid: Grid) -> None:
        self.group = group
        self.grid = grid
        self.looked_at = 0
        self.used: list[int] = []
        self.seen: list[str] = []
        self.rejected: list[str] = []
        self.judged = False
        self.tops: tuple[tuple[float, float], ...] = ()
        self.samples: list[NDArray[np.uint16]] = []

    def resume(self, kept: GroupProgress) -> None:
        """Go on from what was kept."""
        self.looked_at, self.judged, self.tops = kept.looked_at, kept.judged, kept.tops
        self.used, self.seen, self.rejected = list(kept.used), list(kept.seen), list(kept.rejected)
        self.samples = list(kept.samples)

    def progressed(self) -> GroupProgress:
        """What is to be kept."""
        none = np.empty((0, len(self.grid.rows), len(self.grid.cols)), np.uint16)
        return GroupProgress(
            self.looked_at, tuple(self.used), tuple(self.seen), tuple(self.rejected), self.judged, self.tops,
            np.stack(self.samples) if self.samples else none,
        )  # fmt: skip

    def leave_out(self, places: Collection[int], reasons: Sequence[str]) -> None:
        """Take frames out that were used, by their places among these."""
        left = [i for i in range(len(self.used)) if i not in places]
        self.used, self.seen = [self.used[i] for i in left], [self.seen[i] for i in left]
        self.samples = [self.samples[i] for i in left]
        self.rejected += reasons

    def alike(self, digest: str) -> list[FrameSource]:
        """The frames used whose first rows have this digest."""
        return [self.group.frames[i] for i, other in zip(self.used, self.seen, strict=True) if other == digest]
