"""From weight maps to a mosaic in the frequency domain: a sum over terms, about one inverse transform (docs/theory.md).

A channel is needed only at its own sites of the mosaic, for example one pixel in four. Taking every second value of a
line folds its spectrum in half. Spectra are therefore folded while they are summed, and each inverse transform has a
quarter of the size. All terms of all layers are added before the inverse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.fft

from photosite.engine.arrays import C64, F32
from photosite.engine.fold_spectra import Folds, RadialRows, add_general, add_radial
from photosite.engine.gridding import Gridding
from photosite.engine.layers import WORKERS, Grid, Layer, term_spectra
from photosite.engine.transfer import RadialTransfer, Sampling, Transfer, folded_terms


def mosaic_of_layers(
    layers: Sequence[Layer], sampling: Sampling, grid: Grid, sites: Sequence[Sequence[tuple[int, int]]]
) -> F32:
    """Return (rows, cols), the mosaic of weight maps, seen through a lens by a sensor.

    The light of all layers adds up. `sites` are (row, col) of each channel in the color filter array's tile.
    """
    places = [(r, c, channel) for channel, of_channel in enumerate(sites) for r, c in of_channel]
    folds = _empty_folds(grid, places)
    spectrum = np.empty((grid.cells(0), grid.cells(1) // 2 + 1), np.complex64)
    for layer in layers:
        response = _Response(layer.transfer, sampling, grid)
        reached = folds if layer.channel is None else _of_channel(folds, layer.channel)
        for term, lines in enumerate(term_spectra(layer, grid, spectrum)):  # one spectrum is in memory at a time
            response.add(scipy.fft.fft(lines, axis=0, overwrite_x=True, workers=WORKERS), term, reached)
    return _mosaic_of_folds(folds.values, places, grid)


def _empty_folds(grid: Grid, places: Sequence[tuple[int, int, int]]) -> Folds:
    cells = grid.cells_per_pixel
    stride = [grid.tile[axis] * cells for axis in (0, 1)]
    turn_y, turn_x = (
        _phases(stride[axis], [place[axis] * cells + cells // 2 for place in places], stride[axis]) for axis in (0, 1)
    )
    small = grid.cells(0) // stride[0], grid.cells(1) // stride[1] // 2 + 1
    return Folds(np.zeros((len(places), *small), np.complex64), np.array([p[2] for p in places]), turn_y, turn_x)


def _of_channel(folds: Folds, channel: int) -> Folds:
    """Return the spectra of one channel's sites, as channel 0; they share memory."""
    first, last = np.searchsorted(folds.channel_of, [channel, channel + 1])
    own = slice(int(first), int(last))
    turn_y, turn_x = (np.ascontiguousarray(turn[:, own]) for turn in (folds.turn_y, folds.turn_x))
    return Folds(folds.values[own], np.zeros_like(folds.channel_of[own]), turn_y, turn_x)


class _Response:
    """H of a layer at the grid's frequencies, term by term."""

    def __init__(self, transfer: Transfer, sampling: Sampling, grid: Grid) -> None:
        self._cols = grid.cells(1)
        self._has_radial = transfer.radial is not None
        # Without a radial part, a placeholder that the numeric kernel ignores.
        radial = transfer.radial or RadialTransfer(np.zeros((1, 1, 2)), 1.0)
        fy = np.abs(np.fft.fftfreq(grid.cells(0), sampling.cell_m(0))).astype(np.float64)
        fx = np.fft.rfftfreq(grid.cells(1), sampling.cell_m(1)).astype(np.float64)
        fold = folded_terms(radial, sampling, fy, fx)
        # Of all terms, which are the second axis of `table` and `fold_down`.
        self._radial = RadialRows(
            fy=(fy / radial.step_per_m).astype(np.float32),
            fx=(fx / radial.step_per_m).astype(np.float32),
            table=radial.table.astype(np.float32),
            aperture_y=sampling.aperture(0, fy).astype(np.float32),
            aperture_x=sampling.aperture(1, fx).astype(np.float32),
            fold_down=fold.down,
            fold_across=fold.across,
        )
        self._kernels = transfer.kernels
        if self._kernels is not None:
            self._gridding = Gridding.of(self._kernels.shape[2], grid.cells(0))

    def add(self, spectrum: C64, term: int, folds: Folds) -> None:
        """Add a term's spectrum times H to the folded spectra."""
        whole, of_term = self._radial, term if self._has_radial else 0
        radial = whole._replace(table=whole.table[:, of_term], fold_down=whole.fold_down[:, of_term])
        if self._kernels is None:
            add_radial(folds, spectrum, self._cols, radial)
            return
        table = self._gridding.table(self._kernels[:, term], self._cols).view(np.float32)
        first, taps = self._gridding.first, self._gridding.taps
        add_general(folds, spectrum, self._cols, table, first, taps, self._has_radial, radial)


def _mosaic_of_folds(folds: C64, places: Sequence[tuple[int, int, int]], grid: Grid) -> F32:
    """Return the mosaic: inverse transforms, with the values of each site at their pixels."""
    cells, cols = grid.cells_per_pixel, grid.cells(1)
    mosaic = np.empty(grid.shape, np.float32)
    small = folds.shape[1], cols // (grid.tile[1] * cells)
    skip = [grid.before(axis) // grid.tile[axis] for axis in (0, 1)]
    for fold, (r, c, _) in zip(folds, places, strict=True):
        # The first value of a site lies some cells into the grid: a phase.
        fold *= _phases(small[0], [r * cells + cells // 2], small[0] * grid.tile[0] * cells)
        fold *= _phases(fold.shape[1], [c * cells + cells // 2], cols)[:, 0]
        fold /= np.float32((grid.tile[0] * cells) * (grid.tile[1] * cells))
        image = scipy.fft.irfft2(fold, s=small, overwrite_x=True, workers=WORKERS)
        target = mosaic[r :: grid.tile[0], c :: grid.tile[1]]
        target[:] = image[skip[0] : skip[0] + target.shape[0], skip[1] : skip[1] + target.shape[1]]
    return mosaic


def _phases(count: int, shifts: Sequence[int], size: int) -> C64:
    """Return (count, shifts): exp(2 pi i k shift / size), with the product reduced modulo size for accuracy."""
    turns = (np.arange(count)[:, None] * np.asarray(shifts)) % size
    angle = 2 * np.pi * turns / size
    # Exactly -1 for a half turn: np.sin(np.pi) is 1e-16.
    sine = np.where(2 * turns % size == 0, 0.0, np.sin(angle))
    return np.asarray(np.cos(angle) + 1j * sine, np.complex64)
