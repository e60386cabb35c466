"""From weight maps to a mosaic in the frequency domain: one sum over maps, about one inverse in all.

The maps are constant over square cells, one or more a pixel. A pixel reads the map, spread by the lens and the cell,
averaged over its photodetector, at its centre: exactly the discrete convolution with the kernel
`(spread * aperture * cell)(pixel centre - cell centre)`. That kernel's transform is the continuous one folded at the
sampling frequency,

    H(f) = sum_m transfer(|f + m fs|) aperture(f + m fs) cell(f + m fs),

and because the lens passes nothing beyond its cutoff the sum is short. Without the folded terms the kernel would
ring, and dark samples beside bright ones would come out negative. At f = 0 only m = 0 is left: a uniform field keeps
its value.

H is never held: m = 0 is a table in |f| times two sinc functions, and the folded terms are smooth, so few products of
a function of each axis hold them (`FoldedTerms`).

A channel is wanted at its own sites of the mosaic only, one pixel in four say. Taking every second value of a line is
folding its spectrum in half; so the spectrum is folded first, and the inverse is of a quarter of the size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange
from photosite.engine.resample import Overlap, mean_along_rows, mean_of_rows, overlap

_FOLD_NODES = 65
"""Nodes of each axis on which the folded terms are computed before cubic interpolation."""
_FOLD_TOLERANCE = 1e-7
"""Relative to the transfer at 0: folded terms smaller than this are left out."""
_STRIP = 256
"""Rows of the spectrum that are filled at a time."""
_WORKERS = -1


@dataclass(frozen=True, eq=False)
class Sampling:
    """The grid of cells and the photodetector on it. Lengths in m; pairs are (vertical, horizontal).

    Parameters
    ----------
    pitch_m
        Distance of pixels.
    detector_m
        Size of the photodetector, centred in the pixel.
    cells_per_pixel
        On each axis; odd, so that a cell lies at the pixel's centre.
    """

    pitch_m: tuple[float, float]
    detector_m: tuple[float, float]
    cells_per_pixel: int = 1

    def cell_m(self, axis: int) -> float:
        """Size of a cell on an axis, 0 vertical, 1 horizontal."""
        return self.pitch_m[axis] / self.cells_per_pixel

    def aperture(self, axis: int, frequency_per_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transfer of photodetector and cell on an axis: two sinc functions."""
        product: NDArray[np.float64] = np.sinc(frequency_per_m * self.detector_m[axis]) * np.sinc(
            frequency_per_m * self.cell_m(axis)
        )
        return product


