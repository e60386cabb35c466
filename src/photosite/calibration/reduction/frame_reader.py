"""Reading of frames in threads while others are reduced."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import chain, islice
from threading import Lock
from types import TracebackType
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.checkpoint import Checkpoint, FirstPass, FrameIdentity, SavedSums, identity
from photosite.calibration.reduction.codes import Counts, channel_counts
from photosite.calibration.reduction.fading_light import LightFades, with_fading_levels
from photosite.calibration.reduction.frame_screening import NEAR_COPY_FRAME, NO_MAJORITY, sample_grid
from photosite.calibration.reduction.group_screening import Screening, screen_frames
from photosite.calibration.reduction.groups import group_label, label_tile
from photosite.calibration.reduction.provenance import UsedFrame
from photosite.calibration.reduction.turned_frames import MOST_COMPARED, TURNED_FRAME, how_turned, middle
from photosite.engine.frame_sums import FrameSums, MeanFrame, PixelVariances
from photosite.engine.lazy_maps import is_large
from photosite.engine.outlying_pixels import distinct
from photosite.engine.process import return_large_arrays
from photosite.engine.threads import computed_beside, thread_count
from photosite.errors import FileError
from photosite.files.small_files import file_stamp
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource
from photosite.frames.repaired_frames import PixelReplacement, numbers_at, repaired
from photosite.frames.stored_rows import StoredRows
from photosite.values.diagnostic import Diagnostic, DiagnosticKind

T = TypeVar("T")

_Numbers = NDArray[np.unsignedinteger] | StoredRows

Progress = Callable[[int, int], None]
"""Called with (frames read, frames to read) after each frame."""


class _Read(NamedTuple):
    """A frame that was read, or opened.

    In the first pass it comes with the pixels of `sample_grid`, and for a checkpoint with its identity.
    """

    source: FrameSource
    dn: _Numbers
    sample: NDArray[np.uint16] | None = None
    identity: FrameIdentity | None = None

    def dn_values(self) -> NDArray[np.unsignedinteger]:
        """Return the (rows, cols) digital numbers."""
        return self.dn.read() if isinstance(self.dn, StoredRows) else self.dn


class ReplacedNumbers(NamedTuple):
    """Numbers (frames, n) of replaced pixels, and of those that replace them."""

    own: NDArray[np.uint16]
    other: NDArray[np.uint16]


_NONE = np.zeros(0, np.int64)


class _KnownNumbers(NamedTuple):
    """Numbers (frames, n) of some pixels of a group by their places: of those of a replacement and of its sources."""

    replacement: PixelReplacement | None
    at: NDArray[np.int64]
    numbers: NDArray[np.uint16]


class _Move(NamedTuple):
    """Where numbers at `at`, of a replacement, are among those at the places `before`, and which are not there."""

    replacement: PixelReplacement
    at: NDArray[np.int64]
    before: NDArray[np.int64] | None = None
    place: NDArray[np.int64] = _NONE
    unknown: NDArray[np.int64] = _NONE


_BATCH_FRAMES, _BATCH_BYTES = 12, 240 << 20
"""Frames added to the sums in one pass, and their memory limit."""

EQUAL_NUMBERS = 0.99
"""Fraction of equal pixels in a frame from which another frame may equal it by chance."""

_STRIP_BYTES = 4 << 20
"""Bytes of a frame that `FrameReader.each_in_strips` reads at a time."""

_MOST_OPEN = 256
"""The same of frames whose rows are read while they are added: files that are open at a time."""

_AHEAD, _AHEAD_BYTES = 128, 80 << 20
"""Frames read ahead, and their memory limit; at least two frames, and one for each core. Many small frames are decoded
while the first kernels are loaded."""
_AHEAD_UNSAFE = 4
"""The same of sources that are read in the caller's thread, where nothing is gained."""

KEPT_BYTES = 240 << 20
"""Memory limit of the mean frames that are kept; groups beyond it, and those of large frames, are read again."""


