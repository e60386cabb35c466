"""Layers: weight maps resampled on the frame's cells, and their spectra along the rows.

A layer's *term* is a combination of weight maps on the padded grid of cells. If a lens varies over the field, a term is
the sum of several combinations, each times a field weight. If the lens distorts, each cell takes the mean of a map over
the place it sees through a warp. Occluders attenuate a map before the lens blurs it.

With lateral color, each wavelength node has a view of its own. A few *node maps* per node are resampled once and
stored, and all terms are combinations of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import scipy.fft

from photosite.engine.jit import C64, F32, F64, I64, THREADS, compiled, prange
from photosite.engine.resample import Corners, Overlap, Warp, mean_along_rows, mean_of_rows, overlap, warped_means
from photosite.engine.transfer import Transfer

_STRIP = 256
"""Rows of cells that are resampled at a time."""
WORKERS = THREADS
_MAPS_PER_WARP = 4
"""Maps that are warped together: finding the place is most of the work, and each map needs memory meanwhile."""


@dataclass(frozen=True, eq=False)
class Grid:
    """The padded grid of cells of a frame."""

    shape: tuple[int, int]  # (rows, cols) of the frame in pixels
    padding: int  # smallest number of pixels beyond each border
    tile: tuple[int, int]  # (rows, cols) of the color filter array's tile
    cells_per_pixel: int = 1  # cells per pixel on each axis

    def before(self, axis: int) -> int:
        """Return the pixels of padding before the frame, a whole number of tiles."""
        return -(-self.padding // self.tile[axis]) * self.tile[axis]

    def padded(self, axis: int) -> int:
        """Return the pixels with padding: a whole number of tiles, with a fast transform."""
        tile = self.tile[axis]
        tiles = -(-(self.shape[axis] + self.before(axis) + self.padding) // tile)
        return int(scipy.fft.next_fast_len(tiles, real=True)) * tile

    def cells(self, axis: int) -> int:
        """Return the cells with padding."""
        return self.padded(axis) * self.cells_per_pixel

    def overlap(self, axis: int, start: float, step: float, samples: int) -> Overlap:
        """Return which samples each cell covers, for sample coordinate = start + step * pixel coordinate."""
        return overlap(self.cells(axis), start - self.before(axis) * step, step / self.cells_per_pixel, samples)

    def centers(self, axis: int) -> F64:
        """Return (cells,) the centers of the cells, in pixels from the frame's first border."""
        return (np.arange(self.cells(axis)) + 0.5) / self.cells_per_pixel - self.before(axis)

    def farthest(self, axis: int) -> float:
        """Return the distance in pixels from the frame's center to the grid's farther border."""
        return max(self.before(axis), self.padded(axis) - self.before(axis) - self.shape[axis]) + self.shape[axis] / 2

    def borders(self, axis: int) -> F64:
        """Return (cells + 1,) the borders between cells, in pixels from the frame's first border."""
        return np.arange(self.cells(axis) + 1) / self.cells_per_pixel - self.before(axis)


@dataclass(frozen=True, eq=False)
class Field:
    """Field weights of R modes: linear between nodes, constant beyond them."""

    # (P,), (Q,) increasing node positions, in pixels from the frame's first border
    row: F64
    col: F64
    weights: F64  # (R, P, Q)


@dataclass(frozen=True, eq=False)
class View:
    """Weight maps as the lens places them on the frame."""

    weights: F32  # (K, rows, cols) maps
    # (row, col) map coordinate of the frame's corner, and map samples per pixel
    start: tuple[float, float]
    step: tuple[float, float]
    warp: Warp | None = None  # distortion; None: cells see the place that `start` and `step` give
    occluders: tuple[View, ...] = ()  # views of one map each, opacities from 0 to 1, that hide parts of the maps


