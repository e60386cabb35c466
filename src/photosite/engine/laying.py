"""Maps laid on the frame's cells: what a layer of a scene is, and its spectrum along the rows.

A layer's term is a map, mixed from the layer's weights, on the padded grid of cells. Where a lens spreads light
differently from place to place a term is several maps, each times a weight over the field. Where it distorts, cells
look at the maps through a warp.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange
from photosite.engine.resample import Overlap, mean_along_rows, mean_of_rows, overlap
from photosite.engine.transfer import Transfer
from photosite.engine.warp import Corners, Warp, warped_means

STRIP = 256
"""Rows of cells that are laid at a time."""
WORKERS = -1


@dataclass(frozen=True, eq=False)
class Grid:
    """The padded grid of cells behind a frame.

    Parameters
    ----------
    shape
        (rows, cols) of the frame, pixels.
    padding
        Pixels kept beyond each border, at least.
    tile
        (rows, cols) of the mosaic's tile.
    cells_per_pixel
        On each axis.
    """

    shape: tuple[int, int]
    padding: int
    tile: tuple[int, int]
    cells_per_pixel: int = 1

    def before(self, axis: int) -> int:
        """Pixels of padding before the frame: whole tiles."""
        return -(-self.padding // self.tile[axis]) * self.tile[axis]

    def padded(self, axis: int) -> int:
        """Pixels with padding: whole tiles, and a size that transforms well."""
        tile = self.tile[axis]
        tiles = -(-(self.shape[axis] + self.before(axis) + self.padding) // tile)
        return int(scipy.fft.next_fast_len(tiles, real=True)) * tile

    def cells(self, axis: int) -> int:
        """Cells with padding."""
        return self.padded(axis) * self.cells_per_pixel

    def overlap(self, axis: int, start: float, step: float, samples: int) -> Overlap:
        """Which samples each cell covers: sample coordinate = start + step * pixel coordinate."""
        return overlap(self.cells(axis), start - self.before(axis) * step, step / self.cells_per_pixel, samples)

    def centers(self, axis: int) -> NDArray[np.float64]:
        """(cells,) where the cells' centres lie, in pixels from the frame's first border."""
        return (np.arange(self.cells(axis)) + 0.5) / self.cells_per_pixel - self.before(axis)

    def farthest(self, axis: int) -> float:
        """The distance of the grid's border from the frame's middle, pixels."""
        return max(self.before(axis), self.padded(axis) - self.before(axis) - self.shape[axis]) + self.shape[axis] / 2

    def borders(self, axis: int) -> NDArray[np.float64]:
        """(cells + 1,) where the borders between cells lie, in pixels from the frame's first border."""
        return np.arange(self.cells(axis) + 1) / self.cells_per_pixel - self.before(axis)


@dataclass(frozen=True, eq=False)
class Field:
    """Weights over the field: linear between nodes, beyond them those of the nearest.

    Parameters
    ----------
    row, col
        (P,), (Q,) increasing: nodes, in pixels from the frame's first border.
    weights
        (R, P, Q).
    """

    row: NDArray[np.float64]
    col: NDArray[np.float64]
    weights: NDArray[np.float64]

    def on_columns(self, grid: Grid) -> NDArray[np.float32]:
        """(R, P, cols of cells): interpolated along the rows."""
        centers = grid.centers(1)
        lines = self.weights.reshape(-1, self.col.size)
        along = np.stack([np.interp(centers, self.col, line) for line in lines])
        return along.reshape(*self.weights.shape[:2], centers.size).astype(np.float32)

    def on_rows(self, grid: Grid) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """For each row of cells the node above it, and the share of the node below."""
        position = np.interp(grid.centers(0), self.row, np.arange(self.row.size))
        index = np.minimum(position.astype(np.int64), max(self.row.size - 2, 0))
        return index, (position - index).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Layer:
    """Weight maps, where they lie, and what a lens and a sensor do to them.

    Parameters
    ----------
    weights
        (K, rows, cols) maps.
    start, step
        (row, col) map coordinate of the frame's corner, and map samples per pixel.
    mixing
        (terms, R, K): a term is the sum over r of `mixing[term, r] @ weights`, each times `field.weights[r]`.
    transfer
        From each term to each channel.
    field
        None: R is 1, and the weight 1 everywhere.
    warp
        Where cells look instead; None: where `start` and `step` have them.
    """

    weights: NDArray[np.float32]
    start: tuple[float, float]
    step: tuple[float, float]
    mixing: NDArray[np.float32]
    transfer: Transfer
    field: Field | None = None
    warp: Warp | None = None

    def corners(self, grid: Grid) -> Corners | None:
        """The corners of the cells and what they look at; None without a warp."""
        if self.warp is None:
            return None
        pitch = self.warp.pitch_m
        y_m, x_m = ((grid.borders(axis) - grid.shape[axis] / 2) * pitch[axis] for axis in (0, 1))
        return Corners(
            self.warp,
            y_m,
            x_m,
            axis=(self.start[0] + self.step[0] * grid.shape[0] / 2, self.start[1] + self.step[1] * grid.shape[1] / 2),
            per_m=(self.step[0] / pitch[0], self.step[1] / pitch[1]),
            shape=(self.weights.shape[1], self.weights.shape[2]),
        )


