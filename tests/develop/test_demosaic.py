"""Demosaicing: against a per-pixel loop and textbook kernels, and on pictures that it reproduces exactly."""

import numpy as np
import pytest
from raising import raises
from scipy.ndimage import convolve

from photosite.develop.demosaic import BAYER, demosaic, demosaic_bilinear
from photosite.errors import InputError
from photosite.values.cfa import NAMED, channel_mask, plane_names

DIAGONAL = (("R", "G", "B"), ("G", "B", "R"), ("B", "R", "G"))
HALF_WIDTHS = {
    "rggb": {"R": 2, "G": 2, "B": 2},
    "rgbw": {"W": 2, "R": 4, "G": 4, "B": 4},
    "rgb-ir": {"Ir": 2, "G": 2, "R": 4, "B": 4},
    "x-trans": {"R": 6, "G": 3, "B": 6},
}


def pixel_by_pixel(mosaic, cfa, half_widths):
    """The definition, one pixel at a time."""
    rows, cols = mosaic.shape
    names = plane_names(cfa)
    out = np.empty((rows, cols, len(names)))
    for r, c, k in np.ndindex(out.shape):
        if cfa[r % len(cfa)][c % len(cfa[0])] == names[k]:
            out[r, c, k] = mosaic[r, c]
            continue
        total = weight = 0.0
        for rr, cc in np.ndindex(rows, cols):
            if cfa[rr % len(cfa)][cc % len(cfa[0])] == names[k]:
                w = np.prod(np.maximum(half_widths[names[k]] - np.abs([rr - r, cc - c]), 0))
                total += w * mosaic[rr, cc]
                weight += w
        out[r, c, k] = total / weight
    return out


@pytest.mark.parametrize("name", HALF_WIDTHS)
def test_every_pixel_follows_the_definition(name):
    mosaic = np.random.default_rng(11).integers(0, 4096, (9, 8)).astype(np.float64)
    wanted = pixel_by_pixel(mosaic, NAMED[name], HALF_WIDTHS[name])
    np.testing.assert_allclose(demosaic_bilinear(mosaic, NAMED[name]), wanted, rtol=3e-7)


def test_a_stated_half_width_is_used():
    mosaic = np.random.default_rng(14).integers(0, 4096, (12, 13)).astype(np.float64)
    wanted = pixel_by_pixel(mosaic, NAMED["x-trans"], dict.fromkeys("RGB", 4))
    np.testing.assert_allclose(demosaic_bilinear(mosaic, NAMED["x-trans"], 4), wanted, rtol=3e-7)
    with raises(InputError, "half_width", value=0):
        demosaic_bilinear(mosaic, NAMED["x-trans"], 0)
    with raises(InputError, "cfa"):  # the nearest red pixel is two rows or columns away
        demosaic_bilinear(mosaic, NAMED["x-trans"], 1)


@pytest.mark.parametrize("name", BAYER)
def test_interior_is_the_textbook_convolution(name):
    mosaic = np.random.default_rng(12).uniform(0, 1, (12, 10))
    planes = demosaic_bilinear(mosaic, NAMED[name])
    cross = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
    square = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
    for k, (channel, kernel) in enumerate(zip("RGB", (square, cross, square), strict=True)):
        wanted = convolve(mosaic * channel_mask(NAMED[name], channel, mosaic.shape), kernel)
        np.testing.assert_allclose(planes[1:-1, 1:-1, k], wanted[1:-1, 1:-1], rtol=1e-6)


