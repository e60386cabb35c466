"""Resampling of a line of samples to another grid by means over intervals, which conserves light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from photosite.engine.arrays import F32, I64
from photosite.engine.jit import compiled


class Overlap(NamedTuple):
    """The samples that each output covers, and their shares: entries first[i] to first[i + 1] belong to output i."""

    first: I64
    sample: I64
    share: F32

    def span(self, start: int, end: int) -> tuple[int, int]:
        """Return the samples that outputs from start to end need: the first, and one after the last."""
        needed = self.sample[self.first[start] : self.first[end]]
        return int(needed.min()), int(needed.max()) + 1


def overlap(count: int, start: float, step: float, samples: int) -> Overlap:
    """Return the overlap of outputs with samples: output i is the mean from start + step i to start + step (i + 1).

    Sample j covers j to j + 1 in these coordinates. Beyond its ends the line repeats its end samples.

    Examples
    --------
    >>> two = overlap(2, 0.5, 1.5, 3)
    >>> two.first, two.sample, two.share.round(3)
    (array([0, 2, 3]), array([0, 1, 2]), array([0.333, 0.667, 1.   ], dtype=float32))
    """
    borders = start + step * np.arange(count + 1)
    # The borders of outputs and samples cut the line into pieces of one sample and one output each.
    inner = np.arange(1, samples, dtype=np.float64)
    cuts = np.union1d(borders, inner[(inner > borders[0]) & (inner < borders[-1])])
    middle = (cuts[:-1] + cuts[1:]) / 2
    output = np.searchsorted(borders, middle, side="right") - 1
    sample = np.clip(np.floor(middle), 0, samples - 1).astype(np.int64)
    share = np.diff(cuts) / step
    first = np.searchsorted(output, np.arange(count + 1)).astype(np.int64)
    return Overlap(first, sample, share.astype(np.float32))


@compiled()
def mean_along_rows(values: F32, across: Overlap) -> F32:
    """Return (rows, count): each row of (rows, samples) resampled. Single-threaded, because strips are short."""
    first, sample, share = across
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
def mean_of_rows(values: F32, down: Overlap, begin: int, offset: int, out: F32) -> None:
    """Compute outputs begin, begin + 1, ... as means of whole rows; values[0] is sample number `offset`."""
    first, sample, share = down
    for i in range(out.shape[0]):
        for entry in range(first[begin + i], first[begin + i + 1]):
            row, weight = values[sample[entry] - offset], share[entry]
            if entry == first[begin + i]:
                for c in range(out.shape[1]):
                    out[i, c] = row[c] * weight
            else:
                for c in range(out.shape[1]):
                    out[i, c] += row[c] * weight
