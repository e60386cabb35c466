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
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, bits_of_single, compiled, single_of_bits
from photosite.engine.random_numbers import (
    EXPOSURE,
    INVERSE,
    MOST_SMALL,
    SMALL_MEAN,
    WordArray,
    exp,
    normal_central,
    normal_tail,
    philox4x32,
    poisson_after,
    uniform,
    uniform_53,
)

_WIDTH = 16
"""Loops over lists go to a multiple of this, so that vectors do all of it; what is behind a list is not used."""


class Run(NamedTuple):
    """Arrays for one run of pixels; a thread allocates them once for several rows."""

    pixels: WordArray  # numbers of the pixels, words of their random counters
    words: WordArray  # (3, n)
    mean: F64
    electrons: F64
    deviates: F64
    # A list of pixels, and values of each. These are separate arrays: LLVM cannot tell that rows of one array
    # do not overlap, and would not vectorize the loops.
    late: I64
    few: I64  # another list
    marks: NDArray[np.uint8]  # 1 for a pixel of that list, 0 otherwise
    trials: WordArray
    listed: tuple[F64, F64, F64, F64, F64]
    short: tuple[F32, F32, F32, F32]


@compiled(inline=True)
def _padded(left: int) -> int:
    return (left + _WIDTH - 1) // _WIDTH * _WIDTH


@compiled()
def new_run(size: int) -> Run:
    """Return arrays for runs of at most `size` pixels."""
    empty, most = np.empty, _padded(size)
    listed = empty(most), empty(most), empty(most), empty(most), empty(most)
    short = empty(most, f), empty(most, f), empty(most, f), empty(most, f)
    words, trials = empty((3, size), np.uint32), empty((4, most), np.uint32)
    late, few, marks = empty(most, np.int64), empty(most, np.int64), np.zeros(most, np.uint8)
    mean, electrons, deviates = empty(size), empty(size), empty(size)
    return Run(empty(size, np.uint32), words, mean, electrons, deviates, late, few, marks, trials, listed, short)


@compiled()
def random_words(
    first: np.uint32, at: int, n: int, frame: np.uint32, use: np.uint32, k0: np.uint32, k1: np.uint32, run: Run
) -> None:
    """Set `n` pixels of a run from entry `at` on: numbers from `first` on, and the first three random words of each."""
    pixels, a, b, c = run.pixels[at:], run.words[0, at:], run.words[1, at:], run.words[2, at:]
    zero = np.uint32(0)
    for i in range(n):
        number = np.uint32(first + np.uint32(i))
        w0, w1, w2, _ = philox4x32(number, frame, use, zero, k0, k1)
        pixels[i] = number
        a[i] = w0
        b[i] = w1
        c[i] = w2


# Decisions in single precision, of which a vector instruction makes twice as many, and in loops whose numbers all have
# 32 bits. Bounds of errors are in units of 2^-24: an operation, a constant and a conversion add one unit of their
# result each; a root halves the error. Fused or not, operations stay within them.

f = np.float32
_UNIT = f(2.0**-32)
_ROUNDING = f(4e-6)
"""Above 40 units of 2^-24."""
_ALL, _HALF = np.uint32(0xFFFFFFFF), np.uint32(0x7FFFFFFF)
_SQRT_HALF_BITS = np.int32(0x3F3504F3)


@compiled(inline=True)
def _short_uniform(word: np.uint32) -> np.float32:
    """Return `uniform` to 2 units of itself."""
    return (f(word) + f(0.5)) * _UNIT


@compiled(inline=True)
def _short_place(word: np.uint32) -> tuple[np.float32, np.float32]:
    """Return `poisson_place`: the distance us from the nearer end to 2 units of itself, u to 2 units of 1/2."""
    us = _short_uniform(min(word, np.uint32(word ^ _ALL)))
    u = f(0.5) - us
    return (u if word > _HALF else -u), us


@compiled(inline=True)
def _short_hat(mean: np.float32) -> tuple[np.float32, np.float32]:
    """Return `poisson_hat` of a mean from 10 on: a to 10 units, b to 5."""
    b = f(0.931) + f(2.53) * math.sqrt(mean)
    return f(-0.059) + f(0.02483) * b, b


