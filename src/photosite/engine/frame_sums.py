"""Exact integer sums over a stack of frames, per pixel and per label.

All statistics that calibration needs of a stack are polynomials of second order in its digital numbers. Integer sums
hold them without rounding, so that results do not depend on the order of frames or on how a stack was split and merged.
A *label* is an integer that a repeating tile assigns to each pixel, such as the index of its color channel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import groupby, islice
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F64, I64, carray, compiled, pointer, prefetch
from photosite.engine.lazy_maps import LazyMap
from photosite.engine.map_statistics import label_pixels
from photosite.engine.pair_sums import LabelClips, PairSums, WatchedPixels, add_pairs_of_files, copy_watched
from photosite.engine.run_lanes import BAND, LANES, add_lanes, copy_run, lane_clips, lane_squares
from photosite.engine.threads import parallel_for, thread_count

MOST_FRAMES = 1 << 15
"""Largest number of frames in one `FrameSums`; n * sum(y^2) of 16-bit numbers then stays below 2^62."""

_BATCH_BYTES = 1 << 28
_BATCH_FRAMES = 16
"""Frames of an iterable that are added together; fewer if they are large."""

_Ints = NDArray[Any]
"""An array of an integer type; numba compiles for the type of the argument."""

RUN = 4096
"""Largest number of pixels in a run."""

_READ_BYTES = 1 << 21
"""Bytes of rows of all frames that a thread reads at a time, so that they stay in the cache."""

_FEW_VALUES = 1 << 18
"""Values of a mean frame that one thread computes."""

_TOGETHER = 8
"""Frames added to the sums at once."""

_NARROW = 23_170
"""The largest number for which eight squares sum to less than 2^32."""

_NO_NUMERATORS = np.zeros((0, 0), np.uint32)

# Unsigned: numba tests whether a signed index counts from the end, which prevents vectorization.
_TWO = np.uint64(2)
_BLOCK, _LINE = np.uint64(64), np.uint64(16)  # pairs of pixels: per prefetch block, per cache line
_LOW_16, _16 = np.uint32(0xFFFF), np.uint32(16)
_R1, _R2, _R3, _R4, _R5, _R6, _R7 = (np.uint64(k * RUN) for k in range(1, _TOGETHER))


@dataclass(frozen=True)
class LabelTotals:
    """Exact totals of one label over a stack of n frames.

    S is the sum of a pixel over the frames, T the sum of a frame over the pixels.
    """

    # Number of each
    frames: int
    pixels: int
    # Sum of all digital numbers, and of their squares
    total: int
    squares: int
    # Sum over pixels of S^2, and over frames of T^2
    pixel_squares: int
    frame_squares: int
    # Number of digital numbers at or below the lower clip, and at or above the upper clip
    low: int
    high: int
    # Variance over pixels of the per-pixel temporal variance, in floating point, for uncertainties; 0 for one frame or
    # one pixel
    variance_spread: float

    def with_replaced(
        self, frame_totals: Sequence[int], chosen: I64, old: _Ints, new: _Ints, black: int, white: int
    ) -> tuple[LabelTotals, list[int]]:
        """Return the totals after chosen columns of numbers (frames, n) are replaced, and those of each frame.

        `frame_totals` are those of the label in each frame; `black` and `white` the clips.

        Examples
        --------
        >>> stack = np.array([[[1, 7, 4]], [[3, 7, 6]]], np.uint16)
        >>> sums = FrameSums((1, 3), white=7).add(stack)
        >>> (totals,), frames = sums.label_totals(), sums.label_frame_totals()[:, 0].tolist()
        >>> found, _ = totals.with_replaced(frames, np.array([0]), stack[:, 0, 1:2], stack[:, 0, :1], 0, 7)
        >>> stack[:, :, 1] = stack[:, :, 0]
        >>> found == FrameSums((1, 3), white=7).add(stack).label_totals()[0]
        True
        """
        n, pixels = self.frames, self.pixels
        sums, squares = np.zeros((2, 2, len(chosen)), np.int64)
        more, clipped = np.zeros(n, np.int64), np.zeros(2, np.int64)
        _replaced_sums(chosen, old, new, black, white, sums, squares, more, clipped)
        moved = [total + change for total, change in zip(frame_totals, more.tolist(), strict=True)]
        found = replace(
            self,
            total=sum(moved),
            squares=self.squares + _exact_sum(squares[1] - squares[0]),
            pixel_squares=self.pixel_squares + _exact_sum((sums[1] - sums[0]) * (sums[1] + sums[0])),
            frame_squares=sum(total**2 for total in moved),
            low=self.low + int(clipped[0]),
            high=self.high + int(clipped[1]),
        )
        if n < 2 or pixels < 2:
            return found, moved
        before, after = (n * squares - sums * sums) / (n * (n - 1.0))
        of_squares = self.variance_spread * (pixels - 1) + pixels * self.temporal_variance**2
        of_squares += float((after**2).sum() - (before**2).sum())
        spread = (of_squares - pixels * found.temporal_variance**2) / (pixels - 1)
        return replace(found, variance_spread=max(spread, 0.0)), moved

    @property
    def mean(self) -> float:
        """Mean digital number."""
        return self.total / (self.frames * self.pixels)

    @property
    def temporal_variance(self) -> float:
        """Mean over pixels of the unbiased temporal variance, shifts of whole frames included."""
        n, pixels = self.frames, self.pixels
        return (n * self.squares - self.pixel_squares) / (n * (n - 1) * pixels)

    @property
    def pixel_variance(self) -> float:
        """Unbiased temporal variance without shifts of whole frames (unstable lamp or black level).

        It is the residual of the two-way analysis of variance, pixels by frames. For two frames it is that of EMVA 1288
        R4.0: half of the mean squared difference minus half of the squared mean difference.
        """
        n, pixels = self.frames, self.pixels
        within = n * pixels * self.squares - pixels * self.pixel_squares
        return (within - n * self.frame_squares + self.total * self.total) / (n * pixels * (n - 1) * (pixels - 1))

    @property
    def spatial_variance(self) -> float:
        """Unbiased variance over pixels of the mean frame, which includes temporal noise / n."""
        n, pixels = self.frames, self.pixels
        return (pixels * self.pixel_squares - self.total * self.total) / (n * n * pixels * (pixels - 1))

    @property
    def frame_mean_variance(self) -> float:
        """Unbiased variance of the frame means over frames."""
        n, pixels = self.frames, self.pixels
        return (n * self.frame_squares - self.total * self.total) / (n * (n - 1) * pixels * pixels)


@dataclass(frozen=True, eq=False)
class MeanFrame(LazyMap):
    """The mean of a stack as a map, stored as the exact sum in the smallest integer type."""

    sum: NDArray[np.unsignedinteger]  # (rows, cols) uint16 or uint32
    count: int
    labels: I64  # repeating tile of labels

    @property
    def shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """Number of rows and columns."""
        return self.sum.shape

    def __getitem__(self, part: Any, /) -> F64:
        some = np.ascontiguousarray(self.sum[part])
        if some.size < _FEW_VALUES or some.ndim != 2:
            return np.asarray(np.divide(some, float(self.count), dtype=np.float64))
        return _filled(None, some.shape, mean_map, some, self.count)

    def plane(self, site: tuple[int, int], shape: tuple[int, ...]) -> MeanFrame:
        """Return the plane of a site of the labels' tile, with its own memory, in the smallest integer type."""
        part = self.sum[site[0] :: self.labels.shape[0], site[1] :: self.labels.shape[1]][: shape[0], : shape[1]]
        dtype = np.uint16 if int(part.max(initial=0)) < 1 << 16 else np.uint32
        return MeanFrame(part.astype(dtype), self.count, self.labels[site[0] :, site[1] :][:1, :1])


