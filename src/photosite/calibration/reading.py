"""Frames read while others are reduced: the calibration's way through the pixels."""

from __future__ import annotations

import hashlib
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.groups import group_label, label_tile
from photosite.calibration.provenance import UsedFrame
from photosite.engine.accumulate import FrameSums, MeanFrame
from photosite.errors import FileError
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
    for a frame without noise. To be used in a `with` statement, which ends the threads.

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
        self.used_frames: list[UsedFrame] = []
        self.rejected: list[str] = []
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
        self._first_pass = self._read_ahead(source for group in order for source in group.frames)
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
        """
        if self._sums is None:
            self._sums = FrameSums((self.frames.rows, self.frames.cols), self.tile, white=self.white)
        result = self._sums.clear()
        if (used := self._used.get(id(group))) is not None:
            self._add(result, self._read_ahead(group.frames[i] for i in used))
            self._count(len(group) - len(used))
            return result
        assert next(self._order) is group, "the first pass has its order"
        used_now: list[int] = []
        self._add(result, self._new(group, used_now))
        self._used[id(group)] = tuple(used_now)
        totals = result.frame_totals()
        self.used_frames += [UsedFrame(group.frames[i], n) for i, n in zip(used_now, totals, strict=True)]
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

    def _new(self, group: FrameGroup, used: list[int]) -> Iterator[_Read]:
        """The group's frames of the first pass, repeats left out; `used` becomes the places of the others."""
        seen: dict[bytes, list[FrameSource]] = {}
        for index, read in enumerate(islice(self._first_pass, len(group))):
            if self._is_new(read, seen, group):
                used.append(index)
                yield read
            else:
                self._count(1)

    def _add(self, sums: FrameSums, reads: Iterable[_Read]) -> None:
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

    def _is_new(self, read: _Read, seen: dict[bytes, list[FrameSource]], group: FrameGroup) -> bool:
        """Whether no earlier frame of the group has the same pixels: by some rows first, then by all."""
        some = read.dn[:: max(1, read.dn.shape[0] // _SAMPLED)]
        alike = seen.setdefault(hashlib.sha256(some.tobytes()).digest(), [])
        # Frames that are all black or all white repeat lawfully; any other needs noise to differ.
        if alike and self._mostly_inside(read.dn):
            for first in alike:
                if np.array_equal(self._checked(first), read.dn):
                    name = read.source.name
                    self.rejected.append(f"{name} repeats {first.name} pixel for pixel ({group_label(group)})")
                    return False
        alike.append(read.source)
        return True

    def _mostly_inside(self, dn: NDArray[np.unsignedinteger]) -> bool:
        return bool(2 * np.count_nonzero((dn > 0) & (dn < self.white)) >= dn.size)
