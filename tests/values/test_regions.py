"""Regions: rectangles, and quadrilaterals against a test of every pixel's corners."""

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.values.cfa import NAMED
from photosite.values.region import Quadrilateral, Region


def within(corners, row, col):
    """Whether a point is in a convex shape: the angles between its corners sum to 360 degrees."""
    away = [complex(r - row, c - col) for r, c in corners]
    turns = [np.angle(b / a) if a != 0 and b != 0 else 0 for a, b in zip(away, away[1:] + away[:1], strict=True)]
    return abs(abs(sum(turns)) - 2 * np.pi) < 1e-6


@pytest.mark.parametrize(
    "corners",
    [
        ((2.3, 4.1), (5.7, 15.2), (14.1, 12.9), (11.8, 3.3)),
        ((2.3, 4.1), (11.8, 3.3), (14.1, 12.9), (5.7, 15.2)),  # in the other direction
        ((0.0, 7.0), (7.0, 14.0), (14.0, 7.0), (7.0, 0.0)),
    ],
)
def test_pixels_inside_have_all_four_corners_inside(corners):
    quad = Quadrilateral("q", corners)
    inside = quad.inside()
    assert inside.shape == (quad.r1 - quad.r0, quad.c1 - quad.c0)
    small = 1e-6
    for r in range(quad.r0, quad.r1):
        for c in range(quad.c0, quad.c1):
            points = [
                (r + small + i * (1 - 2 * small), c + small + j * (1 - 2 * small)) for i in (0, 1) for j in (0, 1)
            ]
            assert inside[r - quad.r0, c - quad.c0] == all(within(corners, *p) for p in points), (r, c)


def test_an_upright_quadrilateral_is_a_region():
    region, quad = Region("a", 3, 10, 5, 14), Quadrilateral("a", ((3, 5), (3, 14), (10, 14), (10, 5)))
    assert (quad.r0, quad.r1, quad.c0, quad.c1) == (region.r0, region.r1, region.c0, region.c1)
    assert quad.inside().all()
    dn = np.random.default_rng(1).integers(0, 4096, (24, 30)).astype(np.uint16)
    frames = [RawFrame(dn, 12, NAMED["gbrg"]), RawFrame(dn[::-1].copy(), 12, NAMED["gbrg"])]
    one, other = patch_statistics(frames, [region]), patch_statistics(frames, [quad])
    for name in ("pixels", "mean_dn", "standard_error_dn", "spatial_noise_dn", "temporal_variance_error_dn2"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_statistics_of_a_slanted_patch_are_those_of_its_pixels():
    dn = np.random.default_rng(2).integers(0, 4096, (24, 30)).astype(np.uint16)
    quad = Quadrilateral("q", ((2.3, 4.1), (5.7, 25.2), (21.1, 22.9), (17.8, 3.3)))
    found = patch_statistics(RawFrame(dn, 12, NAMED["rggb"]), [quad])
    for k, channel in enumerate(found.channels):
        values = [
            float(dn[r, c])
            for r in range(quad.r0, quad.r1)
            for c in range(quad.c0, quad.c1)
            if quad.inside()[r - quad.r0, c - quad.c0] and NAMED["rggb"][r % 2][c % 2] == channel
        ]
        assert found.pixels[0, k] == len(values)
        assert found.mean_dn[0, k] == pytest.approx(np.mean(values))
        assert found.spatial_noise_dn[0, k] == pytest.approx(np.std(values, ddof=1))


def test_the_error_of_temporal_variances_is_their_scatter():
    # 400 stacks of 3 frames, 100 pixels: the spread of the variance is known to 1 / sqrt(800) = 3.5 %.
    rng = np.random.default_rng(3)
    fixed = rng.normal(0, 30, (10, 10))
    found = []
    for _ in range(400):
        frames = [RawFrame(np.rint(1000 + fixed + rng.normal(0, 8, (10, 10))).astype(np.uint16), 12) for _ in range(3)]
        stats = patch_statistics(frames, [Region("a", 0, 10, 0, 10)])
        found.append((stats.temporal_noise_dn[0, 0] ** 2, stats.temporal_variance_error_dn2[0, 0]))
    variance, error = np.array(found).T
    assert np.sqrt(np.mean(error**2)) == pytest.approx(variance.std(), rel=0.14)


@pytest.mark.parametrize(
    "corners",
    [
        ((0, 0), (0, 5), (5, 5), (-1, 0)),
        ((0, 0), (5, 5), (0, 5), (5, 0)),
        ((0, 0), (0, 5), (0, 9), (5, 0)),
        ((0, 0), (0, 5), (1, 1), (5, 0)),
        ((0, 0), (0, 5), (5, np.nan), (5, 0)),
    ],
)
def test_invalid_quadrilaterals(corners):
    with raises(InputError, "corners", value=corners):
        Quadrilateral("q", corners)


def test_a_patch_beyond_the_frame():
    frame = RawFrame(np.zeros((8, 8), np.uint16), 12)
    with pytest.raises(InputError) as caught:
        patch_statistics(frame, [Quadrilateral("q", ((0, 0), (0, 9), (5, 5), (5, 0)))])
    assert (caught.value.what, caught.value.where) == ("region", "patch 'q'")
