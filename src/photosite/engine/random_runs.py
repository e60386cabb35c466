"""Random numbers for short runs of pixels: random words, Poisson counts, normal deviates.

The common case is computed for the whole run in straight loops, which become vector instructions. The few pixels that
need more work (rejected trials, tails, small means) are listed and computed afterwards. The numbers of a pixel depend
on its counter alone, not on the run, and are those of `random_numbers`, bit for bit. Where a decision takes long, a
shorter computation with a known error decides, and leaves to `random_numbers` what is within that error.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from photosite.engine.jit import F64, I64, compiled
from photosite.engine.random_numbers import (
    EXPOSURE,
    INVERSE,
    MOST_SMALL,
    SMALL_MEAN,
    WordArray,
    exp,
    mantissa,
    normal_central,
    normal_tail,
    philox4x32,
    poisson_after,
    poisson_candidate,
    poisson_hat,
    poisson_place,
    uniform,
    uniform_53,
)

_WIDTH = 8
"""Loops over lists go to a multiple of this, so that vectors do all of it; what is behind a list is not used."""


class Run(NamedTuple):
    """Arrays for one run of pixels; a thread allocates them once for several rows."""

    words: WordArray
    mean: F64
    electrons: F64
    deviates: F64
    # A list of pixels, and what is known of each. These are separate arrays: LLVM cannot tell that rows of one array
    # do not overlap, and would not vectorize the loops.
    late: I64
    trials: WordArray
    listed: tuple[F64, F64, F64, F64, F64]


@compiled()
def new_run(size: int) -> Run:
    """Return arrays for runs of at most `size` pixels."""
    empty, most = np.empty, size + _WIDTH
    listed = empty(most), empty(most), empty(most), empty(most), empty(most)
    words, trials, late = empty((3, size), np.uint32), empty((2, most), np.uint32), empty(most, np.int64)
    return Run(words, empty(size), empty(size), empty(size), late, trials, listed)


@compiled(inline=True)
def _padded(left: int) -> int:
    return (left + _WIDTH - 1) // _WIDTH * _WIDTH


@compiled()
def random_words(
    first: np.uint32, n: int, frame: np.uint32, use: np.uint32, k0: np.uint32, k1: np.uint32, words: WordArray
) -> None:
    """Fill (3, n) with the first three random words of each pixel."""
    zero = np.uint32(0)
    for i in range(n):
        w0, w1, w2, _ = philox4x32(np.uint32(first + np.uint32(i)), frame, use, zero, k0, k1)
        words[0, i] = w0
        words[1, i] = w1
        words[2, i] = w2


_TOLERANCE = 1e-6
"""Of the logarithms in `poisson_verdict`, absolute and relative; the errors of the series are below a third of it."""


@compiled(inline=True)
def poisson_at_once(mean: float, w0: np.uint32, w1: np.uint32, tolerance: float) -> bool:
    """Return whether the squeeze accepts a candidate, without a division.

    A tolerance of 1e-9 gives true only if `poisson_squeeze` accepts, and one of -1e-9 gives false only if it does not.
    """
    _, b = poisson_hat(mean)
    _, us = poisson_place(w0)
    return (us >= 0.07) & ((0.9277 - tolerance - uniform(w1)) * (b - 2.0) >= 3.6224)


@compiled(inline=True)
def poisson_verdict(mean: float, candidate: float, w0: np.uint32, w1: np.uint32) -> float:
    """Return 1 if a candidate is certainly accepted, -1 if it is certainly rejected, 0 if `poisson_after` must decide.

    The test of `poisson_accept`, with two divisions instead of eight. With x = (k - mean) / (k + mean),
    k log(mean / k) + k - mean = -(k - mean) x - 2 k (x^3 / 3 + x^5 / 5 + ...), where nothing large cancels.
    """
    k = candidate
    a, b = poisson_hat(mean)
    _, us = poisson_place(w0)
    v = uniform(w1)
    both, beyond = k + mean, b - 3.4
    hat = beyond * (a + b * (us * us))
    height = v * (us * us) * (1.1239 * beyond + 1.1328)
    inverse = 1.0 / (k * both * hat)
    one_over_k = inverse * both * hat
    x = (k - mean) * (inverse * k * hat)
    height *= inverse * k * both
    t = x * x
    series = 1 / 21 + t * (1 / 23)
    series = 1 / 19 + t * series
    series = 1 / 17 + t * series
    series = 1 / 15 + t * series
    series = 1 / 13 + t * series
    series = 1 / 11 + t * series
    series = 1 / 9 + t * series
    series = 1 / 7 + t * series
    series = 1 / 5 + t * series
    series = 1 / 3 + t * series
    square = one_over_k * one_over_k
    stirling = one_over_k * (1 / 12 - square * (1 / 360 - square * (1 / 1260)))
    density = -x * ((k - mean) + 2.0 * k * (t * series)) - stirling
    margin = density - 0.5 * _short_log(height * height * (2.0 * math.pi * k))
    tolerance = _TOLERANCE * (1.0 - density) + 1e-14 * k
    known = (k >= 3.0) & (t <= 0.3)
    possible = (us >= 0.013) | (v <= us)
    accepted = (known & possible & (margin > tolerance)) | poisson_at_once(mean, w0, w1, 1e-9)
    rejected = ((k < 0.0) | (not possible) | (known & (margin < -tolerance))) & (
        not poisson_at_once(mean, w0, w1, -1e-9)
    )
    return 1.0 if accepted else (-1.0 if rejected else 0.0)


@compiled(inline=True)
def _short_log(x: float) -> float:
    """Return the natural logarithm of a normal double above 0 to 1e-8."""
    m, e = mantissa(x)
    s = (m - 1.0) / (m + 1.0)
    t = s * s
    series = 1.0 + t * (1 / 3 + t * (1 / 5 + t * (1 / 7 + t * (1 / 9))))
    return e * 0.6931471805599453 + 2.0 * s * series


@compiled()
def poisson_run(n: int, run: Run, first: np.uint32, frame: np.uint32, k0: np.uint32, k1: np.uint32) -> None:
    """Draw the Poisson counts of a run: one trial for each pixel, then undecided trials, then small means."""
    words, mean, electrons, late, trials = run.words, run.mean, run.electrons, run.late, run.trials
    small = 0
    for i in range(n):
        small += int(mean[i] < SMALL_MEAN)
    if small < n:
        for i in range(n):
            electrons[i] = poisson_candidate(mean[i], words[0, i])
            taken = poisson_at_once(mean[i], words[0, i], words[1, i], 1e-9)
            trials[0, i] = np.uint32((mean[i] >= SMALL_MEAN) & (not taken))
        left = 0
        for i in range(n):
            late[left] = i
            left += int(trials[0, i])
        _poisson_late(left, run, first, frame, k0, k1)
    if small:
        left = 0
        for i in range(n):
            late[left] = i
            left += int(mean[i] < SMALL_MEAN)
        _poisson_small(left, run)


@compiled()
def _poisson_late(left: int, run: Run, first: np.uint32, frame: np.uint32, k0: np.uint32, k1: np.uint32) -> None:
    """Decide about the candidates of the listed pixels; draw the rejected ones again until none is left.

    Each pixel gets the count that `poisson_after` gives from draw 0 on.
    """
    words, mean, electrons, late, trials = run.words, run.mean, run.electrons, run.late, run.trials
    means, candidates, verdicts, _, _ = run.listed
    for j in range(left):
        i = late[j]
        means[j] = mean[i]
        candidates[j] = electrons[i]
        trials[0, j] = words[0, i]
        trials[1, j] = words[1, i]
    draw = np.uint32(0)
    while left > 0:
        for j in range(_padded(left)):
            verdicts[j] = poisson_verdict(means[j], candidates[j], trials[0, j], trials[1, j])
        kept = 0
        for j in range(left):
            i = late[j]
            electrons[i] = candidates[j]  # of rejected ones, too: the next draw replaces them
            late[kept] = i
            means[kept] = means[j]
            kept += int(verdicts[j] < 0.0)
            if verdicts[j] == 0.0:
                electrons[i] = poisson_after(mean[i], np.uint32(first + np.uint32(i)), frame, EXPOSURE, draw, k0, k1)
        left = kept
        draw += np.uint32(1)
        for j in range(_padded(left)):
            w0, w1, _, _ = philox4x32(np.uint32(first + np.uint32(late[j])), frame, EXPOSURE, draw, k0, k1)
            trials[0, j] = w0
            trials[1, j] = w1
            candidates[j] = poisson_candidate(means[j], w0)


_STEPS = 5
"""Counts of the inversion in one pass over the pixels."""


@compiled()
def _poisson_small(left: int, run: Run) -> None:
    """Draw the listed pixels by inversion, some counts per pass for all: the same sums as `poisson_small`."""
    words, mean, electrons, late = run.words, run.mean, run.electrons, run.late
    p, small, term, total, count = run.listed
    most = _padded(left)
    p[left:most], small[left:most] = 0.0, 0.0
    for j in range(left):
        i = late[j]
        small[j] = mean[i]
        p[j] = uniform_53(words[0, i], words[1, i])
    for j in range(most):
        term[j] = exp(-small[j])
        total[j] = term[j]
        count[j] = 1.0 if p[j] > total[j] else 0.0
    step, more = 1, 1
    while more and step < MOST_SMALL:
        more = 0
        for j in range(most):
            t, s, c = term[j], total[j], count[j]
            for k in range(_STEPS):
                t *= small[j] * INVERSE[step + k]
                s += t
                c += 1.0 if p[j] > s else 0.0
            term[j], total[j], count[j] = t, s, c
            more += int(p[j] > s)
        step += _STEPS
    for j in range(left):
        electrons[late[j]] = min(count[j], float(MOST_SMALL))


_FIRST_CENTRAL = np.uint32(math.ceil(0.075 * 2**32 - 0.5))
"""First word whose uniform number is within 0.425 of the median, where `normal_central` is valid."""
_CENTRAL = np.uint32(2**32 - 1 - 2 * int(_FIRST_CENTRAL))
"""Last of those words less the first."""


@compiled()
def normal_run(n: int, words: WordArray, run: Run) -> None:
    """Draw the standard normal deviates of a run from one word per pixel: the central range for all, then the tails."""
    deviates, late, (tails, _, _, _, _) = run.deviates, run.late, run.listed
    for i in range(n):
        deviates[i] = normal_central(uniform(words[i]) - 0.5)
    left = 0
    for i in range(n):
        late[left] = i
        left += int(np.uint32(words[i] - _FIRST_CENTRAL) > _CENTRAL)
    for j in range(left):
        tails[j] = uniform(words[late[j]]) - 0.5
    for j in range(_padded(left)):
        tails[j] = normal_tail(tails[j])
    for j in range(left):
        deviates[late[j]] = tails[j]