def laid_spectra(layer: Layer, grid: Grid, out: NDArray[np.complex64]) -> Iterator[NDArray[np.complex64]]:
    """Each term of a layer laid on the cells and transformed along its rows; `out` holds one after another."""
    corners = layer.corners(grid)
    if corners is not None:
        yield from _warped_spectra(layer, grid, corners, out)
        return
    lines = [grid.overlap(axis, layer.start[axis], layer.step[axis], layer.weights.shape[axis + 1]) for axis in (0, 1)]
    if layer.field is None:
        for mix in layer.mixing[:, 0]:
            _plain_spectrum(layer.weights, mix, lines, out)
            yield out
        return
    across, down = layer.field.on_columns(grid), layer.field.on_rows(grid)
    for mix in layer.mixing:
        for begin in range(0, out.shape[0], STRIP):
            end = min(begin + STRIP, out.shape[0])
            weighed = _weighed_rows(layer.weights, mix, lines, across, down, begin, end)
            out[begin:end] = scipy.fft.rfft(weighed, axis=1, workers=WORKERS)
        yield out


def _plain_spectrum(
    weights: NDArray[np.float32], mix: NDArray[np.float32], lines: Sequence[Overlap], out: NDArray[np.complex64]
) -> None:
    """A map laid on the cells, transformed along its rows, into (rows, cols // 2 + 1).

    Laying is linear on each axis, so its order is free: a map of few rows is transformed first and its
    spectrum brought to all rows after.
    """
    down, across = lines
    parts = out.view(np.float32)
    rows = out.shape[0]
    for begin in range(0, rows, STRIP):
        end = min(begin + STRIP, rows)
        first, last = down.span(begin, end)
        if last - first <= end - begin:
            strip = np.tensordot(mix, weights[:, first:last], axes=1)
            laid = mean_along_rows(strip, across.first, across.sample, across.share)
            narrow = scipy.fft.rfft(laid, axis=1, workers=WORKERS).view(np.float32)
            mean_of_rows(narrow, down.first, down.sample, down.share, begin, first, parts[begin:end])
        else:
            short = np.empty((end - begin, weights.shape[2]), np.float32)
            strip = np.tensordot(mix, weights[:, first:last], axes=1)
            mean_of_rows(strip, down.first, down.sample, down.share, begin, first, short)
            laid = mean_along_rows(short, across.first, across.sample, across.share)
            out[begin:end] = scipy.fft.rfft(laid, axis=1, workers=WORKERS)


