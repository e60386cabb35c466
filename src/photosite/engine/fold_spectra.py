"""Kernels that multiply a term's spectrum by H and add it to the folded spectra of the mosaic's sites, in one pass.

Each value of the half spectrum is read once. Values beyond half the sampling frequency along the columns are conjugates
of values in the mirrored row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.engine.arrays import C64, F32, I64
from photosite.engine.jit import compiled, prange


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
    # (channels, rows, products) and (products, cols // 2 + 1): the folded terms of H, see `FoldedTerms`
    fold_down: F32
    fold_across: F32


@compiled(parallel=True)
def add_radial(folds: Folds, spectrum: C64, cols: int, radial: RadialRows) -> None:
    """Add spectrum * H of each site's channel, folded to the site's grid, to `folds`.

    `spectrum` is that of a term on the cells, (rows, cols // 2 + 1).
    """
    values, channel_of, turn_y, turn_x = folds
    rows, half = spectrum.shape
    small_rows, small_half = values.shape[1], values.shape[2]
    small_cols = cols // turn_x.shape[0]
    channels = radial.table.shape[0]
    for r in prange(small_rows):
        response = np.empty((channels, half), np.float32)
        index = np.empty(half, np.int32)
        share = np.empty(half, np.float32)
        for alias_y in range(turn_y.shape[0]):
            y = r + alias_y * small_rows
            _positions(radial, y, index, share)
            for channel in range(channels):
                _response(response[channel], index, share, radial, channel, y)
            mirrored = spectrum[(rows - y) % rows]
            for alias_x in range(turn_x.shape[0]):
                first = alias_x * small_cols
                direct = min(max(cols // 2 - first + 1, 0), small_half)  # columns before the mirror begins
                for site in range(channel_of.size):
                    turn = turn_y[alias_y, site] * turn_x[alias_x, site]
                    gain = response[channel_of[site]]
                    _add_direct(values[site, r, :direct], spectrum[y, first:], gain[first:], turn)
                    _add_mirrored(values[site, r, direct:], mirrored, gain, cols - first - direct, turn)


@compiled()
def _positions(radial: RadialRows, y: int, index: NDArray[np.int32], share: F32) -> None:
    """Compute the positions of a row of frequencies between the table's nodes; a share above 1 is beyond the last."""
    fx = radial.fx
    last = np.int32(radial.table.shape[1] - 2)
    square = radial.fy[y] * radial.fy[y]
    for c in range(fx.size):
        position = np.sqrt(square + fx[c] * fx[c])
        index[c] = min(np.int32(position), last)
        share[c] = position - np.float32(index[c])


@compiled()
def _response(out: F32, index: NDArray[np.int32], share: F32, radial: RadialRows, channel: int, y: int) -> None:
    """Compute H of a channel along a row of frequencies."""
    nodes, aperture_y, aperture_x = radial.table[channel], radial.aperture_y[y], radial.aperture_x
    for c in range(out.size):
        low = nodes[index[c]]
        value = low + share[c] * (nodes[index[c] + 1] - low)
        value = value if share[c] <= np.float32(1.0) else np.float32(0.0)
        out[c] = value * (aperture_y * aperture_x[c])
    for p in range(radial.fold_across.shape[0]):
        weight, across = radial.fold_down[channel, y, p], radial.fold_across[p]
        for c in range(out.size):
            out[c] += weight * across[c]


@compiled()
def _add_direct(out: C64, spectrum: C64, gain: F32, turn: np.complex64) -> None:
    if turn.imag == 0:
        sign = turn.real
        for c in range(out.size):
            out[c] += spectrum[c] * (gain[c] * sign)
    else:
        for c in range(out.size):
            out[c] += (spectrum[c] * gain[c]) * turn


@compiled()
def _add_mirrored(out: C64, mirrored: C64, gain: F32, start: int, turn: np.complex64) -> None:
    """As `_add_direct`, but backwards from column `start` of the mirrored row."""
    if turn.imag == 0:
        sign = turn.real
        for c in range(out.size):
            out[c] += np.conj(mirrored[start - c]) * (gain[start - c] * sign)
    else:
        for c in range(out.size):
            out[c] += (np.conj(mirrored[start - c]) * gain[start - c]) * turn


@compiled(parallel=True)
def add_general(
    folds: Folds, spectrum: C64, cols: int, kernel: F32, first: I64, taps: F32, has_radial: bool, radial: RadialRows
) -> None:
    """As `add_radial`, for a complex H: that of a kernel, plus an optional radial part.

    A row of the spectrum and its mirror enter the same two rows of the folded spectra. They are processed together, so
    that H is computed once for each.

    - `kernel`: (channels, rows of the kernel's table, 2 (cols // 2 + 1)), real and imaginary parts alternating.
    - `first`, `taps`: See `gridding.Gridding`.
    - `has_radial`: Whether H includes `radial`.
    """
    rows, half = spectrum.shape
    channels = kernel.shape[0]
    small_rows = folds.values.shape[1]
    aliases = folds.turn_y.shape[0]
    for pair in prange(small_rows // 2 + 1):
        line = np.empty(2 * half, np.float32)
        real = np.empty(half if has_radial else 1, np.float32)
        index = np.empty(half if has_radial else 1, np.int32)
        share = np.empty(half if has_radial else 1, np.float32)
        passed = np.empty((2, channels, half), np.complex64)
        mirror_row = (small_rows - pair) % small_rows
        for alias in range(aliases):
            for side in range(2):
                y = pair + alias * small_rows
                if side == 1:
                    y = (rows - y) % rows
                if has_radial:
                    _positions(radial, y, index, share)
                for channel in range(channels):
                    _kernel_line(line, kernel[channel], first[y], taps[y])
                    if has_radial:
                        _response(real, index, share, radial, channel, y)
                        _add_real(line, real)
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
def _add_real(out: F32, real: F32) -> None:
    for c in range(real.size):
        out[2 * c] += real[c]


@compiled()
def _multiplied(out: C64, spectrum: C64, line: F32) -> None:
    gain = line.view(np.complex64)
    for c in range(out.size):
        out[c] = spectrum[c] * gain[c]


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
