"""Veiling glare compared with a sum over pixels, the limits of ISO 9358, and conservation of light."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.camera.veiling_glare import add_glare
from photosite.errors import InputError
from photosite.optics.illumination import VeilingGlare
from photosite.values.cfa import Cfa, cfa_from, channel_names, channel_sites

MONO = cfa_from("mono")
PITCH = (6e-6, 6e-6)


def veiled(
    frame: NDArray[np.float64], glare: VeilingGlare, cfa: Cfa = MONO, pitch: tuple[float, float] = PITCH
) -> NDArray[np.float32]:
    out = frame.astype(np.float32)
    add_glare(out, glare, cfa, pitch)
    return out


def mirrored_sum(frame: NDArray[np.float64], spread: tuple[float, float]) -> NDArray[np.float64]:
    """The reference: the kernel's sum over all pixels, and over five mirror images in each direction.

    `spread` in pixels on each axis.
    """
    rows, cols = frame.shape
    tiles = 5
    wide = np.pad(frame, [(tiles * n, tiles * n) for n in (rows, cols)], mode="symmetric")
    y = np.arange(-tiles * rows, (tiles + 1) * rows)[:, None]
    x = np.arange(-tiles * cols, (tiles + 1) * cols)
    out = np.zeros_like(frame)
    for r in range(0, rows, 7):  # some rows and columns are enough
        for c in range(0, cols, 5):
            kernel = np.exp(-np.hypot((y - r) / spread[0], (x - c) / spread[1]))
            out[r, c] = (kernel * wide).sum() / (2 * math.pi * spread[0] * spread[1])
    return out


def test_uniform_field_stays_uniform() -> None:
    frame = np.full((70, 90), 1234.5)
    for spread in (None, 0.2e-3, 50e-3):
        np.testing.assert_allclose(veiled(frame, VeilingGlare(0.3, spread)), 1234.5, rtol=1e-6)


@pytest.mark.parametrize("cfa", ["mono", "rggb"])
@pytest.mark.parametrize("spread", [None, 0.2e-3, 3e-3])
def test_light_of_each_channel_is_conserved(cfa: str, spread: float | None) -> None:
    tile = cfa_from(cfa)
    frame = np.random.default_rng(1).random((131, 205)) ** 8 * 1e4
    frame[:60] *= 20
    after = veiled(frame, VeilingGlare(0.2, spread), tile)
    for name in channel_names(tile):
        sites = [(slice(r, None, len(tile)), slice(c, None, len(tile[0]))) for r, c in channel_sites(tile, name)]
        before, now = (sum(a[s].sum(dtype=np.float64) for s in sites) for a in (frame, after))
        assert now == pytest.approx(before, rel=1e-6)


def test_black_spot_on_a_bright_field() -> None:
    """ISO 9358: the signal in a small black spot, relative to the field around it, is the veiling glare index."""
    rows, cols, side = 300, 400, 6
    frame = np.full((rows, cols), 5000.0)
    frame[147 : 147 + side, 197 : 197 + side] = 0
    even = veiled(frame, VeilingGlare(0.04))
    # What the spot itself lacks is missing from the veil: 36 pixels of 120 000.
    fraction = side**2 / (rows * cols)
    assert even[149, 199] / even[10, 10] == pytest.approx(0.04 * (1 - fraction) / (1 - 0.04 * fraction), rel=1e-5)
    near = veiled(frame, VeilingGlare(0.04, 150 * 6e-6))
    assert near[149, 199] / near[10, 10] == pytest.approx(0.04, rel=2e-3)


@pytest.mark.parametrize("pitch", [(6e-6, 6e-6), (8e-6, 5e-6)])
def test_scatter_is_the_sum_over_all_pixels(pitch: tuple[float, float]) -> None:
    frame = np.zeros((48, 60))
    frame[10:30, 5:21] = 100.0
    frame[35:47, 40:] = 30.0
    spread_m = 24 * 6e-6
    want = mirrored_sum(frame, (spread_m / pitch[0], spread_m / pitch[1]))
    got = veiled(frame, VeilingGlare(0.5, spread_m), pitch=pitch)
    veil = (got - 0.5 * frame) / 0.5
    there = want > 0
    assert there.sum() == 84
    assert np.abs(veil - want)[there].max() < 4e-3 * want.max()


def test_channels_do_not_mix() -> None:
    frame = np.zeros((64, 96))
    frame[0::2, 0::2] = 900.0  # red alone
    after = veiled(frame, VeilingGlare(0.1, 0.4e-3), cfa_from("rggb"))
    assert after[0::2, 1::2].max() == after[1::2].max() == 0
    np.testing.assert_allclose(after[0::2, 0::2], 900, rtol=1e-5)


def test_wide_scatter_becomes_uniform() -> None:
    frame = np.zeros((64, 96))
    frame[8:24, 8:40] = 100
    wide, even = (veiled(frame, VeilingGlare(0.1, spread)) for spread in (0.5, None))
    np.testing.assert_allclose(wide, even, rtol=1e-4)


def test_no_glare_and_no_light() -> None:
    frame = np.random.default_rng(2).random((20, 20))
    assert (veiled(frame, VeilingGlare(0.0)) == frame.astype(np.float32)).all()
    assert (veiled(np.zeros((20, 20)), VeilingGlare(0.5)) == 0).all()


def test_narrow_spread_is_an_error() -> None:
    with pytest.raises(InputError) as caught:
        veiled(np.ones((40, 40)), VeilingGlare(0.1, 12e-6))
    assert (caught.value.where, caught.value.what) == ("veiling_glare", "spread_m")