@compiled(inline=True)
def _short_squeeze(b: np.float32, us: np.float32, v: np.float32, slack: np.float32) -> bool:
    """Return whether the squeeze accepts: surely with slack `_ROUNDING`, possibly with -`_ROUNDING`.

    The first factor errs by 4 units of 1, the second by 7 of itself; it is 6.9 or more.
    """
    return bool((us >= f(0.07) + slack) & ((f(0.9277) - slack - v) * (b - f(2.0)) >= f(3.6224)))


@compiled(inline=True)
def _short_log(x: np.float32) -> np.float32:
    """Return the natural logarithm of a normal number above 0, to 4 units of 1 and 4 of itself."""
    bits = bits_of_single(x)
    e = np.int32(np.int32(bits - _SQRT_HALF_BITS) >> np.int32(23))
    m = single_of_bits(np.int32(bits - np.int32(e << np.int32(23))))
    s = (m - f(1.0)) / (m + f(1.0))
    t = s * s
    series = f(1.0) + t * (f(1 / 3) + t * (f(1 / 5) + t * (f(1 / 7) + t * f(1 / 9))))
    return f(e) * f(0.6931471805599453) + f(2.0) * s * series


@compiled(fused=True)
def short_trials(
    n: int, mean: F32, w0: WordArray, w1: WordArray, deviation: F32, error: F32, at_once: WordArray
) -> None:
    """Fill (n,) with the deviations of the candidates from the mean + 0.43, the bounds of their errors, in electrons,
    and 1 where the squeeze accepts for sure. Means are 10 or more; others give nothing of use.

    The sum in parentheses errs by 14 units, u by 1 of itself and 2 of us: in all, 16 units of the deviation and 2 of b.
    """
    for i in range(n):
        a, b = _short_hat(mean[i])
        u, us = _short_place(w0[i])
        deviation[i] = (f(2.0) * a / us + b) * u
        error[i] = f(1.2e-6) * (abs(deviation[i]) + b)
        at_once[i] = np.uint32(_short_squeeze(b, us, _short_uniform(w1[i]), _ROUNDING))


@compiled(inline=True)
def _count(mean: float, deviation: np.float32, error: np.float32) -> float:
    """Return the candidate of a trial; NaN if it could differ within the error of the deviation."""
    place = np.float64(deviation) + mean + 0.43
    count = np.floor(place)
    above = place - count
    return count if (above > np.float64(error)) & (above < 1.0 - np.float64(error)) else math.nan


