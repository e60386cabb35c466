"""From weight maps to a mosaic in the frequency domain: a sum over terms, about one inverse transform.

docs/theory/model.md derives the equations.

A channel is needed only at its own sites of the mosaic, for example one pixel in four. Taking every second value of a
line folds its spectrum in half. Spectra are therefore folded while they are summed, and each inverse transform has a
quarter of the size. All terms of all layers are added before the inverse.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from photosite.engine.fourier import fft, ifft_unscaled, irfft_unscaled, rfft
from photosite.engine.jit import C64, F32, F64, I64, compiled, read_only
from photosite.engine.layers import Grid, Layer, spectra_at_once, term_spectra
from photosite.engine.threads import parallel_for
from photosite.engine.transfer import RadialTransfer, Sampling, Transfer, folded_terms

TAPS = 8
"""Rows that a row is interpolated from; the error is about 1e-7 of the kernel's sum, as single precision has."""
_OVERSAMPLING = 2


def mosaic_of_layers(
    layers: Sequence[Layer],
    sampling: Sampling,
    grid: Grid,
    sites: Sequence[Sequence[tuple[int, int]]],
    progress: Callable[[int, int, str], object] | None = None,
) -> F32:
    """Return (rows, cols), the mosaic of weight maps, seen through a lens by a sensor.

    The light of all layers adds up. `sites` are (row, col) of each channel in the color filter array's tile.
    `progress` receives the number of terms done, of how many, and their name.
    """
    places = [(r, c, channel) for channel, of_channel in enumerate(sites) for r, c in of_channel]
    return _mosaic_of_folds(_folds_of_layers(layers, sampling, grid, places, progress), places, grid)


