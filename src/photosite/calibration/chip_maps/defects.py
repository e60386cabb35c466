"""Defective pixels: those that differ from the others of their channel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from photosite.sensor.chip import DefectKind, Defects

FAR_SIGMA = 4.5
"""Standard deviations of the channel's map beyond which a pixel is listed.

For a normal distribution, 3.4 pixels in a million lie beyond this on one side. A pixel that is truly five standard
deviations out is missed with probability Phi(-0.5 / u), where u is the map's uncertainty in the same unit: 0.6 % for
u = 0.2.
"""

DEAD_RESPONSE = 0.5
"""Relative response below which a pixel is dead."""

NOISY_P_VALUE = 1e-7
"""Probability that the noise of an ordinary pixel exceeds the limit for noisy pixels."""

_NORMAL_QUARTILE = 0.6744897501960817


def sites(tile: NDArray[np.int64], label: int) -> Iterator[tuple[slice, slice]]:
    """Yield the planes of a channel as row and column slices, one for each of its sites in the tile."""
    for r, c in np.argwhere(tile == label):
        yield slice(int(r), None, tile.shape[0]), slice(int(c), None, tile.shape[1])


def channel_values(values: NDArray[np.float32], tile: NDArray[np.int64], label: int) -> NDArray[np.float32]:
    """Return the values (n,) of one channel of a map."""
    return np.concatenate([values[part].ravel() for part in sites(tile, label)])


def deviations(
    values: NDArray[np.float32], uncertainty: NDArray[np.float32], tile: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Return each pixel's distance from the median of its channel, in standard deviations of the channel's map.

    The standard deviation is the interquartile range divided by 1.35, which far pixels do not widen. It includes the
    usual measurement uncertainty. If a pixel was measured less precisely, the excess is added to its scale, so that
    noise alone does not make it a defect.

    Examples
    --------
    >>> values = np.array([[-900.0, -1, 0, 1, 900]], np.float32)
    >>> deviations(values, np.zeros_like(values), np.zeros((1, 1), np.int64))[0, 1:].round().tolist()
    [-1.0, 0.0, 1.0, 607.0]
    """
    out = np.empty_like(values)
    for label in range(int(tile.max()) + 1):
        low, middle, high = np.quantile(channel_values(values, tile, label), [0.25, 0.5, 0.75])
        variance = ((high - low) / (2 * _NORMAL_QUARTILE)) ** 2
        usual = np.median(channel_values(uncertainty, tile, label)) ** 2
        for part in sites(tile, label):
            scale = np.sqrt(variance + np.maximum(uncertainty[part] ** 2 - usual, 0.0))
            off = values[part] - middle
            # In a map of equal values, any other value is infinitely far off.
            with np.errstate(divide="ignore", invalid="ignore"):
                out[part] = np.where(off == 0.0, 0.0, off / scale)
    return out


def listed(
    kind: DefectKind, chosen: NDArray[np.bool_], value: NDArray[np.floating], deviation: NDArray[np.floating]
) -> Defects:
    """Return the selected pixels of a map as defects."""
    place = np.nonzero(chosen)
    return of_kind(kind, place, value[place], deviation[place])


def of_kind(
    kind: DefectKind, place: tuple[NDArray[np.int64], ...], value: NDArray[np.floating], deviation: NDArray[np.floating]
) -> Defects:
    """Return defects of one kind at (rows, columns)."""
    row, col = place
    return Defects(row, col, np.full(len(row), kind, np.uint8), value.astype(np.float64), deviation.astype(np.float64))


def merged(lists: Sequence[Defects]) -> Defects:
    """Merge lists of defects, sorted by row, column and kind."""
    columns = {entry.name: np.concatenate([getattr(one, entry.name) for one in lists]) for entry in fields(Defects)}
    order = np.lexsort((columns["kind"], columns["col"], columns["row"]))
    return Defects(**{name: column[order] for name, column in columns.items()})
