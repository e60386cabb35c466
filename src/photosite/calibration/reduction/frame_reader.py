"""Reading of frames in threads while others are reduced."""

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

from photosite.calibration.checks.frame_screening import SampleGrid, find_outlier_frames, top_value_shares
from photosite.calibration.reduction.checkpoint import Checkpoint, GroupProgress
from photosite.calibration.reduction.groups import group_label, label_tile
from photosite.calibration.reduction.provenance import UsedFrame
from photosite.engine.frame_sums import FrameSums, MeanFrame
from photosite.errors import CalibrationError, FileError
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource

Progress = Callable[[int, int], None]
"""Called with (frames read, frames to read) after each frame."""

_TOGETHER, _TOGETHER_BYTES = 8, 160 << 20
"""Frames added to the sums in one pass, and their memory limit."""

_AHEAD, _AHEAD_BYTES = 4, 80 << 20
"""Frames read ahead, and their memory limit; at least two frames."""

_SAMPLED_ROWS = 16
"""Rows compared first to find repeated frames."""

KEPT_BYTES = 240 << 20
"""Memory limit of the mean frames that are kept; groups beyond it are read again."""


def _frames_within(frame_bytes: int, most: int, limit: int, least: int) -> int:
    return max(least, min(most, limit // max(frame_bytes, 1)))


@dataclass(frozen=True)
class _Read:
    """A frame that was read."""

    source: FrameSource
    dn: NDArray[np.unsignedinteger]


class FrameReader:
    """Reads the groups of a frame set into exact sums, with a few frames in memory at a time.

    Threads read the next frames while the current ones are summed. Each frame is checked against the size and bit depth
    of the set. A frame that repeats an earlier one of its group bit by bit is left out, because a copy would count as a
    frame without noise. When a group is complete, outlier frames (`checks/frame_screening.py`) are left out and the
    others are summed again. Use the reader in a `with` statement, which ends the threads.

    Parameters
    ----------
    frames
        The frame set.
    progress
        Called after each frame.
    checkpoint
        Where the sums of the first pass are saved, and from where an interrupted run resumes.
    """

    def __init__(
        self, frames: FrameSet, progress: Progress | None = None, checkpoint: Checkpoint | None = None
    ) -> None:
        self.frames = frames
        self.tile = label_tile(frames)
        self.white = (1 << frames.bits) - 1
        self.used_frames: list[UsedFrame] = []
        self.rejected: list[str] = []
        self.tops: dict[int, tuple[tuple[float, float], ...]] = {}
        """`top_value_shares` of each group's channels, by the `id` of the group."""
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
        self._checkpoint = checkpoint
        left = (
            source
            for group in order
            for source in group.frames[checkpoint.frames_read(group) if checkpoint is not None else 0 :]
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
        """Return the exact sums of a group's frames, valid until the next group is requested.

        In the first pass, groups must be requested in the order of the set, dark groups first.
        """
        if self._sums is None:
            self._sums = FrameSums((self.frames.rows, self.frames.cols), self.tile, white=self.white)
        result = self._sums.clear()
        if (used := self._used.get(id(group))) is not None:
            self._add(result, self._read_ahead(group.frames[i] for i in used))
            self._count(len(group) - len(used))
            return result
        assert next(self._order) is group, "the first pass follows the order of the set"
        first = _FirstPass(group, SampleGrid.of((self.frames.rows, self.frames.cols), len(group)))
        if self._checkpoint is not None and (saved := self._checkpoint.load(group, result)) is not None:
            first.resume(saved)
            self.rejected += saved.rejected
            self._count(saved.read)
        self._add(result, self._new(first), first)
        if not first.screened:
            self._screen(first, result)
            if self._checkpoint is not None:
                self._checkpoint.save(group, result, first.progress())
        self._used[id(group)] = tuple(first.used)
        self.tops[id(group)] = first.tops
        totals = result.frame_totals()
        if self._dark_dn is None and group.kind == "dark":
            self._dark_dn = sum(totals) / (len(totals) * result.sum.size)
        self.used_frames += [UsedFrame(group.frames[i], n) for i, n in zip(first.used, totals, strict=True)]
        return result

    def keep(self, group: FrameGroup, sums: FrameSums) -> None:
        """Keep a group's mean frame for `mean`, within the memory limit."""
        mean = sums.mean_frame()
        if self._kept_bytes + mean.sum.nbytes <= KEPT_BYTES:
            self._means[id(group)] = mean
            self._kept_bytes += mean.sum.nbytes

    def kept(self, group: FrameGroup) -> bool:
        """Return whether a group's mean frame was kept, so that `mean` need not read it again."""
        return id(group) in self._means

    def mean(self, group: FrameGroup) -> MeanFrame:
        """Return a group's mean frame and release it if it was kept, or compute it from its frames again."""
        if (mean := self._means.pop(id(group), None)) is not None:
            self._kept_bytes -= mean.sum.nbytes
            return mean
        return self.sums(group).mean_frame()

    def _screen(self, first: _FirstPass, sums: FrameSums) -> None:
        """Leave outlier frames out of a group's sums."""
        if outliers := find_outlier_frames(first.samples, self._dark_dn):
            label, n = group_label(first.group), len(first.used)
            named = [(first.group.frames[first.used[entry.index]].name, entry.reason) for entry in outliers]
            if 2 * len(outliers) >= n:
                shown = ", ".join(name for name, _ in named[:3]) + (f" and {len(named) - 3} more" * (len(named) > 3))
                raise CalibrationError(
                    f"{shown} {'' if n == 2 else f'of {n} '}differ from each other far beyond noise, and there is no "
                    f"majority that shows which are broken ({named[0][0]}: {named[0][1]})",
                    where=f"{self.frames.source}: {label}",
                    hint="Remove the broken frames, or correct what is listed as one setting",
                )
            reasons = [f"{name} differs from the other {label}: {reason}" for name, reason in named]
            first.leave_out([entry.index for entry in outliers], reasons)
            self.rejected += reasons
            self.expect(len(first.used))
            self._add(sums.clear(), self._read_ahead(first.group.frames[i] for i in first.used))
        rows, cols = np.ix_(first.grid.rows % self.tile.shape[0], first.grid.cols % self.tile.shape[1])
        first.tops = top_value_shares(first.samples, self.tile[rows, cols], self.frames.bits)
        first.screened, first.samples = True, []

    def _new(self, first: _FirstPass) -> Iterator[_Read]:
        """Read the remaining frames of a group in the first pass, and leave repeats out."""
        for read in islice(self._first_pass, len(first.group) - first.read):
            if (original := self._repeated(read, first)) is None:
                first.used.append(first.read)
                first.samples.append(first.grid.sample(read.dn))
                first.read += 1
                yield read
            else:
                name = read.source.name
                first.rejected.append(f"{name} repeats {original.name} pixel for pixel ({group_label(first.group)})")
                self.rejected.append(first.rejected[-1])
                first.read += 1
                self._count(1)

    def _add(self, sums: FrameSums, reads: Iterable[_Read], first: _FirstPass | None = None) -> None:
        left = iter(reads)
        while batch := list(islice(left, self._together)):
            sums.add([read.dn for read in batch])
            for read, highest in zip(batch, sums.highest[-len(batch) :], strict=True):
                if highest > self.white:
                    raise FileError(
                        read.source.name,
                        f"the frame holds {highest} DN, above {self.white} DN, the full scale of {self.frames.bits} "
                        f"bits",
                        hint="Correct the bits of the protocol",
                    )
                self._count(1)
            if first is not None and self._checkpoint is not None and self._checkpoint.due():
                self._checkpoint.save(first.group, sums, first.progress())
            del batch, read  # free their memory before the next batch

    def _count(self, frames: int) -> None:
        for _ in range(frames):
            self._done += 1
            if self._progress is not None:
                self._progress(self._done, self._expected)

    def _read_ahead(self, sources: Iterable[FrameSource]) -> Iterator[_Read]:
        """Yield the frames in order, read in threads where that is safe."""
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
                f"the frame is {dn.shape} of {dn.dtype}, but the others are {shape} of uint16",
                hint="Remove it, or calibrate frames of one size",
            )
        return dn

    def _repeated(self, read: _Read, first: _FirstPass) -> FrameSource | None:
        """Return the earlier frame of the group with the same pixels, if any: some rows are compared first."""
        rows = read.dn[:: max(1, read.dn.shape[0] // _SAMPLED_ROWS)]
        digest = hashlib.sha256(rows.tobytes()).hexdigest()
        candidates = first.frames_with(digest)
        # Frames that are all black or all white may repeat; any other two differ by their noise.
        if candidates and self._mostly_inside(read.dn):
            for candidate in candidates:
                if np.array_equal(self._checked(candidate), read.dn):
                    return candidate
        first.digests.append(digest)
        return None

    def _mostly_inside(self, dn: NDArray[np.unsignedinteger]) -> bool:
        return bool(2 * np.count_nonzero((dn > 0) & (dn < self.white)) >= dn.size)


class _FirstPass:
    """The state of the first pass over a group: see `GroupProgress`."""

    def __init__(self, group: FrameGroup, grid: SampleGrid) -> None:
        self.group = group
        self.grid = grid
        self.read = 0
        self.used: list[int] = []
        self.digests: list[str] = []
        self.rejected: list[str] = []
        self.screened = False
        self.tops: tuple[tuple[float, float], ...] = ()
        self.samples: list[NDArray[np.uint16]] = []

    def resume(self, saved: GroupProgress) -> None:
        """Continue from a saved state."""
        self.read, self.screened, self.tops = saved.read, saved.screened, saved.tops
        self.used, self.digests, self.rejected = list(saved.used), list(saved.digests), list(saved.rejected)
        self.samples = list(saved.samples)

    def progress(self) -> GroupProgress:
        """Return the state to save."""
        none = np.empty((0, len(self.grid.rows), len(self.grid.cols)), np.uint16)
        return GroupProgress(
            self.read, tuple(self.used), tuple(self.digests), tuple(self.rejected), self.screened, self.tops,
            np.stack(self.samples) if self.samples else none,
        )  # fmt: skip

    def leave_out(self, places: Collection[int], reasons: Sequence[str]) -> None:
        """Remove used frames, by their indices among these."""
        left = [i for i in range(len(self.used)) if i not in places]
        self.used, self.digests = [self.used[i] for i in left], [self.digests[i] for i in left]
        self.samples = [self.samples[i] for i in left]
        self.rejected += reasons

    def frames_with(self, digest: str) -> list[FrameSource]:
        """Return the used frames whose sampled rows have this digest."""
        return [self.group.frames[i] for i, other in zip(self.used, self.digests, strict=True) if other == digest]