@pytest.mark.parametrize("cfa", [*NAMED.values(), DIAGONAL])
def test_constants_are_kept_to_the_border_and_ramps_of_different_slopes_inside(cfa):
    names, shape = plane_names(cfa), (19, 17)
    colors = 301.0 + 67.0 * np.arange(len(names))
    mosaic = sum(value * channel_mask(cfa, name, shape) for name, value in zip(names, colors, strict=True))
    np.testing.assert_allclose(demosaic_bilinear(mosaic, cfa), np.broadcast_to(colors, (*shape, len(names))), rtol=1e-6)
    r, c = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    ramps = np.stack([300 + (3 - k) * r + (2 * k - 5) * c for k in range(len(names))], axis=-1)
    mosaic = sum(ramps[..., k] * channel_mask(cfa, name, shape) for k, name in enumerate(names))
    reach = max(len(cfa), len(cfa[0])) - 1
    inside = np.s_[reach : shape[0] - reach, reach : shape[1] - reach]
    np.testing.assert_allclose(demosaic_bilinear(mosaic, cfa)[inside], ramps[inside], rtol=1e-6)


def test_input_of_any_type_and_memory_order_gives_the_same():
    mosaic = np.random.default_rng(13).integers(0, 4096, (6, 8)).astype(np.uint16)
    wanted = demosaic_bilinear(mosaic, NAMED["rggb"])
    assert wanted.dtype == np.float32
    for other in (mosaic.astype(np.float64), np.asfortranarray(mosaic), mosaic.tolist()):
        assert (demosaic_bilinear(other, NAMED["rggb"]) == wanted).all()


def test_a_missing_channel_is_an_error():
    with raises(InputError, "cfa"):
        demosaic_bilinear(np.ones((1, 8)), NAMED["rggb"])


def test_a_stack_is_not_a_mosaic():
    for method in ("bilinear", "menon"):
        with raises(InputError, "mosaic", value=(2, 4, 4)):
            demosaic(np.ones((2, 4, 4)), NAMED["rggb"], method)


@pytest.mark.parametrize("name", BAYER)
def test_malvar_is_the_published_filter(name):
    """The coefficients of Malvar, He and Cutler (2004), figure 2, at the red and blue pixels."""
    mosaic = np.random.default_rng(15).uniform(0, 1, (14, 12))
    planes = demosaic(mosaic, NAMED[name], "malvar")
    cross, diagonal = np.zeros((5, 5)), np.zeros((5, 5))
    cross[[0, 2, 2, 4], [2, 0, 4, 2]] = -1
    cross[[1, 2, 2, 3], [2, 1, 3, 2]] = 2
    cross[2, 2] = 4
    diagonal[[0, 2, 2, 4], [2, 0, 4, 2]] = -1.5
    diagonal[[1, 1, 3, 3], [1, 3, 1, 3]] = 2
    diagonal[2, 2] = 6
    inside = np.zeros(mosaic.shape, bool)
    inside[2:-2, 2:-2] = True
    for own, other in ("RB", "BR"):
        at = inside & channel_mask(NAMED[name], own, mosaic.shape)
        np.testing.assert_allclose(planes[at, 1], convolve(mosaic, cross / 8)[at], rtol=1e-5)
        np.testing.assert_allclose(planes[at, "RGB".index(other)], convolve(mosaic, diagonal / 8)[at], atol=1e-6)
        np.testing.assert_allclose(planes[at, "RGB".index(own)], mosaic[at], rtol=1e-6)


def test_the_methods_for_bayer_mosaics_are_sharper_and_refuse_other_tiles():
    r, c = np.mgrid[:48, :64]
    gray = 0.5 + 0.4 * np.sin(0.9 * r) * np.cos(0.6 * c)
    inside = np.s_[4:-4, 4:-4]
    errors = {
        method: float(np.std((demosaic(gray, NAMED["grbg"], method) - gray[..., None])[inside]))
        for method in ("bilinear", "malvar", "menon")
    }
    assert errors["malvar"] < 0.5 * errors["bilinear"]
    assert errors["menon"] < 0.5 * errors["bilinear"]
    with raises(InputError, "cfa", value="RC/CB", hint="Use the method 'bilinear'"):
        demosaic(gray, NAMED["rccb"], "malvar")
    with raises(InputError, "demosaic", value="ahd"):
        demosaic(gray, NAMED["rggb"], "ahd")
