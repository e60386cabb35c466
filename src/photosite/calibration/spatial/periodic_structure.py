"""Periodic structure of flat fields: a mosaic that is not stated, its wrong phase, and unequal readout channels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PERIODS = (1, 2, 4, 6)
"""Periods of color filter arrays: none; Bayer; 2 x 2 pixels of one color; X-Trans."""

CELL = 12
"""Rows and columns of the cell that all periods divide."""

LEAST_CELLS = 16
"""Cells below which a frame is too small to show a period."""

MOSAIC_SHARE = 0.02
"""Difference between places of a period, as a share of the signal, above which they do not belong to one channel.

The two greens of a Bayer mosaic and the readout channels of a chip differ by less.
"""

READOUT_SHARE = 0.002
"""Difference above which places of a period are reported as readout channels of different response."""

SIGNIFICANCE = 6.0
"""Difference, in standard uncertainties, below which it is chance."""


@dataclass(frozen=True)
class PeriodicStructure:
    """Signal of a flat at the places of a period, relative to the mean of the channel.

    Parameters
    ----------
    relative
        (period, period) signal over that of the channel's mean; 1 where the pixels respond alike.
    uncertainty
        Standard uncertainty of one place.
    """

    relative: NDArray[np.float64]
    uncertainty: float

    @property
    def period(self) -> int:
        """Period in rows and columns."""
        return int(self.relative.shape[0])

    @property
    def difference(self) -> float:
        """Difference between the highest and the lowest place, as a share of the signal."""
        return float(np.nanmax(self.relative) - np.nanmin(self.relative))

    @property
    def by_lines(self) -> str:
        """Return "rows" or "columns" where only these differ, as readout channels do; "" otherwise."""
        for name, axis in (("columns", 0), ("rows", 1)):
            means = np.nanmean(self.relative, axis=axis, keepdims=True)
            if np.nanmax(np.abs(self.relative - means)) < max(0.1 * self.difference, SIGNIFICANCE * self.uncertainty):
                return name
        return ""

    def of_mosaic(self) -> bool:
        """Return whether the structure is that of a mosaic whose channels are not stated, or not as they are."""
        return self.difference > MOSAIC_SHARE and not self.by_lines

    def __str__(self) -> str:
        percent = f"{100.0 * self.difference:.2g} %"
        if not self.of_mosaic():
            return (
                f"the flat fields differ by {percent} with a period of {self.period} {self.by_lines or 'pixels'}, "
                f"as with readout channels of different gain; PRNU includes this difference"
            )
        likely = f"; {' or '.join(self.bayer_patterns())} fits" if self.period == 2 else ""
        return (
            f"the flat fields repeat every {self.period} rows and columns, by {percent} of the signal, within what "
            f"is stated as one channel, as with a color filter array that is not stated or has another phase{likely}"
        )

    def bayer_patterns(self) -> tuple[str, ...]:
        """Return the Bayer patterns that fit: the greens lie on the diagonal whose two places are most alike."""
        if self.period != 2:
            return ()
        (a, b), (c, d) = self.relative.tolist()
        return ("GRBG", "GBRG") if abs(a - d) < abs(b - c) else ("RGGB", "BGGR")


def periodic_structure(
    flat: NDArray[np.float64], dark: NDArray[np.float64], tile: NDArray[np.int64]
) -> PeriodicStructure | None:
    """Return the periodic structure of the pixels of one channel, the most different one; None where there is none.

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
    if rows * cols < LEAST_CELLS or CELL % tile.shape[0] or CELL % tile.shape[1]:
        return None
    signal = flat[: rows * CELL, : cols * CELL] - dark[: rows * CELL, : cols * CELL]
    # The median of the cells keeps defects and shading from standing out as a period.
    cells = signal.reshape(rows, CELL, cols, CELL).swapaxes(1, 2).reshape(-1, CELL, CELL)
    labels = np.tile(tile, (CELL // tile.shape[0], CELL // tile.shape[1]))
    relative, spread = np.empty((CELL, CELL)), 0.0
    for channel in range(int(tile.max()) + 1):
        inside = labels == channel
        values = cells[:, inside]
        scaled = values / np.median(values, axis=1, keepdims=True)
        place = np.median(scaled, axis=0)
        relative[inside] = place / place.mean()
        spread = max(spread, 1.4826 * float(np.median(np.abs(scaled - place))))
    noise = 1.2533 * spread / np.sqrt(len(cells))
    for period in PERIODS:
        folds = CELL // period
        folded = relative.reshape(folds, period, folds, period).mean(axis=(0, 2))
        rest = relative - np.tile(folded, (folds, folds))
        found = PeriodicStructure(folded, noise / folds)
        if np.abs(rest).max() < max(SIGNIFICANCE * noise, 0.1 * found.difference):
            shown = found.difference > max(READOUT_SHARE, SIGNIFICANCE * found.uncertainty)
            return found if shown else None
    return None
