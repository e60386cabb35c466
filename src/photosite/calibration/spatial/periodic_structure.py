"""Periodic structure of flat fields: a mosaic that is not stated, its wrong phase, and unequal readout channels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

PERIODS = (1, 2, 4, 6)
"""Periods of color filter arrays: none; Bayer; 2 x 2 pixels of one color; X-Trans."""

CELL = 12
"""Rows and columns of the cell that all periods divide."""

LEAST_CELLS = 16
"""Cells below which a frame is too small to show a period."""

LEAST_LIGHT = 0.1
"""Share of the usual signal below which a cell counts as not lit: covered pixels, corners that no light reaches."""

MOSAIC_SHARE = 0.02
"""Difference between places of a period, as a share of the signal, above which they do not belong to one channel.

The two greens of a Bayer mosaic and the readout channels of a chip differ by less.
"""

FILTER_SHARE = 0.1
"""Difference above which rows or columns belong to a striped color filter array: readout channels differ by less."""

READOUT_SHARE = 0.002
"""Difference above which places of a period are reported as readout channels of different response."""

BY_CHANCE = 1e-4
"""Share of flat fields without a period in which one of the places may deviate beyond chance."""


@dataclass(frozen=True)
class PeriodicStructure:
    """Signal of a flat at the places of a period, relative to the mean of the channel.

    Parameters
    ----------
    relative
        (period, period) signal over that of the channel's mean; 1 where the pixels respond alike.
    chance
        Deviation of one place that chance explains.
    """

    relative: NDArray[np.float64]
    chance: float

    @property
    def period(self) -> int:
        """Period in rows and columns."""
        return int(self.relative.shape[0])

    @property
    def difference(self) -> float:
        """Difference between the highest and the lowest place, as a share of the signal."""
        return float(self.relative.max() - self.relative.min())

    @property
    def by_lines(self) -> str:
        """Return "rows" or "columns" where only these differ, as readout channels do; "" otherwise."""
        for name, axis in (("columns", 0), ("rows", 1)):
            means = self.relative.mean(axis=axis, keepdims=True)
            if np.abs(self.relative - means).max() < max(0.1 * self.difference, self.chance):
                return name
        return ""

    def of_mosaic(self) -> bool:
        """Return whether the structure is that of a mosaic whose channels are not stated, or not as they are."""
        return self.difference > (FILTER_SHARE if self.by_lines else MOSAIC_SHARE)

    def __str__(self) -> str:
        percent = f"{100.0 * self.difference:.2g} %"
        if not self.of_mosaic():
            filters = " or a striped color filter array that is not stated" * (self.difference > MOSAIC_SHARE)
            return (
                f"the flat fields differ by {percent} with a period of {self.period} {self.by_lines or 'pixels'}, "
                f"as with readout channels of different gain{filters}; PRNU includes this difference"
            )
        likely = f"; {' or '.join(self.bayer_patterns())} fits" if self.period == 2 else ""
        return (
            f"the flat fields repeat every {self.period} {self.by_lines or 'rows and columns'}, by {percent} of the "
            f"signal, within what is stated as one channel, as with a color filter array that is not stated or has "
            f"another phase{likely}"
        )

    def bayer_patterns(self) -> tuple[str, ...]:
        """Return the Bayer patterns that fit: the greens lie on the diagonal whose two places are most alike."""
        if self.period != 2:
            return ()
        (a, b), (c, d) = self.relative.tolist()
        return ("GRBG", "GBRG") if abs(a - d) < abs(b - c) else ("RGGB", "BGGR")


def _fold(places: NDArray[np.float64], period: int) -> NDArray[np.float64]:
    """Return the means (..., period, period) of the places (..., cell, cell) of a period."""
    folds = CELL // period
    return np.asarray(places.reshape(-1, folds, period, folds, period).mean(axis=(1, 3)))


def _chance(blocks: Sequence[NDArray[np.float64]], period: int) -> float:
    """Return how far a place of a period may deviate by chance, from (blocks, cell, cell) places of parts of a frame.

    The blocks are whole columns and whole rows of cells. They contain the patterns of columns and rows of a chip, which
    all cells of a block share.
    """
    variance = [_fold(places, period).var(axis=0, ddof=1).mean() / len(places) for places in blocks]
    freedom = period * (min(len(places) for places in blocks) - 1)
    # A median scatters more than a mean, by this factor for normal noise.
    return 1.2533 * math.sqrt(sum(variance)) * -float(stdtrit(freedom, BY_CHANCE / (2.0 * period**2)))


def periodic_structure(
    flat: NDArray[np.float64], dark: NDArray[np.float64], tile: NDArray[np.int64]
) -> PeriodicStructure | None:
    """Return the periodic structure of the pixels of one channel, the most different one; None within chance.

    Parameters
    ----------
    flat, dark
        (rows, cols) mean frames, DN.
    tile
        The repeating tile of channel indices, as stated.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> flat = 1000.0 + rng.normal(0.0, 10.0, (96, 96))
    >>> mono = np.zeros((1, 1), np.int64)
    >>> periodic_structure(flat, 0.0 * flat, mono) is None
    True
    >>> flat[::2, ::2] *= 0.6
    >>> flat[1::2, 1::2] *= 0.7
    >>> found = periodic_structure(flat, 0.0 * flat, mono)
    >>> found.relative.round(1).tolist(), found.bayer_patterns()
    ([[0.7, 1.2], [1.2, 0.8]], ('RGGB', 'BGGR'))
    """
    rows, cols = (length // CELL for length in flat.shape)
    if rows * cols < LEAST_CELLS or min(rows, cols) < 2 or CELL % tile.shape[0] or CELL % tile.shape[1]:
        return None
    signal = flat[: rows * CELL, : cols * CELL] - dark[: rows * CELL, : cols * CELL]
    # The median of the cells keeps defects and shading from standing out as a period.
    cells = signal.reshape(rows, CELL, cols, CELL).swapaxes(1, 2)
    # Leave out rows and columns of cells with parts that no light reached.
    level = np.median(cells, axis=(2, 3))
    lit = level > LEAST_LIGHT * np.median(level)
    lit_cols = lit.mean(axis=0) > 0.5
    lit_rows = lit[:, lit_cols].all(axis=1)
    cells, level = cells[lit_rows][:, lit_cols], level[lit_rows][:, lit_cols]
    if lit_rows.sum() * lit_cols.sum() < LEAST_CELLS or min(cells.shape[:2]) < 2:
        return None
    labels = np.tile(tile, (CELL // tile.shape[0], CELL // tile.shape[1]))
    # Shading tilts all cells alike.
    tilt = [np.gradient(level, axis=axis) / level / CELL for axis in (0, 1)]
    away = np.arange(CELL) - 0.5 * (CELL - 1)
    ramp = tilt[0][..., None, None] * away[:, None] + tilt[1][..., None, None] * away
    shape = CELL, CELL
    relative, by_rows, by_cols = (np.empty((*size, *shape)) for size in ((), cells.shape[:1], cells.shape[1:2]))
    for channel in range(int(tile.max()) + 1):
        inside = labels == channel
        values = cells[:, :, inside]
        usual = np.median(values, axis=2, keepdims=True)
        if not (usual > 0.0).all():
            return None  # a channel without light
        scaled = values / usual - ramp[:, :, inside]
        place = np.median(scaled, axis=(0, 1))
        relative[inside] = place / place.mean()
        by_cols[:, inside], by_rows[:, inside] = np.median(scaled, axis=0), np.median(scaled, axis=1)
    chance = {period: _chance((by_rows, by_cols), period) for period in (*PERIODS[1:], CELL)}
    for period in PERIODS:
        folded = _fold(relative, period)[0]
        rest = relative - np.tile(folded, (CELL // period, CELL // period))
        found = PeriodicStructure(folded, chance.get(period, 0.0))
        limits = {longer: max(limit, 0.1 * found.difference) for longer, limit in chance.items()}
        if all(np.abs(_fold(rest, longer)).max() < limit for longer, limit in limits.items()):
            return found if found.difference > READOUT_SHARE else None
    return None
