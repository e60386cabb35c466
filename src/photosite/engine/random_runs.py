"""Random numbers for short runs of pixels: random words, Poisson counts, normal deviates.

The common case is computed for the whole run in straight loops, which become vector instructions. The few pixels that
need more work (rejected trials, tails, small means) are listed and computed afterwards. The numbers of a pixel depend
on its counter alone, not on the run.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.arrays import F64, I64
from photosite.engine.elementary import exp
from photosite.engine.jit import compiled
from photosite.engine.philox import EXPOSURE, philox4x32
from photosite.engine.variates import (
    INVERSE,
    MOST_SMALL,
    SMALL_MEAN,
    normal_central,
    normal_tail,
    poisson_accept,
    poisson_after,
    poisson_candidate,
    poisson_squeeze,
    uniform,
    uniform_53,
)

Words = NDArray[np.uint32]


class Run(NamedTuple):
    """Arrays for one run of pixels; a thread allocates them once per row."""

    words: Words
    mean: F64
    electrons: F64
    deviates: F64
    late: I64
    tails: F64
    trials: Words


@compiled()
def new_run(size: int) -> Run:
    """Return arrays for runs of at most `size` pixels."""
    empty = np.empty
    return Run(
        empty((3, size), np.uint32), empty(size), empty(size), empty(size), empty(size, np.int64), empty(size),
        empty((2, size), np.uint32),
    )  # fmt: skip


@compiled()
def random_words(
    first: np.uint32, n: int, frame: np.uint32, use: np.uint32, k0: np.uint32, k1: np.uint32, words: Words
) -> None:
    """Fill (3, n) with the first three random words of each pixel."""
    zero = np.uint32(0)
    for i in range(n):
        w0, w1, w2, _ = philox4x32(np.uint32(first + np.uint32(i)), frame, use, zero, k0, k1)
        words[0, i] = w0
        words[1, i] = w1
        words[2, i] = w2


@compiled()
def poisson_run(n: int, run: Run, first: np.uint32, frame: np.uint32, k0: np.uint32, k1: np.uint32) -> None:
    """Draw the Poisson counts of a run: one trial for each pixel, then undecided trials, then small means."""
    words, mean, electrons, late, trials = run.words, run.mean, run.electrons, run.late, run.trials
    for i in range(n):
        electrons[i] = poisson_candidate(mean[i], words[0, i])
    for i in range(n):
        taken = poisson_squeeze(mean[i], words[0, i], words[1, i])
        trials[0, i] = np.uint32((mean[i] >= SMALL_MEAN) & (not taken))
    left = 0
    for i in range(n):
        late[left] = i
        left += int(trials[0, i])
    _poisson_late(left, run, first, frame, k0, k1)
    left = 0
    for i in range(n):
        late[left] = i
        left += int(mean[i] < SMALL_MEAN)
    if left:
        _poisson_small(left, mean, words, electrons, late)


@compiled()
def _poisson_late(left: int, run: Run, first: np.uint32, frame: np.uint32, k0: np.uint32, k1: np.uint32) -> None:
    """Test the candidates of the listed pixels by the exact ratio; draw the rejected ones again until none is left.

    Each pixel gets the count that `poisson_after` gives from draw 0 on.
    """
    words, mean, electrons, late, trials = run.words, run.mean, run.electrons, run.late, run.trials
    # Separate arrays: LLVM cannot tell that rows of one array do not overlap, and would not vectorize the loops.
    means, candidates, accepted = np.empty(left), np.empty(left), np.empty(left)
    for j in range(left):
        i = late[j]
        means[j] = mean[i]
        candidates[j] = electrons[i]
        trials[0, j] = words[0, i]
        trials[1, j] = words[1, i]
    draw = np.uint32(0)
    while left > 0:
        for j in range(left):
            u, v = trials[0, j], trials[1, j]
            # Below 16 the series of the ratio is invalid: use any number, the pixel is drawn by `poisson_after`.
            likely = poisson_accept(means[j], max(candidates[j], 16.0), u, v)
            accepted[j] = 1.0 if poisson_squeeze(means[j], u, v) | likely else 0.0
        kept = 0
        for j in range(left):
            i = late[j]
            if candidates[j] < 16.0:
                electrons[i] = poisson_after(mean[i], np.uint32(first + np.uint32(i)), frame, EXPOSURE, draw, k0, k1)
            elif accepted[j] > 0.0:
                electrons[i] = candidates[j]
            else:
                late[kept] = i
                means[kept] = means[j]
                kept += 1
        left = kept
        draw += np.uint32(1)
        for j in range(left):
            w0, w1, _, _ = philox4x32(np.uint32(first + np.uint32(late[j])), frame, EXPOSURE, draw, k0, k1)
            trials[0, j] = w0
            trials[1, j] = w1
            candidates[j] = poisson_candidate(means[j], w0)


@compiled()
def _poisson_small(left: int, mean: F64, words: Words, electrons: F64, late: I64) -> None:
    """Draw the listed pixels by inversion, one count per step for all: the same sums as `poisson_small`."""
    p, small = np.empty(left), np.empty(left)
    term, total, count = np.empty(left), np.empty(left), np.empty(left)
    for j in range(left):
        i = late[j]
        small[j] = mean[i]
        p[j] = uniform_53(words[0, i], words[1, i])
    for j in range(left):
        term[j] = exp(-small[j])
        total[j] = term[j]
        count[j] = 1.0 if p[j] > total[j] else 0.0
    step = 1
    more = True
    while more and step < MOST_SMALL:
        open_ = 0.0
        for j in range(left):
            term[j] *= small[j] * INVERSE[step]
            total[j] += term[j]
            beyond = 1.0 if p[j] > total[j] else 0.0
            count[j] += beyond
            open_ = max(open_, beyond)
        more = open_ > 0.0
        step += 1
    for j in range(left):
        electrons[late[j]] = count[j]


@compiled()
def normal_run(n: int, words: Words, run: Run) -> None:
    """Draw the standard normal deviates of a run from one word per pixel: the central range for all, then the tails."""
    deviates, late, tails = run.deviates, run.late, run.tails
    for i in range(n):
        deviates[i] = normal_central(uniform(words[i]) - 0.5)
    left = 0
    for i in range(n):
        late[left] = i
        left += int(abs(uniform(words[i]) - 0.5) > 0.425)
    for j in range(left):
        tails[j] = uniform(words[late[j]]) - 0.5
    for j in range(left):
        tails[j] = normal_tail(tails[j])
    for j in range(left):
        deviates[late[j]] = tails[j]
