"""Exact integer sums over a stack of frames, per pixel and per label.

Everything that calibration needs of a stack is a polynomial of second order in its digital numbers, so
integer sums hold it without rounding: the result does not depend on the order of the frames, nor on how a
stack was split and merged. A *label* is an integer that a repeating tile gives each pixel; what it stands for
(a colour channel) is the caller's business.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled

_Ints = NDArray[Any]
"""An array of the integer type that its caller allocates; numba compiles for the one that comes."""

MOST_FRAMES = 1 << 15
"""Frames that one `FrameSums` holds: n * sum(y^2) of 16-bit numbers then stays below 2^62."""

_LOW_32 = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)


@compiled()
def _add_frame(
    frame: _Ints,
    labels: _Ints,
    black: np.uint64,
    white: np.uint64,
    sums: _Ints,
    squares: _Ints,
    totals: _Ints,
    low: _Ints,
    high: _Ints,
) -> None:
    """Add one frame to the per-pixel sums, its total to each label's, and count the clipped pixels."""
    rows, cols = frame.shape
    tile_rows, tile_cols = labels.shape
    for r in range(rows):
        for phase in range(tile_cols):
            label = labels[r % tile_rows, phase]
            total = np.uint64(0)
            n_low = 0
            n_high = 0
            for c in range(phase, cols, tile_cols):
                y = np.uint64(frame[r, c])
                sums[r, c] += np.uint32(y)
                squares[r, c] += y * y
                total += y
                n_low += int(y <= black)
                n_high += int(y >= white)
            totals[label] += total
            low[label] += n_low
            high[label] += n_high


@compiled()
def _label_sums(
    sums: _Ints,
    squares: _Ints,
    labels: _Ints,
    counts: _Ints,
    totals: _Ints,
    split: _Ints,
) -> None:
    """Per label: pixels, sum of the sums, and the sums of squares in halves of 32 bits: none can overflow.

    `split[label]` is low and high half of sum(q), then low and high half of sum(S^2).
    """
    rows, cols = sums.shape
    tile_rows, tile_cols = labels.shape
    for r in range(rows):
        for phase in range(tile_cols):
            label = labels[r % tile_rows, phase]
            for c in range(phase, cols, tile_cols):
                s = np.uint64(sums[r, c])
                q = squares[r, c]
                counts[label] += 1
                totals[label] += s
                split[label, 0] += q & _LOW_32
                split[label, 1] += q >> _32
                split[label, 2] += (s * s) & _LOW_32
                split[label, 3] += (s * s) >> _32


@compiled()
def _variance_moments(
    sums: _Ints,
    squares: _Ints,
    labels: _Ints,
    n: np.uint64,
    first: NDArray[np.float64],
    second: NDArray[np.float64],
) -> None:
    """Per label, the sum of the per-pixel unbiased variances and the sum of their squares."""
    rows, cols = sums.shape
    tile_rows, tile_cols = labels.shape
    scale = 1.0 / (float(n) * float(n - np.uint64(1)))
    for r in range(rows):
        for phase in range(tile_cols):
            label = labels[r % tile_rows, phase]
            a = 0.0
            b = 0.0
            for c in range(phase, cols, tile_cols):
                s = np.uint64(sums[r, c])
                v = float(n * squares[r, c] - s * s) * scale
                a += v
                b += v * v
            first[label] += a
            second[label] += b


@dataclass(frozen=True)
class LabelTotals:
    """One label's exact totals over a stack of n frames.

    S is a pixel's sum over the frames, T a frame's sum over the pixels.

    Parameters
    ----------
    frames, pixels
        How many of each.
    total
        Sum of all digital numbers.
    squares
        Sum of all their squares.
    pixel_squares
        Sum over pixels of S^2.
    frame_squares
        Sum over frames of T^2.
    low, high
        How many digital numbers were at or below the lower clip, and at or above the upper one.
    variance_spread
        Variance over pixels of the per-pixel temporal variance (rounded: it serves uncertainties only); 0
        where there is one frame or one pixel.
    """

    frames: int
    pixels: int
    total: int
    squares: int
    pixel_squares: int
    frame_squares: int
    low: int
    high: int
    variance_spread: float

    @property
    def mean(self) -> float:
        """Mean digital number."""
        return self.total / (self.frames * self.pixels)

    @property
    def temporal_variance(self) -> float:
        """Mean over pixels of the unbiased temporal variance; shifts common to a whole frame count in it."""
        n, pixels = self.frames, self.pixels
        return (n * self.squares - self.pixel_squares) / (n * (n - 1) * pixels)

    @property
    def pixel_variance(self) -> float:
        """Unbiased temporal variance without the shifts common to a whole frame (unsteady lamp, black level).

        It is the residual of the two-way analysis of variance, pixels by frames; for two frames,
        EMVA 1288 R4.0's half of the mean squared difference less half of the squared mean difference.
        """
        n, pixels = self.frames, self.pixels
        residual = (
            n * pixels * self.squares - pixels * self.pixel_squares - n * self.frame_squares + self.total * self.total
        )
        return residual / (n * pixels * (n - 1) * (pixels - 1))

    @property
    def spatial_variance(self) -> float:
        """Unbiased variance over pixels of the mean frame, temporal noise / n included."""
        n, pixels = self.frames, self.pixels
        return (pixels * self.pixel_squares - self.total * self.total) / (n * n * pixels * (pixels - 1))

    @property
    def frame_mean_variance(self) -> float:
        """Unbiased variance over frames of the frame's mean."""
        n, pixels = self.frames, self.pixels
        return (n * self.frame_squares - self.total * self.total) / (n * (n - 1) * pixels * pixels)


