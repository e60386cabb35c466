"""Whether the frames of a group are of one kind: half-read, black, white or lit ones are told before they count.

All frames of a group are of one scene, so that each is held against the group's median. Of each frame a grid of pixels
is looked at, 64 x 64 at most, in 8 x 8 blocks. Three scores tell how far it is off, and 1 is where it becomes strange:

- level: its mean against the median of the means, in units of 20 % of the signal and six times a pixel's noise;
- blocks: its worst block against the median pattern, moved and scaled with the frame's own level, in units of 20 % of
  the block's signal, three times a pixel's noise and six times that of the block's mean;
- noise: a pixel's deviation from the median pattern, in units of three times that of the other frames, 10 % of the
  signal and half a DN.

Where the frames of a group scatter by themselves (a lamp that flickers), the limit goes up with them, to 2 at most:
six times the scatter of the levels by the median of absolute deviations, four times the median of the blocks' scores.
Steady frames and normal noise come near 1 once in 10^8 blocks; under a lamp whose light scatters by 5 % from frame to
frame, less than once in 10 000 frames. What stays unseen: a lamp off by less than 20 %, a defect smaller than half an
eighth of the frame's height or width, a white frame among flats near saturation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SIDE, FEWER, MANY = 64, 24, 4096
"""Pixels looked at along each side; fewer where a group has more frames than `MANY`, which would fill the memory."""

BLOCKS, LEAST_BLOCK = 8, 4
"""Blocks along each side, and pixels along the side of one: small frames have fewer blocks."""

LEAST_PIXELS = 16
"""Pixels that tell anything of a frame."""

SIGNAL_SHARE = 0.2
"""Of the signal above dark: lamps and shutters are better, broken frames mostly worse."""

LEVEL_NOISE, BLOCK_NOISE, MEAN_NOISE = 6.0, 3.0, 6.0
"""Times a pixel's temporal noise that a frame, or a block of it, may be off, as black levels drift and rows are noisy;
and times the noise of a block's mean."""

NOISIER = 3.0
"""Times the noise of the other frames."""

NOISE_SHARE = 0.1
"""Of the signal: what the noise of a frame near saturation may be more than that of others that are clipped."""

LEVEL_SCATTER, BLOCK_SCATTER, MOST = 6.0, 4.0, 2.0
"""Times the scatter of the group that the limit follows, and how far."""

LEAST_NOISE_DN = 0.5
"""Noise of numbers that quantisation holds still."""

_NORMAL = 1.4826
"""Standard deviation of a normal over its median absolute deviation."""


@dataclass(frozen=True)
class Grid:
    """The pixels that are looked at, the same in all frames of a group.

    Parameters
    ----------
    rows, cols
        Their places along each side; of a mosaic, odd and even ones.
    """

    rows: NDArray[np.int64]
    cols: NDArray[np.int64]

    @classmethod
    def of(cls, shape: tuple[int, int], frames: int) -> Grid:
        """For frames of a size, and how many of them."""
        most = SIDE if frames <= MANY else FEWER
        return cls(_places(shape[0], most), _places(shape[1], most))

    def sample(self, dn: NDArray[np.unsignedinteger]) -> NDArray[np.uint16]:
        """(rows, cols) the pixels of a frame."""
        pixels: NDArray[np.uint16] = dn[np.ix_(self.rows, self.cols)].astype(np.uint16)
        return pixels


