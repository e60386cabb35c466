"""Lines without light at the edges of the array: optical black, which is covered, and overscan, which has no pixels."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field

from photosite.errors import InputError
from photosite.sensor.effects.section import Corner, EffectSection, Limits
from photosite.sensor.quantity import about
from photosite.values.region import Border

_Lines = Annotated[int, Field(ge=0, le=65_535, strict=True)]


class OpticalBlack(EffectSection):
    """Rows and columns of the array without light. Covered ones have the same noise and dark current as the others.

    Overscan is read after the last line of the array, on the side opposite to the output. It has no pixels: read noise
    and black level, but no dark current and no pattern.

    Examples
    --------
    >>> OpticalBlack(left=8, overscan_rows=4).border("top_left")
    (0, 4, 8, 0)
    """

    placed = True

    top: _Lines = about("Covered rows at the top.", "pixels", 8, default=0)
    bottom: _Lines = about("Covered rows at the bottom.", "pixels", 0, default=0)
    left: _Lines = about("Covered columns at the left.", "pixels", 16, default=0)
    right: _Lines = about("Covered columns at the right.", "pixels", 0, default=0)
    overscan_rows: _Lines = about("Rows that are read after the last one.", "pixels", 16, default=0)
    overscan_cols: _Lines = about("Columns that are read after the last one.", "pixels", 32, default=0)

    def nominal(self) -> Self:
        """Return the lines, which a data sheet states."""
        return self

    def overscan(self, output: Corner) -> Border:
        """Return the lines of overscan at each side, for the corner of the output."""
        rows, cols = self.overscan_rows, self.overscan_cols
        return (
            *((0, rows) if output.startswith("top") else (rows, 0)),
            *((0, cols) if output.endswith("left") else (cols, 0)),
        )

    def border(self, output: Corner) -> Border:
        """Return all lines without light at each side, for the corner of the output."""
        top, bottom, left, right = self.overscan(output)
        return top + self.top, bottom + self.bottom, left + self.left, right + self.right

    def check(self, limits: Limits) -> None:
        """Raise `InputError` unless pixels with light are left, and their first has the tile's first filter."""
        top, bottom, left, right = self.border(limits.output)
        for name, size, lines in (("top", limits.rows, top + bottom), ("left", limits.cols, left + right)):
            if lines >= size:
                raise InputError(name, value=lines, expected=f"below {size}, together with the opposite side")
        for name, lines, step in (("top", top, limits.tile[0]), ("left", left, limits.tile[1])):
            if lines % step:
                raise InputError(name, value=lines, expected=f"a multiple of {step}, the size of the array's tile")
