"""Detect frames from another chip, gain setting or binning, by their pattern and noise.

Frames of one chip share its fixed pattern, so that their deviations from a smooth frame are correlated, by the variance
of that pattern. Frames of another chip of the same model have the same mean and noise, and no such correlation. Where
the pattern is too weak to show, there is no warning.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.photon_transfer import LINEAR_FRACTION
from photosite.calibration.reduction.frame_screening import LEAST_PIXELS, block_numbers
from photosite.calibration.reduction.groups import GroupStatistics, pooled_level
from photosite.engine.map_statistics import remove_group_means
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.uncertain import NORMAL_MAD

Array = NDArray[np.floating]


@lru_cache(maxsize=4)
def _places(labels: bytes, shape: tuple[int, ...]) -> list[tuple[NDArray[np.intp], NDArray[np.int64]]]:
    """Return the places of each channel, and the block, row and column of each of them."""
    channels = np.frombuffer(labels, np.int64)
    groupings = np.stack([block_numbers(shape), *np.indices(shape)]).reshape(3, -1)
    inside = [np.flatnonzero(channels == label) for label in np.unique(channels)]
    return [(places, np.take(groupings, places, axis=1)) for places in inside]


CLIPPED_SIGMA = 5.0
"""Deviations beyond this many robust standard deviations are clipped, so that a few hot pixels are not the pattern."""


def fine_pattern(samples: Sequence[NDArray[np.generic]], labels: NDArray[np.int64]) -> list[Array]:
    """Return the (frames, pixels) deviations from the means of blocks, rows and columns, for each channel.

    `samples` are (rows, cols) each; `labels` are the channels of the pixels. Each channel has its own means and its own
    limit at which tails are clipped: one may be saturated where another is not.
    """
    stack = np.stack(samples).astype(np.float32)
    stack -= stack.mean(axis=(1, 2), keepdims=True)  # keeps single precision exact enough
    stack = stack.reshape(len(stack), -1)
    channels = []
    for places, groupings in _places(labels.tobytes(), labels.shape):
        pixels = np.take(stack, places, axis=1)
        # The second round is without the pull of the tails on the means.
        remove_group_means(pixels, groupings, 2, CLIPPED_SIGMA * NORMAL_MAD)
        channels.append(pixels)
    return channels


def _joined(channels: Sequence[Array]) -> tuple[Array, Array]:
    """Return the (frames, pixels) deviations of all channels, and the same, moved within each channel."""
    moved = [np.roll(pixels, pixels.shape[1] // 3, axis=1) for pixels in channels]
    return np.concatenate(channels, axis=1), np.concatenate(moved, axis=1)


COMPARED_SIGMA = 3.0
"""Covariance of two patterns, in standard uncertainties, from which they are compared."""
LEAST_COMMON_FRACTION = 0.3
"""Least fraction of the usual covariance that a pattern has with those of its chip; those of other chips have none."""
COMMON_SIGMA = 8.0
"""Usual covariance with the others, in standard uncertainties, from which its lack in a frame is no chance."""
LEAST_FRAMES, MOST_COMPARED = 3, 200
"""Least frames that show a majority; frames that others are compared with, at most."""


def find_foreign(patterns: Array, shifted: Array, strength: Array | None = None) -> list[int]:
    """Return the places of the patterns that have nothing in common with the largest set of patterns of one chip.

    Parameters
    ----------
    patterns
        (frames, pixels) deviations from the means of blocks, rows and columns.
    shifted
        The same, moved by some pixels: their covariance with the others is chance.
    strength
        (frames,) variance of the fixed pattern in each; by default one for all, the median covariance.
    """
    count, pixels = patterns.shape
    if count < (LEAST_FRAMES if strength is None else 2):
        return []
    core = _spread(count)
    variance = np.einsum("ij,ij->i", patterns, patterns) / pixels
    scale = np.sqrt(np.outer(variance, variance[core]))
    if not scale.all():
        return []
    common = patterns @ patterns[core].T / pixels
    uncertainty = scale * _chance(patterns, shifted)
    common[core, np.arange(len(core))] = np.nan
    if strength is None:
        strength = np.full(count, np.median(common[~np.isnan(common)]))
    pattern = np.minimum.outer(strength, strength[core])
    compared = (pattern > COMPARED_SIGMA * uncertainty) & ~np.isnan(common)
    same = compared & (np.nan_to_num(common) > 0.5 * pattern)
    left, largest = set(range(len(core))), np.zeros(0, np.intp)
    while left:
        found = _connected(same[core], min(left))
        left -= set(found.tolist())
        largest = max(largest, found, key=len)
    inside = compared[:, largest]
    alike, expected, spread = (
        np.where(inside, values[:, largest], 0.0).sum(axis=1) for values in (common, pattern, uncertainty**2)
    )
    return [
        int(i)
        for i in np.flatnonzero(
            (alike < LEAST_COMMON_FRACTION * expected) & (expected > COMMON_SIGMA * np.sqrt(spread))
        )
    ]


def _chance(patterns: Array, shifted: Array) -> float:
    """Return the standard deviation of the correlation of two patterns that have nothing in common."""
    core = _spread(len(patterns))
    length = np.linalg.norm(patterns, axis=1)
    correlation = patterns @ shifted[core].T / np.outer(length, length[core])
    return max(1.0 / math.sqrt(patterns.shape[1]), float(np.sqrt(np.mean(correlation**2))))


def _connected(linked: NDArray[np.bool_], start: int) -> NDArray[np.intp]:
    found = np.zeros(len(linked), np.bool_)
    found[start] = True
    while (more := found | linked[found].any(axis=0)).sum() > found.sum():
        found = more
    return np.flatnonzero(found)


LARGEST_KURTOSIS = 4.0
"""Kurtosis, 3 for normal noise, above which a channel is partly saturated by its wells and is not compared."""


def _normal_channels(channels: Sequence[Array]) -> list[Array]:
    """Return the patterns without channels of heavy tails or without noise, and with the same spread in the others."""
    normal = []
    for pixels in channels:
        square = pixels**2
        variance = square.mean(axis=1)
        # One number that differs in 4096 gives 2e-4 DN^2; less is rounding of equal numbers.
        if variance.min() > 1e-6 and np.median(np.mean(square**2, axis=1) / variance**2) <= LARGEST_KURTOSIS:
            normal.append(pixels / np.float32(math.sqrt(np.median(variance))))
    return normal


def _noise(patterns: Array) -> Array:
    """Return the temporal variance of each frame, from differences of pairs; a few copies do not change it."""
    core = _spread(len(patterns))
    variance = np.mean(patterns**2, axis=1)
    difference = variance[:, None] + variance[core] - 2.0 * (patterns @ patterns[core].T) / patterns.shape[1]
    difference[core, np.arange(len(core))] = np.nan  # sorted behind the others
    ordered, others = np.sort(difference, axis=1), len(core) - np.isin(np.arange(len(patterns)), core)
    each = np.arange(len(patterns))
    medians = 0.5 * (ordered[each, (others - 1) // 2] + ordered[each, others // 2])
    return np.asarray(medians - 0.5 * np.median(difference[~np.isnan(difference)]))


def _spread(count: int) -> NDArray[np.intp]:
    """Return up to `MOST_COMPARED` places, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_COMPARED)).round().astype(np.intp))


