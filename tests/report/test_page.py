"""Pictures for pages: reduction, enlargement, differences, JPEG, and developed pairs."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from photosite.develop.develop import develop_pair
from photosite.frames.raw_frame import RawFrame
from photosite.report.page import enlarge, jpeg_bytes, magnified, shrink
from photosite.values.cfa import cfa_from


def test_shrink_takes_means_of_squares() -> None:
    picture = np.random.default_rng(2).uniform(0, 1, (11, 17, 3)).astype(np.float32)
    small = shrink(picture, widest=6)
    assert small.shape == (3, 5, 3)
    for r in range(3):
        for c in range(5):
            expected = picture[3 * r : 3 * r + 3, 3 * c : 3 * c + 3].reshape(9, 3).mean(axis=0)
            np.testing.assert_allclose(small[r, c], expected, rtol=1e-6)


def test_narrow_picture_is_unchanged() -> None:
    picture = np.random.default_rng(2).uniform(0, 1, (5, 6, 3)).astype(np.float32)
    np.testing.assert_array_equal(shrink(picture, widest=6), picture)


def test_enlarge_is_undone_by_shrink() -> None:
    picture = np.random.default_rng(4).uniform(0, 1, (3, 4, 3)).astype(np.float32)
    np.testing.assert_allclose(shrink(enlarge(picture, 5), widest=4), picture, rtol=1e-6)


def test_black_level_does_not_change_the_developed_pair() -> None:
    dn = np.random.default_rng(6).integers(100, 3000, (12, 18)).astype(np.uint16)
    first = RawFrame(dn, bits=12, cfa=cfa_from("rggb"), black_level_dn=10, white_level_dn=4010)
    second = RawFrame(dn + 22, bits=12, cfa=cfa_from("rggb"), black_level_dn=32, white_level_dn=4032)
    one, other = develop_pair(first, second)
    np.testing.assert_allclose(one, other, atol=1e-6)


def test_brighter_frame_stays_brighter() -> None:
    """Automatic exposure of each frame would hide the difference."""
    dn = np.full((8, 8), 1000, np.uint16)
    one, other = develop_pair(RawFrame(dn, bits=12), RawFrame(2 * dn, bits=12))
    assert other.mean() > 1.3 * one.mean()


def test_magnified_difference() -> None:
    one, other = np.full((2, 2, 3), 0.5, np.float32), np.full((2, 2, 3), 0.45, np.float32)
    np.testing.assert_allclose(magnified(one, other, 4.0), 0.7, atol=1e-6)
    np.testing.assert_allclose(magnified(other, one, 4.0), 0.3, atol=1e-6)
    np.testing.assert_array_equal(magnified(one, other, 100.0), 1.0)


def test_jpeg_contains_the_picture() -> None:
    picture = np.broadcast_to(np.linspace(0, 1, 64, dtype=np.float32)[:, None, None], (64, 48, 3))
    back = np.asarray(Image.open(io.BytesIO(jpeg_bytes(picture)))) / 255.0
    assert back.shape == picture.shape
    np.testing.assert_allclose(back, picture, atol=0.02)