def _open_files() -> int:
    """Return how many frames may be open at a time: a quarter of the files that the process may open."""
    try:
        import resource
    except ImportError:  # Windows
        return _MOST_OPEN // 4
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return max(2, min(_MOST_OPEN, limit // 4)) if limit != resource.RLIM_INFINITY else _MOST_OPEN


REPEATED_FRAME = DiagnosticKind(
    "repeated-frame",
    "left out",
    "A frame repeats another pixel for pixel.",
    "The copy was left out: its noise is that of the other frame.",
    "Look for a camera or program that writes a frame twice.",
    false_alarms="none: frames are compared",
)


class FrameReader:
    """Reads the groups of a frame set into exact sums, with a few frames in memory at a time.

    Threads read the next frames while the current ones are summed. Each frame is checked against the size and bit depth
    of the set. A frame that repeats an earlier one of its group bit by bit is left out, because a copy would count as a
    frame without noise. When a group is complete, outlier frames (`reduction/frame_screening.py`) are left out and the
    others are summed again. `progress` is called after each frame. A checkpoint holds the sums of the first pass, from
    which an interrupted run resumes. Use the reader in a `with` statement, which ends the threads.
    """

    def __init__(self, frames: FrameSet, progress: Progress | None = None, checkpoint: SavedSums | None = None) -> None:
        self.frames = frames
        self.tile = label_tile(frames.cfa)
        self.white = (1 << frames.bits) - 1
        self.used_frames: list[UsedFrame] = []
        self.rejected: list[Diagnostic] = []
        self.counts: dict[int, Counts] = {}
        """`count_codes` of each group's samples, by the `id` of the group."""
        self.replaced: dict[int, ReplacedNumbers] = {}
        """Numbers of the pixels of each group that `replace_pixels` replaced, by the `id` of the group."""
        self._known: dict[int, _KnownNumbers] = {}
        self._watched = _NONE
        self._moves: list[_Move] = []
        self._dark_dn: float | None = None
        self._progress = progress
        self._done = 0
        self._counting = Lock()
        self._expected = frames.frame_count
        self._used: dict[int, list[int]] = {}
        self._highest: dict[int, int] = {}
        self._means: dict[int, MeanFrame] = {}
        self._kept_bytes = 0
        self._shape = frames.rows, frames.cols
        self._large = is_large(self._shape)
        if self._large:
            return_large_arrays()
        frame_bytes = max(2 * frames.rows * frames.cols, 1)
        self._batch_frames = max(1, min(_BATCH_FRAMES, _BATCH_BYTES // frame_bytes))
        self._open = _open_files()
        threads = thread_count()  # compressed frames are decoded on all cores
        self._ahead = max(2, threads, min(_AHEAD, self._open, _AHEAD_BYTES // frame_bytes))
        self._threads = ThreadPoolExecutor(threads, "photosite-read")
        order = (*frames.of_kind("dark"), *frames.of_kind("light"))
        self._order = iter(order)
        self._checkpoint = checkpoint
        unread = (
            (source, len(group))
            for group in order
            for saved in [None if checkpoint is None else checkpoint.load(group)]
            for source in group.frames[saved.read if saved else 0 :]
        )
        self._first_pass = self._read_ahead(unread, identify=isinstance(checkpoint, Checkpoint))
        self._screening: Future[Screening] = Future()
        self._sums: FrameSums | None = None

    def __enter__(self) -> FrameReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._threads.shutdown(cancel_futures=True)
        self._first_pass.close()  # its generator has this reader, whose arrays would stay until the next collection

    @property
    def thread_safe(self) -> bool:
        """Whether all frames may be read in threads."""
        return all(source.thread_safe for group in self.frames.groups for source in group.frames)

    def expect(self, frames: int) -> None:
        """Announce frames that will be read again."""
        self._expected += frames

    def sums(self, group: FrameGroup, *, variance: bool = False) -> FrameSums:
        """Return the exact sums of a group's frames, valid until the next group is requested.

        In the first pass, groups must be requested in the order of the set, dark groups first. `variance` is whether
        the variance of each pixel will be needed, which takes longer.
        """
        if self._sums is None:
            self._sums = FrameSums(self._shape, self.tile, white=self.white)
        result = self._sums.clear()
        if (used := self._used.get(id(group))) is not None:
            reads = self._read_ahead((group.frames[i], 0) for i in used)
            self._add(result, reads, variance=variance, highest=self._highest.get(id(group)))
            self._count(len(group) - len(used))
            return result
        assert next(self._order) is group, "the first pass follows the order of the set"
        saved = None if self._checkpoint is None else self._checkpoint.load(group, result)
        if saved is not None:
            self._check_unchanged(group, saved)
        first = saved or FirstPass()
        self.rejected += first.rejected
        self._count(first.read)
        result.watch(self._watched)
        self._add(result, self._new_then_screen(group, first), group, first, variance=variance)
        if not first.screened:
            self._screen(group, first, result, variance=variance)
            if len(self._watched) and len(numbers := result.watched_numbers()) == len(first.used):
                self._known[id(group)] = _KnownNumbers(None, self._watched, numbers)
            if self._checkpoint is not None:
                self._checkpoint.save(group, result, first)
        self._used[id(group)], self._highest[id(group)] = first.used, max(result.highest, default=self.white)
        self.counts[id(group)] = first.counts
        totals = result.frame_totals()
        if self._dark_dn is None and group.kind == "dark":
            self._dark_dn = sum(totals) / (len(totals) * result.sum.size)
        self.used_frames += [UsedFrame(group.frames[i], n) for i, n in zip(first.used, totals, strict=True)]
        return result

    def variances(self, group: FrameGroup) -> PixelVariances:
        """Return the variance of each pixel over the used frames of a group, which are read again."""
        sources = self.used_sources(group)
        opened = [each for source in sources if (each := source.open_rows()) is not None]
        if len(sources) == len(opened) <= self._open:
            sums = self._sums = self._sums or FrameSums(self._shape, self.tile, white=self.white)
            numerators = sums.numerators(opened, max(self._highest[id(group)], 1))
            if numerators is not None:
                self._count(len(group))
                return PixelVariances(numerators, len(opened) * (len(opened) - 1.0))
        return PixelVariances(self.sums(group, variance=True).variance(), 1.0)

    def part(self, group: FrameGroup, indices: range) -> tuple[FrameSums, FirstPass]:
        """Return the sums of some frames of a group, before outlier frames are left out, instead of a first pass."""
        self._first_pass = self._read_ahead((group.frames[index], len(group)) for index in indices)
        sums, first = FrameSums(self._shape, self.tile, white=self.white), FirstPass(read=indices.start)
        self._add(sums, self._new(group, first), variance=True)
        return sums, first

    def keep(self, group: FrameGroup, sums: FrameSums) -> None:
        """Keep a group's mean frame for `mean`, within the memory limit."""
        if id(group) in self._means or self._large:
            return
        mean = sums.mean_frame()
        size = mean.sum.nbytes
        if self._kept_bytes + size <= KEPT_BYTES:
            self._means[id(group)] = mean
            self._kept_bytes += size

    def kept(self, group: FrameGroup) -> bool:
        """Return whether a group's mean frame was kept, so that `mean` need not read it again."""
        return id(group) in self._means

    def mean(self, group: FrameGroup) -> MeanFrame:
        """Return a group's mean frame and release it if it was kept, or compute it from its frames again."""
        if (mean := self._means.pop(id(group), None)) is not None:
            self._kept_bytes -= mean.sum.nbytes
            return mean
        mean = self.sums(group).mean_frame(narrow=not self._large)
        self.release()
        return mean

    def release(self) -> None:
        """Release the memory of the sums; those that were returned become invalid."""
        self._sums = None
        if self._large:
            return_large_arrays()

    def leave_out_groups(self, reasons: Sequence[tuple[FrameGroup, DiagnosticKind, str]]) -> None:
        """Leave groups that were read out of the frames, and announce that the others will be read again."""
        groups = [group for group, _, _ in reasons]
        unwanted = {id(group) for group in groups}
        sources = {id(source) for group in groups for source in group.frames}
        left = tuple(group for group in self.frames.groups if id(group) not in unwanted)
        self.rejected += [
            kind(f"{source.name}: {reason}") for group, kind, reason in reasons for source in self.used_sources(group)
        ]
        for group in groups:
            del self.counts[id(group)]
        self.used_frames = [entry for entry in self.used_frames if id(entry.source) not in sources]
        self.frames = replace(self.frames, groups=left)
        self.expect(self.frames.frame_count)

    def watch(self, replacement: PixelReplacement) -> None:
        """Keep the numbers of these pixels, and of their sources, of the groups that are read from now on."""
        self._watched = distinct(self._places(replacement))

    def _places(self, replacement: PixelReplacement) -> NDArray[np.int64]:
        cols = self._shape[1]
        return np.concatenate([row * cols + col for row, col in (replacement.bad, replacement.sources)])

    def replaced_numbers(self, group: FrameGroup, replacement: PixelReplacement) -> ReplacedNumbers:
        """Return the numbers of pixels, and of those that replace them, of the used frames of a group.

        Those that are known are not read again.
        """
        known = self._known.get(id(group))
        if known is None or known.replacement is not replacement:
            if not self._moves or self._moves[0].replacement is not replacement:
                self._moves = [_Move(replacement, self._places(replacement))]
            known = self._known[id(group)] = self._numbers_of(group, known)
        n = len(replacement.bad_row)
        return ReplacedNumbers(known.numbers[:, :n], known.numbers[:, n:])

    def _numbers_of(self, group: FrameGroup, known: _KnownNumbers | None) -> _KnownNumbers:
        """Return the numbers of a group for the replacement of `_moves`; those that are known are not read again."""
        replacement, at = self._moves[0].replacement, self._moves[0].at
        if known is None:
            return _KnownNumbers(replacement, at, self._read_numbers(group, at))
        move = next((one for one in self._moves if one.before is known.at), None)
        if move is None:  # the same for all groups with numbers at these places
            order = np.argsort(known.at)
            place = order[np.minimum(np.searchsorted(known.at, at, sorter=order), len(order) - 1)]
            move = _Move(replacement, at, known.at, place, np.flatnonzero(known.at[place] != at))
            self._moves.append(move)
        numbers = known.numbers.take(move.place, axis=1)
        if len(move.unknown):
            numbers[:, move.unknown] = self._read_numbers(group, at[move.unknown])
        return _KnownNumbers(replacement, at, numbers)

    def _read_numbers(self, group: FrameGroup, at: NDArray[np.int64]) -> NDArray[np.uint16]:
        row, col = np.divmod(at, self._shape[1])
        return np.array(self._in_threads(self.used_sources(group), partial(numbers_at, row=row, col=col)), np.uint16)

    def replace_pixels(self, replacement: PixelReplacement) -> None:
        """Replace pixels in all frames that were read; their sums, counts and mean frames become those without them."""
        before, self.frames = self.frames, repaired(self.frames, replacement)
        own, other = replacement.bad, replacement.sources
        totals = {id(entry.source): entry.total for entry in self.used_frames}
        self.used_frames = []
        for old, new in zip(before.groups, self.frames.groups, strict=True):
            numbers = self.replaced[id(new)] = self.replaced_numbers(old, replacement)
            used = self._used[id(new)] = self._used.pop(id(old))
            self._highest[id(new)] = self._highest.pop(id(old))
            self.counts[id(new)] = self._moved_counts(self.counts.pop(id(old)), len(old), own, numbers)
            if (mean := self._means.pop(id(old), None)) is not None:
                mean.sum[own] = mean.sum[other]
                self._means[id(new)] = mean
            more = numbers.other.sum(axis=1, dtype=np.int64) - numbers.own.sum(axis=1, dtype=np.int64)
            self.used_frames += [
                UsedFrame(new.frames[i], totals[id(old.frames[i])] + n)
                for i, n in zip(used, more.tolist(), strict=True)
            ]
        self._known.clear()
        self._moves.clear()

    def _moved_counts(
        self, counts: Counts, frames: int, own: tuple[NDArray[np.int64], NDArray[np.int64]], numbers: ReplacedNumbers
    ) -> Counts:
        """Return the counts of the sampled pixels after some are replaced."""
        rows, cols = sample_grid(self._shape, frames)
        times = np.bincount(rows.ravel(), minlength=self._shape[0])[own[0]]
        times = times * np.bincount(cols.ravel(), minlength=self._shape[1])[own[1]]
        labels = self.tile[own[0] % self.tile.shape[0], own[1] % self.tile.shape[1]]
        parts = []
        for label in range(int(self.tile.max()) + 1):
            chosen = np.flatnonzero((labels == label) & (times > 0))
            codes, found = channel_counts(counts, label)
            full = np.zeros(1 << 16, np.int64)
            full[codes] = found
            weight = np.broadcast_to(times[chosen], (len(numbers.own), len(chosen)))
            np.add.at(full, numbers.own[:, chosen], -weight)
            np.add.at(full, numbers.other[:, chosen], weight)
            left = np.flatnonzero(full > 0)
            parts.append(np.column_stack([np.full(len(left), label), left, full[left]]))
        return np.concatenate(parts)

    def used_sources(self, group: FrameGroup) -> list[FrameSource]:
        """Return the frames of a group that entered its sums, in their order."""
        return [group.frames[i] for i in self._used[id(group)]]

    def each(self, sources: Iterable[FrameSource], rows: slice) -> list[NDArray[np.unsignedinteger]]:
        """Return successive rows of each frame, in the order of the frames; they are read in threads."""
        first, last, _ = rows.indices(self._shape[0])

        def result(source: FrameSource) -> NDArray[np.unsignedinteger]:
            stored = source.open_rows()
            if stored is None:
                return source.read()[rows].copy()
            out = np.empty((last - first, self._shape[1]), np.uint16)
            stored.read_rows(first, out)
            return out

        return self._in_threads(sources, result)

    def each_in_strips(
        self, sources: Iterable[FrameSource], function: Callable[[NDArray[np.unsignedinteger]], T]
    ) -> list[list[T]]:
        """Return a function of each strip of each frame, in the order of the frames.

        Strips are successive rows, a multiple of the tile's. Frames are read, and the function called, in threads. The
        memory of a strip is used again: the result must not view it.
        """
        step = self.tile.shape[0]
        height = max(_STRIP_BYTES // (2 * max(self._shape[1], 1) * step), 1) * step

        def result(source: FrameSource) -> list[T]:
            stored = source.open_rows()
            starts = range(0, self._shape[0], height)
            if stored is None:
                dn = source.read()
                return [function(dn[first : first + height]) for first in starts]
            buffer, found = np.empty((min(height, self._shape[0]), self._shape[1]), np.uint16), []
            for first in starts:
                part = buffer[: self._shape[0] - first]
                stored.read_rows(first, part)
                found.append(function(part))
            return found

        return self._in_threads(sources, result)

    def _in_threads(self, sources: Iterable[FrameSource], result: Callable[[FrameSource], T]) -> list[T]:
        """Return a function of each frame, called in threads where that is safe."""
        futures = []
        for source in sources:
            if source.thread_safe:
                futures.append(self._threads.submit(result, source))
            else:
                futures.append(Future())
                futures[-1].set_result(result(source))
        return [future.result() for future in futures]

    def _check_unchanged(self, group: FrameGroup, first: FirstPass) -> None:
        """Raise an error if a frame of the checkpoint has changed; frames are read where the stamp does not tell."""
        doubtful = [
            (source, known.sha256)
            for source, known in zip(group.frames, first.identities, strict=False)
            if known.stamp is None or known.stamp != file_stamp(source.path)
        ]
        reads = self._read_ahead(((source, 0) for source, _ in doubtful), identify=True)
        for (source, sha256), read in zip(doubtful, reads, strict=True):
            if read.identity is None or read.identity.sha256 != sha256:
                raise FileError(
                    source.name,
                    "the frame has changed since its sums were saved",
                    hint="Remove the checkpoint folder and start again",
                )

    def _new_then_screen(self, group: FrameGroup, first: FirstPass) -> Iterator[_Read]:
        """As `_new`; when all are read, start to screen them, while the last ones are summed."""
        yield from self._new(group, first)
        if not first.screened:
            rows, cols = sample_grid(self._shape, len(group))
            labels = self.tile[rows % self.tile.shape[0], cols % self.tile.shape[1]]
            samples, dark = list(first.samples), group.kind == "dark"
            self._screening = computed_beside(self._threads, screen_frames, samples, labels, self._dark_dn, dark=dark)

    def _screen(self, group: FrameGroup, first: FirstPass, sums: FrameSums, *, variance: bool) -> None:
        """Leave near copies and outlier frames out of a group's sums.

        Raises
        ------
        LightFades
            If the light of the group fades, so that its frames are several levels.
        """
        if group.kind == "light":
            means = np.array([float(sample.mean()) for sample in first.samples])
            if (divided := with_fading_levels(self.frames, group, first.used, means, self._dark_dn)) is not None:
                raise LightFades(divided)
        label, before = group_label(group), len(first.used)
        copies, outliers, counts = self._screening.result()
        if copies:
            names, size = [group.frames[i].name for i in first.used], first.samples[0].size
            reasons = [
                NEAR_COPY_FRAME(
                    f"{names[place]} repeats {names[original]}: {differ} of {size} sampled pixels differ ({label})",
                    differ,
                )
                for place, (original, differ) in copies.items()
            ]
            self._leave_out(first, copies, reasons)
        if outliers:
            n = len(first.used)
            named = [(group.frames[first.used[place]].name, reason) for place, reason in outliers.items()]
            if 2 * len(outliers) >= n:
                shown = ", ".join(name for name, _ in named[:3]) + (f" and {len(named) - 3} more" * (len(named) > 3))
                raise NO_MAJORITY.error(
                    f"{shown} {'' if n == 2 else f'of {n} '}differ from each other far beyond noise, and there is no "
                    f"majority that shows which are broken ({named[0][0]}: {named[0][1]})",
                    where=f"{self.frames.source}: {label}",
                    hint="Remove the broken frames, or correct what is listed as one setting",
                )
            turned = self._turned(group, first, outliers)
            reasons = [
                TURNED_FRAME(f"{name} is {turned[place]} relative to the other {label}")
                if place in turned
                else reason.within(f"{name} differs from the other {label}")
                for place, (name, reason) in zip(outliers, named, strict=True)
            ]
            self._leave_out(first, outliers, reasons)
        if len(first.used) < before:
            self.expect(len(first.used))
            self._add(sums.clear(), self._read_ahead((group.frames[i], 0) for i in first.used), variance=variance)
        first.counts = counts
        first.screened, first.samples = True, []

    def _turned(self, group: FrameGroup, first: FirstPass, outliers: Collection[int]) -> dict[int, str]:
        """Return how outlier frames of a group are mirrored or rotated, by their place."""
        others = [group.frames[i] for place, i in enumerate(first.used) if place not in outliers]
        found = {place: self.how_turned([group.frames[first.used[place]]], others) for place in outliers}
        return {place: how for place, how in found.items() if how is not None}

    def how_turned(self, frames: Sequence[FrameSource], others: Sequence[FrameSource]) -> str | None:
        """Return how frames are mirrored or rotated relative to others, or None; a few of each are read again."""
        read = [[middle(each.read(), self.tile.shape) for each in part[:MOST_COMPARED]] for part in (frames, others)]
        return how_turned(read[0], read[1], self.tile.shape)

    def _leave_out(self, first: FirstPass, places: Collection[int], reasons: Sequence[Diagnostic]) -> None:
        left = [place for place in range(len(first.used)) if place not in places]
        first.used, first.digests = [first.used[i] for i in left], [first.digests[i] for i in left]
        first.samples = [first.samples[i] for i in left]
        self._reject(first, *reasons)

    def _reject(self, first: FirstPass, *reasons: Diagnostic) -> None:
        first.rejected += reasons
        self.rejected += reasons

    def _new(self, group: FrameGroup, first: FirstPass) -> Iterator[_Read]:
        """Read the remaining frames of a group in the first pass, and leave repeats out."""
        for read in islice(self._first_pass, len(group) - first.read):
            if read.identity is not None:
                first.identities.append(read.identity)
            assert read.sample is not None
            original = self._repeated(read, read.sample, group, first)
            if original is None:
                first.used.append(first.read)
                first.samples.append(read.sample)
                first.read += 1
                yield read
            else:
                text = f"{read.source.name} repeats {original} pixel for pixel ({group_label(group)})"
                self._reject(first, REPEATED_FRAME(text))
                first.read += 1
                self._count(1)

    def _add(
        self,
        sums: FrameSums,
        reads: Iterable[_Read],
        group: FrameGroup | None = None,
        first: FirstPass | None = None,
        *,
        variance: bool,
        highest: int | None = None,
    ) -> None:
        """Add frames, of which the largest number may be known, and save the sums of the first pass now and then."""
        left = iter(reads)
        # Sums that are saved need the squares of the pixels.
        squares = variance or self._checkpoint is not None
        following = list(islice(left, 1))
        while batch := self._batch(following, left):
            following = [] if squares else list(islice(left, 1))
            numbers = [read.dn for read in batch]
            if squares or following:
                sums.add(numbers)
            else:
                sums.add_last(numbers, highest)
            names = [read.source.name for read in batch]
            del batch, numbers  # free the frames before the next ones are read
            for name, top in zip(names, sums.highest[-len(names) :], strict=True):
                if top > self.white:
                    bits = self.frames.bits
                    raise FileError(
                        name,
                        f"the frame holds {top} DN, above {self.white} DN, the full scale of {bits} bits",
                        hint="Correct the bits of the protocol",
                    )
                self._count(1)
            if group is not None and first is not None and self._checkpoint is not None and self._checkpoint.due():
                self._checkpoint.save(group, sums, first)

    def _batch(self, following: list[_Read], left: Iterator[_Read]) -> list[_Read]:
        """Return the frames of the next pass: at most `_open`, of which at most `_batch_frames` are in memory."""
        batch, held = [], 0
        for read in chain(following, left):
            batch.append(read)
            held += not isinstance(read.dn, StoredRows)
            if len(batch) == self._open or held == self._batch_frames:
                break
        return batch

    def _count(self, frames: int) -> None:
        with self._counting:  # groups may be read in several threads
            for _ in range(frames):
                self._done += 1
                if self._progress is not None:
                    self._progress(self._done, self._expected)

    def _read_ahead(
        self, sources: Iterable[tuple[FrameSource, int]], identify: bool = False
    ) -> Generator[_Read, None, None]:
        """Yield the frames in order, read in threads where that is safe.

        Each source comes with the number of frames of its group, or 0 if it need not be sampled.
        """
        pending: deque[Future[_Read]] = deque()
        for source, group_size in sources:
            if source.thread_safe:
                pending.append(self._threads.submit(self._checked, source, group_size, identify))
            else:
                pending.append(Future())
                pending[-1].set_result(self._checked(source, group_size, identify))
            if len(pending) > (self._ahead if source.thread_safe else min(self._ahead, _AHEAD_UNSAFE)):
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()

    def _checked(self, source: FrameSource, group_size: int = 0, identify: bool = False) -> _Read:
        stamp = file_stamp(source.path) if identify else None
        if not identify and (opened := source.open_rows()) is not None:
            return _Read(source, opened, self._sample(opened, group_size))
        dn = source.read()
        if dn.shape != self._shape or dn.dtype not in (np.uint8, np.uint16):
            raise FileError(
                source.name,
                f"the frame is {dn.shape} of {dn.dtype}, but the others are {self._shape} of uint16",
                hint="Remove it, or calibrate frames of one size",
            )
        return _Read(source, dn, self._sample(dn, group_size), identity(stamp, dn) if identify else None)

    def _sample(self, dn: _Numbers, group_size: int) -> NDArray[np.uint16] | None:
        """Return the sampled pixels of a frame, one of so many."""
        if not group_size:
            return None
        rows, cols = sample_grid(self._shape, group_size)
        if isinstance(dn, StoredRows):
            return dn.take_rows(rows.ravel())[:, cols.ravel()]
        return dn[rows, cols].astype(np.uint16)

    def _repeated(self, read: _Read, sample: NDArray[np.uint16], group: FrameGroup, first: FirstPass) -> str | None:
        """Return the name of an earlier frame of the group with the same pixels; the samples are compared first."""
        digest = hashlib.sha256(sample.tobytes()).hexdigest()
        candidates = [group.frames[i] for i, other in zip(first.used, first.digests, strict=True) if other == digest]
        # Frames that are clipped, or whose noise is far below a digital number, may repeat; any other two differ.
        if (
            candidates
            and self._clipped_fraction(dn := read.dn_values(), group) <= 0.5
            and self._equal_fraction(dn) < EQUAL_NUMBERS
        ):
            for candidate in candidates:
                if np.array_equal(self._checked(candidate).dn_values(), dn):
                    return candidate.name
        first.digests.append(digest)
        return None

    def _equal_fraction(self, dn: NDArray[np.unsignedinteger]) -> float:
        """Return the fraction of pixels at the most frequent number of their channel."""
        height, width = self.tile.shape
        equal = 0
        for label in range(int(self.tile.max()) + 1):
            parts = [dn[r::height, c::width].ravel() for r, c in np.argwhere(self.tile == label)]
            equal += int(np.bincount(np.concatenate(parts)).max())
        return equal / dn.size

    def _clipped_fraction(self, dn: NDArray[np.unsignedinteger], group: FrameGroup) -> float:
        """Return the fraction of pixels at 0, or of a flat field's at the highest number of the channel."""
        height, width = self.tile.shape
        clipped = 0
        for label in range(int(self.tile.max()) + 1):
            parts = [dn[r::height, c::width] for r, c in np.argwhere(self.tile == label)]
            top = max(int(part.max(initial=1)) for part in parts) if group.kind == "light" else self.white
            clipped += sum(int(np.count_nonzero((part == 0) | (part >= top))) for part in parts)
        return clipped / dn.size