def _weighed_rows(
    weights: NDArray[np.float32],
    mix: NDArray[np.float32],
    lines: Sequence[Overlap],
    field_across: NDArray[np.float32],
    field_down: tuple[NDArray[np.int64], NDArray[np.float32]],
    begin: int,
    end: int,
) -> NDArray[np.float32]:
    """(end - begin, cols): rows of cells of the maps `mix @ weights`, each times its weight over the field, summed.

    The axis that has fewer samples comes last, and is weighted as it is laid.
    """
    down, across = lines
    index, share = field_down[0][begin:end], field_down[1][begin:end]
    first, last = down.span(begin, end)
    strip = np.tensordot(mix, weights[:, first:last], axes=1)
    out = np.empty((end - begin, field_across.shape[2]), np.float32)
    if last - first <= end - begin:
        flat = mean_along_rows(strip.reshape(-1, strip.shape[2]), across.first, across.sample, across.share)
        wide = flat.reshape(len(mix), last - first, -1)
        _weigh_rows(wide, down.first, down.sample, down.share, begin, first, field_across, index, share, out)
        return out
    short = np.empty((len(mix), end - begin, strip.shape[2]), np.float32)
    for values, rows in zip(strip, short, strict=True):
        mean_of_rows(values, down.first, down.sample, down.share, begin, first, rows)
    _weigh_along(short, across.first, across.sample, across.share, field_across, index, share, out)
    return out


def _warped_spectra(
    layer: Layer, grid: Grid, corners: Corners, out: NDArray[np.complex64]
) -> Iterator[NDArray[np.complex64]]:
    """As `laid_spectra`, through a warp. The field's weights are those of the place where light arrives."""
    if layer.field is not None:
        across, (index, share) = layer.field.on_columns(grid), layer.field.on_rows(grid)
        cols = np.arange(grid.cells(1) + 1)  # warped rows have their columns
        once = np.ones(cols.size - 1, np.float32)
    for mix in layer.mixing:
        for begin in range(0, out.shape[0], STRIP):
            end = min(begin + STRIP, out.shape[0])
            first, last = corners.span(begin, end)
            strip = np.tensordot(mix, layer.weights[:, first:last], axes=1)
            warped = [warped_means(values, first, corners, begin, end) for values in strip]
            laid = warped[0]
            if layer.field is not None:
                laid = np.empty_like(warped[0])
                rows = index[begin:end], share[begin:end]
                _weigh_along(np.stack(warped), cols, cols[:-1], once, across, *rows, laid)
            out[begin:end] = scipy.fft.rfft(laid, axis=1, workers=WORKERS)
        yield out


@compiled(parallel=True)
def _weigh_rows(
    wide: NDArray[np.float32],
    first: NDArray[np.int64],
    sample: NDArray[np.int64],
    overlap_share: NDArray[np.float32],
    begin: int,
    offset: int,
    across: NDArray[np.float32],
    index: NDArray[np.int64],
    share: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """out = sum over r of the means of whole rows of wide[r], times the field's weight (see `mean_of_rows`).

    The weight is between rows index and index + 1 of across, (R, P, cols).
    """
    count, rows, cols = wide.shape[0], out.shape[0], out.shape[1]
    last = across.shape[1] - 1
    for i in prange(rows):
        low, part = index[i], share[i]
        line = np.zeros(cols, np.float32)
        for r in range(count):
            above, below = across[r, low], across[r, min(low + 1, last)]
            for entry in range(first[begin + i], first[begin + i + 1]):
                values, weight = wide[r, sample[entry] - offset], overlap_share[entry]
                for c in range(cols):
                    line[c] += values[c] * weight * (above[c] + part * (below[c] - above[c]))
        out[i] = line


@compiled(parallel=True)
def _weigh_along(
    short: NDArray[np.float32],
    first: NDArray[np.int64],
    sample: NDArray[np.int64],
    overlap_share: NDArray[np.float32],
    across: NDArray[np.float32],
    index: NDArray[np.int64],
    share: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """out = sum over r of short[r] brought to the cells along its rows, times the field's weight."""
    count, rows, cols = short.shape[0], out.shape[0], out.shape[1]
    last = across.shape[1] - 1
    for i in prange(rows):
        low, part = index[i], share[i]
        line = np.zeros(cols, np.float32)
        for r in range(count):
            values, above, below = short[r, i], across[r, low], across[r, min(low + 1, last)]
            for c in range(cols):
                mean = np.float32(0.0)
                for entry in range(first[c], first[c + 1]):
                    mean += values[sample[entry]] * overlap_share[entry]
                line[c] += mean * (above[c] + part * (below[c] - above[c]))
        out[i] = line