class PixelVariances(NamedTuple):
    """The variance of each pixel: whole numbers over a divisor where that is faster, else floating point over 1."""

    values: NDArray[np.uint32] | F64
    divisor: float


class FrameRows(Protocol):
    """A frame of uint16 of which some rows are read at a time, by any thread, such as from a file."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""

    @property
    def place(self) -> tuple[int, int] | None:
        """Descriptor of an open file, and position of the first pixel there, of rows without gaps; else None."""

    def read_rows(self, first: int, out: NDArray[np.uint16], /) -> None:
        """Read successive rows into a C-contiguous array (n, cols)."""


Frame = NDArray[np.unsignedinteger] | FrameRows


def _filled(out: F64 | None, shape: tuple[int, ...], fill: Callable[..., None], *arguments: object) -> F64:
    """Fill a map by a kernel, the given one or a new one, and return it."""
    if out is None:
        out = np.empty(shape)
    elif out.shape != shape or out.dtype != np.float64:
        raise ValueError(f"out must be {shape} of float64, got {out.shape} of {out.dtype}")
    fill(*arguments, out)
    return out


class _LabelSquares(NamedTuple):
    """Results of `label_squares`."""

    exact: NDArray[np.uint64]
    spread: F64

    @classmethod
    def zeros(cls, bands: int, labels: int) -> _LabelSquares:
        """Return arrays of zeros, which the kernels add to."""
        return cls(np.zeros((bands, labels, 3), np.uint64), np.zeros((bands, labels)))


class FrameSums:
    """Exact count, sum and sum of squares per pixel of a stack of frames.

    It takes 12 bytes per pixel, or 2 to 4 where all frames are added at once by `add_last`, and two numbers per frame
    and label. With at most 32 768 frames of 16 bits, a pixel's sum stays below 2^31, its sum of squares below 2^47, and
    n sum(y^2), used for the variance, below 2^62.

    - `shape`: (rows, cols) of a frame.
    - `labels`: (tile rows, tile cols) repeating tile of labels, integers from 0; None is one label for all pixels.
    - `black`, `white`: Digital numbers at or below `black`, or at or above `white`, are counted as clipped.

    Raises `ValueError` if the tile has more than 64 columns.

    Examples
    --------
    >>> stack = np.array([[[1, 7]], [[3, 7]]], dtype=np.uint16)
    >>> sums = FrameSums((1, 2)).add(stack)
    >>> sums.count, sums.mean().tolist(), sums.variance().tolist()
    (2, [[2.0, 7.0]], [[2.0, 0.0]])
    >>> sums.label_totals()[0].temporal_variance
    1.0
    """

    def __init__(
        self, shape: tuple[int, int], labels: NDArray[np.integer] | None = None, *, black: int = 0, white: int = 65_535
    ) -> None:
        self.shape = shape
        self.labels = np.zeros((1, 1), np.int64) if labels is None else np.asarray(labels, np.int64)
        if self.labels.shape[1] > LANES:
            raise ValueError(f"labels must have at most {LANES} columns, got {self.labels.shape[1]}")
        self.black, self.white = black, white
        self.count = 0
        self._sum: NDArray[np.unsignedinteger] | None = None
        self._taken = False
        """Whether a mean frame has the memory of `sum`."""
        self._squares: NDArray[np.uint64] | None = None
        self._label_squares: _LabelSquares | None = None
        self.highest: list[int] = []
        """Largest digital number of each frame, in the order of addition."""
        n_labels = int(self.labels.max()) + 1
        self._clipped = np.zeros((n_labels, 2), np.int64)
        self._frame_totals: list[NDArray[np.uint64]] = []
        self._watched = np.zeros(0, np.int64)
        self._watched_numbers: list[NDArray[np.uint16]] = []

    def watch(self, at: I64) -> None:
        """Copy the numbers of some pixels while frames are added, until other ones are given.

        `at` are their ascending numbers in the order of the rows.

        Examples
        --------
        >>> sums = FrameSums((1, 3))
        >>> sums.watch(np.array([0, 2]))
        >>> sums.add(np.array([[1, 7, 4]], np.uint16)).watched_numbers().tolist()
        [[1, 4]]
        """
        self._watched = at

    def watched_numbers(self) -> NDArray[np.uint16]:
        """Return (frames, n) the numbers of the watched pixels."""
        return np.concatenate([np.zeros((0, len(self._watched)), np.uint16), *self._watched_numbers])

    @property
    def sum(self) -> NDArray[np.unsignedinteger]:
        """The (rows, cols) sum."""
        if self._sum is None:
            self._sum = np.zeros(self.shape, np.uint32)
        return self._sum

    @sum.setter
    def sum(self, values: NDArray[np.unsignedinteger]) -> None:
        self._sum, self._taken = values, False

    @property
    def sum_of_squares(self) -> NDArray[np.uint64]:
        """The (rows, cols) sum of squares.

        Raises `ValueError` after `add_last`.
        """
        if self._label_squares is not None:
            raise ValueError("the squares of single pixels are not kept after add_last")
        if self._squares is None:
            self._squares = np.zeros(self.shape, np.uint64)
        return self._squares

    def clear(self) -> FrameSums:
        """Remove all frames, reusing the memory, which is faster than allocating it; return self.

        The maps keep their content until the next frames overwrite it.
        """
        self.count = 0
        self.highest = []
        self._clipped = np.zeros_like(self._clipped)
        self._frame_totals, self._watched_numbers = [], []
        self._label_squares = None
        return self

    def add(self, frames: NDArray[np.unsignedinteger] | Iterable[Frame]) -> FrameSums:
        """Add a frame (rows, cols), a stack (frames, rows, cols) or an iterable of frames; return self.

        A stack or a list is added at about the speed of memory. Single frames are slower, because the sums are read and
        written for each. Frames in files (`FrameRows`) are read into the cache, a few rows of all at a time.

        Raises `ValueError` if a frame has another size, is not uint8 or uint16, or there are more than 32 768 frames.
        Earlier frames may have been added.
        """
        if isinstance(frames, np.ndarray) and frames.ndim == 2:
            frames = (frames,)
        if isinstance(frames, np.ndarray | Sequence):
            for batch in _by_kind(frames):
                self._add_batch(batch, self.white)
            return self
        left = iter(frames)
        pixels = max(self.shape[0] * self.shape[1], 1)
        together = max(1, min(_BATCH_FRAMES, _BATCH_BYTES // (2 * pixels)))
        while batch := list(islice(left, together)):
            for part in _by_kind(batch):
                self._add_batch(part, self.white)
            del batch, part  # free it before the next batch is read
        return self

    def add_last(self, frames: Sequence[Frame], full_scale: int | None = None) -> FrameSums:
        """Add the last frames, and compute the squares of `label_totals` in the same pass; return self.

        This is faster than `add` and `label_totals`, because the squares of single pixels are neither stored nor read
        again. `sum_of_squares`, `variance`, `state` and `merge` are not available afterwards, and no frames can be
        added. Where all frames are in files, `sum` may have 16 bits, and `mean_frame` takes it over. `full_scale` is
        the largest number that is expected, `white` if it is None; the sums are right if the frames exceed it.

        Raises `ValueError` as `add` does, or if there are no frames.

        Examples
        --------
        >>> stack = np.array([[[1, 7]], [[3, 7]]], dtype=np.uint16)
        >>> FrameSums((1, 2)).add_last(stack).label_totals() == FrameSums((1, 2)).add(stack).label_totals()
        True
        """
        if not len(frames):
            raise ValueError("frames must not be empty")
        *before, last = _by_kind(frames)
        for batch in before:
            self._add_batch(batch, self.white)
        self._add_batch(last, self.white if full_scale is None else full_scale, last=True)
        return self

    def numerators(self, frames: Sequence[Frame], full_scale: int) -> NDArray[np.uint32] | None:
        """Return (rows, cols) n (n - 1) times the variance of each pixel over the n frames of a stack, which is exact.

        `sum` is overwritten. None unless all frames are in files and few enough for sums of 16 bits: `variance` of
        frames that are added takes three times as long.

        Raises `ValueError` as `add` does.
        """
        if any(isinstance(frame, np.ndarray) for frame in frames) or not frames:
            return None
        out = np.empty(self.shape, np.uint32)
        return out if self.clear()._add_batch(frames, full_scale, last=True, numerators=out) else None

    def _widen(self) -> None:
        """Replace a sum of 16 bits, whose content is lost, or one that a mean frame has taken over."""
        if self._sum is None or self._sum.dtype != np.uint32 or self._taken:
            self.sum = self.sum.astype(np.uint32) if self.count else np.empty(self.shape, np.uint32)

    def _add_batch(
        self,
        frames: Sequence[Frame],
        full_scale: int,
        *,
        last: bool = False,
        numerators: NDArray[np.uint32] = _NO_NUMERATORS,
    ) -> bool:
        """Add frames that are all in memory, or all in files; return whether numerators were filled."""
        for frame in frames:
            dtype = frame.dtype if isinstance(frame, np.ndarray) else np.uint16
            if frame.shape != self.shape or dtype not in (np.uint8, np.uint16):
                raise ValueError(f"frames must be {self.shape} of uint8 or uint16, got {frame.shape} of {dtype}")
        if self.count + len(frames) > MOST_FRAMES:
            raise ValueError(f"a stack must have at most {MOST_FRAMES} frames")
        held = [frame for frame in frames if isinstance(frame, np.ndarray)]
        stored = [frame for frame in frames if not isinstance(frame, np.ndarray)]
        only = last and self.count == 0
        # Of frames in memory too, it would double the time of compilation.
        narrow = only and not held and len(frames) * full_scale < 1 << 16
        if narrow:
            self._sum = None  # released first
            self.sum = np.empty(self.shape, np.uint16)
        else:
            self._widen()
        squares = np.empty((0, 0), np.uint64) if only else self.sum_of_squares
        bands, n_labels = -(-self.shape[0] // BAND), len(self._clipped)
        totals = np.zeros((bands, len(frames), n_labels), np.uint64)
        clipped = np.zeros((bands, n_labels, 2), np.int64)
        highest = np.zeros((bands, len(frames)), np.uint32)
        of_labels = _LabelSquares.zeros(bands, n_labels)
        settings = SumSettings(self.labels, self.black, self.white, self.count, last)
        into = StackSums(self.sum, squares, totals, clipped, highest, *of_labels)
        watched = WatchedPixels.of(self._watched, self.shape, len(frames))
        filled = False
        if stored:
            filled = _add_stored(stored, full_scale, settings, into, watched, numerators)
        else:
            if len({frame.dtype for frame in held}) > 1:
                held = [frame.astype(np.uint16, copy=False) for frame in held]
            held = [np.ascontiguousarray(frame) for frame in held]
            for frame, numbers in zip(held, watched.numbers, strict=True):
                numbers[:] = frame.reshape(-1)[self._watched]
            add_frames(_pixels(held), settings, into)
        if only and stored and (top := int(highest.max())) > full_scale:
            return self._add_batch(frames, top, last=True, numerators=numerators)
        if last:
            self._label_squares = of_labels
        self._frame_totals.extend(totals.sum(axis=0))
        self._watched_numbers.append(watched.numbers)
        self._clipped += clipped.sum(axis=0)
        self.highest.extend(highest.max(axis=0).tolist())
        self.count += len(frames)
        return filled

    def state(self) -> dict[str, NDArray[np.integer]]:
        """Return the content of the sums as arrays by name, for `restore`.

        Examples
        --------
        >>> sums = FrameSums((1, 2)).add(np.array([[3, 4]], np.uint16))
        >>> FrameSums((1, 2)).restore(sums.state()).label_totals() == sums.label_totals()
        True
        """
        n_labels = len(self._clipped)
        return {
            "sum": self.sum,
            "sum_of_squares": self.sum_of_squares,
            "highest": np.array(self.highest, np.int64),
            "clipped": self._clipped,
            "frame_totals": np.array(self._frame_totals, np.uint64).reshape(-1, n_labels),
        }

    def restore(self, state: Mapping[str, NDArray[np.integer]]) -> FrameSums:
        """Replace the content by that of `state`; return self.

        Raises `KeyError` if an array is missing.
        Raises `ValueError` if the arrays have another size or other labels, or contradict each other.
        """
        frames, n_labels = state["frame_totals"].shape[0], len(self._clipped)
        shapes: dict[str, tuple[int, ...]] = {"sum": self.shape, "sum_of_squares": self.shape}
        shapes |= {"highest": (frames,), "clipped": (n_labels, 2), "frame_totals": (frames, n_labels)}
        for name, shape in shapes.items():
            if state[name].shape != shape:
                raise ValueError(f"{name} must have shape {shape}, got {state[name].shape}")
        if int(state["sum"].sum(dtype=np.uint64)) != int(state["frame_totals"].sum(dtype=np.uint64)):
            raise ValueError("the sums of the pixels and the totals of the frames differ")
        self._widen()
        self.sum[...] = state["sum"]
        self._label_squares = None
        self.sum_of_squares[...] = state["sum_of_squares"]
        self.highest = state["highest"].tolist()
        self._clipped = state["clipped"].astype(np.int64)
        self._frame_totals = list(state["frame_totals"].astype(np.uint64))
        self.count = frames
        return self

    def merge(self, other: FrameSums) -> FrameSums:
        """Return new sums over the frames of both.

        Raises `ValueError` if they differ in shape, labels or clips, or have more than 32 768 frames together.
        """
        same = (self.shape, self.black, self.white) == (other.shape, other.black, other.white)
        if not (same and np.array_equal(self.labels, other.labels)):
            raise ValueError("merged sums must have the same size, labels and clips")
        if self.count + other.count > MOST_FRAMES:
            raise ValueError(f"a stack must have at most {MOST_FRAMES} frames")
        both = FrameSums(self.shape, self.labels, black=self.black, white=self.white)
        both.count = self.count + other.count
        both.sum = self.sum + other.sum
        both._squares = self.sum_of_squares + other.sum_of_squares
        both.highest = self.highest + other.highest
        both._clipped = self._clipped + other._clipped
        both._frame_totals = self._frame_totals + other._frame_totals
        return both

    def mean(self, out: F64 | None = None) -> F64:
        """Return (rows, cols) the mean over the frames, in `out` if given."""
        return _filled(out, self.shape, mean_map, self.sum, self.count)

    def mean_frame(self, *, narrow: bool = True) -> MeanFrame:
        """Return the mean, which stays valid when the sums change; it may take over the memory of the sum.

        `narrow` is whether a sum of 32 bits is copied to one of 16 bits where that holds it.
        """
        fits = narrow and self.count * max(self.highest, default=0) < 1 << 16
        if fits and self.sum.dtype != np.uint16:
            return MeanFrame(self.sum.astype(np.uint16), self.count, self.labels)
        self._taken = True
        return MeanFrame(self.sum, self.count, self.labels)

    def variance(self, out: F64 | None = None, rows: slice = slice(None)) -> F64:
        """Return (rows, cols) the unbiased temporal variance, of a slice of the rows, in `out` if given.

        It is the integer n sum(y^2) - sum(y)^2, divided by n (n - 1).
        """
        sums, squares = self.sum[rows], self.sum_of_squares[rows]
        return _filled(out, sums.shape, variance_map, sums, squares, self.count)

    def frame_means(self) -> F64:
        """Return (frames, labels) the means of each frame, in the order of addition."""
        return np.array(self._frame_totals, dtype=np.float64) / label_pixels(self.shape, self.labels)

    def label_frame_totals(self) -> NDArray[np.uint64]:
        """Return (frames, labels) the exact sum of each frame and label, in the order of addition."""
        return np.array(self._frame_totals, np.uint64).reshape(-1, len(self._clipped))

    def frame_totals(self) -> list[int]:
        """Return the exact sum of each frame, in the order of addition."""
        return [int(labels.sum()) for labels in self._frame_totals]

    def label_totals(self) -> tuple[LabelTotals, ...]:
        """Return the exact totals of each label."""
        n = self.count
        found = self._label_squares
        if found is None:
            found = _LabelSquares.zeros(-(-self.shape[0] // BAND), len(self._clipped))
            label_squares(self.sum, self.sum_of_squares, self.labels, n, found.exact, found.spread)
        result = []
        for k, pixels in enumerate(label_pixels(self.shape, self.labels).tolist()):
            squares, s_low, s_high = (sum(map(int, found.exact[:, k, part])) for part in range(3))
            pixel_squares = s_low + (s_high << 32)
            frame_totals = [int(frame[k]) for frame in self._frame_totals]
            variance_spread = 0.0
            if n > 1 and pixels > 1:
                first = n * squares - pixel_squares
                numerators = float(found.spread[:, k].sum()) - float(first) ** 2 / pixels
                # Rounding may make it negative.
                variance_spread = max(numerators, 0.0) / (float(n * (n - 1)) ** 2 * (pixels - 1))
            result.append(
                LabelTotals(
                    frames=n,
                    pixels=pixels,
                    total=sum(frame_totals),
                    squares=squares,
                    pixel_squares=pixel_squares,
                    frame_squares=sum(total**2 for total in frame_totals),
                    low=int(self._clipped[k, 0]),
                    high=int(self._clipped[k, 1]),
                    variance_spread=variance_spread,
                )
            )
        return tuple(result)


@compiled()
def _replaced_sums(
    chosen: I64,
    old: _Ints,
    new: _Ints,
    black: int,
    white: int,
    sums: I64,
    squares: I64,
    more: I64,
    clipped: I64,
) -> None:
    """Add the sums and squares (2, n) of pixels before and after, and the changes of frames and of clipped numbers."""
    for k in range(old.shape[0]):
        for j in range(chosen.size):
            a, b = np.int64(old[k, chosen[j]]), np.int64(new[k, chosen[j]])
            sums[0, j] += a
            sums[1, j] += b
            squares[0, j] += a * a
            squares[1, j] += b * b
            more[k] += b - a
            clipped[0] += np.int64(b <= black) - np.int64(a <= black)
            clipped[1] += np.int64(b >= white) - np.int64(a >= white)


def _exact_sum(values: I64) -> int:
    """Return the sum of integers below 2^63, which may exceed them."""
    if not values.size:
        return 0
    step = max((1 << 62) // max(int(np.abs(values).max()), 1), 1)
    return sum(map(int, np.add.reduceat(values, np.arange(0, values.size, step))))


def _by_kind(frames: Iterable[Frame]) -> list[list[Frame]]:
    """Return the frames in runs that are all in memory, or all in files."""
    return [list(run) for _, run in groupby(frames, lambda frame: isinstance(frame, np.ndarray))]


def _pixels(frames: Sequence[_Ints]) -> FramePixels:
    addresses = np.array([frame.ctypes.data for frame in frames], np.int64)
    like = np.empty(0, frames[0].dtype)
    paired = like.itemsize == 2 and frames[0].shape[1] % 2 == 0 and not (addresses % 4).any()
    return FramePixels(addresses, like, bool(paired))


def _add_stored(
    frames: Sequence[FrameRows],
    full_scale: int,
    settings: SumSettings,
    into: StackSums,
    watched: WatchedPixels,
    numerators: NDArray[np.uint32],
) -> bool:
    """Add frames that are read a few rows at a time, each thread into a buffer that stays in its cache.

    Return whether numerators were filled.
    """
    rows, cols = frames[0].shape
    labels, black, white, before, last_frames = settings
    by_band = into[2:]
    if last_frames and not before and labels.shape[1] <= 2 and cols % 2 == 0:
        places = [frame.place for frame in frames]
        clips = LabelClips(labels, black, white)
        if add_pairs_of_files(places, clips, full_scale, PairSums(into.sums, *by_band, numerators), watched):
            return numerators.size > 0
        for part in by_band:  # a file cannot be read; the reads below tell why
            part[...] = 0
    height = max(_READ_BYTES // max(2 * len(frames) * cols, 1) // BAND, 1) * BAND
    unused: list[_Ints] = []

    def add(first: int) -> None:
        buffer = unused.pop() if unused else np.empty((len(frames), height, cols), np.uint16)
        last = min(first + height, rows)
        for frame, out in zip(frames, buffer, strict=True):
            frame.read_rows(first, out[: last - first])
        bands = slice(first // BAND, -(-last // BAND))
        copy_watched(buffer, last - first, first, watched)
        parts = StackSums(*(part[first:last] for part in into[:2]), *(part[bands] for part in by_band))
        add_rows(_pixels([*buffer]), settings, first, parts)
        unused.append(buffer)

    with ThreadPoolExecutor(thread_count()) as threads:
        list(threads.map(add, range(0, rows, height)))
    return False


# Kernels of `FrameSums`: several frames per pass over each run of pixels, at about the speed of memory.
#
# A run is a piece of a row that fits the inner caches. The pixels of eight frames are copied there, the extremes and
# totals of each frame are taken, and then all eight are added to the run's sums at once. The sums are read from memory
# and written once per call, however many frames are added.
#
# Label statistics of a run are first kept in *lanes*: position in the run modulo a multiple of the tile's columns.
# Lanes are adjacent in memory, so that their loops become vector instructions for any tile.
#
# Staging and prefetch need LLVM intrinsics (`jit`). A plain loop that adds one frame after another takes 1.6 to 2.0
# times as long; these kernels without the prefetch take 1.2 to 1.3 times as long (32 frames of 1024 x 3872 pixels, one
# core).


class FramePixels(NamedTuple):
    """Where the pixels of frames are."""

    addresses: I64  # (frames,) of C-contiguous pixels; numba has no arrays of arrays
    like: _Ints  # an array of the frames' dtype
    paired: bool  # 16 bits, an even number of columns, and addresses that are multiples of four


class SumSettings(NamedTuple):
    """What frames are added to, and what is counted."""

    labels: I64  # (tile rows, tile cols); at most LANES columns
    black: int
    white: int
    before: int  # number of frames in the sums; 0 overwrites their content
    last: bool  # whether these frames are the last: then `squares` is not written, but `exact` and `spread` are


class StackSums(NamedTuple):
    """The sums over frames."""

    # (rows, cols) uint32 and uint64, added to
    sums: _Ints
    squares: _Ints
    totals: _Ints  # (bands, frames, labels) uint64, zeros: becomes the total of each frame and label, by bands of rows
    clipped: _Ints  # (bands, labels, 2) int64, zeros: becomes the count at or below black, and at or above white
    highest: _Ints  # (bands, frames) uint32, zeros: becomes the largest number
    # As for `label_squares`
    exact: _Ints
    spread: F64


def add_frames(frames: FramePixels, settings: SumSettings, into: StackSums) -> None:
    """Add frames to the per-pixel sums."""
    parallel_for(_add_frames, len(into.totals), frames, settings, into)


@compiled()
def _add_frames(start: int, stop: int, frames: FramePixels, settings: SumSettings, into: StackSums) -> None:
    for band in range(start, stop):
        _add_band(frames, settings, 0, into, band)


@compiled()
def add_rows(frames: FramePixels, settings: SumSettings, start: int, into: StackSums) -> None:
    """As `add_frames` in one thread, for whole bands of rows of frames, of which the first is the row `start`."""
    for band in range(into.totals.shape[0]):
        _add_band(frames, settings, start, into, band)


@compiled()
def _add_band(frames: FramePixels, settings: SumSettings, start: int, into: StackSums, band: int) -> None:
    sums, squares, totals, clipped, highest, exact, spread = into
    labels, black, white, before, last = settings
    rows, cols = sums.shape
    tile_rows, tile_cols = labels.shape
    count = frames.addresses.size
    lanes, n = LANES // tile_cols * tile_cols, np.uint64(before + count)
    run = RUN // (2 * tile_cols) * 2 * tile_cols  # starts with the tile's first column, and with a pair
    stage = np.zeros(_TOGETHER * RUN, np.uint16)
    words = stage.view(np.uint32)
    part = np.empty(RUN, np.uint32)
    run_sums, run_squares = np.empty(RUN, np.uint32), np.empty(RUN, np.uint64)
    counts = np.zeros((2, LANES), np.uint32)
    whole, rounded = np.zeros((3, LANES), np.uint64), np.zeros(LANES)
    for r in range(band * BAND, min(rows, (band + 1) * BAND)):
        row_labels = labels[(start + r) % tile_rows]
        for c in range(0, cols, run):
            m = min(run, cols - c)
            here_sums, here_squares = sums[r, c : c + m], squares[r, c : c + m]
            if before:
                copy_run(here_sums, run_sums)
                copy_run(here_squares, run_squares)
            else:
                run_sums[:m] = 0
                run_squares[:m] = 0
            for first in range(0, count, _TOGETHER):
                present = min(_TOGETHER, count - first)
                top = np.uint32(0)
                for k in range(present):
                    lowest, high, even, odd = _stage_run(frames, first + k, r * cols + c, m, stage, words, k * RUN)
                    top = max(top, high)
                    highest[band, first + k] = max(highest[band, first + k], high)
                    if tile_cols <= 2:
                        totals[band, first + k, row_labels[0]] += np.uint64(even)
                        totals[band, first + k, row_labels[tile_cols - 1]] += np.uint64(odd)
                    else:
                        _lane_totals(stage[k * RUN : k * RUN + m], row_labels, counts, totals[band, first + k])
                    if lowest <= black or high >= white:
                        lane_clips(stage[k * RUN : k * RUN + m], row_labels, black, white, counts, clipped[band])
                for k in range(present, _TOGETHER):
                    stage[k * RUN : k * RUN + m] = 0
                if top <= _NARROW:
                    _add_narrow(stage, m, part, run_sums, run_squares)
                else:
                    _add_wide(stage, m, run_sums, run_squares)
            copy_run(run_sums[:m], here_sums)
            if last:
                lane_squares(run_sums[:m], run_squares[:m], lanes, n, whole, rounded)
            else:
                copy_run(run_squares[:m], here_squares)
        if last:
            add_lanes(whole, rounded, row_labels, lanes, exact[band], spread[band])


@compiled()
def _stage_run(
    frames: FramePixels, number: int, pixel: int, m: int, stage: _Ints, words: _Ints, at: int
) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """Copy a run of m pixels of a frame to the stage, and return its extremes and totals."""
    addresses, like = frames.addresses, frames.like
    place = pixel * like.itemsize
    here = pointer(addresses[number] + place)
    if not frames.paired:
        _copy(carray(here, m, like.dtype), stage, at)
        return _extremes_and_totals(stage, words, at, m)
    ahead = addresses[0] + place + 2 * m
    if number + 1 < addresses.size:
        ahead = addresses[number + 1] + place
    return _copy_pairs(carray(here, m // 2, np.uint32), words, at, ahead)


@compiled()
def _copy_pairs(
    source: _Ints, words: _Ints, place: int, ahead: int
) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """As `_copy` and `_extremes_and_totals` in one loop, for sources that can be read two pixels at a time.

    Meanwhile the data at the address `ahead` are prefetched: the processor predicts how a run continues, but not that
    the next run is in another frame.
    """
    lowest, highest = np.uint32(_LOW_16), np.uint32(0)
    even = odd = np.uint32(0)
    at, size = np.uint64(place) // _TWO, np.uint64(source.size)
    for first in range(np.uint64(0), size, _BLOCK):
        for line in range(_BLOCK // _LINE):
            prefetch(int(ahead + np.int64(first + line * _LINE) * 4))
        for j in range(min(_BLOCK, size - first)):
            word = source[first + j]
            words[at + first + j] = word
            a = np.uint32(word & _LOW_16)
            b = np.uint32(word >> _16)
            lowest = min(lowest, min(a, b))
            highest = max(highest, max(a, b))
            even = np.uint32(even + a)
            odd = np.uint32(odd + b)
    return lowest, highest, even, odd


@compiled()
def _copy(source: _Ints, stage: _Ints, place: int) -> None:
    for j in range(np.uint64(source.size)):
        stage[np.uint64(place) + j] = source[j]


@compiled()
def _extremes_and_totals(
    stage: _Ints, words: _Ints, place: int, pixels: int
) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """Return minimum and maximum of a staged run, and the totals of its pixels at even and odd positions.

    `words` views the stage as two pixels per word, so that a mask and a shift separate even from odd.
    """
    at, m = np.uint64(place), np.uint64(pixels)
    lowest = highest = np.uint32(stage[at])
    even = odd = np.uint32(0)
    for j in range(m // _TWO):
        word = words[at // _TWO + j]
        a = np.uint32(word & _LOW_16)
        b = np.uint32(word >> _16)
        lowest = min(lowest, min(a, b))
        highest = max(highest, max(a, b))
        even = np.uint32(even + a)
        odd = np.uint32(odd + b)
    if m % _TWO:
        last = np.uint32(stage[at + m - np.uint64(1)])
        lowest = min(lowest, last)
        highest = max(highest, last)
        even = np.uint32(even + last)
    return lowest, highest, even, odd


@compiled()
def _lane_totals(pixels: _Ints, row_labels: _Ints, counts: _Ints, totals: _Ints) -> None:
    """Add a frame's total over each label."""
    lanes = LANES // row_labels.size * row_labels.size
    size, step = np.uint64(pixels.size), np.uint64(lanes)
    sums = counts[0]
    sums[:] = 0
    for first in range(np.uint64(0), size, step):
        for lane in range(min(step, size - first)):
            sums[lane] += np.uint32(pixels[first + lane])
    for lane in range(lanes):
        totals[row_labels[lane % row_labels.size]] += np.uint64(sums[lane])