@dataclass(frozen=True, eq=False)
class RadialTransfer:
    """Transfer of a rotationally symmetric lens, summed over wavelength, from each map to each channel.

    Parameters
    ----------
    table
        (channels, maps, nodes) at frequencies 0, step, 2 step, ...; linear between, 0 beyond. A channel that a map does
        not reach has zeros.
    step_per_m
        Distance of nodes, cycles/m.
    """

    table: NDArray[np.float64]
    step_per_m: float

    @property
    def reach_per_m(self) -> float:
        """Frequency beyond which nothing passes."""
        return float(self.step_per_m * (self.table.shape[2] - 1))

    def at(self, frequency_per_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(channels, maps, ...) at frequencies of any shape."""
        nodes = self.table.shape[2]
        position = frequency_per_m / self.step_per_m
        index = np.minimum(position.astype(np.intp), nodes - 2)
        share = position - index
        values: NDArray[np.float64] = np.where(
            position <= nodes - 1,
            self.table[:, :, index] * (1 - share) + self.table[:, :, index + 1] * share,
            0.0,
        )
        return values


@dataclass(frozen=True, eq=False)
class FoldedTerms:
    """The terms with m other than 0 as sums of products: down[channel, map, fy] @ across[:, fx]."""

    down: NDArray[np.float32]  # (channels, maps, fy, products)
    across: NDArray[np.float32]  # (products, fx)


def folded(
    transfer: RadialTransfer, sampling: Sampling, fy_per_m: NDArray[np.float64], fx_per_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(channels, maps, fy, fx): the terms with m other than 0, at frequencies up to half the sampling frequency."""
    rate = [1.0 / sampling.cell_m(axis) for axis in (0, 1)]
    most = [int(np.ceil(transfer.reach_per_m / r + 0.5)) for r in rate]
    total = np.zeros((*transfer.table.shape[:2], fy_per_m.size, fx_per_m.size))
    for m in range(-most[0], most[0] + 1):
        fy = fy_per_m + m * rate[0]
        for n in range(-most[1], most[1] + 1):
            fx = fx_per_m + n * rate[1]
            near = np.hypot(np.abs(fy).min(), np.abs(fx).min())
            if (m, n) == (0, 0) or near > transfer.reach_per_m:
                continue
            aperture = sampling.aperture(0, fy)[:, None] * sampling.aperture(1, fx)[None, :]
            total += transfer.at(np.hypot(fy[:, None], fx[None, :])) * aperture
    return total


def folded_terms(
    transfer: RadialTransfer, sampling: Sampling, fy_per_m: NDArray[np.float64], fx_per_m: NDArray[np.float64]
) -> FoldedTerms:
    """The folded terms on a grid: computed on few nodes, split by singular values, interpolated by cubic splines."""
    from scipy.interpolate import make_interp_spline

    nodes = [np.linspace(0, 0.5 / sampling.cell_m(axis), _FOLD_NODES) for axis in (0, 1)]
    table = folded(transfer, sampling, *nodes)
    channels, maps = table.shape[:2]
    left, size, right = np.linalg.svd(table.reshape(-1, _FOLD_NODES), full_matrices=False)
    keep = max(1, int((size > _FOLD_TOLERANCE * np.abs(transfer.table[:, :, 0]).max()).sum()))
    down = (left[:, :keep] * size[:keep]).reshape(channels, maps, _FOLD_NODES, keep)
    down = make_interp_spline(nodes[0], np.moveaxis(down, 2, 0), k=3)(np.abs(fy_per_m))
    across = make_interp_spline(nodes[1], right[:keep].T, k=3)(fx_per_m).T
    return FoldedTerms(
        np.ascontiguousarray(np.moveaxis(down, 0, 2), np.float32), np.ascontiguousarray(across, np.float32)
    )


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
        for alias_y in range(turn_y.shape[0]):
            y = r + alias_y * small_rows
            _responses(response, fy[y], fx, table, aperture_y[y], aperture_x, fold_down[:, y], fold_across)
            mirrored = spectrum[(rows - y) % rows]
            for alias_x in range(turn_x.shape[0]):
                first = alias_x * small_cols
                direct = min(max(cols // 2 - first + 1, 0), small_half)  # columns before the mirror begins
                for site in range(channel_of.size):
                    channel = channel_of[site]
                    turn = turn_y[alias_y, site] * turn_x[alias_x, site]
                    out = folds[site, r]
                    for c in range(direct):
                        out[c] += (spectrum[y, first + c] * response[channel, first + c]) * turn
                    for c in range(direct, small_half):
                        x = cols - first - c
                        out[c] += (np.conj(mirrored[x]) * response[channel, x]) * turn


@compiled()
def _responses(
    out: NDArray[np.float32],
    fy: np.float32,
    fx: NDArray[np.float32],
    table: NDArray[np.float32],
    aperture_y: np.float32,
    aperture_x: NDArray[np.float32],
    fold_down: NDArray[np.float32],
    fold_across: NDArray[np.float32],
) -> None:
    """H of each channel along a row of frequencies."""
    last = np.int32(table.shape[1] - 2)
    square = fy * fy
    for channel in range(table.shape[0]):
        nodes = table[channel]
        for c in range(fx.size):
            position = np.sqrt(square + fx[c] * fx[c])
            index = min(np.int32(position), last)
            share = position - np.float32(index)
            value = nodes[index] + share * (nodes[index + 1] - nodes[index])
            value = value if share <= np.float32(1.0) else np.float32(0.0)
            out[channel, c] = value * (aperture_y * aperture_x[c])
        for p in range(fold_across.shape[0]):
            weight = fold_down[channel, p]
            for c in range(fx.size):
                out[channel, c] += weight * fold_across[p, c]


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
    phases: NDArray[np.complex64] = np.exp(2j * np.pi * turns / size).astype(np.complex64)
    return phases
