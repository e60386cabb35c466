"""Statistics of many single-precision values have the bits of NumPy's of the same values in doubles."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.engine import large_statistics


@pytest.mark.parametrize("size", [1, 2, 3, 100, 4097, 300_001, 1_000_003])
def test_the_bits_are_those_of_numpy(monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    monkeypatch.setattr(large_statistics, "_PIECE", 1000)
    values = np.random.default_rng(size).lognormal(1.0, 2.0, size).astype(np.float32)
    doubles, before = values.astype(np.float64), values.copy()
    for fractions in ([0.1, 0.5, 0.9], [0.25, 1.0, 0.0], (np.arange(25) + 0.5) / 25):
        assert np.array_equal(large_statistics.quantiles(values, fractions), np.quantile(doubles, fractions))
    assert large_statistics.median(values) == np.median(doubles)
    found = large_statistics.mean_and_deviation(lambda piece: values[piece], size)
    assert found == (doubles.mean(), doubles.std())
    assert np.array_equal(values, before)


def test_pieces_cover_a_sequence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large_statistics, "_PIECE", 4)
    found = [list(range(10))[piece] for piece in large_statistics.pieces(10)]
    assert found == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9]]
