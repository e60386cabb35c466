"""Maps laid on the frame's cells: what a layer of a scene is, and its spectrum along the rows.

A layer's term is a map, mixed from the layer's weights, on the padded grid of cells. Where a lens spreads light
differently from place to place a term is several maps, each times a weight over the field. Where it distorts, cells
look at the maps through a warp. Where sheets stand before the layer, cells get what these let pass.

Where colours fall in different places a few pictures of the maps are laid, through the colours' warps, and kept: all
terms are sums of these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

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
_TOGETHER = 4
"""Maps that go through a warp together: the way is most of the work, and each is kept for a while."""


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
class View:
    """Weight maps, and where they are seen.

    Parameters
    ----------
    weights
        (K, rows, cols) maps.
    start, step
        (row, col) map coordinate of the frame's corner, and map samples per pixel.
    warp
        Where cells look instead; None: where `start` and `step` have them.
    before
        What hides parts of the maps, on the cells: each a view of one map, of opacities from 0 to 1.
    """

    weights: NDArray[np.float32]
    start: tuple[float, float]
    step: tuple[float, float]
    warp: Warp | None = None
    before: tuple[View, ...] = ()


@dataclass(frozen=True, eq=False)
class Layer:
    """Maps in view, and what a lens and a sensor do to them.

    Parameters
    ----------
    views
        The maps; more than once where colours show them in different places.
    mixing
        (terms, R, S): a term is the sum over r of `mixing[term, r] @ pictures`, each times `field.weights[r]`. What is
        all 0 for an r costs nothing.
    transfer
        From each term to each channel, or to one.
    pictures
        Of each view (S_n, K): its pictures are these times its weights; the S of all views stand one after another.
        They are laid once and kept. None: the only view's weights themselves, laid for each term; S is K.
    field
        None: R is 1, and the weight 1 everywhere.
    channel
        The only one that the layer reaches; None: all.
    """

    views: tuple[View, ...]
    mixing: NDArray[np.float32]
    transfer: Transfer
    pictures: tuple[NDArray[np.float32], ...] | None = None
    field: Field | None = None
    channel: int | None = None


def laid_spectra(layer: Layer, grid: Grid, out: NDArray[np.complex64]) -> Iterator[NDArray[np.complex64]]:
    """Each term of a layer laid on the cells and transformed along its rows; `out` holds one after another."""
    view = layer.views[0]
    if layer.pictures is None and layer.field is None and view.warp is None and not view.before:
        lines = _lines(view, grid)
        for mix in layer.mixing[:, 0]:
            _plain_spectrum(view.weights, mix, lines, out)
            yield out
    elif layer.pictures is None and view.warp is not None:
        for some in _few_terms(layer):
            yield from _spectra(some, grid, out)
    else:
        yield from _spectra(layer, grid, out)


def _few_terms(layer: Layer) -> Iterator[Layer]:
    """The layer some terms at a time, whose maps go the way through a warp together."""
    used: NDArray[np.bool_] = np.asarray(layer.mixing.any(axis=2))
    maps, first = used.sum(axis=1), 0
    while first < len(maps):
        count = max(1, int(np.searchsorted(np.cumsum(maps[first:]), _TOGETHER, side="right")))
        some = slice(first, first + count)
        first += count
        if maps[some].sum() > _TOGETHER:
            yield replace(layer, mixing=layer.mixing[some])
            continue
        mixing = np.zeros((*used[some].shape, int(maps[some].sum())), np.float32)
        mixing[(*np.nonzero(used[some]), np.arange(mixing.shape[2]))] = 1.0
        yield replace(layer, mixing=mixing, pictures=(layer.mixing[some][used[some]],))


def _spectra(layer: Layer, grid: Grid, out: NDArray[np.complex64]) -> Iterator[NDArray[np.complex64]]:
    """As `laid_spectra`, of any layer."""
    view = layer.views[0]
    pictures_of = (
        _laid_for_each(view, grid) if layer.pictures is None else _laid_once(layer.views, layer.pictures, grid)
    )
    weigh = None if layer.field is None else _Weighing.of(layer.field, grid)
    for mix in layer.mixing:
        used = mix.any(axis=1)
        for begin in range(0, out.shape[0], STRIP):
            end = min(begin + STRIP, out.shape[0])
            laid = pictures_of(mix[used], begin, end)
            rows = laid[0] if weigh is None else weigh(laid, used, begin, end)
            out[begin:end] = scipy.fft.rfft(rows, axis=1, workers=WORKERS)
        yield out


Pictures = Callable[[NDArray[np.float32], int, int], NDArray[np.float32]]
"""(mixes (R, S), begin, end) -> (R, end - begin, cols): rows of cells of sums of pictures."""


def _laid_once(views: Sequence[View], pictures: Sequence[NDArray[np.float32]], grid: Grid) -> Pictures:
    """The pictures of all views, which are laid here."""
    shape = grid.cells(0), grid.cells(1)
    laid = np.empty((sum(map(len, pictures)), *shape), np.float32)
    first = 0
    for view, few in zip(views, pictures, strict=True):
        if not len(few):
            continue
        rows_of = _laid_for_each(view, grid)
        for begin in range(0, shape[0], STRIP):
            end = min(begin + STRIP, shape[0])
            laid[first : first + len(few), begin:end] = rows_of(few, begin, end)
        first += len(few)

    def mixed(mixes: NDArray[np.float32], begin: int, end: int) -> NDArray[np.float32]:
        out = np.empty((len(mixes), end - begin, shape[1]), np.float32)
        _mix_rows(laid[:, begin:end], mixes, out)
        return out

    return mixed


def _laid_for_each(view: View, grid: Grid) -> Pictures:
    """How sums of a view's weights are laid, what stands before it taken off."""
    pictures = _open_pictures(view, grid)
    if not view.before:
        return pictures
    passing = _passing(view.before, grid)
    return lambda few, begin, end: pictures(few, begin, end) * passing[begin:end]


