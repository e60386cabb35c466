"""Products of the noise of frames, compared with NumPy."""

import numpy as np
import pytest

from photosite.engine.noise_products import difference_products, frame_products

TILES = [(1, 1), (2, 2), (3, 2)]


def random_frames(count, shape=(31, 38)):
    return np.random.default_rng(1).poisson(300.0, (count, *shape)).astype(np.uint16)


@pytest.mark.parametrize("tile", TILES)
def test_products_of_a_difference(tile):
    first, second = random_frames(2)
    rows, cols = (length // of_tile * of_tile for length, of_tile in zip(first.shape, tile, strict=True))
    difference = np.zeros((rows, cols))
    for r, c in np.ndindex(*tile):
        a, b = (frame[r : rows : tile[0], c : cols : tile[1]].astype(float) for frame in (first, second))
        mean, plane = a + b - (a + b).mean(), a - b - (a - b).mean()
        difference[r :: tile[0], c :: tile[1]] = plane - np.vdot(plane, mean) / np.vdot(mean, mean) * mean
    found = difference_products(first, second, tile, 2)
    padded = np.pad(difference, 2)
    for r, c in np.ndindex(*tile):
        for dy, dx in np.ndindex(5, 5):
            products = difference * padded[dy : dy + rows, dx : dx + cols]
            np.testing.assert_allclose(found.near[r, c, dy, dx], products[r :: tile[0], c :: tile[1]].sum(), atol=1e-6)
        np.testing.assert_allclose(found.rows[:, c], difference[:, c :: tile[1]].sum(axis=1), atol=1e-8)
        np.testing.assert_allclose(found.columns[r], difference[r :: tile[0]].sum(axis=0), atol=1e-8)


def test_equal_frames_have_no_difference():
    frame = np.full((4, 4), 7, np.uint16)
    assert not difference_products(frame, frame, (2, 2), 1).near.any()


@pytest.mark.parametrize("tile", TILES)
@pytest.mark.parametrize("part", [1, 1000])
def test_products_of_frames_without_what_is_smooth(tile, part):
    stack, block = random_frames(5, (67, 41)), 4
    for site in np.ndindex(*tile):
        plane = stack[:, site[0] :: tile[0], site[1] :: tile[1]].astype(float)
        rows, cols = (length // block * block for length in plane.shape[1:])
        height = max(part // cols // block, 1) * block
        found = list(frame_products(stack, site, tile, block, part))
        assert len(found) == -(-rows // height)
        for start, (products, pixels) in zip(range(0, rows, height), found, strict=True):
            values = plane[:, start : min(start + height, rows), :cols]
            values -= values.mean(axis=2, keepdims=True)
            values -= values.mean(axis=1, keepdims=True)
            blocks = values.reshape(len(stack), -1, block, cols // block, block)
            blocks -= blocks.mean(axis=(2, 4), keepdims=True)
            values = values.reshape(len(stack), -1)
            assert pixels == values.shape[1]
            np.testing.assert_allclose(products, values @ values.T, atol=1e-6)
