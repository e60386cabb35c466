"""From weight maps to a mosaic in the frequency domain: one sum over maps, about one inverse transform in all.

A channel is wanted at its own sites of the mosaic only, one pixel in four say. Taking every second value of a line is
folding its spectrum in half; so spectra are folded as they are summed, and each inverse is of a quarter of the size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange
from photosite.engine.resample import Overlap, mean_along_rows, mean_of_rows, overlap
from photosite.engine.transfer import RadialTransfer, Sampling, folded_terms

_STRIP = 256
"""Rows of the spectrum that are filled at a time."""
_WORKERS = -1


@dataclass(frozen=True, eq=False)
class Laying:
    """How maps are laid on the padded grid of cells.

    Parameters
    ----------
    shape
        (rows, cols) of the frame, pixels.
    start, step
        (row, col) map coordinate of the frame's corner, and map samples per pixel.
    padding
        Pixels kept beyond each border, at least.
    tile
        (rows, cols) of the mosaic's tile.
    """

    shape: tuple[int, int]
    start: tuple[float, float]
    step: tuple[float, float]
    padding: int
    tile: tuple[int, int]

    def before(self, axis: int) -> int:
        """Pixels of padding before the frame: whole tiles."""
        return -(-self.padding // self.tile[axis]) * self.tile[axis]

    def padded(self, axis: int) -> int:
        """Pixels with padding: whole tiles, and a size that transforms well."""
        tile = self.tile[axis]
        tiles = -(-(self.shape[axis] + self.before(axis) + self.padding) // tile)
        return int(scipy.fft.next_fast_len(tiles, real=True)) * tile

    def overlap(self, axis: int, samples: int, cells_per_pixel: int) -> Overlap:
        """Which samples each padded cell covers."""
        step = self.step[axis] / cells_per_pixel
        start = self.start[axis] - self.before(axis) * self.step[axis]
        return overlap(self.padded(axis) * cells_per_pixel, start, step, samples)


def mosaic_of_maps(
    weights: NDArray[np.float32],
    mixing: NDArray[np.float32],
    transfer: RadialTransfer,
    sampling: Sampling,
    laying: Laying,
    sites: Sequence[Sequence[tuple[int, int]]],
) -> NDArray[np.float32]:
    """The mosaic that a lens and a sensor make of weight maps.

    Parameters
    ----------
    weights
        (K, rows, cols) maps.
    mixing
        (maps, K): map m is `mixing[m] @ weights`.
    transfer, sampling, laying
        What happens to the maps.
    sites
        For each channel its (row, col) sites in the tile.

    Returns
    -------
    ndarray
        (rows, cols) float32, each pixel from its own channel.
    """
    cells = sampling.cells_per_pixel
    rows, cols = (laying.padded(axis) * cells for axis in (0, 1))
    stride = [laying.tile[axis] * cells for axis in (0, 1)]
    fy = np.abs(np.fft.fftfreq(rows, sampling.cell_m(0))).astype(np.float64)
    fx = np.fft.rfftfreq(cols, sampling.cell_m(1)).astype(np.float64)
    fold = folded_terms(transfer, sampling, fy, fx)
    aperture_y, aperture_x = (sampling.aperture(axis, f).astype(np.float32) for axis, f in ((0, fy), (1, fx)))
    node_y, node_x = ((f / transfer.step_per_m).astype(np.float32) for f in (fy, fx))
    table = transfer.table.astype(np.float32)
    lines = [laying.overlap(axis, weights.shape[axis + 1], cells) for axis in (0, 1)]

    places = [(r, c, channel) for channel, of_channel in enumerate(sites) for r, c in of_channel]
    # The sign (for a tile of 2; a root of unity in general) with which an alias enters a site's folded spectrum.
    turn_y, turn_x = (
        _phases(stride[axis], [place[axis] * cells + cells // 2 for place in places], stride[axis]) for axis in (0, 1)
    )
    channel_of = np.array([p[2] for p in places])
    folds = np.zeros((len(places), rows // stride[0], cols // stride[1] // 2 + 1), np.complex64)
    spectrum = np.empty((rows, cols // 2 + 1), np.complex64)
    for m, mix in enumerate(mixing):
        _laid_spectrum(weights, mix, lines, cols, spectrum)
        spectrum = scipy.fft.fft(spectrum, axis=0, overwrite_x=True, workers=_WORKERS)
        _accumulate(
            folds,
            spectrum,
            cols,
            node_y,
            node_x,
            table[:, m],
            aperture_y,
            aperture_x,
            fold.down[:, m],
            fold.across,
            channel_of,
            turn_y,
            turn_x,
        )
    del spectrum
    return _mosaic_of_folds(folds, places, cols, laying, cells)


def _laid_spectrum(
    weights: NDArray[np.float32],
    mix: NDArray[np.float32],
    lines: Sequence[Overlap],
    cols: int,
    out: NDArray[np.complex64],
) -> None:
    """A map laid on the cells, transformed along its rows, into (rows, cols // 2 + 1).

    Laying is linear on each axis, so its order is free: a map of few rows is transformed first and its
    spectrum brought to all rows after.
    """
    down, across = lines
    parts = out.view(np.float32)
    rows = out.shape[0]
    for begin in range(0, rows, _STRIP):
        end = min(begin + _STRIP, rows)
        first, last = down.span(begin, end)
        strip = np.tensordot(mix, weights[:, first:last], axes=1)
        if last - first <= end - begin:
            laid = mean_along_rows(strip, across.first, across.sample, across.share)
            narrow = scipy.fft.rfft(laid, axis=1, workers=_WORKERS).view(np.float32)
            mean_of_rows(narrow, down.first, down.sample, down.share, begin, first, parts[begin:end])
        else:
            short = np.empty((end - begin, strip.shape[1]), np.float32)
            mean_of_rows(strip, down.first, down.sample, down.share, begin, first, short)
            laid = mean_along_rows(short, across.first, across.sample, across.share)
            out[begin:end] = scipy.fft.rfft(laid, axis=1, workers=_WORKERS)


@compiled(parallel=True)
def _accumulate(
    folds: NDArray[np.complex64],
    spectrum: NDArray[np.complex64],
    cols: int,
    fy: NDArray[np.float32],
    fx: NDArray[np.float32],
    table: NDArray[np.float32],
    aperture_y: NDArray[np.float32],
    aperture_x: NDArray[np.float32],
    fold_down: NDArray[np.float32],
    fold_across: NDArray[np.float32],
    channel_of: NDArray[np.int64],
    turn_y: NDArray[np.complex64],
    turn_x: NDArray[np.complex64],
) -> None:
    """folds[site] += spectrum * H of the site's channel, folded to the site's grid.

    Every value of the half spectrum is met once: what lies beyond half the sampling frequency on the columns' axis is
    the conjugate of a value of the mirrored row. Frequencies are in nodes of the table.
    """
    rows, half = spectrum.shape
    small_rows, small_half = folds.shape[1], folds.shape[2]
    small_cols = cols // turn_x.shape[0]
    for r in prange(small_rows):
        response = np.empty((table.shape[0], half), np.float32)
        index = np.empty(half, np.int32)
        share = np.empty(half, np.float32)
        for alias_y in range(turn_y.shape[0]):
            y = r + alias_y * small_rows
            _positions(fy[y], fx, table.shape[1], index, share)
            for channel in range(table.shape[0]):
                _response(
                    response[channel],
                    index,
                    share,
                    table[channel],
                    aperture_y[y],
                    aperture_x,
                    fold_down[channel, y],
                    fold_across,
                )
            mirrored = spectrum[(rows - y) % rows]
            for alias_x in range(turn_x.shape[0]):
                first = alias_x * small_cols
                direct = min(max(cols // 2 - first + 1, 0), small_half)  # columns before the mirror begins
                for site in range(channel_of.size):
                    turn = turn_y[alias_y, site] * turn_x[alias_x, site]
                    gain = response[channel_of[site]]
                    _add_direct(folds[site, r, :direct], spectrum[y, first:], gain[first:], turn)
                    _add_mirrored(folds[site, r, direct:], mirrored, gain, cols - first - direct, turn)


@compiled()
def _positions(
    fy: np.float32, fx: NDArray[np.float32], nodes: int, index: NDArray[np.int32], share: NDArray[np.float32]
) -> None:
    """Where a row of frequencies falls between the table's nodes; a share above 1 is beyond the last."""
    last = np.int32(nodes - 2)
    square = fy * fy
    for c in range(fx.size):
        position = np.sqrt(square + fx[c] * fx[c])
        index[c] = min(np.int32(position), last)
        share[c] = position - np.float32(index[c])


@compiled()
def _response(
    out: NDArray[np.float32],
    index: NDArray[np.int32],
    share: NDArray[np.float32],
    nodes: NDArray[np.float32],
    aperture_y: np.float32,
    aperture_x: NDArray[np.float32],
    fold_down: NDArray[np.float32],
    fold_across: NDArray[np.float32],
) -> None:
    """H of a channel along a row of frequencies."""
    for c in range(out.size):
        low = nodes[index[c]]
        value = low + share[c] * (nodes[index[c] + 1] - low)
        value = value if share[c] <= np.float32(1.0) else np.float32(0.0)
        out[c] = value * (aperture_y * aperture_x[c])
    for p in range(fold_across.shape[0]):
        weight = fold_down[p]
        for c in range(out.size):
            out[c] += weight * fold_across[p, c]


@compiled()
def _add_direct(
    out: NDArray[np.complex64], spectrum: NDArray[np.complex64], gain: NDArray[np.float32], turn: np.complex64
) -> None:
    if turn.imag == 0:
        sign = turn.real
        for c in range(out.size):
            out[c] += spectrum[c] * (gain[c] * sign)
    else:
        for c in range(out.size):
            out[c] += (spectrum[c] * gain[c]) * turn


@compiled()
def _add_mirrored(
    out: NDArray[np.complex64],
    mirrored: NDArray[np.complex64],
    gain: NDArray[np.float32],
    start: int,
    turn: np.complex64,
) -> None:
    """As `_add_direct`, backwards from column `start` of the mirrored row."""
    if turn.imag == 0:
        sign = turn.real
        for c in range(out.size):
            out[c] += np.conj(mirrored[start - c]) * (gain[start - c] * sign)
    else:
        for c in range(out.size):
            out[c] += (np.conj(mirrored[start - c]) * gain[start - c]) * turn


def _mosaic_of_folds(
    folds: NDArray[np.complex64],
    places: Sequence[tuple[int, int, int]],
    cols: int,
    laying: Laying,
    cells: int,
) -> NDArray[np.float32]:
    """The inverse transforms, each site's values to their place in the mosaic."""
    mosaic = np.empty(laying.shape, np.float32)
    small = folds.shape[1], cols // (laying.tile[1] * cells)
    skip = [laying.before(axis) // laying.tile[axis] for axis in (0, 1)]
    for fold, (r, c, _) in zip(folds, places, strict=True):
        # A site's first value lies some cells into the grid: a shift, which is a phase.
        fold *= _phases(small[0], [r * cells + cells // 2], small[0] * laying.tile[0] * cells)
        fold *= _phases(fold.shape[1], [c * cells + cells // 2], cols)[:, 0]
        fold /= np.float32((laying.tile[0] * cells) * (laying.tile[1] * cells))
        image = scipy.fft.irfft2(fold, s=small, overwrite_x=True, workers=_WORKERS)
        target = mosaic[r :: laying.tile[0], c :: laying.tile[1]]
        target[:] = image[skip[0] : skip[0] + target.shape[0], skip[1] : skip[1] + target.shape[1]]
    return mosaic


def _phases(count: int, shifts: Sequence[int], size: int) -> NDArray[np.complex64]:
    """(count, shifts): exp(2 pi i k shift / size), the product reduced before it becomes an angle."""
    turns = (np.arange(count)[:, None] * np.asarray(shifts)[None, :]) % size
    angle = 2 * np.pi * turns / size
    # A half turn is -1 and no more: a sine of pi is 1e-16.
    sine = np.where(2 * turns % size == 0, 0.0, np.sin(angle))
    phases: NDArray[np.complex64] = (np.cos(angle) + 1j * sine).astype(np.complex64)
    return phases
