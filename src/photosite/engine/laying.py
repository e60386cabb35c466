"""Maps laid on the frame's cells: what a layer of a scene is, and its spectrum along the rows.

A layer's term is a map, mixed from the layer's weights, on the padded grid of cells. Where a lens spreads light
differently from place to place a term is several maps, each times a weight over the field. Where it distorts, cells
look at the maps through a warp. Where sheets stand before the layer, cells get what these let pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange
from photosite.engine.resample import Overlap, mean_along_rows, mean_of_rows, overlap
from photosite.engine.transfer import Transfer
from photosite.engine.warp import CellWeights, Corners, Warp, warped_means

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
class Sheet:
    """An opacity, and where it lies.

    Parameters
    ----------
    opacity
        (rows, cols) 0 to 1.
    start, step, warp
        As for `Layer`.
    """

    opacity: NDArray[np.float32]
    start: tuple[float, float]
    step: tuple[float, float]
    warp: Warp | None = None


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
        (terms, R, K): a term is the sum over r of `mixing[term, r] @ weights`, each times `field.weights[r]`. What is
        all 0 for an r costs nothing.
    transfer
        From each term to each channel.
    field
        None: R is 1, and the weight 1 everywhere.
    warp
        Where cells look instead; None: where `start` and `step` have them.
    before
        What hides parts of the layer, on the cells.
    """

    weights: NDArray[np.float32]
    start: tuple[float, float]
    step: tuple[float, float]
    mixing: NDArray[np.float32]
    transfer: Transfer
    field: Field | None = None
    warp: Warp | None = None
    before: tuple[Sheet, ...] = ()


def laid_spectra(layer: Layer, grid: Grid, out: NDArray[np.complex64]) -> Iterator[NDArray[np.complex64]]:
    """Each term of a layer laid on the cells and transformed along its rows; `out` holds one after another."""
    if layer.field is None and layer.warp is None and not layer.before:
        lines = _lines(layer.weights, layer.start, layer.step, grid)
        for mix in layer.mixing[:, 0]:
            _plain_spectrum(layer.weights, mix, lines, out)
            yield out
        return
    rows = _laid_rows(layer, grid)
    passing = _passing(layer.before, grid) if layer.before else None
    for mix in layer.mixing:
        for begin in range(0, out.shape[0], STRIP):
            end = min(begin + STRIP, out.shape[0])
            laid = rows(mix, begin, end)
            if passing is not None:
                laid *= passing[begin:end]
            out[begin:end] = scipy.fft.rfft(laid, axis=1, workers=WORKERS)
        yield out


Rows = Callable[[NDArray[np.float32], int, int], NDArray[np.float32]]
"""(mix (R, K), begin, end) -> (end - begin, cols): rows of cells."""


def _laid_rows(layer: Layer | Sheet, grid: Grid) -> Rows:
    """How rows of a layer's cells are come by: through a warp or not, weighted over a field or not."""
    weights = layer.opacity[None] if isinstance(layer, Sheet) else layer.weights
    field = None if isinstance(layer, Sheet) else layer.field
    if layer.warp is not None:
        return _warped_rows(weights, _corners(layer.warp, layer.start, layer.step, weights, grid), field, grid)
    lines = _lines(weights, layer.start, layer.step, grid)
    if field is None:
        return lambda mix, begin, end: _plain_rows(weights, mix[0], lines, begin, end)
    across, down = field.on_columns(grid), field.on_rows(grid)

    def weighed(mix: NDArray[np.float32], begin: int, end: int) -> NDArray[np.float32]:
        used = mix.any(axis=1)
        return _weighed_rows(weights, mix[used], lines, across[used], down, begin, end)

    return weighed


def _passing(sheets: Sequence[Sheet], grid: Grid) -> NDArray[np.float32]:
    """(rows, cols) what sheets let through to each cell; parts of a cell that two of them cover are independent."""
    passing = np.ones((grid.cells(0), grid.cells(1)), np.float32)
    alone = np.ones((1, 1), np.float32)
    for sheet in sheets:
        rows = _laid_rows(sheet, grid)
        for begin in range(0, passing.shape[0], STRIP):
            end = min(begin + STRIP, passing.shape[0])
            passing[begin:end] *= np.float32(1) - rows(alone, begin, end)
    return passing


def _lines(
    weights: NDArray[np.float32], start: tuple[float, float], step: tuple[float, float], grid: Grid
) -> list[Overlap]:
    """Which samples each row and each column of cells covers."""
    return [grid.overlap(axis, start[axis], step[axis], weights.shape[axis + 1]) for axis in (0, 1)]


def _corners(
    warp: Warp, start: tuple[float, float], step: tuple[float, float], weights: NDArray[np.float32], grid: Grid
) -> Corners:
    """The corners of the cells, and what of a map they look at."""
    pitch = warp.pitch_m
    y_m, x_m = ((grid.borders(axis) - grid.shape[axis] / 2) * pitch[axis] for axis in (0, 1))
    return Corners(
        warp,
        y_m,
        x_m,
        axis=(start[0] + step[0] * grid.shape[0] / 2, start[1] + step[1] * grid.shape[1] / 2),
        per_m=(step[0] / pitch[0], step[1] / pitch[1]),
        shape=(weights.shape[1], weights.shape[2]),
    )


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
            laid = _plain_rows(weights, mix, lines, begin, end)
            out[begin:end] = scipy.fft.rfft(laid, axis=1, workers=WORKERS)


def _plain_rows(
    weights: NDArray[np.float32], mix: NDArray[np.float32], lines: Sequence[Overlap], begin: int, end: int
) -> NDArray[np.float32]:
    """(end - begin, cols): rows of cells of the map `mix @ weights`."""
    down, across = lines
    first, last = down.span(begin, end)
    short = np.empty((end - begin, weights.shape[2]), np.float32)
    strip = np.tensordot(mix, weights[:, first:last], axes=1)
    mean_of_rows(strip, down.first, down.sample, down.share, begin, first, short)
    laid: NDArray[np.float32] = mean_along_rows(short, across.first, across.sample, across.share)
    return laid


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


def _warped_rows(weights: NDArray[np.float32], corners: Corners, field: Field | None, grid: Grid) -> Rows:
    """As `_laid_rows`, through a warp. The field's weights are those of the place where light arrives."""
    across = index = share = None
    if field is not None:
        across = np.ascontiguousarray(np.moveaxis(field.on_columns(grid), 0, 2))
        index, share = field.on_rows(grid)

    def rows(mix: NDArray[np.float32], begin: int, end: int) -> NDArray[np.float32]:
        first, last = corners.span(begin, end)
        used = mix.any(axis=1)
        strip = np.tensordot(mix[used], weights[:, first:last], axes=1)
        of_cells = None
        if across is not None and index is not None and share is not None:
            of_cells = CellWeights(np.ascontiguousarray(across[:, :, used]), index[begin:end], share[begin:end])
        return warped_means(strip, first, corners, begin, end, of_cells)

    return rows


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
