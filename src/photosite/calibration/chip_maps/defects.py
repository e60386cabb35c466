"""Defective pixels: those that differ from the others of their channel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

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
    """Return the values (n,) of one channel of a map, a copy."""
    return np.concatenate([values[part].ravel() for part in sites(tile, label)])


@dataclass(frozen=True, eq=False)
class Deviations:
    """A map of each pixel's distance from the median of its channel, computed for the rows that are read.

    Parameters
    ----------
    values, uncertainty, tile
        The map, its uncertainty, and the channels.
    middle, variance, usual
        (channels,) median, variance of the channel's map, and square of the usual uncertainty.
    """

    values: NDArray[np.float32]
    uncertainty: NDArray[np.float32]
    tile: NDArray[np.int64]
    middle: NDArray[np.float64]
    variance: NDArray[np.float64]
    usual: NDArray[np.float32]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of rows and columns."""
        return self.values.shape

    def __getitem__(self, rows: slice) -> NDArray[np.float32]:
        """Return the deviations of a slice of successive rows."""
        values, uncertainty = self.values[rows], self.uncertainty[rows]
        tile = np.roll(self.tile, -rows.indices(self.shape[0])[0], axis=0)
        out = np.empty_like(values)
        for label, (middle, variance, usual) in enumerate(zip(self.middle, self.variance, self.usual, strict=True)):
            for part in sites(tile, label):
                scale = np.sqrt(variance + np.maximum(uncertainty[part] ** 2 - usual, 0.0))
                off = values[part] - middle
                # In a map of equal values, any other value is infinitely far off.
                with np.errstate(divide="ignore", invalid="ignore"):
                    out[part] = np.where(off == 0.0, 0.0, off / scale)
        return out


def deviations(values: NDArray[np.float32], uncertainty: NDArray[np.float32], tile: NDArray[np.int64]) -> Deviations:
    """Return each pixel's distance from the median of its channel, in standard deviations of the channel's map.

    The standard deviation is the interquartile range divided by 1.35, which far pixels do not widen. It includes the
    usual measurement uncertainty. If a pixel was measured less precisely, the excess is added to its scale, so that
    noise alone does not make it a defect.

    Examples
    --------
    >>> values = np.array([[-900.0, -1, 0, 1, 900]], np.float32)
    >>> deviations(values, np.zeros_like(values), np.zeros((1, 1), np.int64))[:][0, 1:].round().tolist()
    [-1.0, 0.0, 1.0, 607.0]
    """
    found = []
    for label in range(int(tile.max()) + 1):
        own = channel_values(values, tile, label)
        low, middle, high = np.quantile(own, [0.25, 0.5, 0.75], overwrite_input=True)
        del own
        usual = np.median(channel_values(uncertainty, tile, label), overwrite_input=True)
        found.append((middle, ((high - low) / (2 * _NORMAL_QUARTILE)) ** 2, usual**2))
    middles, variances, usuals = zip(*found, strict=True)
    return Deviations(values, uncertainty, tile, np.array(middles), np.array(variances), np.array(usuals))


def listed(
    kind: DefectKind,
    chosen: NDArray[np.bool_],
    value: NDArray[np.floating],
    deviation: NDArray[np.floating],
    first_row: int = 0,
) -> Defects:
    """Return the selected pixels of a map, or of its rows from `first_row`, as defects."""
    row, col = np.nonzero(chosen)
    return of_kind(kind, (row + first_row, col), value[row, col], deviation[row, col])


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
