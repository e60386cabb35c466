"""Statistics of the planes of a mosaic, compared with NumPy and SciPy."""

import numpy as np
import pytest
from scipy.ndimage import convolve, uniform_filter

from photosite.engine.site_planes import (
    count_numbers,
    far_sums,
    high_passed_planes,
    mean_of_sites,
    plane_moments,
    spaced_values,
)
from photosite.engine.threads import ITEMS_PER_THREAD, threads_for

SHAPES = [(31, 40), (64, 97), (200, 133)]
TILES = [(1, 1), (2, 2), (3, 2)]


def random_map(shape, seed=1):
    return np.random.default_rng(seed).gamma(2.0, 3.0, shape) + 1e3


@pytest.mark.parametrize("tile", TILES)
@pytest.mark.parametrize("shape", [(4, 31), *SHAPES])
def test_moments_of_planes(shape, tile):
    values = random_map(shape)
    found = plane_moments(values, tile)
    assert list(found) == list(np.ndindex(*tile))
    for site, (shape_found, rows, columns, second, fourth) in found.items():
        plane = values[site[0] :: tile[0], site[1] :: tile[1]]
        assert shape_found == plane.shape
        np.testing.assert_allclose(rows, plane.mean(1) - plane.mean(), atol=1e-10)
        np.testing.assert_allclose(columns, plane.mean(0) - plane.mean(), atol=1e-10)
        left = plane - plane.mean(1, keepdims=True) - plane.mean(0) + plane.mean()
        assert second == pytest.approx((left**2).mean(), rel=1e-9, abs=1e-20)
        assert fourth == pytest.approx((left**4).mean(), rel=1e-9, abs=1e-20)


@pytest.mark.parametrize("tile", TILES)
@pytest.mark.parametrize("shape", [(57, 40), (60, 97), (400, 1133)])
def test_high_passed_planes_match_scipy(shape, tile):
    values = random_map(shape)
    found = high_passed_planes(values, tile)
    for site in np.ndindex(*tile):
        plane = values[site[0] :: tile[0], site[1] :: tile[1]]
        smooth = uniform_filter(uniform_filter(plane, 7), 11)
        smooth = convolve(smooth, np.outer([1, 2, 1], [1, 2, 1]) / 16)
        np.testing.assert_allclose(
            found[site[0] :: tile[0], site[1] :: tile[1]], (plane - smooth)[9:-9, 9:-9], atol=1e-10
        )


@pytest.mark.parametrize("tile", TILES)
def test_moments_of_high_passed_planes(tile):
    values = random_map((400, 1133))
    found, expected = (
        plane_moments(values, tile, high_passed=True),
        plane_moments(high_passed_planes(values, tile), tile),
    )
    for one, other in zip(found.values(), expected.values(), strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(one.rows, other.rows, atol=1e-12)
        np.testing.assert_allclose(one.columns, other.columns, atol=1e-12)
        assert (one.second, one.fourth) == pytest.approx((other.second, other.fourth), rel=1e-12)


@pytest.mark.parametrize("shape", [(18, 60), (60, 18), (5, 5)])
def test_planes_without_pixels_beyond_the_border_of_the_filter(shape):
    assert high_passed_planes(random_map(shape), (1, 1)).size == 0


def test_the_result_does_not_depend_on_the_number_of_threads():
    values, found = random_map((333, 200)), []
    for threads in (1, 2):
        with threads_for(threads * ITEMS_PER_THREAD):
            of_planes = [
                *plane_moments(values, (2, 2)).values(),
                *plane_moments(values, (2, 2), high_passed=True).values(),
            ]
            moments = [(m.rows.tobytes(), m.columns.tobytes(), m.second, m.fourth) for m in of_planes]
            far = far_sums(values, np.full((2, 2), 1e3), np.full((2, 2), 100.0))
            mean = mean_of_sites(values, None, (2, 2), relative=True)[:]
            found.append((moments, far, mean.tobytes()))
    assert found[0] == found[1]


@pytest.mark.parametrize("tile", TILES)
@pytest.mark.parametrize("shape", SHAPES)
def test_far_pixels_and_spaced_values(shape, tile):
    values = random_map(shape)
    whole = values[: shape[0] // tile[0] * tile[0], : shape[1] // tile[1] * tile[1]]
    middle, limit = random_map(tile, 2), np.random.default_rng(3).uniform(1.0, 400.0, tile)
    expected = np.zeros(3)
    for site in np.ndindex(*tile):
        plane = whole[site[0] :: tile[0], site[1] :: tile[1]]
        square = (plane - middle[site]) ** 2
        beyond = square > limit[site]
        expected += beyond.sum(), square[beyond].sum(), square.sum()
        np.testing.assert_array_equal(spaced_values(values, site, tile, 7), plane.ravel()[::7])
    np.testing.assert_allclose(far_sums(values, middle, limit), expected, rtol=1e-12)


@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize("tile", TILES)
def test_mean_of_sites(tile, relative):
    values, dark = random_map((61, 97)), random_map((61, 97), 2) - 900.0
    signal = values - dark
    rows, cols = 61 // tile[0], 97 // tile[1]
    sites = [signal[r :: tile[0], c :: tile[1]][:rows, :cols] for r, c in np.ndindex(*tile)]
    expected = np.mean([site / site.mean() if relative else site for site in sites], axis=0)
    np.testing.assert_allclose(mean_of_sites(values, dark, tile, relative=relative)[:], expected, rtol=1e-12)
    assert mean_of_sites(dark, values, tile, relative=True) is None


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_counts_of_numbers(dtype):
    frame = np.random.default_rng(1).integers(0, np.iinfo(dtype).max + 1, (31, 53)).astype(dtype)
    np.testing.assert_array_equal(count_numbers(frame), np.bincount(frame.ravel(), minlength=1 << 16))
