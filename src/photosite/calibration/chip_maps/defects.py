"""Pixels that are not like the others of their channel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from photosite.sensor.measured_chip import DefectKind, Defects, no_defects

FAR_SIGMA = 4.5
"""Standard deviations of the channel's map beyond which a pixel is listed. Of ordinary pixels with a normal spread 3.4
in a million lie beyond on one side; a pixel that truly is five out is missed with probability Phi(-0.5 / u), where u is
the map's uncertainty in the same unit: 0.6 % where that is a fifth."""

DEAD_RESPONSE = 0.5
"""Relative response below which a pixel is dead."""

NOISY_PROBABILITY = 1e-7
"""Probability that an ordinary pixel's noise comes out as large as that of one that is listed."""

_NORMAL_QUARTILE = 0.6744897501960817


def sites(tile: NDArray[np.int64], label: int) -> Iterator[tuple[slice, slice]]:
    """The planes of a channel: rows and columns of each of its sites in the tile."""
    for r, c in np.argwhere(tile == label):
        yield slice(int(r), None, tile.shape[0]), slice(int(c), None, tile.shape[1])


def channel_values(values: NDArray[np.float32], tile: NDArray[np.int64], label: int) -> NDArray[np.float32]:
    """(n,) a channel's values of a map."""
    return np.concatenate([values[part].ravel() for part in sites(tile, label)])


def deviations(
    values: NDArray[np.float32], uncertainty: NDArray[np.float32], tile: NDArray[np.int64]
) -> NDArray[np.float32]:
    """How far each pixel of a map lies from its channel's median, in standard deviations of the channel's map.

    The standard deviation is the interquartile range over 1.35, which far pixels do not widen. It holds the ordinary
    measurement uncertainty; a pixel that was measured worse than the others is given what it is worse by on top, so
    that noise alone lists nobody.

    Parameters
    ----------
    values, uncertainty
        (rows, cols).
    tile
        The repeating tile of channel indices.

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
            # In a map without spread whatever differs is infinitely far off.
            with np.errstate(divide="ignore", invalid="ignore"):
                out[part] = np.where(off == 0.0, 0.0, off / scale)
    return out


def listed(
    kind: DefectKind, chosen: NDArray[np.bool_], value: NDArray[np.floating], deviation: NDArray[np.floating]
) -> Defects:
    """The chosen pixels of a map as defects."""
    row, col = np.nonzero(chosen)
    return Defects(
        row,
        col,
        np.full(len(row), kind, np.uint8),
        value[row, col].astype(np.float64),
        deviation[row, col].astype(np.float64),
    )


def together(lists: Sequence[Defects]) -> Defects:
    """Several lists as one, by row, column and kind."""
    if not lists:
        return no_defects()
    columns = {entry.name: np.concatenate([getattr(one, entry.name) for one in lists]) for entry in fields(Defects)}
    order = np.lexsort((columns["kind"], columns["col"], columns["row"]))
    return Defects(**{name: column[order] for name, column in columns.items()})