@compiled(fused=True)
def short_verdicts(
    n: int, mean: F32, candidate: F32, difference: F32, w0: WordArray, w1: WordArray, verdict: F32
) -> None:
    """Fill (n,): 1 for a candidate that is surely accepted, -1 for one that is surely rejected, 0 for `poisson_after`.

    The test of `poisson_accept`. With x = (k - mean) / (k + mean), k log(mean / k) + k - mean = -(k - mean) x - 2 k
    (x^3 / 3 + x^5 / 5 + ...), where nothing large cancels. The density errs by 15 units of itself, the logarithm by 20
    of 1 and 4 of itself. A candidate that is NaN is never accepted.

    - `difference`: Candidate less mean.
    """
    for i in range(n):
        k = candidate[i]
        a, b = _short_hat(mean[i])
        _, us = _short_place(w0[i])
        v = _short_uniform(w1[i])
        beyond, square = b - f(3.4), us * us
        height = v * square * (f(1.1239) * beyond + f(1.1328)) / (beyond * (a + b * square))
        both = k + mean[i]
        inverse = f(1.0) / (k * both)
        x, one_over_k = difference[i] * (inverse * k), inverse * both
        t = x * x
        series = f(1 / 17) + t * f(1 / 19)
        series = f(1 / 15) + t * series
        series = f(1 / 13) + t * series
        series = f(1 / 11) + t * series
        series = f(1 / 9) + t * series
        series = f(1 / 7) + t * series
        series = f(1 / 5) + t * series
        series = f(1 / 3) + t * series
        square_k = one_over_k * one_over_k
        stirling = one_over_k * (f(1 / 12) - square_k * (f(1 / 360) - square_k * f(1 / 1260)))
        density = -x * (difference[i] + f(2.0) * k * (t * series)) - stirling
        margin = density - f(0.5) * _short_log(height * height * (f(2.0 * math.pi) * k))
        error = f(2.0) * _ROUNDING * (f(1.0) - density) + f(1e-14) * k  # the second is that of `poisson_accept`
        known = (k >= f(3.0)) & (k < f(1e15)) & (t <= f(0.2)) & (height >= f(1e-15))
        possible = (us >= f(0.013) + _ROUNDING) | (v <= us * (f(1.0) - _ROUNDING))
        impossible = (us < f(0.013) - _ROUNDING) & (v > us * (f(1.0) + _ROUNDING))
        at_once = _short_squeeze(b, us, v, _ROUNDING) & (k == k)
        accepted = (known & possible & (margin > error)) | at_once
        may_be_at_once = _short_squeeze(b, us, v, -_ROUNDING)
        rejected = ((k < f(0.0)) | impossible | (known & (margin < -error))) & (not may_be_at_once)
        verdict[i] = f(1.0) if accepted else (f(-1.0) if rejected else f(0.0))


NORMAL_ERROR = 4e-6
"""Bound of the error of `short_normals`."""


@compiled(fused=True)
def short_normals(n: int, words: WordArray, deviates: F32) -> None:
    """Fill (n,) with the deviates of `normal` to `NORMAL_ERROR`, and with NaN in the tails, of 1 word in 1000.

    For a uniform number 1/2 + q, the deviate is q times a smooth function of -log(1 - 4 q^2): Giles, "Approximating the
    erfinv function", GPU Computing Gems, Jade Edition (2011) 109. The polynomial was fitted to a relative error of 5e-7
    where the logarithm is at most 6.25. The deviate is at most 3.3 there.
    """
    for i in range(n):
        q, us = _short_place(words[i])
        t = -_short_log(f(4.0) * us * (f(1.0) - us)) - f(3.125)
        ratio = f(-4.78088542e-6) + t * f(9.2061046e-7)
        ratio = f(-3.72433285e-5) + t * ratio
        ratio = f(5.32448095e-4) + t * ratio
        ratio = f(-2.10034089e-3) + t * ratio
        ratio = f(-1.70728559e-2) + t * ratio
        ratio = f(6.79273566e-1) + t * ratio
        ratio = f(4.67724331) + t * ratio
        deviates[i] = q * ratio if t <= f(3.125) else f(math.nan)


@compiled()
def poisson_run(n: int, run: Run, frame: np.uint32, k0: np.uint32, k1: np.uint32) -> None:
    """Draw the Poisson counts of a run: one trial for each pixel, then small means, then undecided trials."""
    words, mean, electrons, late, trials = run.words, run.mean, run.electrons, run.late, run.trials
    short_mean, deviation, error, _ = run.short
    small = 0
    for i in range(n):
        short_mean[i] = mean[i]
        small += int(mean[i] < SMALL_MEAN)
        run.marks[i] = mean[i] < SMALL_MEAN
    left = 0
    if small < n:
        short_trials(n, short_mean, words[0], words[1], deviation, error, trials[0])
        for i in range(n):
            count = _count(mean[i], deviation[i], error[i])
            electrons[i] = count
            undecided = (count != count) | (trials[0, i] == np.uint32(0))
            trials[0, i] = np.uint32((mean[i] >= SMALL_MEAN) & undecided)
        for i in range(n):
            late[left] = i
            left += int(trials[0, i])
    if small:
        _poisson_small(marked(run.marks, n, run.few), run)
    _poisson_late(left, run, frame, k0, k1)


