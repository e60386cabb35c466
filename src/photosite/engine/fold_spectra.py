"""Kernels that multiply a term's spectrum by H and add it to the folded spectra of the mosaic's sites, in one pass.

Each value of the half spectrum is read once. Values beyond half the sampling frequency along the columns are conjugates
of values in the mirrored row.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange


@compiled(parallel=True)
def add_radial(
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
    """Add spectrum * H of each site's channel, folded to the site's grid, to `folds`; H is real, a function of |f|.

    Parameters
    ----------
    folds
        (sites, rows, cols // 2 + 1) spectra of the sites' own grids.
    spectrum
        (rows, cols // 2 + 1) spectrum of a term on the cells.
    cols
        Columns of the cells.
    fy, fx
        Frequencies, in steps of the table.
    table
        (channels, nodes).
    aperture_y, aperture_x
        Transfer of photodetector, cell and low-pass filter on each axis.
    fold_down, fold_across
        (channels, rows, products) and (products, cols // 2 + 1): the folded terms of H, see `FoldedTerms`.
    channel_of
        (sites,) channel of each site.
    turn_y, turn_x
        (aliases, sites) phase with which an alias enters a site's folded spectrum.
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
    """Compute the positions of a row of frequencies between the table's nodes; a share above 1 is beyond the last."""
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
    """Compute H of a channel along a row of frequencies."""
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
    folds: NDArray[np.complex64],
    spectrum: NDArray[np.complex64],
    cols: int,
    rows_of_kernel: NDArray[np.float32],
    first: NDArray[np.int64],
    taps: NDArray[np.float32],
    radial: bool,
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
    """As `add_radial`, for a complex H: that of a kernel, plus an optional radial part.

    A row of the spectrum and its mirror enter the same two rows of the folded spectra. They are processed together, so
    that H is computed once for each.

    Parameters
    ----------
    rows_of_kernel
        (channels, rows of the kernel's table, 2 (cols // 2 + 1)), real and imaginary parts alternating.
    first, taps
        See `gridding.Gridding`.
    radial
        Whether H has a radial part, which the parameters after this one describe.
    """
    rows, half = spectrum.shape
    channels = rows_of_kernel.shape[0]
    small_rows = folds.shape[1]
    aliases = turn_y.shape[0]
    for pair in prange(small_rows // 2 + 1):
        line = np.empty(2 * half, np.float32)
        real = np.empty(half if radial else 1, np.float32)
        index = np.empty(half if radial else 1, np.int32)
        share = np.empty(half if radial else 1, np.float32)
        passed = np.empty((2, channels, half), np.complex64)
        mirror_row = (small_rows - pair) % small_rows
        for alias in range(aliases):
            for side in range(2):
                y = pair + alias * small_rows
                if side == 1:
                    y = (rows - y) % rows
                if radial:
                    _positions(fy[y], fx, table.shape[1], index, share)
                for channel in range(channels):
                    _kernel_line(line, rows_of_kernel[channel], first[y], taps[y])
                    if radial:
                        _response(
                            real,
                            index,
                            share,
                            table[channel],
                            aperture_y[y],
                            aperture_x,
                            fold_down[channel, y],
                            fold_across,
                        )
                        _add_real(line, real)
                    _multiplied(passed[side, channel], spectrum[y], line)
            _fold_row(folds, pair, alias, passed[0], passed[1], cols, channel_of, turn_y, turn_x)
            if mirror_row != pair:
                of_mirror = (rows - pair - alias * small_rows) % rows // small_rows
                _fold_row(folds, mirror_row, of_mirror, passed[1], passed[0], cols, channel_of, turn_y, turn_x)


@compiled()
def _kernel_line(out: NDArray[np.float32], table: NDArray[np.float32], first: int, taps: NDArray[np.float32]) -> None:
    """Interpolate a row of a kernel's spectrum from the eight nearest rows of its table."""
    long = table.shape[0]
    a, b, c, d = table[first], table[(first + 1) % long], table[(first + 2) % long], table[(first + 3) % long]
    e, f, g, h = (
        table[(first + 4) % long],
        table[(first + 5) % long],
        table[(first + 6) % long],
        table[(first + 7) % long],
    )
    ta, tb, tc, td, te, tf, tg, th = taps[0], taps[1], taps[2], taps[3], taps[4], taps[5], taps[6], taps[7]
    for i in range(out.size):
        out[i] = ((ta * a[i] + tb * b[i]) + (tc * c[i] + td * d[i])) + (
            (te * e[i] + tf * f[i]) + (tg * g[i] + th * h[i])
        )


@compiled()
def _add_real(out: NDArray[np.float32], real: NDArray[np.float32]) -> None:
    for c in range(real.size):
        out[2 * c] += real[c]


@compiled()
def _multiplied(out: NDArray[np.complex64], spectrum: NDArray[np.complex64], line: NDArray[np.float32]) -> None:
    gain = line.view(np.complex64)
    for c in range(out.size):
        out[c] = spectrum[c] * gain[c]


@compiled()
def _fold_row(
    folds: NDArray[np.complex64],
    row: int,
    alias_y: int,
    direct: NDArray[np.complex64],
    mirrored: NDArray[np.complex64],
    cols: int,
    channel_of: NDArray[np.int64],
    turn_y: NDArray[np.complex64],
    turn_x: NDArray[np.complex64],
) -> None:
    """Add a row times H, and its mirror, to a row of the folded spectra."""
    small_half = folds.shape[2]
    small_cols = cols // turn_x.shape[0]
    for alias_x in range(turn_x.shape[0]):
        start = alias_x * small_cols
        count = min(max(cols // 2 - start + 1, 0), small_half)  # columns before the mirror begins
        for site in range(channel_of.size):
            turn = turn_y[alias_y, site] * turn_x[alias_x, site]
            channel = channel_of[site]
            _add(folds[site, row, :count], direct[channel, start:], turn)
            _add_reversed(folds[site, row, count:], mirrored[channel], cols - start - count, turn)


@compiled()
def _add(out: NDArray[np.complex64], values: NDArray[np.complex64], turn: np.complex64) -> None:
    if turn.imag == 0:
        sign = turn.real
        for c in range(out.size):
            out[c] += values[c] * sign
    else:
        for c in range(out.size):
            out[c] += values[c] * turn


@compiled()
def _add_reversed(out: NDArray[np.complex64], values: NDArray[np.complex64], start: int, turn: np.complex64) -> None:
    """Add conjugates, backwards from `start`."""
    if turn.imag == 0:
        sign = turn.real
        for c in range(out.size):
            out[c] += np.conj(values[start - c]) * sign
    else:
        for c in range(out.size):
            out[c] += np.conj(values[start - c]) * turn
