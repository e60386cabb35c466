"""Means of blocks without outliers, compared with NumPy's medians."""

import numpy as np
import pytest

from photosite.engine.block_means import block_means


@pytest.mark.parametrize("side", [2, 3, 7, 24])
@pytest.mark.parametrize("shape", [(30, 43), (101, 64)])
@pytest.mark.parametrize("grain", [0.0, 0.25])
def test_outliers_are_left_out(shape, side, grain):
    rng = np.random.default_rng(1)
    values = rng.normal(2.0, 1.0, shape)
    if grain:
        values = np.round(values / grain) * grain
    values[rng.random(shape) < 0.01] += 50.0
    rows, cols = shape[0] // side, shape[1] // side
    blocks = values[: rows * side, : cols * side].reshape(rows, side, cols, side).swapaxes(1, 2).reshape(rows, cols, -1)
    distance = np.abs(blocks - np.median(blocks, axis=2, keepdims=True))
    kept = distance <= 3.0 * np.median(distance)
    assert not kept.all()
    expected = (blocks * kept).sum(axis=2) / np.maximum(kept.sum(axis=2), 1)
    np.testing.assert_allclose(block_means(values, side, 3.0), expected, rtol=1e-13, atol=1e-13)


def test_equal_values():
    np.testing.assert_array_equal(block_means(np.full((8, 12), 3.0), 4, 4.0), np.full((2, 3), 3.0))