@compiled()
def _add_narrow(stage: _Ints, m: int, part: _Ints, sums: _Ints, squares: _Ints) -> None:
    """Add eight staged runs to the sums, if eight squares fit 32 bits.

    Two loops, because the widest type in a loop determines how many numbers a vector holds.
    """
    for j in range(np.uint64(m)):
        y0, y1 = np.uint32(stage[j]), np.uint32(stage[_R1 + j])
        y2, y3 = np.uint32(stage[_R2 + j]), np.uint32(stage[_R3 + j])
        y4, y5 = np.uint32(stage[_R4 + j]), np.uint32(stage[_R5 + j])
        y6, y7 = np.uint32(stage[_R6 + j]), np.uint32(stage[_R7 + j])
        sums[j] += np.uint32(y0 + y1 + y2 + y3 + y4 + y5 + y6 + y7)
        part[j] = np.uint32(y0 * y0 + y1 * y1 + y2 * y2 + y3 * y3 + y4 * y4 + y5 * y5 + y6 * y6 + y7 * y7)
    for j in range(np.uint64(m)):
        squares[j] += np.uint64(part[j])


@compiled()
def _add_wide(stage: _Ints, m: int, sums: _Ints, squares: _Ints) -> None:
    """Add eight staged runs to the sums, for any numbers."""
    for j in range(np.uint64(m)):
        y0, y1 = np.uint64(stage[j]), np.uint64(stage[_R1 + j])
        y2, y3 = np.uint64(stage[_R2 + j]), np.uint64(stage[_R3 + j])
        y4, y5 = np.uint64(stage[_R4 + j]), np.uint64(stage[_R5 + j])
        y6, y7 = np.uint64(stage[_R6 + j]), np.uint64(stage[_R7 + j])
        sums[j] += np.uint32(y0 + y1 + y2 + y3 + y4 + y5 + y6 + y7)
        squares[j] += y0 * y0 + y1 * y1 + y2 * y2 + y3 * y3 + y4 * y4 + y5 * y5 + y6 * y6 + y7 * y7


