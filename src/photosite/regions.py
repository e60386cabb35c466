"""Rectangles of pixels with a name: where a chart's patches lie."""

from __future__ import annotations

from dataclasses import dataclass

from photosite.errors import InputError


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle, rows r0 to r1 and columns c0 to c1, the second of each excluded.

    Raises
    ------
    InputError
        If it is empty or begins below 0.

    Examples
    --------
    >>> Region("white", 10, 20, 0, 5).shape
    (10, 5)
    """

    name: str
    r0: int
    r1: int
    c0: int
    c1: int

    def __post_init__(self) -> None:
        if not (0 <= self.r0 < self.r1 and 0 <= self.c0 < self.c1):
            raise InputError(
                f"region '{self.name}' is empty or begins below 0: rows {self.r0} to {self.r1}, "
                f"columns {self.c0} to {self.c1}"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.r1 - self.r0, self.c1 - self.c0
