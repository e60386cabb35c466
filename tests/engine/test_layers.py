"""Layers: field weights, and the sum of layers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from photosite.engine.layers import Field, Grid, Layer, View, spectra_at_once, term_spectra
from photosite.engine.mosaic import mosaic_of_layers
from photosite.engine.resample import Warp
from photosite.engine.transfer import RadialTransfer, Sampling, Transfer

RNG = np.random.default_rng(6)
GRID = Grid((12, 15), 3, (2, 2), 3)
FIELD = Field(np.array([-1.0, 4, 9]), np.array([0.0, 2, 11, 14]), RNG.random((2, 3, 4)))
SAMPLING = Sampling((6e-6, 5e-6), (5e-6, 4e-6), 3)
ANYTHING = Transfer(RadialTransfer(RNG.random((3, 2, 9)), 4e4))
SITES = [[(0, 0)], [(0, 1), (1, 0)], [(1, 1)]]


def layer(rows: int = 12, cols: int = 15, equal: int = 1) -> Layer:
    """Return a layer of maps in which so many neighboring rows are equal."""
    step = (rows / 12, cols / 15)
    weights = np.repeat(RNG.random((4, rows // equal, cols)).astype(np.float32), equal, axis=1)
    view = View(weights, (0.0, 0.0), step)
    return Layer((view,), RNG.random((2, 2, 4)).astype(np.float32), ANYTHING, field=FIELD)


def on_cells(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return a map with samples of whole pixels or cells on the padded grid, with repeated border."""
    rows, cols = values.shape[0] // 12 or 1, values.shape[1] // 15 or 1
    pixels = np.kron(values, np.ones((max(12 // values.shape[0], 1), max(15 // values.shape[1], 1))))
    cells = np.kron(pixels, np.ones((3 // rows, 3 // cols)))
    before = [GRID.before(axis) * 3 for axis in (0, 1)]
    after = [GRID.cells(axis) - cells.shape[axis] - before[axis] for axis in (0, 1)]
    return np.pad(cells, list(zip(before, after, strict=True)), mode="edge")


@pytest.mark.parametrize(("rows", "cols", "equal"), [(12, 15, 1), (4, 5, 1), (36, 45, 1), (36, 15, 9), (4, 5, 4)])
def test_term_is_the_sum_of_weighted_maps(rows: int, cols: int, equal: int) -> None:
    """Compared with SciPy's linear interpolation, for scenes with fewer and with more samples than pixels."""
    one = layer(rows, cols, equal)
    points = np.stack(
        np.meshgrid(
            np.clip(GRID.centers(0), FIELD.row[0], FIELD.row[-1]),
            np.clip(GRID.centers(1), FIELD.col[0], FIELD.col[-1]),
            indexing="ij",
        ),
        axis=-1,
    )
    fields = [RegularGridInterpolator((FIELD.row, FIELD.col), w)(points) for w in FIELD.weights]
    out = np.empty((spectra_at_once(one), GRID.cells(0), GRID.cells(1) // 2 + 1), np.complex64)
    for mix, spectrum in zip(one.mixing, term_spectra(one, GRID, out), strict=True):
        maps = np.tensordot(mix, one.views[0].weights, axes=1)
        expected = sum(on_cells(m) * f for m, f in zip(maps, fields, strict=True))
        assert np.fft.irfft(spectrum, GRID.cells(1), axis=1) == pytest.approx(expected, abs=1e-5)


def test_field_with_one_node_of_weight_1() -> None:
    plain = replace(layer(), field=None, mixing=RNG.random((2, 1, 4)).astype(np.float32))
    even = replace(plain, field=Field(np.zeros(1), np.zeros(1), np.ones((1, 1, 1))))
    got = [mosaic_of_layers([one], SAMPLING, GRID, SITES) for one in (plain, even)]
    assert np.abs(got[0] - got[1]).max() < 1e-6 * np.abs(got[0]).max()


def test_layers_add_up() -> None:
    first, second = layer(), replace(layer(4, 5), transfer=Transfer(None, RNG.random((3, 2, 15, 15))))
    together = mosaic_of_layers([first, second], SAMPLING, GRID, SITES)
    apart = sum(mosaic_of_layers([one], SAMPLING, GRID, SITES) for one in (first, second))
    assert np.abs(together - apart).max() < 1e-6 * np.abs(apart).max()


def test_radial_part_and_kernel_add_up() -> None:
    kernels = RNG.random((3, 2, 15, 15))
    one = layer()
    both, alone, rest = (
        mosaic_of_layers([replace(one, transfer=t)], SAMPLING, GRID, SITES)
        for t in (Transfer(ANYTHING.radial, kernels), ANYTHING, Transfer(None, kernels))
    )
    assert np.abs(both - (alone + rest)).max() < 1e-6 * np.abs(both).max()


@pytest.mark.parametrize("tile", [(1, 1), (2, 2), (3, 2), (4, 4)])
def test_kernel_is_a_convolution_for_any_tile(tile: tuple[int, int]) -> None:
    """Compared with SciPy's, in the center of a frame, at each channel's sites."""
    from scipy.signal import convolve2d

    grid = Grid((24, 36), 8, tile)
    sites = [[(r, c)] for r in range(tile[0]) for c in range(tile[1])]
    kernels = RNG.random((len(sites), 1, 7, 7))
    weights = RNG.random((1, 24, 36)).astype(np.float32)
    one = Layer((View(weights, (0.0, 0.0), (1.0, 1.0)),), np.ones((1, 1, 1), np.float32), Transfer(None, kernels))
    got = mosaic_of_layers([one], Sampling((5e-6, 5e-6), (5e-6, 5e-6)), grid, sites)
    padded = np.pad(weights[0].astype(np.float64), 3, mode="edge")
    for kernel, [(r, c)] in zip(kernels[:, 0], sites, strict=True):
        expected = convolve2d(padded, kernel, mode="valid")[r :: tile[0], c :: tile[1]]
        assert np.abs(got[r :: tile[0], c :: tile[1]] - expected).max() < 1e-6 * expected.max()


def test_node_maps_of_several_views_equal_separate_layers() -> None:
    """Two views, three node maps, two terms, the second channel: against one layer per node map."""
    view = layer().views[0]
    views = view, replace(view, start=(0.4, -0.7)), replace(view, start=(0.1, 0.2))
    node_maps = tuple(RNG.random((n, 4)).astype(np.float32) for n in (2, 0, 1))
    mixing = RNG.random((2, 2, 3)).astype(np.float32)
    transfer = Transfer(RadialTransfer(RNG.random((1, 2, 9)), 4e4))
    got = mosaic_of_layers([Layer(views, mixing, transfer, node_maps, FIELD, 1)], SAMPLING, GRID, SITES)
    table = np.zeros((3, 2, 9))
    assert transfer.radial is not None
    table[1] = transfer.radial.table[0]
    alone = [
        Layer((views[n],), mixing[:, :, s, None] * node_maps[n][k], Transfer(RadialTransfer(table, 4e4)), field=FIELD)
        for s, (n, k) in enumerate([(0, 0), (0, 1), (2, 0)])
    ]
    expected = mosaic_of_layers(alone, SAMPLING, GRID, SITES)
    assert expected[0::2, 1::2].any()
    assert expected[1::2, 0::2].any()
    assert np.abs(got - expected).max() < 1e-6 * expected.max()
    assert not got[0::2, 0::2].any()
    assert not got[1::2, 1::2].any()


def test_terms_warped_together_equal_single_terms() -> None:
    """Seven terms with one to three modes each, more than are warped together."""
    radius = np.hypot(20, 20) * 6e-6
    warp = Warp(np.linspace(1.0, 1.05, 65), radius**2 / 64, (6e-6, 5e-6))
    view = replace(layer(9, 11).views[0], warp=warp)
    mixing = RNG.random((7, 2, 4)).astype(np.float32)
    mixing[[0, 1, 4], 0] = 0.0
    mixing[[2, 5], 1] = 0.0
    transfer = Transfer(RadialTransfer(RNG.random((3, 7, 9)), 4e4))
    got = mosaic_of_layers([Layer((view,), mixing, transfer, field=FIELD)], SAMPLING, GRID, SITES)
    assert transfer.radial is not None
    alone = [
        Layer((view,), mixing[t, None], Transfer(RadialTransfer(transfer.radial.table[:, t, None], 4e4)), field=FIELD)
        for t in range(7)
    ]
    expected = mosaic_of_layers(alone, SAMPLING, GRID, SITES)
    assert np.abs(got - expected).max() < 1e-6 * np.abs(expected).max()