@dataclass(frozen=True, eq=False)
class Layer:
    """Maps, and the transfers of lens and sensor that act on them."""

    views: tuple[View, ...]  # the maps: one view, or one per wavelength node
    # (terms, R, S): a term is the sum over r of `mixing[term, r] @ maps`, each times `field.weights[r]`. Modes whose
    # mixing is all 0 cost nothing.
    mixing: F32
    transfer: Transfer  # from each term to each channel, or to one
    # (S_n, K) for each view: its node maps are these times its weights; the S of all views follow one another. They are
    # resampled once and stored. None: terms combine the weights of the only view, and S is K.
    node_maps: tuple[F32, ...] | None = None
    field: Field | None = None  # field weights of the R modes; None: R is 1, and the weight is 1 everywhere
    channel: int | None = None  # the only channel that the layer reaches; None: all


def term_spectra(layer: Layer, grid: Grid, out: C64) -> Iterator[C64]:
    """Yield each term of a layer on the cells, transformed along its rows; all share the memory of `out`."""
    view = layer.views[0]
    if layer.node_maps is None and layer.field is None and view.warp is None and not view.occluders:
        plain = _PlainMaps(view, grid)
        for mix in layer.mixing[:, 0]:
            plain.spectrum(mix, out)
            yield out
    elif layer.node_maps is None and view.warp is not None:
        for part in _split_terms(layer):
            yield from _term_spectra(part, grid, out)
    else:
        yield from _term_spectra(layer, grid, out)


def _split_terms(layer: Layer) -> Iterator[Layer]:
    """Yield the layer with a few terms at a time, whose maps are warped together and stored."""
    used = np.asarray(layer.mixing.any(axis=2))
    maps, first = used.sum(axis=1), 0
    while first < len(maps):
        count = max(1, int(np.searchsorted(np.cumsum(maps[first:]), _MAPS_PER_WARP, side="right")))
        part = slice(first, first + count)
        first += count
        if maps[part].sum() > _MAPS_PER_WARP:
            yield replace(layer, mixing=layer.mixing[part])
            continue
        mixing = np.zeros((*used[part].shape, int(maps[part].sum())), np.float32)
        mixing[(*np.nonzero(used[part]), np.arange(mixing.shape[2]))] = 1.0
        yield replace(layer, mixing=mixing, node_maps=(layer.mixing[part][used[part]],))


def _term_spectra(layer: Layer, grid: Grid, out: C64) -> Iterator[C64]:
    """As `term_spectra`, for any layer."""
    field = _FieldWeights(layer.field, grid)
    terms: Iterator[_Rows]
    if layer.node_maps is None:
        terms = _terms_of_view(_maps_of_view(layer.views[0], grid), layer, field)
    else:
        terms = _terms_of_stored(_stored_maps(layer.views, layer.node_maps, grid), layer, field)
    for term in terms:
        for begin, end in _strips(len(out)):
            out[begin:end] = scipy.fft.rfft(term(begin, end), axis=1, workers=WORKERS)
        yield out


def _terms_of_view(maps: _Maps, layer: Layer, field: _FieldWeights) -> Iterator[_Rows]:
    """Yield a function for each term, whose maps are combined and resampled row by row."""
    for mix in layer.mixing:
        used = mix.any(axis=1)

        def rows(begin: int, end: int, mixes: F32 = mix[used], across: F32 = field.across[used]) -> F32:
            combined = maps.rows(mixes, begin, end)
            if layer.field is None:
                one: F32 = combined[0]
                return one
            return field.sum(combined, 0, across, begin, end)

        yield rows


def _terms_of_stored(maps: F32, layer: Layer, field: _FieldWeights) -> Iterator[_Rows]:
    """Yield a function for each term, as the sum of (S, rows, cols) maps times their share of the field weights."""
    for mix in layer.mixing:
        only = int(mix.argmax()) if layer.field is None and np.count_nonzero(mix) == 1 and mix.max() == 1.0 else None
        mixed = np.tensordot(mix, field.across, axes=(0, 0))

        def rows(begin: int, end: int, only: int | None = only, across: F32 = mixed) -> F32:
            return field.sum(maps, begin, across, begin, end) if only is None else maps[only, begin:end]

        yield rows


