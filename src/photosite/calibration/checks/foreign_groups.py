"""Groups of frames of another chip among the rest: the fixed pattern of their mean frames is not that of the others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.checks.foreign_frames import find_foreign, fine_pattern
from photosite.calibration.photon_transfer.photon_transfer import LINEAR_SHARE
from photosite.calibration.reduction.groups import GroupStatistics, pooled_level

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroupSample:
    """A group and the sampled pixels (rows, cols) of its mean frame."""

    statistics: GroupStatistics
    mean: Array


def find_foreign_groups(
    darks: Sequence[GroupSample], lights: Sequence[GroupSample], reference: int, labels: NDArray[np.int64]
) -> tuple[list[int], list[int]]:
    """Return the dark groups and the light groups with another fixed pattern than most others of their kind.

    Compared are mean dark frames, and the relative response in the flat fields of the linear range. Row noise and hot
    pixels do not matter.

    Parameters
    ----------
    darks, lights
        The groups, and samples of their mean frames at the same pixels.
    reference
        Index of the dark group that is subtracted from the flat fields.
    labels
        Channels of the sampled pixels.
    """
    noise = [_noise(entry) for entry in darks]
    found = _foreign(darks, [entry.mean for entry in darks], noise, labels)
    dark, black = darks[reference], np.array([level.mean for level in darks[reference].statistics.levels])
    linear: list[int] = []
    relative, of_relative = [], []
    levels = [pooled_level(entry.statistics.levels) for entry in lights]
    repeated = [i for i, level in enumerate(levels) if level.repeated]
    peak = max((levels[i] for i in repeated), key=lambda level: level.variance, default=None)
    for i in repeated:
        entry = lights[i]
        signal = np.array([level.mean for level in entry.statistics.levels]) - black
        dim = peak is not None and levels[i].mean - black.mean() <= LINEAR_SHARE * (peak.mean - black.mean())
        if dim and signal.min() > 0.0 and not any(level.clipped for level in entry.statistics.levels):
            linear.append(i)
            relative.append((entry.mean - dark.mean) / signal[labels])
            of_relative.append(float(np.mean((_noise(entry) + noise[reference]) / signal**2)))
    return found, [linear[i] for i in _foreign([lights[i] for i in linear], relative, of_relative, labels)]


def _noise(entry: GroupSample) -> float:
    """Return the temporal variance in a mean frame; infinite for a single frame, whose noise is unknown."""
    level = pooled_level(entry.statistics.levels)
    return level.variance / level.frames if level.repeated else math.inf


def _foreign(
    groups: Sequence[GroupSample], means: Sequence[Array], noise: Sequence[float], labels: NDArray[np.int64]
) -> list[int]:
    if len(groups) < 2:
        return []
    patterns, shifted = fine_pattern(means, labels)
    variance = np.einsum("ij,ij->i", patterns, patterns) / patterns.shape[1]
    strength = np.maximum(variance - np.array(noise), 0.0)
    return find_foreign(patterns, shifted, strength)