def _places(length: int, most: int) -> NDArray[np.int64]:
    if length <= most:
        return np.arange(length)
    place = np.arange(most)
    places: NDArray[np.int64] = np.minimum(2 * (place * length // (2 * most)) + place % 2, length - 1)
    return places


@dataclass(frozen=True)
class Broken:
    """A frame that is not like the others of its group.

    Parameters
    ----------
    place
        Its place among the samples.
    reason
        What is strange about it.
    """

    place: int
    reason: str


def find_outlier_frames(samples: Sequence[NDArray[np.uint16]], dark_dn: float | None) -> list[Broken]:
    """The frames of a group that are off, by their samples; more than half of them where no majority agrees.

    Of two frames both are off if they differ.

    Parameters
    ----------
    samples
        `Grid.sample` of each frame.
    dark_dn
        Level without light; None if it is not known, and all of the level is taken for it.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> frames = [np.uint16(rng.normal(500.0, 10.0, (64, 64))) for _ in range(5)]
    >>> find_outlier_frames(frames, 64.0)
    []
    >>> frames[3][30:] = 0
    >>> [(entry.place, entry.reason) for entry in find_outlier_frames(frames, 64.0)]
    [(3, 'its mean is 234 DN, that of the others 499.4 DN')]
    """
    n = len(samples)
    if n < 2 or samples[0].size < LEAST_PIXELS:
        return []
    stack = np.stack(samples)
    pattern = np.median(stack, axis=0)
    off = np.array([_blocks(sample - pattern) for sample in stack])
    blocks = _blocks(pattern)
    means = stack.mean(axis=(1, 2))
    level = float(np.median(means))
    signal = 0.0 if dark_dn is None else max(level - dark_dn, 0.0)
    spread = np.array([_spread(sample - pattern, mean) for sample, mean in zip(stack, off, strict=True)])
    noise = max(float(np.median(spread)) * np.sqrt(n / (n - 1)), LEAST_NOISE_DN)

    of_level = np.abs(means - level) / (SIGNAL_SHARE * signal + LEVEL_NOISE * noise)
    local = np.zeros_like(blocks) if dark_dn is None else np.maximum(blocks - dark_dn, 0.0)
    usual = float(np.median(local))
    # Light scales a pattern, where there is light; a black level moves it.
    weight = local / usual if usual > LEVEL_NOISE * noise else np.ones_like(local)
    rest = off - np.median(off, axis=(1, 2), keepdims=True) * weight
    allowed = (BLOCK_NOISE + MEAN_NOISE / np.sqrt(_sizes(pattern.shape))) * noise
    of_blocks = np.abs(rest / (SIGNAL_SHARE * local + allowed)).max(axis=(1, 2))
    of_noise = spread / (NOISIER * float(np.median(spread)) + NOISE_SHARE * signal + LEAST_NOISE_DN)

    level_limit = _limit(LEVEL_SCATTER * _NORMAL * float(np.median(of_level)), n)
    block_limit = _limit(BLOCK_SCATTER * float(np.median(of_blocks)), n)
    found = []
    for i in range(n):
        if of_level[i] > level_limit:
            others = float(np.median(np.delete(means, i)))
            reason = f"its mean is {means[i]:.4g} DN, that of the others {others:.4g} DN"
        elif of_blocks[i] > block_limit:
            worst = float(rest[i].ravel()[np.abs(rest[i]).argmax()])
            reason = (
                f"a part of it is {abs(worst):.4g} DN {'above' if worst > 0 else 'below'} the pattern of the others"
            )
        elif of_noise[i] > 1.0:
            others = float(np.median(np.delete(spread, i)))
            reason = (
                f"its pixels are {spread[i]:.3g} DN off the pattern of the others, those of the others {others:.3g}"
            )
        else:
            continue
        found.append(Broken(i, reason))
    return found


def _limit(scatter: float, frames: int) -> float:
    """Two frames tell no scatter; their deviations are half of their difference."""
    return 1.0 if frames == 2 else min(max(scatter, 1.0), MOST)


def _starts(length: int) -> NDArray[np.int64]:
    blocks = min(BLOCKS, max(length // LEAST_BLOCK, 1))
    return np.arange(blocks) * length // blocks


def _lengths(length: int) -> NDArray[np.int64]:
    return np.diff(np.append(_starts(length), length))


def _sizes(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """(block rows, block columns) pixels in each block."""
    return np.outer(_lengths(shape[0]), _lengths(shape[1]))


def _blocks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(block rows, block columns) means."""
    rows, cols = (_starts(length) for length in values.shape)
    sums = np.add.reduceat(np.add.reduceat(values, rows, axis=0), cols, axis=1)
    means: NDArray[np.float64] = sums / _sizes(values.shape)
    return means


def _spread(deviation: NDArray[np.float64], blocks: NDArray[np.float64]) -> float:
    """Robust standard deviation of pixels within their blocks."""
    heights, widths = (_lengths(length) for length in deviation.shape)
    inside = deviation - np.repeat(np.repeat(blocks, heights, axis=0), widths, axis=1)
    return _NORMAL * float(np.median(np.abs(inside)))


def top_value_shares(
    samples: Sequence[NDArray[np.uint16]], labels: NDArray[np.int64], bits: int
) -> tuple[tuple[float, float], ...]:
    """Per label, the highest number and the share of pixels at it, where it can be the top of a smaller converter.

    The share is 0 where it is no 2^k - 1 from 6 bits to one below the converter's.

    Parameters
    ----------
    labels
        (rows, cols) the label of each pixel of a sample.
    """
    stack = np.stack(samples)
    result = []
    for label in range(int(labels.max()) + 1):
        values = stack[:, labels == label]
        top = int(values.max(initial=0))
        smaller = 6 <= top.bit_length() < bits and top & (top + 1) == 0
        result.append((float(top), float((values == top).mean()) if smaller else 0.0))
    return tuple(result)