@compiled()
def marked(marks: NDArray[np.uint8], n: int, few: I64) -> int:
    """List those of `n` pixels whose mark is 1 in `few`, clear the marks, and return their number.

    Eight pixels without marks take the time of one.
    """
    found, eights = np.uint64(0), marks.view(np.uint64)
    for j in range((n + 7) // 8):
        if eights[j]:
            for i in range(8 * j, 8 * j + 8):
                few[found] = i
                found += np.uint64(marks[i])
            eights[j] = np.uint64(0)
    return int(np.int64(found))


@compiled()
def _poisson_late(left: int, run: Run, frame: np.uint32, k0: np.uint32, k1: np.uint32) -> None:
    """Decide about the candidates of the listed pixels; draw the rejected ones again until none is left.

    Each pixel gets the count that `poisson_after` gives from draw 0 on.
    """
    words, mean, electrons, late, trials = run.words, run.mean, run.electrons, run.late, run.trials
    means, candidates, pixels, exact, marks = run.listed[0], run.listed[1], run.trials[3], run.few, run.marks
    short_mean, count, difference, verdicts = run.short
    for j in range(left):
        i = np.uint64(late[j])  # an unsigned index is not tested for counting from the end
        pixels[j] = run.pixels[i]
        means[j] = mean[i]
        candidates[j] = electrons[i]
        trials[0, j] = words[0, i]
        trials[1, j] = words[1, i]
    draw = np.uint32(0)
    while left > 0:
        padded = _padded(left)
        for j in range(padded):
            short_mean[j] = means[j]
            count[j] = candidates[j]
            difference[j] = candidates[j] - means[j]
        short_verdicts(padded, short_mean, count, difference, trials[0], trials[1], verdicts)
        for j in range(left):
            marks[j] = verdicts[j] == f(0.0)
        for j in range(marked(marks, left, exact)):
            i = late[exact[j]]
            candidates[exact[j]] = poisson_after(mean[i], run.pixels[i], frame, EXPOSURE, draw, k0, k1)
        kept = np.uint64(0)
        for j in range(left):
            i = late[j]
            electrons[np.uint64(i)] = candidates[j]  # of rejected ones, too: the next draw replaces them
            late[kept] = i
            pixels[kept] = pixels[j]
            means[kept] = means[j]
            kept += np.uint64(verdicts[j] < f(0.0))
        left = int(np.int64(kept))
        padded = _padded(left)
        draw = np.uint32(draw + np.uint32(1))
        for j in range(padded):
            w0, w1, _, _ = philox4x32(pixels[j], frame, EXPOSURE, draw, k0, k1)
            trials[0, j] = w0
            trials[1, j] = w1
            short_mean[j] = means[j]
        short_trials(padded, short_mean, trials[0], trials[1], count, difference, trials[2])
        for j in range(padded):
            candidates[j] = _count(means[j], count[j], difference[j])


_STEPS = 5
"""Counts of the inversion in one pass over the pixels."""


@compiled()
def _poisson_small(small: int, run: Run) -> None:
    """Draw the first pixels in `few` by inversion, some counts per pass over all: the same sums as `poisson_small`."""
    words, mean, electrons, numbers = run.words, run.mean, run.electrons, run.few
    p, means, term, total, count = run.listed
    most = _padded(small)
    p[small:most], means[small:most] = 0.0, 0.0
    for j in range(small):
        i = numbers[j]
        means[j] = mean[i]
        p[j] = uniform_53(words[0, i], words[1, i])
    for j in range(most):
        term[j] = exp(-means[j])
        total[j] = term[j]
        count[j] = 1.0 if p[j] > total[j] else 0.0
    step, more = 1, 1
    while more and step < MOST_SMALL:
        more = 0
        for j in range(most):
            t, s, c = term[j], total[j], count[j]
            for k in range(_STEPS):
                t *= means[j] * INVERSE[step + k]
                s += t
                c += 1.0 if p[j] > s else 0.0
            term[j], total[j], count[j] = t, s, c
            more += int(p[j] > s)
        step += _STEPS
    for j in range(small):
        electrons[numbers[j]] = min(count[j], float(MOST_SMALL))


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
