"""Optical black: rows and columns at the edges of the array that are covered."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from photosite.errors import InputError
from photosite.sensor.quantity import about
from photosite.values.validated import Section

_Lines = Annotated[int, Field(ge=0, le=65_535, strict=True)]


class OpticalBlack(Section):
    """Rows and columns of the array without light. They have the same noise and dark current as the others.

    Examples
    --------
    >>> OpticalBlack(left=8).text
    '0,0,8,0'
    """

    top: _Lines = about("Rows at the top, a multiple of the color filter array's tile.", "pixels", 8, default=0)
    bottom: _Lines = about("Rows at the bottom.", "pixels", 0, default=0)
    left: _Lines = about("Columns at the left, a multiple of the color filter array's tile.", "pixels", 16, default=0)
    right: _Lines = about("Columns at the right.", "pixels", 0, default=0)

    @property
    def text(self) -> str:
        """The numbers of lines in a frame's metadata."""
        return f"{self.top},{self.bottom},{self.left},{self.right}"

    def check(self, rows: int, cols: int, tile: tuple[int, int]) -> None:
        """Raise `InputError` unless pixels with light are left, and their first has the tile's first filter."""
        for name, size, lines in (("top", rows, self.top + self.bottom), ("left", cols, self.left + self.right)):
            if lines >= size:
                raise InputError(name, value=lines, expected=f"below {size}, together with the opposite side")
        for name, lines, step in (("top", self.top, tile[0]), ("left", self.left, tile[1])):
            if lines % step:
                raise InputError(name, value=lines, expected=f"a multiple of {step}, the size of the array's tile")