def label_squares(sums: _Ints, squares: _Ints, labels: _Ints, n: int, exact: _Ints, spread: F64) -> None:
    """Compute the squares that `LabelTotals` needs, by band of rows and label.

    - `sums`, `squares`: (rows, cols) S and Q, the sum and the sum of squares of each pixel over n frames.
    - `exact`: (bands, labels, 3) uint64, zeros: becomes the sum of Q, and those of the low and high 32 bits of S^2,
      which cannot overflow.
    - `spread`: (bands, labels), zeros: becomes the sum of (n Q - S^2)^2 in floating point.
    """
    parallel_for(_label_squares, len(exact), sums, squares, labels, n, exact, spread)


@compiled()
def _label_squares(
    start: int, stop: int, sums: _Ints, squares: _Ints, labels: _Ints, n: int, exact: _Ints, spread: F64
) -> None:
    rows = sums.shape[0]
    tile_rows, tile_cols = labels.shape
    lanes = LANES // tile_cols * tile_cols
    for band in range(start, stop):
        whole, rounded = np.zeros((3, LANES), np.uint64), np.zeros(LANES)
        for r in range(band * BAND, min(rows, (band + 1) * BAND)):
            lane_squares(sums[r], squares[r], lanes, np.uint64(n), whole, rounded)
            add_lanes(whole, rounded, labels[r % tile_rows], lanes, exact[band], spread[band])


def mean_map(sums: _Ints, n: int, out: F64) -> None:
    """Compute (rows, cols) S / n in `out`."""
    parallel_for(_mean_map, len(sums), sums, n, out)


@compiled()
def _mean_map(start: int, stop: int, sums: _Ints, n: int, out: F64) -> None:
    cols = sums.shape[1]
    for r in range(start, stop):
        for c in range(np.uint64(cols)):
            out[r, c] = np.float64(sums[r, c]) / np.float64(n)


def variance_map(sums: _Ints, squares: _Ints, n: int, out: F64) -> None:
    """Compute (rows, cols) (n Q - S^2) / (n (n - 1)) in `out`, with an exact numerator."""
    parallel_for(_variance_map, len(sums), sums, squares, n, out)


@compiled()
def _variance_map(start: int, stop: int, sums: _Ints, squares: _Ints, n: int, out: F64) -> None:
    cols = sums.shape[1]
    divisor = np.float64(n) * np.float64(n - 1)
    for r in range(start, stop):
        for c in range(np.uint64(cols)):
            s = np.uint64(sums[r, c])
            out[r, c] = np.float64(np.int64(np.uint64(n) * squares[r, c] - s * s)) / divisor
