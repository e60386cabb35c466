"""Runs of pixels have the numbers of single pixels, bit for bit; short decisions agree with the exact ones."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.engine.random_numbers import (
    EXPOSURE,
    MOST_SMALL,
    key_from_seed,
    normal,
    poisson,
    poisson_accept,
    poisson_after,
    poisson_candidate,
    poisson_squeeze,
)
from photosite.engine.random_runs import (
    NORMAL_ERROR,
    new_run,
    normal_run,
    poisson_run,
    random_words,
    short_normals,
    short_trials,
    short_verdicts,
)

KEY = key_from_seed(2**35 + 5)
FIRST, FRAME = 2**32 - 20_000, np.uint32(3)
SIZE = 1000
LEVELS = [
    0.0,
    1e-9,
    0.03,
    0.7,
    2.0,
    6.0,
    9.999,
    10.0,
    10.4,
    13.0,
    19.0,
    31.0,
    75.0,
    300.0,
    2e3,
    3e4,
    1e6,
    1e9,
    1e15,
    1e30,
]


def check_run(mean: NDArray[np.float64], first: int) -> None:
    """Compare the Poisson counts and deviates of a run with those of `poisson` and `normal`."""
    run = new_run(mean.size)
    run.mean[:] = mean
    first %= 2**32
    random_words(np.uint32(first), 0, mean.size, FRAME, EXPOSURE, *KEY, run)
    poisson_run(mean.size, run, FRAME, *KEY)
    normal_run(mean.size, run.words[2], run)
    numbers = (np.uint32((first + i) % 2**32) for i in range(mean.size))
    assert list(run.electrons) == [poisson(m, n, FRAME, EXPOSURE, *KEY) for m, n in zip(mean, numbers, strict=True)]
    assert list(run.deviates) == [normal(word) for word in run.words[2]]


@pytest.mark.parametrize("level", LEVELS)
def test_runs_have_the_numbers_of_single_pixels(level: float) -> None:
    check_run(np.full(SIZE, level), FIRST)
    check_run(level * np.random.default_rng(1).uniform(0.9, 1.1, SIZE - 3), FIRST + SIZE)


def test_mixed_runs_have_the_numbers_of_single_pixels() -> None:
    rng = np.random.default_rng(2)
    for k in range(20):
        check_run(np.exp(rng.uniform(-4, 9, SIZE + k)), FIRST + 2 * k * SIZE)


@pytest.mark.parametrize(("mean", "most"), [(10.0, 0.08), (25.0, 0.02), (400.0, 1e-3), (3e5, 0.005), (1e8, 0.1)])
def test_short_decisions_agree_with_the_exact_ones(mean: float, most: float) -> None:
    """Of 20 000 trials, at most a fraction `most` is left to the exact functions."""
    n, zero = 20_000, np.uint32(0)
    run = new_run(n)
    random_words(np.uint32(0), 0, n, FRAME, EXPOSURE, *KEY, run)
    w0, w1, _ = run.words
    short_mean, deviation, error, verdict = (values[:n] for values in run.short)
    short_mean[:] = mean
    at_once = run.trials[0]
    short_trials(n, short_mean, w0, w1, deviation, error, at_once)
    candidates = np.array([poisson_candidate(mean, word) for word in w0])
    place = deviation.astype(np.float64) + mean + 0.43
    unsure = np.minimum(place - np.floor(place), np.ceil(place) - place) <= error
    assert (np.floor(place) == candidates)[~unsure].all()
    difference = (candidates - mean).astype(np.float32)
    short_verdicts(n, short_mean, candidates.astype(np.float32), difference, w0, w1, verdict)
    for i in range(n):
        exact = poisson_squeeze(mean, w0[i], w1[i])
        assert exact or not at_once[i]
        if candidates[i] >= 16:
            exact = exact or poisson_accept(mean, candidates[i], w0[i], w1[i])
        else:  # the whole draw
            exact = poisson_after(mean, np.uint32(i), FRAME, EXPOSURE, zero, *KEY) == candidates[i]
        assert verdict[i] == 0 or (verdict[i] > 0) == exact or (candidates[i] < 16 and verdict[i] < 0)
    assert np.count_nonzero(unsure | (verdict == 0)) <= most * n


def test_candidates_in_doubt_are_not_accepted() -> None:
    run = new_run(1000)
    random_words(np.uint32(0), 0, 1000, FRAME, EXPOSURE, *KEY, run)
    short_mean, candidate, difference, verdict = run.short
    short_mean[:], candidate[:], difference[:] = 400.0, np.nan, np.nan
    short_verdicts(1000, short_mean, candidate, difference, *run.words[:2], verdict)
    assert (verdict[:1000] <= 0).all()


def test_short_deviates_are_within_their_error() -> None:
    """At a million words: all of the ends of the range, and every 5000th."""
    words = np.concatenate([np.arange(0, 2**32, 5000), np.arange(50_000), 2**32 - 1 - np.arange(50_000)])
    words = words.astype(np.uint32)
    short = np.empty(words.size, np.float32)
    short_normals(words.size, words, short)
    exact = np.array([normal(word) for word in words])
    assert np.isnan(short).mean() < 0.11
    assert np.isnan(short[: 2**32 // 5000]).mean() < 0.00105
    assert np.nanmax(np.abs(short - exact)) < NORMAL_ERROR / 2


def test_counts_of_the_inversion_end() -> None:
    """The largest uniform number gives a finite count."""
    run = new_run(8)
    run.mean[:] = 9.99
    run.words[:] = np.uint32(2**32 - 1)
    poisson_run(8, run, FRAME, *KEY)
    assert ((run.electrons > 30) & (run.electrons <= MOST_SMALL)).all()
