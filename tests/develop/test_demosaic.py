"""Bilinear demosaic: against a per-pixel loop, against textbook kernels, and on pictures that it reproduces exactly."""

import numpy as np
import pytest
from raising import raises
from scipy.ndimage import convolve

from photosite.develop.demosaic import demosaic_bilinear
from photosite.errors import InputError
from photosite.values.cfa import NAMED, channel_mask, plane_names

BAYER = ("rggb", "bggr", "gbrg", "grbg")

# On a Bayer tile a channel's neighbors are all beside or all diagonal; on this one the weights matter.
DIAGONAL = (("R", "G", "B"), ("G", "B", "R"), ("B", "R", "G"))


def pixel_by_pixel(mosaic, cfa):
    """The definition, one pixel at a time."""
    rows, cols = mosaic.shape
    names = plane_names(cfa)
    out = np.empty((rows, cols, len(names)))
    for r in range(rows):
        for c in range(cols):
            for k, name in enumerate(names):
                if cfa[r % len(cfa)][c % len(cfa[0])] == name:
                    out[r, c, k] = mosaic[r, c]
                    continue
                total = weight = 0.0
                for rr in range(max(r - 1, 0), min(r + 2, rows)):
                    for cc in range(max(c - 1, 0), min(c + 2, cols)):
                        if cfa[rr % len(cfa)][cc % len(cfa[0])] == name:
                            w = 2.0 if rr == r or cc == c else 1.0
                            total += w * mosaic[rr, cc]
                            weight += w
                out[r, c, k] = total / weight
    return out


@pytest.mark.parametrize("cfa", [*(NAMED[name] for name in BAYER), DIAGONAL])
@pytest.mark.parametrize("shape", [(3, 3), (3, 5), (6, 8), (7, 4)])
def test_every_pixel_follows_the_definition(cfa, shape):
    mosaic = np.random.default_rng(11).integers(0, 4096, shape).astype(np.float64)
    np.testing.assert_allclose(demosaic_bilinear(mosaic, cfa), pixel_by_pixel(mosaic, cfa), rtol=3e-7)


@pytest.mark.parametrize("name", BAYER)
def test_interior_is_the_textbook_convolution(name):
    mosaic = np.random.default_rng(12).uniform(0, 1, (12, 10))
    planes = demosaic_bilinear(mosaic, NAMED[name])
    cross = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
    square = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
    for k, (channel, kernel) in enumerate(zip("RGB", (square, cross, square), strict=True)):
        wanted = convolve(mosaic * channel_mask(NAMED[name], channel, mosaic.shape), kernel)
        np.testing.assert_allclose(planes[1:-1, 1:-1, k], wanted[1:-1, 1:-1], rtol=1e-6)


@pytest.mark.parametrize("name", BAYER)
def test_even_colour_is_kept_to_the_last_row_and_column(name):
    colour = {"R": 301.0, "G": 977.0, "B": 45.0}
    mosaic = sum(v * channel_mask(NAMED[name], c, (5, 7)) for c, v in colour.items())
    assert (demosaic_bilinear(mosaic, NAMED[name]) == [301.0, 977.0, 45.0]).all()


@pytest.mark.parametrize("name", BAYER)
def test_ramps_of_different_slopes_are_kept_inside(name):
    r, c = np.mgrid[0:9, 0:8].astype(np.float64)
    ramps = {"R": 10 + 3 * r - c, "G": 50 - 2 * r + 4 * c, "B": 5 + r + 7 * c}
    mosaic = sum(ramps[k] * channel_mask(NAMED[name], k, r.shape) for k in ramps)
    wanted = np.stack([ramps[k] for k in "RGB"], axis=-1)
    # Sums of small integers over powers of two: exact in float32.
    assert (demosaic_bilinear(mosaic, NAMED[name])[1:-1, 1:-1] == wanted[1:-1, 1:-1]).all()


def test_monochrome_is_unchanged():
    mosaic = np.arange(12, dtype=np.uint16).reshape(3, 4)
    planes = demosaic_bilinear(mosaic, NAMED["mono"])
    assert planes.shape == (3, 4, 1)
    assert (planes[..., 0] == mosaic).all()


def test_input_of_any_type_and_memory_order_gives_the_same():
    mosaic = np.random.default_rng(13).integers(0, 4096, (6, 8)).astype(np.uint16)
    wanted = demosaic_bilinear(mosaic, NAMED["rggb"])
    assert wanted.dtype == np.float32
    for other in (mosaic.astype(np.float64), np.asfortranarray(mosaic), mosaic.tolist()):
        assert (demosaic_bilinear(other, NAMED["rggb"]) == wanted).all()


@pytest.mark.parametrize(
    "tile",
    [
        ("RRGG", "RRGG", "GGBB", "GGBB"),
        ("RWGW", "WRWG", "GWBW", "WGWB"),
        ("GBGGRG", "RGRBGB", "GBGGRG", "GRGGBG", "BGBRGR", "GRGGBG"),
    ],
)
@pytest.mark.parametrize("shape", [(8, 8), (9, 11)])
def test_large_tiles_keep_even_colors(tile, shape):
    """Quad Bayer, RGBW and X-Trans; at corners some channels are more than half a tile away."""
    cfa = tuple(tuple(row) for row in tile)
    names = plane_names(cfa)
    mosaic = sum((10.0 + k) * channel_mask(cfa, name, shape) for k, name in enumerate(names))
    planes = demosaic_bilinear(mosaic, cfa)
    np.testing.assert_allclose(planes, np.broadcast_to(10.0 + np.arange(len(names)), planes.shape), rtol=1e-6)


def test_a_missing_channel_is_an_error():
    with raises(InputError, "cfa"):
        demosaic_bilinear(np.ones((1, 8)), NAMED["rggb"])


def test_a_stack_is_not_a_mosaic():
    with raises(InputError, "mosaic", value=(2, 4, 4)):
        demosaic_bilinear(np.ones((2, 4, 4)), NAMED["rggb"])