FOREIGN_FRAMES = DiagnosticKind(
    "foreign-frames",
    "left out",
    "The fixed pattern of a frame or a group is not that of the others.",
    "It comes from another chip, gain setting or binning, and was left out.",
    "Remove the frames, or calibrate them separately.",
    false_alarms="below 1 of 1000 sets",
)


NOISE_FRAMES, NOISE_CHANGE, NOISE_SCATTER = 4, 0.3, 8.0
"""Least frames for the comparison of their noise; least relative difference of a variance; the same as a multiple of
its scatter, that of the others (median absolute deviation) or of chance."""
HIGHEST_FRACTION = 0.002
"""Fraction of a frame's pixels at the highest number of all above which its noise, maybe clipped, is not compared."""


def find_foreign_frames(samples: Sequence[NDArray[np.uint16]], labels: NDArray[np.int64]) -> dict[int, str]:
    """Return the frames of a group with another fixed pattern or another noise than the others: how each differs.

    Parameters
    ----------
    samples
        Sampled pixels of each frame (`sample_grid`).
    labels
        Channels of these pixels.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> chips = rng.normal(1000.0, 5.0, (2, 64, 64))
    >>> frames = [np.uint16(chips[int(i == 3)] + rng.normal(0.0, 8.0, (64, 64))) for i in range(6)]
    >>> find_foreign_frames(frames, np.zeros((64, 64), np.int64))
    {3: 'its fixed pattern is not that of the others: another chip, or another readout'}
    """
    n = len(samples)
    if n < LEAST_FRAMES or samples[0].size < LEAST_PIXELS:
        return {}
    normal = _normal_channels(fine_pattern(samples, labels))
    if not normal:
        return {}
    patterns, shifted = _joined(normal)
    reason = "its fixed pattern is not that of the others: another chip, or another readout"
    found = dict.fromkeys(find_foreign(patterns, shifted), reason)
    rest = np.setdiff1d(np.arange(n), list(found))
    highest = max(int(sample.max()) for sample in samples)
    if len(rest) < NOISE_FRAMES or max(np.mean(sample == highest) for sample in samples) > HIGHEST_FRACTION:
        return found
    variance = _noise(patterns[rest])
    usual = float(np.median(variance))
    if usual <= 0.0 or not patterns[rest].any(axis=1).all():
        return found
    change = variance / usual - 1.0
    scatter = max(
        NORMAL_MAD * float(np.median(np.abs(change))), math.sqrt(2.0) * _chance(patterns[rest], shifted[rest])
    )
    limit = max(NOISE_CHANGE, NOISE_SCATTER * scatter)
    for place in np.flatnonzero(np.abs(change) > limit):
        times = float(np.sqrt(variance[place] / usual))
        found[int(rest[place])] = f"its noise is {times:.2g} times that of the others: another gain, binning or readout"
    return found


