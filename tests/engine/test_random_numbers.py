"""Philox4x32-10 compared with the known answers published by Random123 (kat_vectors); the distributions of variates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from photosite.engine.jit import compiled
from photosite.engine.random_numbers import (
    exp,
    gamma_constants,
    gamma_squeeze,
    key_from_seed,
    log,
    normal,
    philox4x32,
    poisson,
)

KNOWN_ANSWERS = [
    ([0, 0, 0, 0], [0, 0], [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
    ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
    (
        [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
        [0xA4093822, 0x299F31D0],
        [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
    ),
]

N = 400_000


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN_ANSWERS)
def test_known_answers(counter: list[int], key: list[int], answer: list[int]) -> None:
    words = philox4x32(*(np.uint32(w) for w in counter), *(np.uint32(w) for w in key))
    assert [int(w) for w in words] == answer


@pytest.mark.parametrize("seed", [0, 1, 123456789, 2**63 + 11, 2**64 - 1])
def test_agrees_with_the_definition_in_integers(seed: int) -> None:
    """An independent Philox4x32-10 in Python integers."""

    def slow(c: list[int], k: list[int]) -> list[int]:
        for _ in range(10):
            a, b = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
            c = [(b >> 32) ^ c[1] ^ k[0], b & 0xFFFFFFFF, (a >> 32) ^ c[3] ^ k[1], a & 0xFFFFFFFF]
            k = [(k[0] + 0x9E3779B9) & 0xFFFFFFFF, (k[1] + 0xBB67AE85) & 0xFFFFFFFF]
        return c

    k0, k1 = key_from_seed(seed)
    words = philox4x32(np.uint32(7), np.uint32(1), np.uint32(2), np.uint32(3), k0, k1)
    assert [int(w) for w in words] == slow([7, 1, 2, 3], [int(k0), int(k1)])


def worst_ulp(ours: list[float], exact: list[float]) -> float:
    return max(abs(a - b) / math.ulp(b) for a, b in zip(ours, exact, strict=True))


def test_log() -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate([np.exp(rng.uniform(-500, 500, 20000)), rng.uniform(0.5, 2, 20000), [1.0, 2.0**-33, 1e5]])
    assert worst_ulp([log(v) for v in x], [math.log(v) for v in x]) <= 2
    assert log(1.0) == 0.0


def test_exp() -> None:
    x = np.concatenate([np.random.default_rng(2).uniform(-700, 700, 20000), np.linspace(-10, 0, 5001)])
    assert worst_ulp([exp(v) for v in x], [math.exp(v) for v in x]) <= 2
    assert exp(0.0) == 1.0


@compiled()
def many_poisson(mean: float, count: int, frame: np.uint32, k0: np.uint32, k1: np.uint32) -> NDArray[np.int64]:
    out = np.empty(count, np.int64)
    for i in range(count):
        out[i] = poisson(mean, np.uint32(i), frame, np.uint32(0), k0, k1)
    return out


@compiled()
def many_normal(count: int, source: np.uint32, k0: np.uint32, k1: np.uint32) -> NDArray[np.float64]:
    out = np.empty(count, np.float64)
    zero = np.uint32(0)
    for i in range(count):
        w0, _, _, _ = philox4x32(np.uint32(i), zero, source, zero, k0, k1)
        out[i] = normal(w0)
    return out


def poisson_p_value(counts: NDArray[np.int64], mean: float) -> float:
    """Chi-square over cells of equal expected size (at most 200, each at least 50 expected), tails in the end cells."""
    low, high = stats.poisson.ppf([1e-12, 1 - 1e-12], mean)
    values = np.arange(max(low - 1, 0), high + 2)
    cumulative = stats.poisson.cdf(values, mean)
    cells = min(200, counts.size // 50)
    cuts = np.unique(np.searchsorted(cumulative, np.linspace(0, 1, cells + 1)[1:-1]))
    borders = np.concatenate([[-np.inf], values[cuts] + 0.5, [np.inf]])
    fraction = np.diff(np.concatenate([[0], cumulative[cuts], [1]]))
    seen = np.histogram(counts, borders)[0]
    keep = fraction * counts.size >= 5
    fraction = np.append(fraction[keep], fraction[~keep].sum())
    seen = np.append(seen[keep], seen[~keep].sum())
    if fraction[-1] * counts.size < 1:
        assert seen[-1] <= 12  # expected below 1: more than 12 has a chance of 1e-13
        fraction, seen = fraction[:-1] / fraction[:-1].sum(), seen[:-1]
    return float(stats.chisquare(seen, fraction * seen.sum()).pvalue)


@pytest.mark.parametrize("mean", [0.01, 0.3, 1.0, 3.7, 9.99, 10.0, 12.5, 30.0, 100.0, 1e3, 12345.6, 1e5])
def test_poisson_counts_follow_the_law(mean: float) -> None:
    """12 means at 1e-4: one false alarm in 800 runs with other seeds."""
    counts = many_poisson(mean, N, np.uint32(0), *key_from_seed(11))
    assert poisson_p_value(counts, mean) > 1e-4
    z = (counts.mean() - mean) / math.sqrt(mean / N)
    assert abs(z) < 4


def test_the_poisson_test_has_power() -> None:
    """A rounded Gaussian with the right mean and variance fails the test up to a mean of 300."""
    rng = np.random.default_rng(5)
    for mean in (10.0, 100.0, 300.0):
        stand_in = np.rint(rng.normal(mean, math.sqrt(mean), N)).astype(np.int64)
        assert poisson_p_value(stand_in, mean) < 1e-4
    shifted = many_poisson(12345.6 * (1 + 3e-4), N, np.uint32(0), *key_from_seed(11))
    assert poisson_p_value(shifted, 12345.6) < 1e-4


def test_zero_mean_gives_zero_counts() -> None:
    assert not many_poisson(0.0, 1000, np.uint32(0), *key_from_seed(1)).any()


def test_normal_quantiles_match_scipy() -> None:
    words = np.unique(np.concatenate([np.arange(9), np.linspace(0, 2**32 - 1, 4001).astype(np.uint64)])).astype(
        np.uint32
    )
    ours = np.array([normal(w) for w in words])
    assert ours == pytest.approx(stats.norm.ppf((words + 0.5) / 2**32), rel=1e-13, abs=1e-15)
    assert ours[0] == pytest.approx(-ours[-1], rel=1e-14)


def test_normal_deviates_pass_anderson_darling() -> None:
    """The 1e-4 point of the statistic for a fully specified distribution is 8.8 (Marsaglia 2004)."""
    z = np.sort(many_normal(N, np.uint32(1), *key_from_seed(23)))
    i = np.arange(1, N + 1)
    a2 = -N - np.mean((2 * i - 1) * (stats.norm.logcdf(z) + stats.norm.logsf(z[::-1])))
    assert a2 < 8.8


def test_sources_frames_seeds_and_neighbours_are_independent() -> None:
    """Correlations of 400 000 pairs, six of them, each beyond 4.5 sigma with chance 7e-6."""
    base = many_normal(N, np.uint32(1), *key_from_seed(23))
    others = {
        "source": many_normal(N, np.uint32(2), *key_from_seed(23)),
        "seed": many_normal(N, np.uint32(1), *key_from_seed(24)),
        "high seed": many_normal(N, np.uint32(1), *key_from_seed(23 + 2**32)),
        "neighbour": np.roll(base, 1),
        "row": np.roll(base, 640),
    }
    for what, other in others.items():
        assert abs(np.corrcoef(base, other)[0, 1]) * math.sqrt(N) < 4.5, what
    frames = [many_poisson(50.0, N, np.uint32(f), *key_from_seed(3)) for f in (0, 1)]
    assert abs(np.corrcoef(*frames)[0, 1]) * math.sqrt(N) < 4.5


def test_gamma_candidates_are_accepted_at_once_only_if_the_exact_test_accepts_them() -> None:
    """Uniform numbers just above the limit exp(x^2 / 2 + d - d v + d log v) are refused; few below it are."""
    rng = np.random.default_rng(5)
    at_once = []
    for shape, x in zip(np.exp(rng.uniform(0, 9, 20_000)), rng.normal(0, 1.5, 20_000), strict=True):
        d, c = gamma_constants(shape)
        cube = max(1 + c * x, 0.0) ** 3
        limit = math.exp(0.5 * x * x + d * (1 - cube + math.log(cube))) if cube else 0.0
        assert not gamma_squeeze(d, c, x, limit + 1e-9)
        at_once.append(gamma_squeeze(d, c, x, 0.99 * limit))
    assert np.mean(at_once) > 0.85
