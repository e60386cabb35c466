"""Rows and columns at the sides of the frame that no light reaches: covered pixels, and overscan without pixels."""

from __future__ import annotations

from dataclasses import dataclass

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
    "No light reaches rows or columns at the sides of the flat fields.",
    "PRNU is withheld. Dark current, saturation and response are means that contain these lines.",
    "Crop the frames to the lines with light, or state the covered lines in the sensor file (optical_black).",
    ("prnu*", "shading_percent", "dark_current_*", "saturation_*", "responsivity_*", "quantum_efficiency_*"),
    "fraction of the pixels",
)


@dataclass(frozen=True)
class UnlitLines:
    """Numbers of lines without light at each side of frames of some rows and columns."""

    top: int
    bottom: int
    left: int
    right: int
    rows: int
    cols: int

    @property
    def fraction(self) -> float:
        """Fraction of the pixels that are in such lines."""
        lit = (self.rows - self.top - self.bottom) * (self.cols - self.left - self.right)
        return 1.0 - lit / (self.rows * self.cols)

    def __str__(self) -> str:
        sides = {"top": self.top, "bottom": self.bottom, "left": self.left, "right": self.right}
        named = ", ".join(f"{count} at the {side}" for side, count in sides.items() if count)
        return (
            f"no light reaches rows or columns at the sides of the flat fields: {named}. They are covered or overscan, "
            f"and PRNU is withheld; dark current, saturation and response contain them. Crop the frames to rows "
            f"{self.top} to {self.rows - self.bottom - 1} and columns {self.left} to {self.cols - self.right - 1}, or "
            f"state the covered lines in the sensor file (optical_black)"
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
    counts = []
    some = slopes[:: max(len(slopes) // LEAST_ROWS, 1)]
    for lines, period in zip((slopes.mean(axis=1), some.mean(axis=0)), tile, strict=True):
        relative = np.empty(lines.size)
        for first in range(period):
            middle = float(np.median(lines[first::period]))
            relative[first::period] = lines[first::period] / middle if middle > 0.0 else 1.0
        counts += [_unlit(relative), _unlit(relative[::-1])]
    found = UnlitLines(*counts, *slopes.shape)
    return found if any(counts) else None


def _unlit(relative: F64) -> int:
    """Return the number of lines from the first one on that have no light, up to a line that has."""
    lit = np.flatnonzero(relative >= UNLIT)
    first = int(lit[0]) if lit.size else 0
    return first if relative[first] > LIT else 0