def _strips(rows: int) -> Iterator[tuple[int, int]]:
    """Yield the first row of each strip, and the one after its last."""
    return ((begin, min(begin + _STRIP, rows)) for begin in range(0, rows, _STRIP))


_Rows = Callable[[int, int], F32]
"""(begin, end) -> (end - begin, cols): rows of cells of a term."""


class _Maps(Protocol):
    """Maps on the grid's cells."""

    def rows(self, mixes: F32, begin: int, end: int) -> F32:
        """Return (R, end - begin, cols): rows of cells of the combinations (R, S) of maps."""
        ...


def _maps_of_view(view: View, grid: Grid) -> _Maps:
    """Return the maps of a view, attenuated by its occluders."""
    maps = _PlainMaps(view, grid) if view.warp is None else _WarpedMaps(view.warp, view, grid)
    return maps if not view.occluders else _OccludedMaps(maps, _transmission(view.occluders, grid))


class _PlainMaps:
    """Maps of a view without distortion."""

    def __init__(self, view: View, grid: Grid) -> None:
        self._weights = view.weights
        self._down, self._across = (
            grid.overlap(axis, view.start[axis], view.step[axis], view.weights.shape[axis + 1]) for axis in (0, 1)
        )

    def rows(self, mixes: F32, begin: int, end: int) -> F32:
        return np.stack([self._rows(mix, begin, end) for mix in mixes])

    def _rows(self, mix: F32, begin: int, end: int) -> F32:
        """Return (end - begin, cols) of the map `mix @ weights`; the axis with fewer samples is resampled last."""
        first, last = self._down.span(begin, end)
        strip = np.tensordot(mix, self._weights[:, first:last], axes=1)
        if last - first <= end - begin:
            wide = mean_along_rows(strip, self._across)
            rows = np.empty((end - begin, wide.shape[1]), np.float32)
            mean_of_rows(wide, self._down, begin, first, rows)
            return rows
        short = np.empty((end - begin, self._weights.shape[2]), np.float32)
        mean_of_rows(strip, self._down, begin, first, short)
        return mean_along_rows(short, self._across)

    def spectrum(self, mix: F32, out: C64) -> None:
        """Compute the map `mix @ weights`, transformed along its rows, into (rows, cols // 2 + 1).

        Resampling is linear on each axis, so the order is free: a map of few rows is transformed before its spectrum
        is resampled to all rows.
        """
        parts = out.view(np.float32)
        for begin, end in _strips(len(out)):
            first, last = self._down.span(begin, end)
            if last - first <= end - begin:
                strip = np.tensordot(mix, self._weights[:, first:last], axes=1)
                wide = mean_along_rows(strip, self._across)
                narrow = scipy.fft.rfft(wide, axis=1, workers=WORKERS).view(np.float32)
                mean_of_rows(narrow, self._down, begin, first, parts[begin:end])
            else:
                out[begin:end] = scipy.fft.rfft(self._rows(mix, begin, end), axis=1, workers=WORKERS)


class _WarpedMaps:
    """Maps of a view with distortion."""

    def __init__(self, warp: Warp, view: View, grid: Grid) -> None:
        pitch, start, step = warp.pitch_m, view.start, view.step
        y_m, x_m = ((grid.borders(axis) - grid.shape[axis] / 2) * pitch[axis] for axis in (0, 1))
        self._weights = view.weights
        self._corners = Corners(
            warp,
            y_m,
            x_m,
            axis=(start[0] + step[0] * grid.shape[0] / 2, start[1] + step[1] * grid.shape[1] / 2),
            per_m=(step[0] / pitch[0], step[1] / pitch[1]),
            shape=(view.weights.shape[1], view.weights.shape[2]),
        )

    def rows(self, mixes: F32, begin: int, end: int) -> F32:
        first, last = self._corners.span(begin, end)
        return warped_means(self._weights[:, first:last], mixes, first, self._corners, begin, end)


