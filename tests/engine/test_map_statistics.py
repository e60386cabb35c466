"""Statistics of maps, compared with NumPy and SciPy."""

import numpy as np
import pytest

from photosite.engine.map_statistics import (
    LONGEST_LINE,
    FrameShift,
    ResidualSums,
    add_residuals,
    add_scaled,
    label_moments,
    line_sums,
    remove_group_means,
)

SHAPES = [(1, 1), (3, 31), (33, 32), (70, 101)]


def random_map(shape, seed=1):
    return np.random.default_rng(seed).gamma(2.0, 3.0, shape) + 1e4


def test_add_scaled_adds_maps_of_several_types_and_refuses_other_sizes():
    rng, total = np.random.default_rng(2), np.zeros((7, 10))
    maps = [rng.integers(0, 60_000, (7, 10)).astype(dtype) for dtype in (np.uint32, np.uint16, np.uint16, np.uint32)]
    factors = [rng.normal(size=(2, 2)) for _ in maps]
    expected = sum(values * np.tile(tile, (4, 5))[:7] for values, tile in zip(maps, factors, strict=True))
    add_scaled(total, list(zip(maps, factors, strict=True)))
    np.testing.assert_allclose(total, expected, rtol=1e-12)
    with pytest.raises(ValueError, match="10"):
        add_scaled(total, [(maps[0][:6], factors[0])])


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32])
def test_add_scaled_repeats_the_tile(dtype):
    total = random_map((7, 10))
    source = np.random.default_rng(2).integers(0, 60_000, (7, 10)).astype(dtype)
    factors = np.array([[1.0, -2.0, 0.0], [0.5, 4.0, 1e-3]])
    expected = total + source * np.tile(factors, (4, 4))[:7, :10]
    add_scaled(total, [(source, factors)])
    np.testing.assert_allclose(total, expected, rtol=1e-14)


def test_label_moments():
    values, tile = np.random.default_rng(2).gamma(2.0, 3.0, (30, 41)) + 1e6, np.array([[0, 1], [1, 2]])
    labels = np.tile(tile, (15, 21))[:, :41]
    for k, moments in enumerate(label_moments(values, tile)):
        chosen = values[labels == k]
        deviation = chosen - chosen.mean()
        assert moments.pixels == chosen.size
        assert moments.mean == pytest.approx(chosen.mean(), rel=1e-14)
        assert moments.variance == pytest.approx(chosen.var(ddof=1), rel=1e-9)
        assert moments.third == pytest.approx((deviation**3).mean(), rel=1e-9)
        assert moments.fourth == pytest.approx((deviation**4).mean(), rel=1e-9)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("tile", [(1, 1), (2, 2), (3, 2)])
@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (64, 33), (130, 66)])
def test_line_sums_of_each_tile_site_match_numpy(shape, tile, dtype):
    frames = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, (3, *shape), dtype, endpoint=True)
    row_sums, column_sums = line_sums(frames, tile)
    assert row_sums.shape == (3, shape[0], tile[1])
    assert column_sums.shape == (3, tile[0], shape[1])
    for r in range(tile[0]):
        for c in range(tile[1]):
            plane = frames[:, r :: tile[0], c :: tile[1]].astype(np.uint64)
            np.testing.assert_array_equal(row_sums[:, r :: tile[0], c], plane.sum(2))
            np.testing.assert_array_equal(column_sums[:, r, c :: tile[1]], plane.sum(1))


def test_line_sums_do_not_overflow():
    frame = np.full((1, LONGEST_LINE), 65_535, np.uint16)
    assert line_sums([frame])[0][0, 0, 0] == LONGEST_LINE * 65_535
    assert line_sums([frame.T])[1][0, 0, 0] == LONGEST_LINE * 65_535


def test_line_sums_accept_views_and_iterators():
    frames = np.random.default_rng(2).integers(0, 4096, (2, 40, 30), np.uint16)
    row_sums, column_sums = line_sums(frame[::2, ::3] for frame in frames)
    np.testing.assert_array_equal(row_sums[:, :, 0], frames[:, ::2, ::3].sum(2, dtype=np.uint32))
    np.testing.assert_array_equal(column_sums[:, 0], frames[:, ::2, ::3].sum(1, dtype=np.uint32))


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ([], "at least one frame"),
        ([np.zeros((2, 2), np.uint16), np.zeros((2, 3), np.uint16)], r"got \(2, 3\)"),
        ([np.zeros((2, 2))], "float64"),
        ([np.zeros((1, LONGEST_LINE + 1), np.uint16)], "at most 65536"),
    ],
)
def test_line_sums_reject_invalid_frames(frames, message):
    with pytest.raises(ValueError, match=message):
        line_sums(frames)


def test_residuals_match_numpy():
    rng = np.random.default_rng(3)
    frames = rng.integers(50, 90, (6, 37, 21)).astype(np.uint16)
    frames[0, 5, 7] = 60_000  # beyond the last bin
    total = frames.sum(axis=0, dtype=np.uint32)
    rows, columns = rng.normal(0, 1, (6, 37)), rng.normal(0, 1, (6, 21))
    (second, fourth), histogram = np.zeros((2, 37, 21), np.float32), np.zeros((5, 100), np.int64)
    for frame, row, column in zip(frames, rows, columns, strict=True):
        add_residuals(frame, total, 6, FrameShift(3.0, row, column), 2.5, ResidualSums(second, fourth, histogram))

    residual = frames - total / 6 - 3.0
    np.testing.assert_allclose(second, (residual**2).sum(axis=0), rtol=1e-5)
    np.testing.assert_allclose(fourth, (residual**4).sum(axis=0), rtol=1e-5)
    shifted = residual - rows[:, :, None] - columns[:, None, :]
    edges = (np.arange(101) - 50) / 2.5
    edges[0], edges[-1] = -np.inf, np.inf
    for block in range(5):
        in_block = shifted[:, block * 37 // 5 : (block + 1) * 37 // 5]
        assert histogram[block].tolist() == np.histogram(in_block, edges)[0].tolist()


def test_means_of_groups_are_removed_in_turn_and_tails_clipped():
    rng = np.random.default_rng(3)
    values = rng.normal(size=(3, 240)).astype(np.float32)
    values[1, 7] = 100.0
    groups = np.stack([np.repeat(np.arange(6), 40), np.tile(np.arange(8), 30)])
    expected = values.astype(np.float64)
    for _ in range(2):
        for grouping in groups:
            for k in np.unique(grouping):
                expected[:, grouping == k] -= expected[:, grouping == k].mean(axis=1, keepdims=True)
        limit = 4.0 * np.median(np.abs(expected[:, ::4]), axis=1, keepdims=True)
        expected = np.clip(expected, -limit, limit)
    remove_group_means(values, groups, 2, 4.0)
    np.testing.assert_allclose(values, expected, atol=1e-5)
    assert abs(values[1, 7]) < 5.0