@dataclass(frozen=True)
class GroupSample:
    """A group and the sampled pixels (rows, cols) of its mean frame."""

    statistics: GroupStatistics
    mean: Array


def find_foreign_groups(
    darks: Sequence[GroupSample], lights: Sequence[GroupSample], reference: int | None, labels: NDArray[np.int64]
) -> tuple[list[int], list[int]]:
    """Return the dark groups and the light groups with another fixed pattern than most others of their kind.

    Compared are mean dark frames, and the relative response in the flat fields of the linear range. Row noise and hot
    pixels do not matter.

    Parameters
    ----------
    darks, lights
        The groups, and samples of their mean frames at the same pixels.
    reference
        Index of the dark group that is subtracted from the flat fields, if any.
    labels
        Channels of the sampled pixels.
    """
    noise = [_group_noise(entry) for entry in darks]
    found = _foreign(darks, [entry.mean for entry in darks], noise, labels)
    subtracted: Array = np.zeros(labels.shape)
    black, black_noise = np.zeros(int(labels.max()) + 1), 0.0
    if reference is not None:
        dark, black_noise = darks[reference], noise[reference]
        subtracted, black = dark.mean, np.array([level.mean for level in dark.statistics.levels])
    linear: list[int] = []
    relative, relative_noise = [], []
    levels = [pooled_level(entry.statistics.levels) for entry in lights]
    repeated = [i for i, level in enumerate(levels) if level.repeated]
    peak = max((levels[i] for i in repeated), key=lambda level: level.variance, default=None)
    for i in repeated:
        entry = lights[i]
        signal = np.array([level.mean for level in entry.statistics.levels]) - black
        dim = peak is not None and levels[i].mean - black.mean() <= LINEAR_FRACTION * (peak.mean - black.mean())
        if dim and signal.min() > 0.0 and not any(level.clipped for level in entry.statistics.levels):
            linear.append(i)
            relative.append((entry.mean - subtracted) / signal[labels])
            relative_noise.append(float(np.mean((_group_noise(entry) + black_noise) / signal**2)))
    return found, [linear[i] for i in _foreign([lights[i] for i in linear], relative, relative_noise, labels)]


def _group_noise(entry: GroupSample) -> float:
    """Return the temporal variance in a mean frame; infinite for a single frame, whose noise is unknown."""
    level = pooled_level(entry.statistics.levels)
    return level.variance / level.frames if level.repeated else math.inf


def _foreign(
    groups: Sequence[GroupSample], means: Sequence[Array], noise: Sequence[float], labels: NDArray[np.int64]
) -> list[int]:
    if len(groups) < 2:
        return []
    patterns, shifted = _joined(fine_pattern(means, labels))
    variance = np.einsum("ij,ij->i", patterns, patterns) / patterns.shape[1]
    strength = np.maximum(variance - np.array(noise), 0.0)
    return find_foreign(patterns, shifted, strength)