@dataclass(frozen=True, eq=False)
class _OccludedMaps:
    """Maps times the transmission of what is in front of them, (rows, cols)."""

    maps: _Maps
    transmission: F32

    def rows(self, mixes: F32, begin: int, end: int) -> F32:
        return self.maps.rows(mixes, begin, end) * self.transmission[begin:end]


def _stored_maps(views: Sequence[View], node_maps: Sequence[F32], grid: Grid) -> F32:
    """Return (S, rows, cols): the node maps of all views on the grid's cells."""
    shape = grid.cells(0), grid.cells(1)
    stored, first = np.empty((sum(map(len, node_maps)), *shape), np.float32), 0
    for view, mixes in zip(views, node_maps, strict=True):
        if not len(mixes):
            continue
        maps = _maps_of_view(view, grid)
        for begin, end in _strips(shape[0]):
            stored[first : first + len(mixes), begin:end] = maps.rows(mixes, begin, end)
        first += len(mixes)
    return stored


def _transmission(occluders: Sequence[View], grid: Grid) -> F32:
    """Return (rows, cols) the light that passes all occluders; their parts of a cell are taken as independent."""
    passing = np.ones((grid.cells(0), grid.cells(1)), np.float32)
    whole = np.ones((1, 1), np.float32)
    for occluder in occluders:
        opacity = _maps_of_view(replace(occluder, occluders=()), grid)
        for begin, end in _strips(len(passing)):
            passing[begin:end] *= np.float32(1) - opacity.rows(whole, begin, end)[0]
    return passing


class _FieldWeights:
    """Field weights on the grid's cells; 1 without a field."""

    def __init__(self, field: Field | None, grid: Grid) -> None:
        rows, centers = grid.cells(0), grid.centers(1)
        self.across = np.ones((1, 1, centers.size), np.float32)  # (R, P, cols), at the rows of nodes
        # For each row of cells the row of nodes above it, and the share of the one below.
        self._index, self._share = np.zeros(rows, np.int64), np.zeros(rows, np.float32)
        if field is None:
            return
        along = [np.interp(centers, field.col, line) for line in field.weights.reshape(-1, field.col.size)]
        self.across = np.stack(along).astype(np.float32).reshape(*field.weights.shape[:2], centers.size)
        position = np.interp(grid.centers(0), field.row, np.arange(field.row.size))
        self._index = np.minimum(position.astype(np.int64), max(field.row.size - 2, 0))
        self._share = (position - self._index).astype(np.float32)

    def sum(self, maps: F32, first: int, across: F32, begin: int, end: int) -> F32:
        """Return (end - begin, cols): rows begin to end of the sum of maps times weights.

        - `maps`: (n, rows, cols), of which row `first` is row `begin` of the grid.
        - `across`: (n, P, cols) combinations of `self.across`.
        """
        out = np.empty((end - begin, maps.shape[2]), np.float32)
        used = np.flatnonzero(across.any(axis=(1, 2)))
        _weigh_rows(maps, used, first, across, self._index[begin:end], self._share[begin:end], out)
        return out


@compiled(parallel=True)
def _weigh_rows(maps: F32, used: I64, first: int, across: F32, index: I64, share: F32, out: F32) -> None:
    """Compute the sum of the used maps, from row `first` on, times weights between rows index and index + 1."""
    rows, cols = out.shape
    last = across.shape[1] - 1
    for i in prange(rows):
        low, part = index[i], share[i]
        line = np.zeros(cols, np.float32)
        for r in used:
            values, above, below = maps[r, first + i], across[r, low], across[r, min(low + 1, last)]
            for c in range(cols):
                line[c] += values[c] * (above[c] + part * (below[c] - above[c]))
        out[i] = line
