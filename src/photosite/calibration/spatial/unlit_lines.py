"""Rows and columns that no light reaches, at the sides or within: covered pixels, and overscan without pixels."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from photosite.engine.jit import F64
from photosite.values.diagnostic import DiagnosticKind

UNLIT, LIT = 0.2, 0.5
"""Response of lines, relative to the median: lines below the first have no light, lines above the second have.
The step between two neighboring lines tells a cover from light that falls off."""

LEAST_ROWS = 256
"""Rows, evenly spaced, of which the response of columns is the mean, at least, where there are as many."""

UNLIT_LINES = DiagnosticKind(
    "unlit-lines",
    "warning",
    "No light reaches rows or columns at the sides of the flat fields, or several beside each other within.",
    "PRNU is withheld. Dark current, saturation and response are means that contain these lines.",
    "Calibrate the pixels with light (--region), of two amplifiers with overscan between them one by one, or state the "
    "covered lines in the sensor file (optical_black).",
    ("prnu*", "shading_percent", "dark_current_*", "saturation_*", "responsivity_*", "quantum_efficiency_*"),
    "fraction of the pixels",
)


@dataclass(frozen=True)
class UnlitLines:
    """Lines without light of frames of some rows and columns.

    Parameters
    ----------
    top, bottom, left, right
        Numbers of lines at each side.
    rows, cols
        Size of the frames.
    inner_rows, inner_cols
        First line, and the one after the last, of each group within.
    """

    top: int
    bottom: int
    left: int
    right: int
    rows: int
    cols: int
    inner_rows: tuple[tuple[int, int], ...] = ()
    inner_cols: tuple[tuple[int, int], ...] = ()

    @property
    def fraction(self) -> float:
        """Fraction of the pixels that are in such lines."""
        inner = [sum(end - first for first, end in groups) for groups in (self.inner_rows, self.inner_cols)]
        lit = (self.rows - self.top - self.bottom - inner[0]) * (self.cols - self.left - self.right - inner[1])
        return 1.0 - lit / (self.rows * self.cols)

    def __str__(self) -> str:
        sides = {"top": self.top, "bottom": self.bottom, "left": self.left, "right": self.right}
        named = [f"{count} at the {side}" for side, count in sides.items() if count]
        for kind, groups in (("rows", self.inner_rows), ("columns", self.inner_cols)):
            named += [f"{kind} {first} to {end - 1}" for first, end in groups]
        inner_row = self.inner_rows[0][0] if self.inner_rows else self.rows - self.bottom
        inner_col = self.inner_cols[0][0] if self.inner_cols else self.cols - self.right
        others = " (and the other parts likewise)" if self.inner_rows or self.inner_cols else ""
        return (
            f"no light reaches rows or columns of the flat fields: {', '.join(named)}. They are covered or overscan, "
            f"and PRNU is withheld; dark current, saturation and response contain them. Calibrate rows {self.top} to "
            f"{inner_row - 1} and columns {self.left} to {inner_col - 1} (--region){others}, or state covered lines in "
            f"the sensor file (optical_black)"
        )


def find_unlit_lines(slopes: F64, tile: tuple[int, ...]) -> UnlitLines | None:
    """Return the lines without light of a map (rows, cols) of responses, or None without such lines.

    Examples
    --------
    >>> slopes = np.ones((20, 24))
    >>> slopes[:, 20:] = 0.01
    >>> find_unlit_lines(slopes, (1, 1)).right
    4
    """
    counts: list[int] = []
    inner = []
    some = slopes[:: max(len(slopes) // LEAST_ROWS, 1)]
    for lines, period in zip((slopes.mean(axis=1), some.mean(axis=0)), tile, strict=True):
        relative = np.empty(lines.size)
        for first in range(period):
            middle = float(np.median(lines[first::period]))
            relative[first::period] = lines[first::period] / middle if middle > 0.0 else 1.0
        sides = [_unlit(relative), _unlit(relative[::-1])]
        counts += sides
        inner.append(_inner(relative, sides[0], relative.size - sides[1]))
    rows, cols = slopes.shape
    if not any(counts) and not any(inner):
        return None
    top, bottom, left, right = counts
    return UnlitLines(top, bottom, left, right, rows, cols, inner_rows=inner[0], inner_cols=inner[1])


LEAST_INNER = 4
"""Lines within the frame that are overscan and not dead lines."""


def _inner(relative: F64, first: int, end: int) -> tuple[tuple[int, int], ...]:
    """Return the groups of lines from `first` to `end` that have no light, between lines that have."""
    edges = np.flatnonzero(np.diff(relative[first:end] < UNLIT)) + 1 + first
    return tuple(
        (int(low), int(high))
        for low, high in pairwise(edges)
        if relative[low] < UNLIT and high - low >= LEAST_INNER and min(relative[low - 1], relative[high]) > LIT
    )


def _unlit(relative: F64) -> int:
    """Return the number of lines from the first one on that have no light, up to a line that has."""
    lit = np.flatnonzero(relative >= UNLIT)
    first = int(lit[0]) if lit.size else 0
    return first if relative[first] > LIT else 0
