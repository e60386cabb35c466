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
    philox4x32,
    poisson,
    poisson_accept,
    poisson_after,
    poisson_candidate,
    poisson_squeeze,
)
from photosite.engine.random_runs import (
    new_run,
    normal_run,
    poisson_at_once,
    poisson_run,
    poisson_verdict,
    random_words,
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
    random_words(np.uint32(first), mean.size, FRAME, EXPOSURE, *KEY, run.words)
    poisson_run(mean.size, run, np.uint32(first), FRAME, *KEY)
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


@pytest.mark.parametrize(("mean", "most"), [(10.0, 0.02), (25.0, 0.012), (400.0, 1e-3), (3e5, 1e-3), (1e8, 1e-3)])
def test_short_decisions_agree_with_the_exact_ones(mean: float, most: float) -> None:
    """Of 20 000 trials, at most a share `most` is left to the exact test."""
    zero, undecided = np.uint32(0), 0
    for i in range(20_000):
        number = np.uint32(i)
        w0, w1, _, _ = (np.uint32(word) for word in philox4x32(number, FRAME, EXPOSURE, zero, *KEY))
        candidate = poisson_candidate(mean, w0)
        at_once = poisson_squeeze(mean, w0, w1)
        accepted = at_once or (candidate >= 16 and poisson_accept(mean, candidate, w0, w1))
        verdict = poisson_verdict(mean, candidate, w0, w1)
        undecided += verdict == 0
        assert at_once or not poisson_at_once(mean, w0, w1, 1e-9)
        assert poisson_at_once(mean, w0, w1, -1e-9) or not at_once
        if candidate >= 16:
            assert accepted if verdict > 0 else not accepted or verdict == 0
        else:  # the whole draw
            drawn = poisson_after(mean, number, FRAME, EXPOSURE, zero, *KEY)
            assert verdict <= 0 or drawn == candidate
    assert undecided <= most * 20_000


def test_counts_of_the_inversion_end() -> None:
    """The largest uniform number gives a finite count."""
    run = new_run(8)
    run.mean[:] = 9.99
    run.words[:] = np.uint32(2**32 - 1)
    poisson_run(8, run, np.uint32(FIRST), FRAME, *KEY)
    assert ((run.electrons > 30) & (run.electrons <= MOST_SMALL)).all()
