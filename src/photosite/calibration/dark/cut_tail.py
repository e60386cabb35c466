"""Noise of the few pixels that reach 0 in dark frames, of which the camera cuts off a part."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import CLIPPED_DARK_FRACTION, GroupStatistics, Level
from photosite.calibration.reduction.reduce import Reduction
from photosite.engine.frame_sums import MeanFrame
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.uncertain import Uncertain

_ZEROS_OVER_NORMAL = 10.0
"""Zeros over those of normal noise from which single noisy pixels are the cause."""

_NEGLIGIBLE = 0.05
"""Variance that may be cut off, over its uncertainty, below which nothing is read again."""

_NOTABLE = 0.5
"""Uncertainty of the variance that is cut off, over that from sampling, from which a warning names it."""


@dataclass(frozen=True)
class CutTail:
    """Temporal variance that is cut off at 0 in dark frames, by channel, DN^2, and the fraction of zeros.

    Pixels that are 0 in all frames are not counted.
    """

    variance: tuple[Uncertain, ...]
    zeros: float
    levels: tuple[Level, ...]

    @property
    def pooled(self) -> Uncertain:
        """Mean over all pixels, DN^2."""
        pixels = sum(level.pixels for level in self.levels)
        total = Uncertain(0.0)
        for level, cut in zip(self.levels, self.variance, strict=True):
            total += cut * (level.pixels / pixels)
        return total

    def warning(self) -> str | None:
        """Return the warning of noise that is cut off; None where sampling alone is as uncertain."""
        fractions = zip(self.levels, self.variance, strict=True)
        if not any(cut.standard_uncertainty > _NOTABLE * level.variance_uncertainty for level, cut in fractions):
            return None
        noise = float(np.mean([level.variance for level in self.levels]))
        raised, doubt = 50.0 * self.pooled.value / noise, 50.0 * self.pooled.standard_uncertainty / noise
        return (
            f"{100 * self.zeros:.2g} % of the numbers in the dark frames are 0, more than noise that is alike in all "
            f"pixels explains: pixels that blink or are noisy reach 0, which cuts off a part of their noise. "
            f"Read noise and dark noise are raised by {raised:.2g} %, from the opposite tail, with a standard "
            f"uncertainty of {doubt:.2g} %. Raise the camera's black level (pedestal) and take the dark frames again"
        )


CUT_TAIL = DiagnosticKind(
    "noise-cut-at-zero",
    "warning",
    "More numbers of the dark frames are 0 than noise that is alike in all pixels explains: noisy pixels reach 0.",
    "A part of their noise is cut off. Read noise and dark noise are raised by it, with a larger uncertainty.",
    "Raise the camera's black level (pedestal), and take the dark frames again.",
    ("read_noise_*", "temporal_dark_noise_e"),
    "fraction of the numbers that are 0",
)


def measure_cut_tail(
    reduction: Reduction, group: GroupStatistics, mean: MeanFrame, reader: FrameReader
) -> CutTail | None:
    """Estimate the variance that is cut off at 0 in the reference dark frames, which are read again if there is any.

    The deviations of a pixel from its mean that are larger than the mean have no counterpart below it: 0 takes its
    place. Both tails of the deviations over all pixels are taken as equal. Where there are more deviations above than
    zeros, such as from cosmic rays, as many as zeros count.
    """
    if not any(level.low_fraction for level in group.levels):
        return None
    always = _by_channel(np.argwhere(mean.sum == 0), reader.tile, len(group.levels))
    zeros = [
        max(level.low_fraction - float(count) / level.pixels, 0.0)
        for level, count in zip(group.levels, always, strict=True)
    ]
    if not any(_matters(level, fraction) for level, fraction in zip(group.levels, zeros, strict=True)):
        return None
    members = {id(source) for source in group.group.frames}
    sources = [entry.source for entry in reduction.used if id(entry.source) in members]
    lost, number = np.zeros(len(zeros)), np.zeros(len(zeros))
    for source in sources:
        dn = source.read()
        places = np.argwhere(dn > (2.0 / mean.count) * mean.sum)
        rows, columns = places.T
        level = mean.sum[rows, columns] / mean.count
        above = (dn[rows, columns] - level) ** 2 - level**2
        lost += _by_channel(places, reader.tile, len(zeros), above)
        number += _by_channel(places, reader.tile, len(zeros))
    samples = [level.pixels * level.frames for level in group.levels]
    return CutTail(
        tuple(_cut(*each) for each in zip(group.levels, zeros, lost, number, samples, strict=True)),
        float(np.average(zeros, weights=samples)),
        group.levels,
    )


def _by_channel(
    places: NDArray[np.intp], tile: NDArray[np.int64], channels: int, weights: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return (channels,) the number of (n, 2) places, or the sum of their weights."""
    rows, columns = places.T
    label = tile[rows % tile.shape[0], columns % tile.shape[1]]
    return np.bincount(label, weights, channels).astype(np.float64)


def _matters(level: Level, zeros: float) -> bool:
    """Return whether zeros beyond those of normal noise may change the variance."""
    if zeros == 0.0 or zeros > CLIPPED_DARK_FRACTION:
        return False
    normal = float(ndtr((0.5 - level.mean) / math.sqrt(level.spatial_variance + level.variance)))
    return zeros > _ZEROS_OVER_NORMAL * normal and zeros * level.mean**2 > _NEGLIGIBLE * level.variance_uncertainty


def _cut(level: Level, zeros: float, lost: float, number: float, samples: int) -> Uncertain:
    """Return the variance that is cut off.

    Its uncertainty is as large as the estimate, and contains half the squared black level for each zero, because the
    deviations above are few.
    """
    if not _matters(level, zeros):
        return Uncertain(0.0)
    value = lost / samples * min(1.0, zeros * samples / number) if number else 0.0
    return Uncertain.of(value, math.hypot(value, 0.5 * zeros * level.mean**2))