def _open_pictures(view: View, grid: Grid) -> Pictures:
    """The same with nothing before it: through a warp or not."""
    if view.warp is None:
        lines = _lines(view, grid)
        return lambda few, begin, end: np.stack([_plain_rows(view.weights, mix, lines, begin, end) for mix in few])
    corners = _corners(view.warp, view, grid)

    def warped(few: NDArray[np.float32], begin: int, end: int) -> NDArray[np.float32]:
        first, last = corners.span(begin, end)
        return warped_means(np.tensordot(few, view.weights[:, first:last], axes=1), first, corners, begin, end)

    return warped


def _passing(sheets: Sequence[View], grid: Grid) -> NDArray[np.float32]:
    """(rows, cols) what opacities let through to each cell; parts of a cell that two of them cover are independent."""
    passing = np.ones((grid.cells(0), grid.cells(1)), np.float32)
    alone = np.ones((1, 1), np.float32)
    for sheet in sheets:
        opacity = _open_pictures(sheet, grid)
        for begin in range(0, passing.shape[0], STRIP):
            end = min(begin + STRIP, passing.shape[0])
            passing[begin:end] *= np.float32(1) - opacity(alone, begin, end)[0]
    return passing


def _lines(view: View, grid: Grid) -> list[Overlap]:
    """Which samples each row and each column of cells covers."""
    return [grid.overlap(axis, view.start[axis], view.step[axis], view.weights.shape[axis + 1]) for axis in (0, 1)]


def _corners(warp: Warp, view: View, grid: Grid) -> Corners:
    """The corners of the cells, and what of a map they look at."""
    pitch, start, step = warp.pitch_m, view.start, view.step
    y_m, x_m = ((grid.borders(axis) - grid.shape[axis] / 2) * pitch[axis] for axis in (0, 1))
    return Corners(
        warp,
        y_m,
        x_m,
        axis=(start[0] + step[0] * grid.shape[0] / 2, start[1] + step[1] * grid.shape[1] / 2),
        per_m=(step[0] / pitch[0], step[1] / pitch[1]),
        shape=(view.weights.shape[1], view.weights.shape[2]),
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
    """(end - begin, cols): rows of cells of the map `mix @ weights`; the axis that has fewer samples comes last."""
    down, across = lines
    first, last = down.span(begin, end)
    strip = np.tensordot(mix, weights[:, first:last], axes=1)
    if last - first <= end - begin:
        wide = mean_along_rows(strip, across.first, across.sample, across.share)
        laid = np.empty((end - begin, wide.shape[1]), np.float32)
        mean_of_rows(wide, down.first, down.sample, down.share, begin, first, laid)
        return laid
    short = np.empty((end - begin, weights.shape[2]), np.float32)
    mean_of_rows(strip, down.first, down.sample, down.share, begin, first, short)
    along: NDArray[np.float32] = mean_along_rows(short, across.first, across.sample, across.share)
    return along


@dataclass(frozen=True, eq=False)
class _Weighing:
    """Pictures times the field's weights, summed."""

    across: NDArray[np.float32]
    index: NDArray[np.int64]
    share: NDArray[np.float32]

    @classmethod
    def of(cls, field: Field, grid: Grid) -> _Weighing:
        return cls(field.on_columns(grid), *field.on_rows(grid))

    def __call__(self, laid: NDArray[np.float32], used: NDArray[np.bool_], begin: int, end: int) -> NDArray[np.float32]:
        out = np.empty(laid.shape[1:], np.float32)
        _weigh_rows(laid, self.across[used], self.index[begin:end], self.share[begin:end], out)
        return out


@compiled(parallel=True)
def _mix_rows(laid: NDArray[np.float32], mixes: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """out = mixes @ laid, (S, rows, cols)."""
    for i in prange(out.shape[1]):
        for r in range(out.shape[0]):
            line = out[r, i]
            line[:] = 0.0
            for s in range(laid.shape[0]):
                factor, values = mixes[r, s], laid[s, i]
                if factor == 0.0:
                    continue
                for c in range(line.size):
                    line[c] += factor * values[c]


@compiled(parallel=True)
def _weigh_rows(
    laid: NDArray[np.float32],
    across: NDArray[np.float32],
    index: NDArray[np.int64],
    share: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """out = sum over r of laid[r] times the field's weight: between rows index and index + 1 of (R, P, cols)."""
    rows, cols = out.shape
    last = across.shape[1] - 1
    for i in prange(rows):
        low, part = index[i], share[i]
        line = np.zeros(cols, np.float32)
        for r in range(laid.shape[0]):
            values, above, below = laid[r, i], across[r, low], across[r, min(low + 1, last)]
            for c in range(cols):
                line[c] += values[c] * (above[c] + part * (below[c] - above[c]))
        out[i] = line