def _folds_of_layers(
    layers: Sequence[Layer],
    sampling: Sampling,
    grid: Grid,
    places: Sequence[tuple[int, int, int]],
    progress: Callable[[int, int, str], object] | None,
) -> C64:
    """Return the folded spectra of each site, for `_mosaic_of_folds`."""
    folds = _empty_folds(grid, places)
    most = max((spectra_at_once(layer) for layer in layers), default=0)
    spectra = np.empty((most, grid.cells(0), grid.cells(1) // 2 + 1), np.complex64)
    done, total = 0, sum(len(layer.mixing) for layer in layers)
    for layer in layers:
        response = _Response(layer.transfer, sampling, grid)
        reached = folds if layer.channel is None else _of_channel(folds, layer.channel)
        for term, lines in enumerate(term_spectra(layer, grid, spectra)):
            response.add(fft(lines, axis=0), term, reached)
            done += 1
            if progress is not None:
                progress(done, total, "transforms")
    return folds.values


def _empty_folds(grid: Grid, places: Sequence[tuple[int, int, int]]) -> Folds:
    cells = grid.cells_per_pixel
    stride = [grid.tile[axis] * cells for axis in (0, 1)]
    shifts = (tuple(place[axis] * cells + cells // 2 for place in places) for axis in (0, 1))
    turn_y, turn_x = (_phases(size, of_axis, size) for size, of_axis in zip(stride, shifts, strict=True))
    small = grid.cells(0) // stride[0], grid.cells(1) // stride[1] // 2 + 1
    return Folds(np.zeros((len(places), *small), np.complex64), np.array([p[2] for p in places]), turn_y, turn_x)


def _of_channel(folds: Folds, channel: int) -> Folds:
    """Return the spectra of one channel's sites, as channel 0; they share memory."""
    first, last = np.searchsorted(folds.channel_of, [channel, channel + 1])
    own = slice(int(first), int(last))
    turn_y, turn_x = (read_only(turn[:, own]) for turn in (folds.turn_y, folds.turn_x))
    return Folds(folds.values[own], np.zeros_like(folds.channel_of[own]), turn_y, turn_x)


class _Response:
    """H of a layer at the grid's frequencies, term by term."""

    def __init__(self, transfer: Transfer, sampling: Sampling, grid: Grid) -> None:
        self._cols = grid.cells(1)
        self._has_radial = transfer.radial is not None
        # Without a radial part, a placeholder that the numeric kernel ignores.
        self._radial = radial_rows(transfer.radial or RadialTransfer(np.zeros((1, 1, 2)), 1.0), sampling, grid)
        self._kernels = transfer.kernels
        if self._kernels is not None:
            self._gridding = Gridding.of(self._kernels.shape[2], grid.cells(0))

    def add(self, spectrum: C64, term: int, folds: Folds) -> None:
        """Add a term's spectrum times H to the folded spectra."""
        whole, of_term = self._radial, term if self._has_radial else 0
        radial = whole._replace(table=read_only(whole.table[:, of_term]), fold=read_only(whole.fold[:, of_term]))
        if self._kernels is None:
            add_radial(folds, spectrum, self._cols, radial)
            return
        table = self._gridding.table(self._kernels[:, term], self._cols).view(np.float32)
        first, taps = self._gridding.first, self._gridding.taps
        add_general(folds, spectrum, self._cols, table, first, taps, self._has_radial, radial)


def radial_rows(radial: RadialTransfer, sampling: Sampling, grid: Grid) -> RadialRows:
    """Return H of all terms, which are the second axis of `table` and `fold`."""
    kept = _kept.get(radial)
    if kept is None or kept[:2] != (sampling, grid):
        _kept[radial] = kept = sampling, grid, _radial_rows(radial, sampling, grid)
    return kept[2]


_kept: WeakKeyDictionary[RadialTransfer, tuple[Sampling, Grid, RadialRows]] = WeakKeyDictionary()
"""Those of the latest frame of a transfer, for as long as it lives."""


def _radial_rows(radial: RadialTransfer, sampling: Sampling, grid: Grid) -> RadialRows:
    fy = np.abs(np.fft.fftfreq(grid.cells(0), sampling.cell_m(0))).astype(np.float64)
    fx = np.fft.rfftfreq(grid.cells(1), sampling.cell_m(1)).astype(np.float64)
    folded = folded_terms(radial, sampling, fy, fx)
    return RadialRows(
        fy=(fy / radial.step_per_m).astype(np.float32),
        fx=(fx / radial.step_per_m).astype(np.float32),
        table=radial.table.astype(np.float32),
        aperture_y=sampling.aperture(0, fy).astype(np.float32),
        aperture_x=sampling.aperture(1, fx).astype(np.float32),
        fold=folded.coefficients,
        fold_first_y=folded.down.first,
        fold_y=folded.down.weights,
        fold_begin_x=np.searchsorted(folded.across.first, np.arange(folded.coefficients.shape[3] - 2)),
        fold_x=folded.across.weights,
    )


def _mosaic_of_folds(folds: C64, places: Sequence[tuple[int, int, int]], grid: Grid) -> F32:
    """Return the mosaic: inverse transforms, with the values of each site at their pixels."""
    cells = grid.cells_per_pixel
    mosaic = np.empty(grid.shape, np.float32)
    skip = [grid.before(axis) // grid.tile[axis] for axis in (0, 1)]
    left = list(folds)
    del folds  # the last spectrum is released before its image is copied
    for r, c, _ in places:
        image = _image_of_fold(left.pop(0), (r * cells + cells // 2, c * cells + cells // 2), grid)
        target = mosaic[r :: grid.tile[0], c :: grid.tile[1]]
        target[:] = image[skip[0] : skip[0] + target.shape[0], skip[1] : skip[1] + target.shape[1]]
    return mosaic


def _image_of_fold(fold: C64, first: tuple[int, int], grid: Grid) -> F32:
    """Return the values of a site, the first of which lies some cells into the grid: a phase; `fold` is overwritten."""
    down, across = (of_tile * grid.cells_per_pixel for of_tile in grid.tile)
    rows, cols = fold.shape[0], grid.cells(1) // across
    fold *= _phases(rows, (first[0],), rows * down)
    fold *= _phases(fold.shape[1], (first[1],), grid.cells(1))[:, 0]
    fold.view(np.float32)[:] *= np.float32(1) / np.float32(down * across)
    # As irfft2 with the same bits, which would copy the spectrum.
    half = ifft_unscaled(fold, axis=0)
    image = irfft_unscaled(half, cols, axis=1)
    image *= np.float32(1.0 / (rows * cols))
    return image


@lru_cache(maxsize=64)
def _phases(count: int, shifts: tuple[int, ...], size: int) -> C64:
    """Return (count, shifts): exp(2 pi i k shift / size), with the product reduced modulo size for accuracy."""
    turns = (np.arange(count)[:, None] * np.asarray(shifts)) % size
    angle = 2 * np.pi * turns / size
    # Exactly -1 for a half turn: np.sin(np.pi) is 1e-16.
    sine = np.where(2 * turns % size == 0, 0.0, np.sin(angle))
    phases = np.asarray(np.cos(angle) + 1j * sine, np.complex64)
    phases.flags.writeable = False
    return phases


# Kernels that multiply a term's spectrum by H and add it to the folded spectra of the mosaic's sites, in one pass.
#
# Each value of the half spectrum is read once. Values beyond half the sampling frequency along the columns are
# conjugates of values in the mirrored row.


class Folds(NamedTuple):
    """The folded spectra of all sites, and the phases with which values of the whole spectrum enter them."""

    values: C64  # (sites, rows, cols // 2 + 1) spectra of the sites' own grids
    channel_of: I64  # (sites,) channel of each site
    # (aliases, sites) phase with which an alias enters a site's folded spectrum: a sign for tiles of 2, in general a
    # root of unity
    turn_y: C64
    turn_x: C64


class RadialRows(NamedTuple):
    """H of one term on the cells, if it is real and a function of |f|."""

    # Frequencies, in steps of the table
    fy: F32
    fx: F32
    table: F32  # (channels, nodes)
    # Transfer of photodetector, cell and low-pass filter on each axis
    aperture_y: F32
    aperture_x: F32
    # The folded terms of H: (channels, B, B) coefficients, and the `SplineRows` along fy and fx; numba takes no tuples
    fold: F32
    fold_first_y: I64
    fold_y: F32
    fold_begin_x: I64  # first column of each interval between nodes, and the number of columns
    fold_x: F32


def add_radial(folds: Folds, spectrum: C64, cols: int, radial: RadialRows) -> None:
    """Add spectrum * H of each site's channel, folded to the site's grid, to `folds`.

    `spectrum` is that of a term on the cells, (rows, cols // 2 + 1).
    """
    parallel_for(_add_radial, folds.values.shape[1], folds, spectrum, cols, radial)


@compiled()
def _add_radial(start: int, stop: int, folds: Folds, spectrum: C64, cols: int, radial: RadialRows) -> None:
    values, channel_of, turn_y, turn_x = folds
    rows, half = spectrum.shape
    small_rows, small_half = values.shape[1], values.shape[2]
    small_cols = cols // turn_x.shape[0]
    channels = radial.table.shape[0]
    for r in range(start, stop):
        response = np.empty((channels, half), np.float32)
        # Conjugates and responses in reverse order, for the columns beyond half of the sampling frequency
        reverse, reverse_response = np.empty(half, np.complex64), np.empty((channels, half), np.float32)
        index = np.empty(half, np.uint32)
        fraction = np.empty(half, np.float32)
        for alias_y in range(turn_y.shape[0]):
            y = r + alias_y * small_rows
            _positions(radial, y, index, fraction)
            for channel in range(channels):
                _response(response[channel], index, fraction, radial, channel, y)
            mirrored = spectrum[(rows - y) % rows]
            for c in range(half):
                reverse[c] = np.conj(mirrored[half - 1 - c])
            for channel in range(channels):
                for c in range(half):
                    reverse_response[channel, c] = response[channel, half - 1 - c]
            for alias_x in range(turn_x.shape[0]):
                first = alias_x * small_cols
                direct = min(max(cols // 2 - first + 1, 0), small_half)  # columns before the mirror begins
                for site in range(channel_of.size):
                    turn = turn_y[alias_y, site] * turn_x[alias_x, site]
                    channel, mirror = channel_of[site], half - 1 - (cols - first - direct)
                    _add_direct(values[site, r, :direct], spectrum[y, first:], response[channel, first:], turn)
                    _add_direct(values[site, r, direct:], reverse[mirror:], reverse_response[channel, mirror:], turn)


@compiled()
def _positions(radial: RadialRows, y: int, index: NDArray[np.uint32], fraction: F32) -> None:
    """Compute the positions of a row of frequencies between the nodes of the table; one above 1 is beyond the last."""
    fx = radial.fx
    last = np.uint32(radial.table.shape[1] - 2)
    square = radial.fy[y] * radial.fy[y]
    for c in range(fx.size):
        position = np.sqrt(square + fx[c] * fx[c])
        index[c] = min(np.uint32(position), last)
        fraction[c] = position - np.float32(index[c])


@compiled()
def _response(out: F32, index: NDArray[np.uint32], fraction: F32, radial: RadialRows, channel: int, y: int) -> None:
    """Compute H of a channel along a row of frequencies."""
    nodes, aperture_y, aperture_x = radial.table[channel], radial.aperture_y[y], radial.aperture_x
    for c in range(out.size):
        low = nodes[index[c]]
        value = low + fraction[c] * (nodes[index[c] + np.uint32(1)] - low)
        value = value if fraction[c] <= np.float32(1.0) else np.float32(0.0)
        out[c] = value * (aperture_y * aperture_x[c])
    _add_folded(out, radial, channel, y)


@compiled()
def _add_folded(out: F32, radial: RadialRows, channel: int, y: int) -> None:
    """Add the folded terms along a row of frequencies."""
    coefficients, first, weights = radial.fold[channel], radial.fold_first_y[y], radial.fold_y[:, y]
    line = np.empty(coefficients.shape[1], np.float32)
    for i in range(line.size):
        low = weights[0] * coefficients[first, i] + weights[1] * coefficients[first + 1, i]
        line[i] = low + (weights[2] * coefficients[first + 2, i] + weights[3] * coefficients[first + 3, i])
    for i in range(radial.fold_begin_x.size - 1):  # columns that share their coefficients, for vector instructions
        columns = slice(radial.fold_begin_x[i], radial.fold_begin_x[i + 1])
        a, b, c, d = line[i], line[i + 1], line[i + 2], line[i + 3]
        wa, wb, wc, wd = (
            radial.fold_x[0, columns],
            radial.fold_x[1, columns],
            radial.fold_x[2, columns],
            radial.fold_x[3, columns],
        )
        sums = out[columns]
        for k in range(sums.size):
            sums[k] += (wa[k] * a + wb[k] * b) + (wc[k] * c + wd[k] * d)


@compiled()
def _add_direct(out: C64, spectrum: C64, gain: F32, turn: np.complex64) -> None:
    if turn.imag == 0:
        sign = turn.real
        for c in range(out.size):
            out[c] += spectrum[c] * (gain[c] * sign)
    else:
        for c in range(out.size):
            out[c] += (spectrum[c] * gain[c]) * turn


def add_general(
    folds: Folds, spectrum: C64, cols: int, kernel: F32, first: I64, taps: F32, has_radial: bool, radial: RadialRows
) -> None:
    """As `add_radial`, for a complex H: that of a kernel, plus an optional radial part.

    A row of the spectrum and its mirror enter the same two rows of the folded spectra. They are processed together, so
    that H is computed once for each.

    - `kernel`: (channels, rows of the kernel's table, 2 (cols // 2 + 1)), real and imaginary parts alternating.
    - `first`, `taps`: See `Gridding`.
    - `has_radial`: Whether H includes `radial`.
    """
    parallel_for(
        _add_general, folds.values.shape[1] // 2 + 1, folds, spectrum, cols, kernel, first, taps, has_radial, radial
    )


@compiled()
def _add_general(
    start: int,
    stop: int,
    folds: Folds,
    spectrum: C64,
    cols: int,
    kernel: F32,
    first: I64,
    taps: F32,
    has_radial: bool,
    radial: RadialRows,
) -> None:
    rows, half = spectrum.shape
    channels = kernel.shape[0]
    small_rows = folds.values.shape[1]
    aliases = folds.turn_y.shape[0]
    for pair in range(start, stop):
        line = np.empty(2 * half, np.float32)
        real = np.empty(half if has_radial else 1, np.float32)
        index = np.empty(half if has_radial else 1, np.uint32)
        fraction = np.empty(half if has_radial else 1, np.float32)
        passed = np.empty((2, channels, half), np.complex64)
        mirror_row = (small_rows - pair) % small_rows
        for alias in range(aliases):
            for side in range(2):
                y = pair + alias * small_rows
                if side == 1:
                    y = (rows - y) % rows
                if has_radial:
                    _positions(radial, y, index, fraction)
                for channel in range(channels):
                    _kernel_line(line, kernel[channel], first[y], taps[y])
                    if has_radial:
                        _response(real, index, fraction, radial, channel, y)
                        _multiplied_with_real(passed[side, channel], spectrum[y], line, real)
                    else:
                        _multiplied(passed[side, channel], spectrum[y], line)
            _fold_row(folds, pair, alias, passed[0], passed[1], cols)
            if mirror_row != pair:
                of_mirror = (rows - pair - alias * small_rows) % rows // small_rows
                _fold_row(folds, mirror_row, of_mirror, passed[1], passed[0], cols)


@compiled()
def _kernel_line(out: F32, table: F32, first: int, taps: F32) -> None:
    """Interpolate a row of a kernel's spectrum from the eight nearest rows of its table."""
    long = table.shape[0]
    a, b, c, d = table[first], table[(first + 1) % long], table[(first + 2) % long], table[(first + 3) % long]
    e, f = table[(first + 4) % long], table[(first + 5) % long]
    g, h = table[(first + 6) % long], table[(first + 7) % long]
    ta, tb, tc, td, te, tf, tg, th = taps[0], taps[1], taps[2], taps[3], taps[4], taps[5], taps[6], taps[7]
    for i in range(out.size):
        low = (ta * a[i] + tb * b[i]) + (tc * c[i] + td * d[i])
        out[i] = low + ((te * e[i] + tf * f[i]) + (tg * g[i] + th * h[i]))


@compiled()
def _multiplied(out: C64, spectrum: C64, line: F32) -> None:
    gain = line.view(np.complex64)
    for c in range(out.size):
        out[c] = spectrum[c] * gain[c]


@compiled()
def _multiplied_with_real(out: C64, spectrum: C64, line: F32, real: F32) -> None:
    """As `_multiplied`, for the sum of a complex and a real line."""
    gain = line.view(np.complex64)
    for c in range(out.size):
        out[c] = spectrum[c] * (gain[c] + real[c])


@compiled()
def _fold_row(folds: Folds, row: int, alias_y: int, direct: C64, mirrored: C64, cols: int) -> None:
    """Add a row times H, and its mirror, to a row of the folded spectra."""
    values, channel_of, turn_y, turn_x = folds
    small_half = values.shape[2]
    small_cols = cols // turn_x.shape[0]
    for alias_x in range(turn_x.shape[0]):
        start = alias_x * small_cols
        count = min(max(cols // 2 - start + 1, 0), small_half)  # columns before the mirror begins
        for site in range(channel_of.size):
            turn = turn_y[alias_y, site] * turn_x[alias_x, site]
            channel = channel_of[site]
            _add(values[site, row, :count], direct[channel, start:], turn)
            _add_reversed(values[site, row, count:], mirrored[channel], cols - start - count, turn)


@compiled()
def _add(out: C64, values: C64, turn: np.complex64) -> None:
    if turn.imag == 0:
        sign = turn.real
        for c in range(out.size):
            out[c] += values[c] * sign
    else:
        for c in range(out.size):
            out[c] += values[c] * turn


@compiled()
def _add_reversed(out: C64, values: C64, start: int, turn: np.complex64) -> None:
    """Add conjugates, backwards from `start`."""
    if turn.imag == 0:
        sign = turn.real
        for c in range(out.size):
            out[c] += np.conj(values[start - c]) * sign
    else:
        for c in range(out.size):
            out[c] += np.conj(values[start - c]) * turn


# The spectrum of a small kernel at the many frequencies of a large frame, row by row.
#
# Along the columns, the kernel is transformed to the frame's length. Along the rows, it is transformed to twice its own
# length, and each row of the frame's spectrum is interpolated from the `TAPS` nearest rows, with Kaiser-Bessel weights.
# The kernel is divided by the transform of the Kaiser-Bessel function before (gridding: Fessler and Sutton, "Nonuniform
# fast Fourier transforms using min-max interpolation", IEEE Trans. Signal Process. 51, 560 (2003), section IV; shape
# parameter after Beatty, Nishimura and Pauly, IEEE Trans. Med. Imaging 24, 799 (2005), eq. 5). Interpolation along rows
# keeps all neighbors contiguous in memory, for vector instructions.


@dataclass(frozen=True, eq=False)
class Gridding:
    """The position of each row of the frame's spectrum among the rows of a kernel's spectrum."""

    size: int  # Q, the rows of the kernel; odd
    first: I64  # (rows,) the first of the `TAPS` rows of the table; the others follow, periodically
    taps: F32  # (rows, TAPS) interpolation weights

    @classmethod
    def of(cls, size: int, rows: int) -> Gridding:
        """Return the gridding for a kernel of `size` rows in a frame of `rows` rows of cells."""
        long = _OVERSAMPLING * size
        position = np.arange(rows) * long / rows
        first = np.floor(position).astype(np.int64) - TAPS // 2 + 1
        offset = position[:, None] - (first[:, None] + np.arange(TAPS))
        inside = np.maximum(1.0 - (2 * offset / TAPS) ** 2, 0.0)
        taps = np.i0(_kaiser_bessel_shape() * np.sqrt(inside)) / np.i0(_kaiser_bessel_shape())
        return cls(size, first % long, taps.astype(np.float32))

    def table(self, kernels: F64, cols: int) -> C64:
        """Return (channels, 2 Q, cols // 2 + 1) complex64: that of (channels, Q, Q) kernels, centered at Q // 2."""
        channels, size = kernels.shape[:2]
        shift = np.arange(size) - size // 2
        lines = np.zeros((channels, size, cols), np.float32)
        for start in range(0, size, cols):  # a kernel wider than the frame wraps around it
            piece = kernels[:, :, start : start + cols] / _kaiser_bessel_transform(shift, _OVERSAMPLING * size)[:, None]
            lines[:, :, : piece.shape[2]] += piece
        narrow = rfft(lines, axis=2)
        turns = (np.arange(cols // 2 + 1) * (size // 2)) % cols
        narrow *= np.exp(2j * np.pi / cols * turns).astype(np.complex64)
        wide = np.zeros((channels, _OVERSAMPLING * size, cols // 2 + 1), np.complex64)
        wide[:, shift % (_OVERSAMPLING * size)] = narrow
        return fft(wide, axis=1)


def _kaiser_bessel_shape() -> float:
    return math.pi * math.sqrt((TAPS / _OVERSAMPLING * (_OVERSAMPLING - 0.5)) ** 2 - 0.8)


def _kaiser_bessel_transform(shift: I64, long: int) -> F64:
    """Return the transform of the Kaiser-Bessel function at shifts of a table of `long` rows."""
    argument = np.sqrt(_kaiser_bessel_shape() ** 2 - (math.pi * TAPS * shift / long) ** 2)
    return TAPS * np.sinh(argument) / argument / np.i0(_kaiser_bessel_shape())
