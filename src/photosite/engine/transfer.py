"""Transfer functions of lens, photodetector and pixel grid (docs/theory/model.md).

Maps are constant over rectangular cells, one or more per pixel. A pixel reads the map, spread by the lens and the cell,
averaged over its photodetector, at its center. That is the discrete convolution with the kernel
`(spread * aperture * cell)(pixel center - cell center)`, whose transform is the continuous one folded at the sampling
frequency,

    H(f) = sum_m transfer(|f + m fs|) aperture(f + m fs) cell(f + m fs).

The lens passes nothing beyond its cutoff, so the sum is short. Without the folded terms the kernel would ring, and dark
samples beside bright ones would become negative. At f = 0 only m = 0 remains: a uniform field keeps its value.

H is never stored as a whole. For a rotationally symmetric lens, m = 0 is a table in |f| times two sinc functions; the
other terms are smooth, and cubic splines of 65 x 65 nodes represent them (`FoldedTerms`). For any other lens
the kernel is stored on the few cells that it covers, and H is interpolated from its transform (`mosaic.Gridding`).
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from photosite.engine.jit import F32, F64, I64, read_only
from photosite.errors import InputError

_FOLD_NODES = 65
"""Nodes per axis at which the folded terms are computed; cubic interpolation between them."""
_MOST_FOLDS = 40_000
"""Limit of the folded terms, whose sum then takes half a minute."""
_FEW_FOLDS = 20


@dataclass(frozen=True, eq=False)
class Sampling:
    """The grid of cells and the photodetector on it. Lengths in m; pairs are (vertical, horizontal)."""

    pitch_m: tuple[float, float]
    detector_m: tuple[float, float]  # size of the photodetector, centered in the pixel
    cells_per_pixel: int = 1  # cells per pixel on each axis; odd, so that a cell lies at the pixel's center
    # Distances by which a birefringent low-pass filter splits a point on each axis into two of half the light, four
    # spots in all; 0 is no filter
    split_m: tuple[float, float] = (0.0, 0.0)

    def cell_m(self, axis: int) -> float:
        """Return the size of a cell on an axis, 0 vertical, 1 horizontal."""
        return self.pitch_m[axis] / self.cells_per_pixel

    def aperture(self, axis: int, frequency_per_m: F64) -> F64:
        """Return the transfer of photodetector, cell and low-pass filter on an axis: two sincs and a cosine."""
        product: F64 = np.sinc(frequency_per_m * self.detector_m[axis]) * np.sinc(frequency_per_m * self.cell_m(axis))
        if self.split_m[axis]:
            product *= np.cos(np.pi * frequency_per_m * self.split_m[axis])
        return product


@dataclass(frozen=True, eq=False)
class RadialTransfer:
    """Transfer of a rotationally symmetric lens, summed over wavelength, from each map to each channel."""

    # (channels, maps, nodes) at frequencies 0, step, 2 step, ...; linear between, 0 beyond. It is 0 for a channel that
    # a map does not reach.
    table: F64
    step_per_m: float  # step between nodes, cycles/m

    @property
    def reach_per_m(self) -> float:
        """Frequency beyond which the transfer is 0."""
        return float(self.step_per_m * (self.table.shape[2] - 1))


@dataclass(frozen=True, eq=False)
class Transfer:
    """Transfer from each term to each channel: a radial part, a part of any shape, or the sum of both."""

    radial: RadialTransfer | None  # part that is a function of |f|, without photodetector and cell
    # (channels, terms, Q, Q), Q odd: convolution kernels on the cells, photodetector and cell included, centered at [Q
    # // 2, Q // 2]
    kernels: F64 | None = None

    @property
    def channels(self) -> int:
        """Number of channels."""
        if self.kernels is not None:
            return len(self.kernels)
        return 0 if self.radial is None else len(self.radial.table)


@dataclass(frozen=True, eq=False)
class FoldedTerms:
    """The terms of H with m other than 0 on a grid of frequencies: splines with B coefficients on each axis."""

    coefficients: F32  # (channels, maps, B, B) of cubic B-splines along fy and fx
    down: SplineRows  # at each fy
    across: SplineRows  # at each fx


class SplineRows(NamedTuple):
    """Cubic B-splines at some positions: each is a sum of four coefficients."""

    first: I64  # (n,) number of the first of the four coefficients
    weights: F32  # (4, n)

    def matrix(self, count: int) -> F32:
        """Return (n, count): the positions' sums of `count` coefficients as a matrix."""
        rows = np.zeros((self.first.size, count), np.float32)
        np.put_along_axis(rows, self.first[:, None] + np.arange(4), self.weights.T, axis=1)
        return rows


