"""The first pass over the frames on several workers: sums of parts of groups, merged without rounding."""

from __future__ import annotations

from dataclasses import dataclass

from photosite.calibration.reduction.checkpoint import FirstPass
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.engine.frame_sums import FrameSums
from photosite.engine.workers import in_order, run_tasks
from photosite.frames.frame_set import FrameGroup, FrameSet

_FRAMES = 32
"""Frames of a part: its sums are 12 bytes a pixel, its frames 64."""

_AHEAD = 16
"""Parts that a scheduler holds at a time, which bounds the memory of this process."""

_Part = tuple[int, range]
"""Index of the group, and the frames of it."""


@dataclass(frozen=True)
class _PartReader:
    """Reads parts of the groups of a frame set."""

    frames: FrameSet

    def __call__(self, part: _Part) -> tuple[FrameSums, FirstPass]:
        index, indices = part
        with FrameReader(self.frames) as reader:
            return reader.part(self.frames.groups[index], indices)

    def name(self, part: _Part) -> str:
        index, indices = part
        frames = self.frames.groups[index].frames
        return f"{frames[indices[0]].name} to {frames[indices[-1]].name}"


class SharedSums:
    """Sums of the groups of a frame set that workers have read, for `FrameReader` in place of a checkpoint.

    A group whose parts may have a frame in common is left to the reader, because a frame that repeats an earlier one
    does not count.
    """

    def __init__(self, frames: FrameSet, *, processes: int | None = 1, scheduler: str | None = None) -> None:
        order = [*frames.of_kind("dark"), *frames.of_kind("light")]
        places = {id(group): index for index, group in enumerate(frames.groups)}
        reader = _PartReader(frames)
        self._parts = [
            (places[id(group)], range(first, min(first + _FRAMES, len(group))))
            for group in order
            for first in range(0, len(group), _FRAMES)
        ]
        self._run = run_tasks(
            reader, self._parts, processes=processes, scheduler=scheduler, name=reader.name, ahead=_AHEAD
        )
        self._completed = in_order(self._run)
        self._places, self._taken = places, 0
        self._found: dict[int, tuple[FrameSums | None, FirstPass | None]] = {}

    def __enter__(self) -> SharedSums:
        return self

    def __exit__(self, *_: object) -> None:
        self._run.close()

    def load(self, group: FrameGroup, sums: FrameSums | None = None) -> FirstPass | None:
        """Return the first pass over a group, None if it must be read; restore its sums, if given."""
        place = self._places[id(group)]
        while place not in self._found:
            self._take_group()
        merged, first = self._found[place]
        if sums is not None and merged is not None:
            sums.restore(merged.state())
            self._found[place] = None, first
        return first

    def save(self, group: FrameGroup, sums: FrameSums, progress: FirstPass) -> None:
        """Keep nothing."""

    def due(self) -> bool:
        """Return that nothing is to be saved."""
        return False

    def _take_group(self) -> None:
        place = self._parts[self._taken][0]
        merged, first_pass = next(self._completed)
        self._taken += 1
        while self._taken < len(self._parts) and self._parts[self._taken][0] == place:
            sums, first = next(self._completed)
            self._taken += 1
            merged = merged.merge(sums)
            first_pass = FirstPass(
                read=first.read,
                used=first_pass.used + first.used,
                digests=first_pass.digests + first.digests,
                rejected=first_pass.rejected + first.rejected,
                samples=first_pass.samples + first.samples,
            )
        several = len(set(first_pass.digests)) < len(first_pass.digests)
        self._found[place] = (None, None) if several else (merged, first_pass)
