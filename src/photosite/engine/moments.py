"""Moments of a map over its pixels, per label of a repeating tile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled

_Ints = NDArray[Any]


@compiled()
def _power_sums(
    values: NDArray[np.float64],
    labels: _Ints,
    centre: NDArray[np.float64],
    counts: _Ints,
    out: NDArray[np.float64],
) -> None:
    """Per label, pixels and the sums of the first to fourth power of the deviation from `centre[label]`."""
    rows, cols = values.shape
    tile_rows, tile_cols = labels.shape
    for r in range(rows):
        for phase in range(tile_cols):
            label = labels[r % tile_rows, phase]
            p1 = 0.0
            p2 = 0.0
            p3 = 0.0
            p4 = 0.0
            for c in range(phase, cols, tile_cols):
                d = values[r, c] - centre[label]
                p1 += d
                p2 += d * d
                p3 += d * d * d
                p4 += d * d * d * d
                counts[label] += 1
            out[label, 0] += p1
            out[label, 1] += p2
            out[label, 2] += p3
            out[label, 3] += p4


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
    # Two passes: the first finds the mean, the second the moments about it, so that nothing cancels.
    for final in (False, True):
        counts = np.zeros(n_labels, np.int64)
        powers = np.zeros((n_labels, 4))
        _power_sums(values, tile, centre, counts, powers)
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
