"""Screening of the frames of a group: half-read, black, white or lit frames are found before they are used.

All frames of a group show the same scene, so each is compared with the group's median, on a grid of at most 64 x 64
pixels in 8 x 8 blocks. Three scores measure its deviation; a score above 1 marks an outlier:

- level: its mean against the median of the means, in units of 20 % of the signal plus six times a pixel's noise;
- blocks: its worst block against the median pattern, scaled and shifted with the frame's own level, in units of 20 % of
  the block's signal plus three times a pixel's noise plus six times the noise of the block's mean;
- noise: a pixel's deviation from the median pattern, in units of three times that of the other frames plus 10 % of the
  signal plus half a DN.

Where the frames of a group scatter (a flickering lamp), the limits rise with them, up to 2: six times the
scatter of the levels by the median absolute deviation, four times the median of the blocks' scores. With steady frames
and normal noise a score near 1 occurs once in 10^8 blocks; under a lamp that scatters by 5 % from frame to frame, in
less than one of 10 000 frames. Not detected: a lamp off by less than 20 %, a defect smaller than a sixteenth of the
frame's height or width, a white frame among flat fields near saturation.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from photosite.values.diagnostic import DiagnosticKind
from photosite.values.uncertain import NORMAL_MAD

T = TypeVar("T", bound=np.generic)


class Tolerance(NamedTuple):
    """What a score tolerates: a fraction of the signal above dark, noise of other frames, and scatter of the group."""

    signal: float
    noise: float
    scatter: float


TOLERANCE = MappingProxyType(
    {
        "level": Tolerance(signal=0.2, noise=6.0, scatter=6.0),
        "block": Tolerance(signal=0.2, noise=3.0, scatter=4.0),
        "noise": Tolerance(signal=0.1, noise=3.0, scatter=0.0),
    }
)
"""Lamps and shutters are better than these fractions, broken frames mostly worse; near saturation, clipped frames have
less noise than others. The noise covers drift of the black level and row noise."""


OUTLIER_FRAME = DiagnosticKind(
    "outlier-frame",
    "left out",
    "The level, a part or the noise of a frame differs from the other frames of its group.",
    "A half-read, black, white or lit frame was left out.",
    "Look at the frame; nothing if it is broken.",
    false_alarms="below 1 of 10 000 frames under a lamp that scatters by 5 %",
)
NEAR_COPY_FRAME = DiagnosticKind(
    "near-copy",
    "left out",
    "A frame repeats an earlier one in nearly all pixels.",
    "The copy was left out: its noise is that of the other frame.",
    "Look for a camera or program that writes a frame twice.",
    size="sampled pixels that differ",
    false_alarms="none with a noise of 0.002 DN or more",
)
NO_MAJORITY = DiagnosticKind(
    "no-majority",
    "refused",
    "Half of the frames of a group or more differ from each other far beyond noise.",
    "There is no result: nothing shows which frames are broken.",
    "Remove the broken frames, or correct what is listed as one setting.",
    ("*",),
)


SIDE, SMALL_SIDE, LARGE_GROUP = 64, 24, 4096
"""Pixels along each side of the grid; fewer for groups of more than `LARGE_GROUP` frames, to limit memory."""


def sample_grid(shape: tuple[int, int], frames: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices of the sampled pixels, (n, 1) rows and (1, m) columns, for a number of frames.

    There are odd and even ones, so that all CFA sites are sampled.
    """
    most = SIDE if frames <= LARGE_GROUP else SMALL_SIDE
    index = np.arange(most)
    rows, cols = (
        np.arange(length) if length <= most else np.minimum(2 * (index * length // (2 * most)) + index % 2, length - 1)
        for length in shape
    )
    return rows[:, None], cols[None, :]


LEAST_PIXELS = 16
"""Pixels below which a frame is not screened."""
MEAN_NOISE, LARGEST_LIMIT = 6.0, 2.0
"""Tolerated deviation of a block, in units of the noise of its mean; and the largest limit that follows the scatter."""
MOST_OF_PIXEL = 12.0
"""Largest deviation of a pixel that counts, in units of that of its block: five of 64 pixels do not suffice."""
LEAST_NOISE_DN = 0.5
"""Least noise assumed, DN, where quantization hides it."""


def find_outlier_frames(samples: Sequence[NDArray[np.uint16]], dark_dn: float | None) -> dict[int, str]:
    """Return the outlier frames of a group: how each differs, by its index among the samples.

    More than half of the frames are outliers where there is no majority: of two different frames, both. `samples` holds
    the sampled pixels of each frame (`sample_grid`); `dark_dn` is the level without light, None if unknown, which takes
    the whole level as dark.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> frames = [np.uint16(rng.normal(500.0, 10.0, (64, 64))) for _ in range(5)]
    >>> find_outlier_frames(frames, 64.0)
    {}
    >>> frames[3][30:] = 0
    >>> find_outlier_frames(frames, 64.0)
    {3: 'its mean is 234 DN, that of the others 499.4 DN'}
    """
    n = len(samples)
    if n < 2 or samples[0].size < LEAST_PIXELS:
        return {}
    stack = np.stack(samples)
    pattern = np.median(stack, axis=0)
    deviation = stack - pattern
    off = _block_means(deviation)
    blocks = _block_means(pattern)
    means = stack.mean(axis=(1, 2))
    level = float(np.median(means))
    signal = 0.0 if dark_dn is None else max(level - dark_dn, 0.0)
    spread = _spread(deviation, off)
    noise = max(float(np.median(spread)) * np.sqrt(n / (n - 1)), LEAST_NOISE_DN)

    of_level, of_block, of_noise = (TOLERANCE[name] for name in ("level", "block", "noise"))
    level_score = np.abs(means - level) / (of_level.signal * signal + of_level.noise * noise)
    local = np.zeros_like(blocks) if dark_dn is None else np.maximum(blocks - dark_dn, 0.0)
    usual = float(np.median(local))
    # A change of the light scales the pattern; a change of the black level shifts it.
    weight = local / usual if usual > of_level.noise * noise else np.ones_like(local)
    rest = off - np.median(off, axis=(1, 2), keepdims=True) * weight
    allowed = (of_block.noise + MEAN_NOISE / np.sqrt(_block_sizes(pattern.shape))) * noise
    tolerated = of_block.signal * local + allowed
    block_score = np.abs(rest / tolerated).max(axis=(1, 2))
    noise_score = spread / (of_noise.noise * float(np.median(spread)) + of_noise.signal * signal + LEAST_NOISE_DN)

    level_limit = _limit(of_level.scatter * NORMAL_MAD * float(np.median(level_score)), n)
    block_limit = _limit(of_block.scatter * float(np.median(block_score)), n)
    for i in np.flatnonzero(block_score > block_limit).tolist():  # a few pixels that blink do not make another frame
        most = _over_blocks(MOST_OF_PIXEL * tolerated, pattern.shape)
        single = deviation[i] - _over_blocks(off[i] - rest[i], pattern.shape)
        rest[i] = _block_means(np.clip(single, -most, most))
        block_score[i] = np.abs(rest[i] / tolerated).max()
    found = {}
    for i in range(n):
        if level_score[i] > level_limit:
            others = float(np.median(np.delete(means, i)))
            found[i] = f"its mean is {means[i]:.4g} DN, that of the others {others:.4g} DN"
        elif block_score[i] > block_limit:
            worst = float(rest[i].ravel()[np.abs(rest[i]).argmax()])
            found[i] = f"a part is {abs(worst):.4g} DN {'above' if worst > 0 else 'below'} the pattern of the others"
        elif noise_score[i] > 1.0:
            others = float(np.median(np.delete(spread, i)))
            found[i] = (
                f"its pixels deviate by {spread[i]:.3g} DN from the others' pattern, the others by {others:.3g} DN"
            )
    return found


NEAR_COPY = 1 / 512
"""Fraction of the sampled pixels up to which a frame that differs from another counts as its copy."""
LEAST_COMPARED, LEAST_NUMBERS = 1024, 3
"""Least sampled pixels, and different numbers in the middle 80 % of them, at which copies are looked for."""
SAMPLE_PARTS = 64
"""Parts of a sample, of which a copy has most in common with its original."""


def find_near_copies(samples: Sequence[NDArray[np.uint16]]) -> dict[int, tuple[int, int]]:
    """Return the frames that repeat an earlier one in nearly all sampled pixels: its index, and pixels that differ.

    Two frames with independent noise of s DN differ in 1.13 s of the pixels if their means lie anywhere between two
    numbers, so `NEAR_COPY` would need a noise of 0.002 DN. Samples of few pixels, or of few different numbers, which
    need not lie anywhere, are not compared. A frame is compared with the one that has most parts of the sample in
    common with it.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> frames = [np.uint16(rng.normal(500.0, 3.0, (64, 64))) for _ in range(3)]
    >>> frames.append(frames[1].copy())
    >>> frames[3][5, 5] += 40
    >>> find_near_copies(frames)
    {3: (1, 1)}
    """
    n = len(samples)
    if n < 2 or samples[0].size < LEAST_COMPARED:
        return {}
    stack = np.stack(samples).reshape(n, -1)
    low, high = np.percentile(stack[0], (10, 90), method="nearest")
    if len(np.unique(stack[0][(stack[0] >= low) & (stack[0] <= high)])) < LEAST_NUMBERS:
        return {}
    found: dict[int, tuple[int, int]] = {}
    earliest: dict[tuple[int, bytes], int] = {}
    borders = [stack.shape[1] * k // SAMPLE_PARTS * stack.itemsize for k in range(SAMPLE_PARTS + 1)]
    for i, pixels in enumerate(stack):
        content = pixels.tobytes()
        parts = [(k, content[borders[k] : borders[k + 1]]) for k in range(SAMPLE_PARTS)]
        (original, _), *_ = Counter([earliest.setdefault(part, i) for part in parts]).most_common(1)
        if original == i:
            continue
        differ = int(np.count_nonzero(pixels != stack[original]))
        if differ <= NEAR_COPY * pixels.size:
            found[i] = original, differ
    return found


def _limit(scatter: float, frames: int) -> float:
    """Return the limit of a score. Two frames show no scatter: the deviation of each is half of their difference."""
    return 1.0 if frames == 2 else min(max(scatter, 1.0), LARGEST_LIMIT)


BLOCKS, LEAST_BLOCK = 8, 4
"""Blocks along each side, and least pixels along the side of a block: small frames have fewer blocks."""


def _block_starts(length: int) -> NDArray[np.int64]:
    blocks = min(BLOCKS, max(length // LEAST_BLOCK, 1))
    return np.arange(blocks) * length // blocks


def _block_lengths(length: int) -> NDArray[np.int64]:
    return np.diff(np.append(_block_starts(length), length))


def _block_sizes(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the (block rows, block columns) numbers of pixels."""
    return np.outer(_block_lengths(shape[0]), _block_lengths(shape[1]))


def _block_means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (..., block rows, block columns) means of samples (..., rows, cols)."""
    rows, cols = (_block_starts(length) for length in values.shape[-2:])
    sums = np.add.reduceat(np.add.reduceat(values, rows, axis=-2), cols, axis=-1)
    return np.asarray(sums / _block_sizes(values.shape[-2:]))


def block_numbers(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the (rows, cols) number of the block of each pixel."""
    blocks = np.arange(_block_sizes(shape).size).reshape(_block_sizes(shape).shape)
    return _over_blocks(blocks, shape)


def _over_blocks(blocks: NDArray[T], shape: tuple[int, ...]) -> NDArray[T]:
    """Return samples (..., rows, cols) with the value of its block at each pixel."""
    heights, widths = (_block_lengths(length) for length in shape)
    return np.repeat(np.repeat(blocks, heights, axis=-2), widths, axis=-1)


def _spread(deviation: NDArray[np.float64], blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (frames,) robust standard deviations of pixels within their blocks."""
    within = np.abs(deviation - _over_blocks(blocks, deviation.shape[-2:]))
    return np.asarray(NORMAL_MAD * np.median(within.reshape(len(within), -1), axis=1, overwrite_input=True))
