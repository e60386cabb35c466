"""Statistics of maps, compared with NumPy and SciPy."""

import numba
import numpy as np
import pytest
from scipy.ndimage import correlate1d

from photosite.engine.map_statistics import add_scaled, label_moments, line_means, residual_moments, smooth_separable

SHAPES = [(1, 1), (3, 31), (33, 32), (70, 101)]


def random_map(shape, seed=1):
    return np.random.default_rng(seed).gamma(2.0, 3.0, shape) + 1e4


@pytest.mark.parametrize("shape", SHAPES)
def test_line_means(shape):
    values = random_map(shape)
    mean, rows, cols = line_means(values)
    assert mean == pytest.approx(values.mean(), rel=1e-14)
    np.testing.assert_allclose(rows, values.mean(1), rtol=1e-14)
    np.testing.assert_allclose(cols, values.mean(0), rtol=1e-14)


@pytest.mark.parametrize("shape", SHAPES)
def test_residual_moments(shape):
    values = random_map(shape)
    rows, cols = values.mean(1), np.linspace(-1.0, 1.0, shape[1])
    residual = values - rows[:, None] - cols
    second, fourth = residual_moments(values, rows, cols)
    assert second == pytest.approx((residual**2).mean(), rel=1e-12)
    assert fourth == pytest.approx((residual**4).mean(), rel=1e-12)


def test_smoothing_matches_scipy_away_from_the_border():
    values, kernel = random_map((40, 53)), np.array([0.1, 0.2, 0.4, 0.2, 0.1])
    expected = correlate1d(correlate1d(values, kernel, 0), kernel, 1)[2:-2, 2:-2]
    np.testing.assert_allclose(smooth_separable(values, kernel), expected, rtol=1e-13)


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32])
def test_add_scaled_repeats_the_tile(dtype):
    total = random_map((7, 10))
    source = np.random.default_rng(2).integers(0, 60_000, (7, 10)).astype(dtype)
    factors = np.array([[1.0, -2.0, 0.0], [0.5, 4.0, 1e-3]])
    expected = total + source * np.tile(factors, (4, 4))[:7, :10]
    add_scaled(total, source, factors)
    np.testing.assert_allclose(total, expected, rtol=1e-14)


def test_results_do_not_depend_on_the_number_of_threads():
    values = random_map((200, 133))
    before = numba.get_num_threads()
    results = []
    try:
        for threads in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(threads)
            mean, rows, cols = line_means(values)
            results.append((mean, rows.tobytes(), cols.tobytes(), residual_moments(values, rows, cols)))
    finally:
        numba.set_num_threads(before)
    assert results[0] == results[1]


def test_label_moments():
    values, tile = np.random.default_rng(2).gamma(2.0, 3.0, (30, 41)) + 1e6, np.array([[0, 1], [1, 2]])
    labels = np.tile(tile, (15, 21))[:, :41]
    for k, moments in enumerate(label_moments(values, tile)):
        chosen = values[labels == k]
        deviation = chosen - chosen.mean()
        assert moments.pixels == chosen.size
        assert moments.mean == pytest.approx(chosen.mean(), rel=1e-14)
        assert moments.variance == pytest.approx(chosen.var(ddof=1), rel=1e-9)
        assert moments.fourth == pytest.approx((deviation**4).mean(), rel=1e-9)
