"""The mosaic of layers on a device: `mosaic.mosaic_of_layers` in whole arrays, with the device's own transforms.

The equations are those of `mosaic`. A GPU transforms a frame in about a millisecond, so spectra are not folded: each
channel is transformed back as a whole, and read at its sites. The sums are those of the CPU in another order; the
results differ by the rounding of 32-bit transforms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from photosite.engine.arrays import Arrays
from photosite.engine.jit import F64, I64
from photosite.engine.layers import Field, Grid, Layer
from photosite.engine.mosaic import RadialRows, radial_rows
from photosite.engine.resample import Overlap
from photosite.engine.transfer import Sampling, SplineRows


def runs_on_device(layer: Layer) -> bool:
    """Return whether `mosaic_on_device` supports a layer: one view, without distortion and occluders."""
    return (
        layer.node_maps is None
        and len(layer.views) == 1
        and not layer.views[0].occluders
        and (layer.views[0].warp is None)
    )


def mosaic_on_device(
    arrays: Arrays, layers: Sequence[Layer], sampling: Sampling, grid: Grid, sites: Sequence[Sequence[tuple[int, int]]]
) -> Any:
    """Return `mosaic.mosaic_of_layers` of layers that `runs_on_device` accepts, (rows, cols) float32 on the device.

    Nothing is copied to the host. The weight maps are copied to the device if they are on the host.
    """
    xp, rows, cols = arrays.xp, grid.cells(0), grid.cells(1)
    spectra = [arrays.zeros((rows, cols // 2 + 1), xp.complex64) for _ in sites]
    for layer in layers:
        transfer = _DeviceTransfer(arrays, layer, sampling, grid)
        channels = range(len(sites)) if layer.channel is None else [layer.channel]
        for term, spectrum in enumerate(_term_spectra(arrays, layer, grid)):
            for number, channel in enumerate(channels):
                spectra[channel] = spectra[channel] + spectrum * transfer.of(number, term)
    mosaic = arrays.zeros(grid.shape, xp.float32)
    n, tile = grid.cells_per_pixel, grid.tile
    for spectrum, of_channel in zip(spectra, sites, strict=True):
        image = xp.fft.irfft(xp.fft.ifft(spectrum, axis=0), n=cols, axis=1)
        for r, c in of_channel:
            down, across = (
                slice(first := (grid.before(axis) + site) * n + n // 2, first + (size - site) * n, tile[axis] * n)
                for axis, (site, size) in enumerate(zip((r, c), grid.shape, strict=True))
            )
            mosaic[r :: tile[0], c :: tile[1]] = image[down, across]
    return mosaic


def _term_spectra(arrays: Arrays, layer: Layer, grid: Grid) -> Iterator[Any]:
    """Yield the spectrum of each term on the cells, (rows, cols // 2 + 1) complex64."""
    xp, view = arrays.xp, layer.views[0]
    weights = arrays.put(view.weights)
    overlaps = [grid.overlap(axis, view.start[axis], view.step[axis], view.weights.shape[axis + 1]) for axis in (0, 1)]
    down, across = (_fractions(arrays, cover) for cover in overlaps)
    narrow = view.weights.shape[1] < grid.cells(0)
    field = None if layer.field is None else _field_weights(arrays, layer.field, grid)
    for mix in layer.mixing:
        if field is None:
            values = xp.tensordot(arrays.put(mix[0]), weights, axes=1)
            if narrow:  # resampling is linear on each axis, so few rows are transformed first
                rows = _means(xp, xp.fft.rfft(_means(xp, values, across, 1), axis=1), down, 0)
            else:
                rows = xp.fft.rfft(_means(xp, _means(xp, values, down, 0), across, 1), axis=1)
        else:
            total = arrays.zeros((grid.cells(0), grid.cells(1)), xp.float32)
            for mode in np.flatnonzero(mix.any(axis=1)):
                values = xp.tensordot(arrays.put(mix[mode]), weights, axes=1)
                total = total + _means(xp, _means(xp, values, across, 1), down, 0) * field(int(mode))
            rows = xp.fft.rfft(total, axis=1)
        yield xp.fft.fft(rows, axis=0)


def _fractions(arrays: Arrays, cover: Overlap) -> list[tuple[Any, Any]]:
    """Return the samples that each output covers as pairs of (count,) samples and fractions, 0 for padding."""
    counts = np.diff(cover.first)
    pairs = []
    for entry in range(int(counts.max())):
        place = np.minimum(cover.first[:-1] + entry, cover.sample.size - 1)
        fraction = np.where(entry < counts, cover.fraction[place], np.float32(0.0))
        pairs.append((arrays.put(cover.sample[place]), arrays.put(fraction)))
    return pairs


def _means(xp: Any, values: Any, fractions: list[tuple[Any, Any]], axis: int) -> Any:
    """Return the means of a map, or of its spectrum, along an axis."""
    shape = (-1, 1) if axis == 0 else (1, -1)
    parts = (xp.take(values, sample, axis=axis) * xp.reshape(fraction, shape) for sample, fraction in fractions)
    total = next(parts)
    for part in parts:
        total = total + part
    return total


def _field_weights(arrays: Arrays, field: Field, grid: Grid) -> Any:
    """Return a function of the mode that gives its field weights on the cells, (rows, cols) float32."""
    xp, centers = arrays.xp, grid.centers(1)
    position = np.interp(grid.centers(0), field.row, np.arange(field.row.size))
    index = np.minimum(position.astype(np.int64), max(field.row.size - 2, 0))
    fraction = arrays.put((position - index).astype(np.float32)[:, None])
    low, high = arrays.put(index), arrays.put(np.minimum(index + 1, field.row.size - 1))

    def of(mode: int) -> Any:
        lines = np.stack([np.interp(centers, field.col, line) for line in field.weights[mode]]).astype(np.float32)
        across = arrays.put(lines)
        above = xp.take(across, low, axis=0)
        return above + fraction * (xp.take(across, high, axis=0) - above)

    return of


class _DeviceTransfer:
    """H of a layer at the grid's frequencies."""

    def __init__(self, arrays: Arrays, layer: Layer, sampling: Sampling, grid: Grid) -> None:
        self._arrays, self._size = arrays, (grid.cells(0), grid.cells(1))
        self._kernels, self._radial = layer.transfer.kernels, None
        if layer.transfer.radial is not None:
            rows = radial_rows(layer.transfer.radial, sampling, grid)
            self._radial = rows
            xp, last = arrays.xp, rows.table.shape[2] - 2
            fy, fx = arrays.put(rows.fy[:, None]), arrays.put(rows.fx[None])
            position = xp.sqrt(fy * fy + fx * fx)
            index = xp.astype(position, xp.int32)
            index = xp.minimum(index, xp.full_like(index, last))
            self._fraction = position - xp.astype(index, xp.float32)
            self._index = xp.reshape(index, (-1,))
            self._aperture = arrays.put(rows.aperture_y[:, None]) * arrays.put(rows.aperture_x[None])

    def of(self, channel: int, term: int) -> Any:
        """Return the transfer from a term to a channel, (rows, cols // 2 + 1)."""
        parts = []
        if self._radial is not None:
            parts.append(self._of_radial(self._radial, channel, term))
        if self._kernels is not None:
            parts.append(self._of_kernel(self._kernels[channel, term]))
        return parts[0] if len(parts) == 1 else parts[0] + parts[1]

    def _of_radial(self, rows: RadialRows, channel: int, term: int) -> Any:
        xp, put = self._arrays.xp, self._arrays.put
        nodes = rows.table[channel, term]
        shape = self._fraction.shape
        low = xp.reshape(xp.take(put(nodes), self._index, axis=0), shape)
        step = xp.reshape(xp.take(put(np.append(np.diff(nodes), np.float32(0.0))), self._index, axis=0), shape)
        inside = xp.astype(self._fraction <= 1.0, xp.float32)
        central = (low + self._fraction * step) * (inside * self._aperture)
        fold, begin = rows.fold[channel, term], rows.fold_begin_x
        first_x = np.repeat(np.arange(begin.size - 1), np.diff(begin))
        down, across = (
            put(SplineRows(first, weights).matrix(len(fold)))
            for first, weights in ((rows.fold_first_y, rows.fold_y), (first_x, rows.fold_x))
        )
        return central + down @ put(fold) @ across.T

    def _of_kernel(self, kernel: F64) -> Any:
        xp, arrays = self._arrays.xp, self._arrays
        middle = [size // 2 for size in kernel.shape]
        for axis, size in enumerate(self._size):  # a kernel wider than the frame wraps around it
            kernel = _wrapped(kernel, size, axis)
        whole = arrays.zeros(self._size, xp.float32)
        whole[: kernel.shape[0], : kernel.shape[1]] = arrays.put(kernel.astype(np.float32))
        whole = xp.roll(whole, (-middle[0], -middle[1]), axis=(0, 1))
        return xp.fft.fft(xp.fft.rfft(whole, axis=1), axis=0)


def _wrapped(kernel: F64, size: int, axis: int) -> F64:
    """Return a kernel whose entries beyond a size are added to those one or more sizes before."""
    if kernel.shape[axis] <= size:
        return kernel
    place: I64 = np.arange(kernel.shape[axis]) % size
    lines = np.moveaxis(kernel, axis, 0)
    out = np.zeros((size, lines.shape[1]))
    np.add.at(out, place, lines)
    return np.moveaxis(out, 0, axis)


def gathered_on_device(arrays: Arrays, mosaic: Any, fractions: F64) -> Any:
    """Return each pixel's sum of fractions of the pixels around it; see `camera.optical_stack.gathered`.

    - `mosaic`: (rows, cols) on the device, one whole tile or more.
    - `fractions`: (tile rows, tile cols, size, size) on the host.
    """
    xp, (tile, size) = arrays.xp, (fractions.shape[:2], fractions.shape[2])
    total = xp.zeros_like(mosaic)
    for y, x in np.argwhere((fractions != 0).any(axis=(0, 1))):
        down, across = (
            arrays.put(_inside(np.arange(count) + shift - size // 2, count, period))
            for count, shift, period in zip(mosaic.shape, (y, x), tile, strict=True)
        )
        weights = arrays.put(fractions[:, :, y, x].astype(np.float32))
        for axis, (count, period) in enumerate(zip(mosaic.shape, tile, strict=True)):
            weights = xp.take(weights, arrays.put(np.arange(count) % period), axis=axis)
        total = total + weights * xp.take(xp.take(mosaic, down, axis=0), across, axis=1)
    return total


def _inside(index: I64, size: int, period: int) -> I64:
    """Return the nearest indices inside the frame at the same site of the tile."""
    before, beyond = index % period, size - period + (index - size) % period
    return np.where(index < 0, before, np.where(index >= size, beyond, index))
