"""Means over intervals: a line of samples brought to another grid, light neither lost nor made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled


@dataclass(frozen=True, eq=False)
class Overlap:
    """Which samples each output covers, and by what share: entries first[i] to first[i + 1] belong to output i."""

    first: NDArray[np.int64]
    sample: NDArray[np.int64]
    share: NDArray[np.float32]

    def span(self, start: int, end: int) -> tuple[int, int]:
        """The samples that outputs from start to end need: from the first one to after the last."""
        needed = self.sample[self.first[start] : self.first[end]]
        return int(needed.min()), int(needed.max()) + 1


def overlap(count: int, start: float, step: float, samples: int) -> Overlap:
    """Output i is the mean over the interval start + step i to start + step (i + 1), in sample coordinates.

    Sample j covers j to j + 1. Beyond its ends the line of samples repeats its last ones.

    Examples
    --------
    >>> two = overlap(2, 0.5, 1.5, 3)
    >>> two.first, two.sample, two.share.round(3)
    (array([0, 2, 3]), array([0, 1, 2]), array([0.333, 0.667, 1.   ], dtype=float32))
    """
    borders = start + step * np.arange(count + 1)
    # Borders between outputs and borders between samples cut the line into pieces of one sample and one output each.
    inner = np.arange(1, samples, dtype=np.float64)
    cuts = np.union1d(borders, inner[(inner > borders[0]) & (inner < borders[-1])])
    middle = (cuts[:-1] + cuts[1:]) / 2
    output = np.searchsorted(borders, middle, side="right") - 1
    sample = np.clip(np.floor(middle), 0, samples - 1).astype(np.int64)
    share = np.diff(cuts) / step
    first = np.searchsorted(output, np.arange(count + 1)).astype(np.int64)
    return Overlap(first, sample, share.astype(np.float32))


# Not on several threads: strips are short, and waking a thread for each takes longer than it saves.


@compiled()
def mean_along_rows(
    values: NDArray[np.float32],
    first: NDArray[np.int64],
    sample: NDArray[np.int64],
    share: NDArray[np.float32],
) -> NDArray[np.float32]:
    """(rows, count): each row of (rows, samples) brought to the overlap's outputs."""
    rows, count = values.shape[0], first.size - 1
    out = np.empty((rows, count), np.float32)
    for r in range(rows):
        for i in range(count):
            total = np.float32(0.0)
            for entry in range(first[i], first[i + 1]):
                total += values[r, sample[entry]] * share[entry]
            out[r, i] = total
    return out


@compiled()
def mean_of_rows(
    values: NDArray[np.float32],
    first: NDArray[np.int64],
    sample: NDArray[np.int64],
    share: NDArray[np.float32],
    begin: int,
    offset: int,
    out: NDArray[np.float32],
) -> None:
    """Outputs begin, begin + 1, ... as means of whole rows; values[0] is sample number `offset`."""
    for i in range(out.shape[0]):
        entry = first[begin + i]
        row = values[sample[entry] - offset]
        weight = share[entry]
        for c in range(out.shape[1]):
            out[i, c] = row[c] * weight
        for entry in range(first[begin + i] + 1, first[begin + i + 1]):
            row = values[sample[entry] - offset]
            weight = share[entry]
            for c in range(out.shape[1]):
                out[i, c] += row[c] * weight
