"""From weight maps to a mosaic in the frequency domain: a sum over terms, about one inverse transform (docs/theory.md).

A channel is needed only at its own sites of the mosaic, for example one pixel in four. Taking every second value of a
line folds its spectrum in half. Spectra are therefore folded while they are summed, and each inverse transform has a
quarter of the size. All terms of all layers are added before the inverse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.engine.fold_spectra import add_general, add_radial
from photosite.engine.gridding import Gridding
from photosite.engine.layers import WORKERS, Grid, Layer, term_spectra
from photosite.engine.transfer import RadialTransfer, Sampling, Transfer, folded_terms


def mosaic_of_layers(
    layers: Sequence[Layer], sampling: Sampling, grid: Grid, sites: Sequence[Sequence[tuple[int, int]]]
) -> NDArray[np.float32]:
    """Return the mosaic of weight maps, seen through a lens by a sensor.

    Parameters
    ----------
    layers
        Maps and their transfers; the light of all layers adds up.
    sampling, grid
        The cells on which all layers are resampled.
    sites
        The (row, col) sites of each channel in the colour filter array's tile.

    Returns
    -------
    ndarray
        (rows, cols) float32, each pixel of its own channel.
    """
    places = [(r, c, channel) for channel, of_channel in enumerate(sites) for r, c in of_channel]
    folds = _Folds.empty(grid, places)
    _add_layers(layers, sampling, grid, folds)
    return _mosaic_of_folds(folds.values, places, grid.cells(1), grid)


def _add_layers(layers: Sequence[Layer], sampling: Sampling, grid: Grid, folds: _Folds) -> None:
    """Add the spectrum of each term times its H to the folded spectra; one spectrum is in memory at a time."""
    spectrum = np.empty((grid.cells(0), grid.cells(1) // 2 + 1), np.complex64)
    for layer in layers:
        response = _Response(layer.transfer, sampling, grid)
        reached = folds if layer.channel is None else folds.of_channel(layer.channel)
        for term, lines in enumerate(term_spectra(layer, grid, spectrum)):
            response.add(scipy.fft.fft(lines, axis=0, overwrite_x=True, workers=WORKERS), term, reached)


@dataclass(frozen=True, eq=False)
class _Folds:
    """The folded spectra of all sites, and the phases with which values of the whole spectrum enter them."""

    values: NDArray[np.complex64]
    channel_of: NDArray[np.int64]
    turn_y: NDArray[np.complex64]
    turn_x: NDArray[np.complex64]

    @classmethod
    def empty(cls, grid: Grid, places: Sequence[tuple[int, int, int]]) -> _Folds:
        cells = grid.cells_per_pixel
        stride = [grid.tile[axis] * cells for axis in (0, 1)]
        # A sign for tiles of 2, in general a root of unity, with which an alias enters a site's folded spectrum.
        turns = [
            _phases(stride[axis], [place[axis] * cells + cells // 2 for place in places], stride[axis])
            for axis in (0, 1)
        ]
        small = grid.cells(0) // stride[0], grid.cells(1) // stride[1] // 2 + 1
        return cls(np.zeros((len(places), *small), np.complex64), np.array([p[2] for p in places]), *turns)

    def of_channel(self, channel: int) -> _Folds:
        """Return the spectra of one channel's sites, as channel 0; they share memory."""
        first, last = np.searchsorted(self.channel_of, [channel, channel + 1])
        own = slice(int(first), int(last))
        only = np.zeros(own.stop - own.start, self.channel_of.dtype)
        turn_y, turn_x = (np.ascontiguousarray(turn[:, own]) for turn in (self.turn_y, self.turn_x))
        return _Folds(self.values[own], only, turn_y, turn_x)


class _Response:
    """H of a layer at the grid's frequencies, term by term."""

    def __init__(self, transfer: Transfer, sampling: Sampling, grid: Grid) -> None:
        self.cols = grid.cells(1)
        radial = transfer.radial
        self._has_radial = radial is not None
        if radial is None:  # a placeholder that the numeric kernel ignores
            radial = RadialTransfer(np.zeros((1, 1, 2)), 1.0)
        fy = np.abs(np.fft.fftfreq(grid.cells(0), sampling.cell_m(0))).astype(np.float64)
        fx = np.fft.rfftfreq(grid.cells(1), sampling.cell_m(1)).astype(np.float64)
        self._fold = folded_terms(radial, sampling, fy, fx)
        self._aperture_y, self._aperture_x = (
            sampling.aperture(axis, f).astype(np.float32) for axis, f in ((0, fy), (1, fx))
        )
        self._node_y, self._node_x = ((f / radial.step_per_m).astype(np.float32) for f in (fy, fx))
        self._table = radial.table.astype(np.float32)
        self._kernels = transfer.kernels
        if self._kernels is not None:
            self._gridding = Gridding.of(self._kernels.shape[2], grid.cells(0))

    def add(self, spectrum: NDArray[np.complex64], term: int, folds: _Folds) -> None:
        """Add a term's spectrum times H to the folded spectra."""
        radial = term if self._has_radial else 0
        of_radial = (
            self._node_y,
            self._node_x,
            self._table[:, radial],
            self._aperture_y,
            self._aperture_x,
            self._fold.down[:, radial],
            self._fold.across,
        )
        of_folds = folds.channel_of, folds.turn_y, folds.turn_x
        if self._kernels is None:
            add_radial(folds.values, spectrum, self.cols, *of_radial, *of_folds)
            return
        table = self._gridding.table(self._kernels[:, term], self.cols).view(np.float32)
        first, taps = self._gridding.first, self._gridding.taps
        add_general(folds.values, spectrum, self.cols, table, first, taps, self._has_radial, *of_radial, *of_folds)


def _mosaic_of_folds(
    folds: NDArray[np.complex64],
    places: Sequence[tuple[int, int, int]],
    cols: int,
    grid: Grid,
) -> NDArray[np.float32]:
    """Return the mosaic: inverse transforms, with the values of each site at their pixels."""
    cells = grid.cells_per_pixel
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


def _phases(count: int, shifts: Sequence[int], size: int) -> NDArray[np.complex64]:
    """Return (count, shifts): exp(2 pi i k shift / size), with the product reduced modulo size for accuracy."""
    turns = (np.arange(count)[:, None] * np.asarray(shifts)[None, :]) % size
    angle = 2 * np.pi * turns / size
    # Exactly -1 for a half turn: np.sin(np.pi) is 1e-16.
    sine = np.where(2 * turns % size == 0, 0.0, np.sin(angle))
    phases: NDArray[np.complex64] = (np.cos(angle) + 1j * sine).astype(np.complex64)
    return phases