class FrameSums:
    """Per-pixel count, sum and sum of squares of a stack of frames, exact.

    Memory does not grow with the number of frames: 12 bytes a pixel, and one number per frame and label.

    Parameters
    ----------
    shape
        (rows, cols) of a frame.
    labels
        (tile rows, tile cols) integers from 0, the repeating tile of labels; one label for all if None.
    black, white
        Digital numbers at or below `black`, and at or above `white`, are counted as clipped.

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
        self,
        shape: tuple[int, int],
        labels: NDArray[np.integer] | None = None,
        *,
        black: int = 0,
        white: int = 65_535,
    ) -> None:
        self.shape = shape
        self.labels = np.zeros((1, 1), np.int64) if labels is None else np.asarray(labels, np.int64)
        self.black = black
        self.white = white
        self.count = 0
        self.sum = np.zeros(shape, np.uint32)
        self.sum_of_squares = np.zeros(shape, np.uint64)
        n_labels = int(self.labels.max()) + 1
        self._low = np.zeros(n_labels, np.int64)
        self._high = np.zeros(n_labels, np.int64)
        self._frame_totals: list[NDArray[np.uint64]] = []

    def add(self, frames: NDArray[np.unsignedinteger] | Iterable[NDArray[np.unsignedinteger]]) -> FrameSums:
        """Add a frame (rows, cols), a stack (frames, rows, cols) or an iterable of frames; returns itself.

        Raises
        ------
        ValueError
            If a frame has another size, is not uint8 or uint16, or there would be more than 32 768 frames.
        """
        if isinstance(frames, np.ndarray) and frames.ndim == 2:
            frames = (frames,)
        for frame in frames:
            if frame.shape != self.shape or frame.dtype not in (np.uint8, np.uint16):
                raise ValueError(f"a frame here is {self.shape} of uint8 or uint16, not {frame.shape} of {frame.dtype}")
            if self.count == MOST_FRAMES:
                raise ValueError(f"one stack holds at most {MOST_FRAMES} frames")
            totals = np.zeros(self._low.size, np.uint64)
            _add_frame(
                np.ascontiguousarray(frame),
                self.labels,
                np.uint64(self.black),
                np.uint64(self.white),
                self.sum,
                self.sum_of_squares,
                totals,
                self._low,
                self._high,
            )
            self._frame_totals.append(totals)
            self.count += 1
        return self

    def merge(self, other: FrameSums) -> FrameSums:
        """A new one that holds the frames of both.

        Raises
        ------
        ValueError
            If they differ in shape, labels or clips, or hold more than 32 768 frames together.
        """
        same = (self.shape, self.black, self.white) == (other.shape, other.black, other.white)
        if not (same and np.array_equal(self.labels, other.labels)):
            raise ValueError("sums can be merged where size, labels and clips are the same")
        if self.count + other.count > MOST_FRAMES:
            raise ValueError(f"one stack holds at most {MOST_FRAMES} frames")
        both = FrameSums(self.shape, self.labels, black=self.black, white=self.white)
        both.count = self.count + other.count
        both.sum = self.sum + other.sum
        both.sum_of_squares = self.sum_of_squares + other.sum_of_squares
        both._low = self._low + other._low
        both._high = self._high + other._high
        both._frame_totals = self._frame_totals + other._frame_totals
        return both

    def mean(self) -> NDArray[np.float64]:
        """(rows, cols) mean over the frames."""
        return np.asarray(self.sum / self.count, dtype=np.float64)

    def variance(self) -> NDArray[np.float64]:
        """(rows, cols) unbiased temporal variance: the integer n sum(y^2) - sum(y)^2 over n (n - 1)."""
        n = np.uint64(self.count)
        total = self.sum.astype(np.uint64)
        return np.asarray((n * self.sum_of_squares - total * total) / (self.count * (self.count - 1)))

    def frame_means(self) -> NDArray[np.float64]:
        """(frames, labels) mean of each frame, in the order they were added."""
        pixels = np.array([entry.pixels for entry in self.label_totals()], dtype=np.float64)
        return np.array(self._frame_totals, dtype=np.float64) / pixels

    def label_totals(self) -> tuple[LabelTotals, ...]:
        """The totals of each label, exact."""
        n_labels = self._low.size
        counts = np.zeros(n_labels, np.int64)
        totals = np.zeros(n_labels, np.uint64)
        split = np.zeros((n_labels, 4), np.uint64)
        _label_sums(self.sum, self.sum_of_squares, self.labels, counts, totals, split)
        first, second = np.zeros(n_labels), np.zeros(n_labels)
        if self.count > 1:
            n = np.uint64(self.count)
            _variance_moments(self.sum, self.sum_of_squares, self.labels, n, first, second)
        result = []
        for k in range(n_labels):
            pixels = int(counts[k])
            q_low, q_high, s_low, s_high = (int(part) for part in split[k])
            spread = (second[k] - first[k] ** 2 / pixels) / (pixels - 1) if pixels > 1 else 0.0
            result.append(
                LabelTotals(
                    frames=self.count,
                    pixels=pixels,
                    total=int(totals[k]),
                    squares=q_low + (q_high << 32),
                    pixel_squares=s_low + (s_high << 32),
                    frame_squares=sum(int(frame[k]) ** 2 for frame in self._frame_totals),
                    low=int(self._low[k]),
                    high=int(self._high[k]),
                    variance_spread=float(max(spread, 0.0)),  # rounding alone makes it negative
                )
            )
        return tuple(result)