def _more_cells(cells: int, folds: int) -> int:
    """Return an odd number of cells with few folds."""
    return 2 * (cells * folds // _FEW_FOLDS // 2) + 1


def sum_folded_terms(transfer: RadialTransfer, sampling: Sampling, fy_per_m: F64, fx_per_m: F64) -> F64:
    """Return (channels, maps, fy, fx): the terms with m other than 0, below the Nyquist frequency.

    They are sparse matrices, of apertures times the fractions of linear interpolation, times the table of all maps.
    """
    from scipy.sparse import csr_array

    rate = [1.0 / sampling.cell_m(axis) for axis in (0, 1)]
    most = [int(np.ceil(transfer.reach_per_m / r + 0.5)) for r in rate]
    if (2 * most[0] + 1) * (2 * most[1] + 1) > _MOST_FOLDS:
        raise InputError(
            "cells_per_pixel",
            value=sampling.cells_per_pixel,
            expected="such that 1 / cell is below the lens's cutoff frequency by a factor of at most "
            f"{math.isqrt(_MOST_FOLDS) // 2}, not {max(most)}",
            hint="Use more cells per pixel, {cells_per_pixel}, or a larger f-number",
            arguments={"cells_per_pixel": _more_cells(sampling.cells_per_pixel, max(most))},
        )
    nodes, points = transfer.table.shape[2], np.arange(fy_per_m.size * fx_per_m.size)
    by_node = np.ascontiguousarray(transfer.table.reshape(-1, nodes).T)
    total = np.zeros((points.size, by_node.shape[1]))
    for m in range(-most[0], most[0] + 1):
        fy = fy_per_m + m * rate[0]
        entries: list[tuple[F64, I64, I64]] = []  # value, point, node
        for n in range(-most[1], most[1] + 1):
            fx = fx_per_m + n * rate[1]
            near = np.hypot(np.abs(fy).min(), np.abs(fx).min())
            if (m, n) == (0, 0) or near > transfer.reach_per_m:
                continue
            aperture = (sampling.aperture(0, fy)[:, None] * sampling.aperture(1, fx)[None, :]).ravel()
            position = np.hypot(fy[:, None], fx[None, :]).ravel() / transfer.step_per_m
            inside = position <= nodes - 1
            position, value, point = position[inside], aperture[inside], points[inside]
            node = np.minimum(position.astype(np.intp), nodes - 2)
            fraction = position - node
            entries += [(value * (1 - fraction), point, node), (value * fraction, point, node + 1)]
        if entries:
            value, point, node = (np.concatenate(part) for part in zip(*entries, strict=True))
            total += csr_array((value, (point, node)), shape=(points.size, nodes)) @ by_node
    return np.ascontiguousarray(total.T).reshape(*transfer.table.shape[:2], fy_per_m.size, fx_per_m.size)


def folded_terms(transfer: RadialTransfer, sampling: Sampling, fy_per_m: F64, fx_per_m: F64) -> FoldedTerms:
    """Return the folded terms on a grid of frequencies from 0 to 0.5 / cell, by cubic splines between few nodes."""
    down, across = map(_spline_rows, _fold_nodes(sampling), (fy_per_m, fx_per_m))
    return FoldedTerms(fold_coefficients(transfer, sampling), down, across)


def fold_coefficients(transfer: RadialTransfer, sampling: Sampling) -> F32:
    """Return (channels, maps, B, B) coefficients of the splines through the folded terms at the nodes."""
    kept = _kept.get(transfer)
    if kept is None or kept[0] != astuple(sampling):
        return keep_fold_coefficients(transfer, sampling, _fold_coefficients(transfer, sampling))
    return kept[1]


def keep_fold_coefficients(transfer: RadialTransfer, sampling: Sampling, coefficients: F32) -> F32:
    """Keep the result of `fold_coefficients` for its next call."""
    coefficients = read_only(coefficients)
    _kept[transfer] = astuple(sampling), coefficients
    return coefficients


_kept: WeakKeyDictionary[RadialTransfer, tuple[tuple[Any, ...], F32]] = WeakKeyDictionary()
"""A sampling and its spline coefficients, the latest of a transfer, for as long as it lives."""


def _fold_nodes(sampling: Sampling) -> list[F64]:
    return [np.linspace(0, 0.5 / sampling.cell_m(axis), _FOLD_NODES) for axis in (0, 1)]


def _fold_coefficients(transfer: RadialTransfer, sampling: Sampling) -> F32:
    if not transfer.table.any():
        return np.zeros((*transfer.table.shape[:2], _FOLD_NODES, _FOLD_NODES), np.float32)
    from scipy.interpolate import make_interp_spline

    nodes = _fold_nodes(sampling)
    values = sum_folded_terms(transfer, sampling, *nodes)
    for axis in (0, 1):
        moved = make_interp_spline(nodes[axis], np.moveaxis(values, axis + 2, 0), k=3).c
        values = np.moveaxis(moved, 0, axis + 2)
    return values.astype(np.float32)


def _spline_rows(nodes: F64, positions: F64) -> SplineRows:
    """Return the splines through values at nodes (`make_interp_spline`) at positions between the nodes.

    This is de Boor's recursion, as in scipy.interpolate, which takes 0.2 s to import.
    """
    knots = np.concatenate([nodes[:1].repeat(4), nodes[2:-2], nodes[-1:].repeat(4)])
    x = np.minimum(positions, nodes[-1])
    interval = np.clip(np.searchsorted(knots, x, side="right") - 1, 3, nodes.size - 1)
    weights = [np.ones(x.size)]
    for degree in (1, 2, 3):
        next_weights = [np.zeros(x.size) for _ in range(degree + 1)]
        for n, weight in enumerate(weights, 1):
            high, low = knots[interval + n], knots[interval + n - degree]
            part = weight / (high - low)
            next_weights[n - 1] += part * (high - x)
            next_weights[n] = part * (x - low)
        weights = next_weights
    return SplineRows(read_only(interval - 3), read_only(np.array(weights, np.float32)))
