"""Moments of a map over its pixels, per label of a repeating tile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange

_Ints = NDArray[Any]
_LANES = 64


@compiled(parallel=True)
def _power_sums(
    values: NDArray[np.float64], labels: _Ints, centre: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """By row and label, the sums of the first to fourth power of the deviation from `centre[label]`."""
    rows = values.shape[0]
    tile_rows, tile_cols = labels.shape
    lanes = max(_LANES // tile_cols, 1) * tile_cols
    for r in prange(rows):
        centres = np.empty(lanes)
        powers = np.zeros((4, lanes))
        for lane in range(lanes):
            centres[lane] = centre[labels[r % tile_rows, lane % tile_cols]]
        _lane_powers(values[r], centres, powers[0], powers[1], powers[2], powers[3])
        for lane in range(lanes):
            for k in range(4):
                out[r, labels[r % tile_rows, lane % tile_cols], k] += powers[k, lane]


@compiled()
def _lane_powers(
    values: NDArray[np.float64],
    centres: NDArray[np.float64],
    p1: NDArray[np.float64],
    p2: NDArray[np.float64],
    p3: NDArray[np.float64],
    p4: NDArray[np.float64],
) -> None:
    size, lanes = np.uint64(values.size), np.uint64(centres.size)
    for first in range(np.uint64(0), size, lanes):
        for lane in range(min(lanes, size - first)):
            d = values[first + lane] - centres[lane]
            square = d * d
            p1[lane] += d
            p2[lane] += square
            p3[lane] += square * d
            p4[lane] += square * square


def label_pixels(shape: tuple[int, ...], labels: NDArray[np.integer]) -> NDArray[np.int64]:
    """Pixels of each label.

    Examples
    --------
    >>> label_pixels((3, 3), np.array([[0, 1], [1, 2]])).tolist()
    [4, 4, 1]
    """
    pixels = np.zeros(int(labels.max()) + 1, np.int64)
    for (r, c), label in np.ndenumerate(labels):
        pixels[label] += len(range(r, shape[0], labels.shape[0])) * len(range(c, shape[1], labels.shape[1]))
    return pixels


@dataclass(frozen=True)
class Moments:
    """Mean, unbiased variance and fourth central moment over the pixels of one label."""

    pixels: int
    mean: float
    variance: float
    fourth: float


def label_moments(values: NDArray[np.float64], labels: NDArray[np.integer] | None = None) -> tuple[Moments, ...]:
    """Moments over pixels of a map, per label.

    Parameters
    ----------
    values
        (rows, cols).
    labels
        The repeating tile of labels, as for `FrameSums`.

    Examples
    --------
    >>> label_moments(np.array([[1.0, 10.0], [3.0, 10.0]]), np.array([[0, 1]]))[0].variance
    2.0
    """
    tile = np.zeros((1, 1), np.int64) if labels is None else np.asarray(labels, np.int64)
    n_labels = int(tile.max()) + 1
    values = np.ascontiguousarray(values, dtype=np.float64)
    centre = np.array([values[tuple(site)] for site in _first_sites(tile, n_labels)])
    counts = label_pixels(values.shape, tile)
    # Two passes: the first finds the mean, the second the moments about it, so that nothing cancels.
    for final in (False, True):
        by_row = np.zeros((values.shape[0], n_labels, 4))
        _power_sums(values, tile, centre, by_row)
        powers = by_row.sum(axis=0)
        if not final:
            centre = centre + powers[:, 0] / counts
    return tuple(
        Moments(
            pixels=int(n),
            mean=float(c),
            variance=float(p[1] / (n - 1)) if n > 1 else 0.0,
            fourth=float(p[3] / n),
        )
        for n, c, p in zip(counts, centre, powers, strict=True)
    )


def _first_sites(tile: NDArray[np.int64], n_labels: int) -> list[tuple[int, int]]:
    """Where in the tile each label occurs first."""
    return [tuple(int(i) for i in np.argwhere(tile == k)[0]) for k in range(n_labels)]  # type: ignore[misc]
