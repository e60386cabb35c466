"""Readout channels: parts of the array that are read through amplifiers of their own."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from photosite.errors import InputError
from photosite.sensor.effects.section import EffectSection, Limits
from photosite.sensor.quantity import NO_UNIT, AnyValue, Positive, about


class ReadoutChannels(EffectSection):
    """Gains and offsets of readout channels, a value for each place of a tile or block.

    Examples
    --------
    >>> columns = ReadoutChannels(relative_gain=((1.01, 0.99),), offset_e=((3, -3),))
    >>> quadrants = ReadoutChannels(arrangement="blocks", relative_gain=((1, 1.02), (0.99, 1)))
    >>> columns.groups(2, 4)[1].tolist(), quadrants.groups(2, 4)[1].tolist()
    ([0, 1, 0, 1], [0, 0, 1, 1])
    """

    placed = True

    arrangement: Literal["tile", "blocks"] = about(
        "tile: the values repeat over the array, as those of odd and even columns; blocks: each value holds for a part "
        "of the array, as those of quadrants.",
        NO_UNIT,
        "tile",
        default="tile",
    )
    relative_gain: tuple[tuple[Positive, ...], ...] | None = about(
        "Gain of each channel relative to the system gain, rows of columns; 1 by default.",
        "1",
        [[1.01, 0.99]],
        default=None,
    )
    offset_e: tuple[tuple[AnyValue, ...], ...] | None = about(
        "Offset of each channel relative to the black level, rows of columns; 0 by default.",
        "e-",
        [[3, -3]],
        default=None,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        shapes = []
        for name in ("relative_gain", "offset_e"):
            if (rows := getattr(self, name)) is None:
                continue
            if not rows or not rows[0] or any(len(row) != len(rows[0]) for row in rows):
                lengths = [len(row) for row in rows]
                raise InputError(name, value=f"rows of {lengths}", expected="one row or more, all of one length")
            shapes.append((len(rows), len(rows[0])))
        if not shapes:
            raise InputError("'relative_gain' and 'offset_e' are both missing", hint="Give one of them")
        if len(set(shapes)) > 1:
            raise InputError("offset_e", value=shapes[1], expected=f"of the shape of relative_gain, {shapes[0]}")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the table of channels."""
        table = self.relative_gain or self.offset_e or ()
        return len(table), len(table[0])

    def check(self, limits: Limits) -> None:
        """Raise `InputError` unless the array has at least a row and a column for each channel."""
        size = limits.rows, limits.cols
        if self.shape[0] > size[0] or self.shape[1] > size[1]:
            raise InputError("relative_gain", value=self.shape, expected=f"at most the array's size, {size}")

    @property
    def line_variances(self) -> tuple[float, float]:
        """Variance over the channels of offsets, e-^2, and of gains relative to their mean."""
        gains, offsets = self.tables()
        return float(offsets.var()), float((gains / gains.mean()).var())

    def groups(self, rows: int, cols: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the row of the table for each row of the array, and the column of the table for each column."""
        sizes = zip(self.shape, (rows, cols), strict=True)
        if self.arrangement == "tile":
            row, column = (np.arange(size) % count for count, size in sizes)
        else:
            row, column = (np.arange(size) * count // size for count, size in sizes)
        return row, column

    def tables(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return relative gain and offset in electrons of each channel, arrays of `shape`."""
        gain, offset = (
            np.full(self.shape, usual) if table is None else np.array([[entry.value for entry in row] for row in table])
            for table, usual in ((self.relative_gain, 1.0), (self.offset_e, 0.0))
        )
        return gain, offset
