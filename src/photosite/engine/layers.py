"""Layers: weight maps resampled on the frame's cells, and their spectra along the rows.

A layer's *term* is a combination of weight maps on the padded grid of cells. If a lens varies over the field, a term is
the sum of several combinations, each times a field weight. If the lens distorts, each cell takes the mean of a map over
the place it sees through a warp. Occluders attenuate a map before the lens blurs it.

With lateral color, each wavelength node has its own view. All terms are combinations of a few *node maps* per
node. These are resampled a strip of rows at a time, and all terms computed from the strip while it is in the cache.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.engine.fourier import next_fast_len, rfft
from photosite.engine.jit import C64, F32, F64, I64, compiled, read_only
from photosite.engine.resample import Corners, Overlap, Warp, mean_along_rows, mean_of_rows, overlap, warped_means
from photosite.engine.threads import parallel_for, threads_for
from photosite.engine.transfer import Transfer

_STRIP, _STRIP_LINES = 256, 2048
"""Rows of cells that are resampled at a time, and rows of all maps and terms together: few enough for the cache, and
many, because threads of numba and SciPy hinder each other when they take turns."""
_COMPARED = 8
"""Columns in which neighboring rows of a map are compared before all of their columns are."""
_CHUNK, _BLOCK = 16, 512
"""Rows and columns of cells that a thread weighs at a time."""
_MAPS_PER_PASS, _TERMS_PER_PASS = 4, 12
"""Maps of one distorted view, and terms of several views, that are computed in one pass: finding the places that cells
see takes long, but the spectra of all terms of a pass are stored."""


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
        return next_fast_len(tiles) * tile

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
    # (S_n, K) for each view: its node maps are these times its weights; the S of all views follow one another. None:
    # terms combine the weights of the only view, and S is K.
    node_maps: tuple[F32, ...] | None = None
    field: Field | None = None  # field weights of the R modes; None: R is 1, and the weight is 1 everywhere
    channel: int | None = None  # the only channel that the layer reaches; None: all


def term_spectra(layer: Layer, grid: Grid, out: C64) -> Iterator[C64]:
    """Yield each term of a layer on the cells, transformed along its rows.

    `out` is memory for `spectra_at_once(layer)` of them, (n, rows, cols // 2 + 1), which those to come overwrite.
    """
    if _is_plain(layer):
        plain = _PlainMaps(layer.views[0], grid)
        for mix in layer.mixing[:, 0]:
            plain.spectrum(mix, out[0])
            yield out[0]
        return
    maps, field = [_maps_of_view(view, grid) for view in layer.views], _FieldWeights(layer.field, grid)
    for node_maps, mixing in _passes(layer):
        spectra = out[: len(mixing)]
        _find_spectra(maps, node_maps, field, mixing, spectra)
        yield from spectra


def spectra_at_once(layer: Layer) -> int:
    """Return the number of terms whose spectra are computed together."""
    return 1 if _is_plain(layer) else max((len(mixing) for _, mixing in _passes(layer)), default=1)


def _is_plain(layer: Layer) -> bool:
    """Return whether each term is a combination of the weights of one view without distortion and occluders."""
    view = layer.views[0]
    return layer.node_maps is None and layer.field is None and view.warp is None and not view.occluders


def _passes(layer: Layer) -> Iterator[tuple[list[F32], F32]]:
    """Yield a few terms at a time: the node maps of each view that they use, and their mixing."""
    used = np.asarray(layer.mixing.any(axis=2))
    if layer.node_maps is not None:
        views = np.repeat(np.arange(len(layer.views)), [len(mixes) for mixes in layer.node_maps])
        combinations, of_term = np.concatenate(layer.node_maps), np.asarray(layer.mixing.any(axis=1))
        # Terms that share no map gain nothing from being computed together.
        size = _TERMS_PER_PASS if (of_term.sum(axis=0) > 1).any() else 1
        for first in range(0, len(of_term), size):
            part = slice(first, first + size)
            shown = of_term[part].any(axis=0)
            node_maps = [combinations[shown & (views == view)] for view in range(len(layer.views))]
            yield node_maps, layer.mixing[part][:, :, shown]
        return
    # Each combination that a term uses becomes a map. Without distortion, maps share nothing.
    most = 1 if layer.views[0].warp is None else _MAPS_PER_PASS
    maps, first = used.sum(axis=1), 0
    while first < len(maps):
        count = max(1, int(np.searchsorted(np.cumsum(maps[first:]), most, side="right")))
        part = slice(first, first + count)
        first += count
        mixing = np.zeros((*used[part].shape, int(maps[part].sum())), np.float32)
        mixing[(*np.nonzero(used[part]), np.arange(mixing.shape[2]))] = 1.0
        yield [layer.mixing[part][used[part]]], mixing


def _find_spectra(
    maps: Sequence[_Maps], node_maps: Sequence[F32], field: _FieldWeights, mixing: F32, spectra: C64
) -> None:
    """Compute the terms of a pass, transformed along their rows, (terms, rows, cols // 2 + 1)."""
    (terms, rows), cols, count = spectra.shape[:2], field.across.shape[2], sum(map(len, node_maps))
    weights = np.tensordot(mixing, field.across, axes=(1, 0))
    used = np.asarray(weights.any(axis=(2, 3)))
    strip = max(_CHUNK, _STRIP_LINES // (count + terms))
    lines = np.empty((count * strip, cols), np.float32)
    out = np.empty((terms, strip, cols), np.float32)
    for begin, end in _strips(rows, strip):
        size, first = end - begin, 0
        numbers = np.empty((count, size), np.int64)
        for of_view, mixes in zip(maps, node_maps, strict=True):
            if len(mixes):
                own = slice(first, first + len(mixes))
                numbers[own] = first * size + of_view.rows(mixes, begin, end, lines[first * size :])
                first += len(mixes)
        if weights.size == cols and (weights == 1).all():  # the term is a map; equal rows are transformed once
            distinct = lines[: numbers[0, -1] + 1]
            spectra[0, begin:end] = rfft(distinct, axis=1)[numbers[0]]
            continue
        above, fraction = field.above[begin:end], field.fraction[begin:end]
        ends, left, place = _ends_of_runs(np.vstack([numbers, above]), fraction)
        with threads_for(terms * ends.size * cols):
            parts = -(-ends.size // _CHUNK) * -(-out.shape[2] // _BLOCK)
            parallel_for(_sum_rows, parts, lines, numbers[:, ends], weights, used, above[ends], fraction[ends], out)
        known = rfft(out[:, : ends.size], axis=2)
        parallel_for(_interpolate_rows, left.size, known.view(np.float32), left, place, begin, spectra.view(np.float32))


def _ends_of_runs(sources: I64, fraction: F32) -> tuple[I64, I64, F32]:
    """Find runs of rows that are sums of the same lines, with weights that are linear in `fraction`.

    - `sources`: (n, rows) what the rows of a run have in common.
    - `fraction`: (rows,) increases or is constant within a run.

    Returns the first and the last row of each run; for each row the place of its run's first among these, and how far
    it is from there to the last, 0 to 1.
    """
    changes = np.flatnonzero((sources[:, 1:] != sources[:, :-1]).any(axis=0)) + 1
    first, last = np.append(0, changes), np.append(changes, fraction.size) - 1
    ends = np.unique(np.concatenate([first, last]))
    of_row = np.repeat(np.arange(first.size), last - first + 1)
    length = fraction[last] - fraction[first]
    length[length == 0] = 1.0
    place = (fraction - fraction[first][of_row]) / length[of_row]
    return ends, np.searchsorted(ends, first)[of_row], place


def _strips(rows: int, size: int = _STRIP) -> Iterator[tuple[int, int]]:
    """Yield the first row of each strip, and the one after its last."""
    return ((begin, min(begin + size, rows)) for begin in range(0, rows, size))


class _Maps(Protocol):
    """Maps on the grid's cells."""

    def rows(self, mixes: F32, begin: int, end: int, lines: F32) -> I64:
        """Compute rows of cells of the combinations (R, S) of maps; equal rows may be computed once.

        Fill the first of `lines`, (at least R (end - begin), cols), and return the number (R, end - begin) of each
        row's line, in increasing order.
        """
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
        self._alike = _equal_rows(view.weights)

    def rows(self, mixes: F32, begin: int, end: int, lines: F32) -> I64:
        # A row that sees equal rows of samples, and the same as the row above, is equal to it.
        first = self._down.first[begin : end + 1]
        top, bottom = (self._alike[self._down.sample[entry]] for entry in (first[:-1], first[1:] - 1))
        single = top == bottom
        distinct = np.append(True, ~(single[1:] & single[:-1] & (np.diff(top) == 0)))
        outputs = begin + np.flatnonzero(distinct)
        for r, mix in enumerate(mixes):
            self._rows(mix, outputs, lines[r * outputs.size : (r + 1) * outputs.size])
        return np.cumsum(distinct) - 1 + outputs.size * np.arange(len(mixes))[:, None]

    def _rows(self, mix: F32, outputs: I64, out: F32) -> None:
        """Compute rows of the map `mix @ weights`; the axis with fewer samples is resampled last."""
        first, last = self._down.span(int(outputs[0]), int(outputs[-1]) + 1)
        strip = _mixed(mix, self._weights[:, first:last])
        if last - first <= len(outputs):
            wide = np.empty((len(strip), out.shape[1]), np.float32)
            mean_along_rows(strip, self._across, wide)
            mean_of_rows(wide, self._down, outputs, first, out)
        else:
            short = np.empty((len(outputs), strip.shape[1]), np.float32)
            mean_of_rows(strip, self._down, outputs, first, short)
            mean_along_rows(short, self._across, out)

    def spectrum(self, mix: F32, out: C64) -> None:
        """Compute the map `mix @ weights`, transformed along its rows, into (rows, cols // 2 + 1).

        Resampling is linear on each axis, so the order is free: a map of few rows is transformed before its spectrum
        is resampled to all rows.
        """
        parts = out.view(np.float32)
        for begin, end in _strips(len(out)):
            first, last = self._down.span(begin, end)
            outputs = np.arange(begin, end)
            wide = np.empty((min(last - first, end - begin), self._across.first.size - 1), np.float32)
            if last - first <= end - begin:
                strip = _mixed(mix, self._weights[:, first:last])
                mean_along_rows(strip, self._across, wide)
                narrow = rfft(wide, axis=1).view(np.float32)
                mean_of_rows(narrow, self._down, outputs, first, parts[begin:end])
            else:
                self._rows(mix, outputs, wide)
                out[begin:end] = rfft(wide, axis=1)


def _equal_rows(weights: F32) -> I64:
    """Return (rows,) numbers of the rows of (K, rows, cols) maps; neighboring rows that are equal have the same."""
    sample = weights[:, :, :: max(weights.shape[2] // _COMPARED, 1)]
    equal = (sample[:, 1:] == sample[:, :-1]).all(axis=(0, 2))
    for r in np.flatnonzero(equal):
        equal[r] = np.array_equal(weights[:, r], weights[:, r + 1])
    return np.cumsum(np.append(True, ~equal))


def _mixed(mix: F32, values: F32) -> F32:
    """Return (rows, cols): the combination (K,) of (K, rows, cols) maps."""
    out = np.empty(values.shape[1:], np.float32)
    with threads_for(out.size):
        parallel_for(_mix, len(out), read_only(mix), values, out)
    return out


@compiled()
def _mix(start: int, stop: int, mix: F32, values: F32, out: F32) -> None:
    for r in range(start, stop):
        line = out[r]
        line[:] = 0.0
        for k in range(mix.size):
            weight, given = mix[k], values[k, r]
            for c in range(line.size):
                line[c] += weight * given[c]


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

    def rows(self, mixes: F32, begin: int, end: int, lines: F32) -> I64:
        first, last = self._corners.span(begin, end)
        shape = len(mixes), end - begin, lines.shape[1]
        out = lines[: shape[0] * shape[1]].reshape(shape)
        warped_means(self._weights[:, first:last], mixes, first, self._corners, begin, out)
        return np.arange(shape[0] * shape[1]).reshape(shape[:2])


@dataclass(frozen=True, eq=False)
class _OccludedMaps:
    """Maps times the transmission of what is in front of them, (rows, cols)."""

    maps: _Maps
    transmission: F32

    def rows(self, mixes: F32, begin: int, end: int, lines: F32) -> I64:
        seen = lines[self.maps.rows(mixes, begin, end, lines)]
        lines[: len(mixes) * (end - begin)] = (seen * self.transmission[begin:end]).reshape(-1, lines.shape[1])
        return np.arange(len(mixes) * (end - begin)).reshape(len(mixes), -1)


def _transmission(occluders: Sequence[View], grid: Grid) -> F32:
    """Return (rows, cols) the light that passes all occluders; their parts of a cell are taken as independent."""
    passing = np.ones((grid.cells(0), grid.cells(1)), np.float32)
    whole, lines = np.ones((1, 1), np.float32), np.empty((_STRIP, grid.cells(1)), np.float32)
    for occluder in occluders:
        opacity = _maps_of_view(replace(occluder, occluders=()), grid)
        for begin, end in _strips(len(passing)):
            passing[begin:end] *= np.float32(1) - lines[opacity.rows(whole, begin, end, lines)[0]]
    return passing


class _FieldWeights:
    """Field weights on the grid's cells; 1 without a field."""

    def __init__(self, field: Field | None, grid: Grid) -> None:
        rows, centers = grid.cells(0), grid.centers(1)
        self.across = np.ones((1, 1, centers.size), np.float32)  # (R, P, cols), at the rows of nodes
        # For each row of cells the row of nodes above it, and the fraction of the one below.
        self.above, self.fraction = np.zeros(rows, np.int64), np.zeros(rows, np.float32)
        if field is None:
            return
        along = [np.interp(centers, field.col, line) for line in field.weights.reshape(-1, field.col.size)]
        self.across = np.stack(along).astype(np.float32).reshape(*field.weights.shape[:2], centers.size)
        position = np.interp(grid.centers(0), field.row, np.arange(field.row.size))
        self.above = np.minimum(position.astype(np.int64), max(field.row.size - 2, 0))
        self.fraction = (position - self.above).astype(np.float32)


@compiled()
def _sum_rows(
    start: int,
    stop: int,
    lines: F32,
    numbers: I64,
    weights: F32,
    used: NDArray[np.bool_],
    above: I64,
    fraction: F32,
    out: F32,
) -> None:
    """Compute the first rows of `out`, (terms, at least rows, cols), as sums of maps times weights.

    - `lines`, `numbers`: Row i of map s is `lines[numbers[s, i]]`.
    - `weights`: (terms, S, P, cols) at the rows of nodes; `used`: (terms, S) whether any is not 0.
    - `above`, `fraction`: (rows,) the row of nodes above each row, and the fraction of the one below.
    """
    rows, cols = numbers.shape[1], out.shape[2]
    blocks = (cols + _BLOCK - 1) // _BLOCK
    for part in range(start, stop):  # what a part needs stays in the cache
        begin, left = part // blocks * _CHUNK, part % blocks * _BLOCK
        block = slice(left, min(left + _BLOCK, cols))
        for i in range(begin, min(begin + _CHUNK, rows)):
            for term in range(out.shape[0]):
                _add_weighed(
                    lines, numbers[:, i], weights[term], used[term], above[i], fraction[i], block, out[term, i]
                )


@compiled()
def _add_weighed(
    lines: F32, numbers: I64, weights: F32, used: NDArray[np.bool_], above: int, fraction: float, block: slice, out: F32
) -> None:
    total, below = out[block], min(above + 1, weights.shape[1] - 1)
    total[:] = 0.0
    for s in range(numbers.size):
        if used[s]:
            values, high, low = lines[numbers[s], block], weights[s, above, block], weights[s, below, block]
            for c in range(total.size):
                total[c] += values[c] * (high[c] + fraction * (low[c] - high[c]))


@compiled()
def _interpolate_rows(start: int, stop: int, known: F32, left: I64, place: F32, begin: int, out: F32) -> None:
    """Compute rows of `out`, (terms, rows, n), from `begin` on, from few `known` ones, (terms, fewer rows, n).

    Row i is at `place[i]`, 0 to 1, between the known rows `left[i]` and the next.
    """
    for i in range(start, stop):
        for term in range(out.shape[0]):
            line, low, high = out[term, begin + i], known[term, left[i]], known[term, left[i]]
            if place[i] > 0:
                high = known[term, left[i] + 1]
            for c in range(line.size):
                line[c] = low[c] + place[i] * (high[c] - low[c])
