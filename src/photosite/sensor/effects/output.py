"""Lossy stages behind the converter: black level subtraction, dropped bits, companding."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, StrictBool, field_validator, model_validator

from photosite.errors import InputError
from photosite.sensor.effects.section import EffectSection, Limits
from photosite.sensor.quantity import NO_UNIT, about


class Output(EffectSection):
    """Digital stages behind the converter, in the order of the fields; together they are one table.

    Examples
    --------
    >>> Output(dropped_bits=2, rescaled=True).table(white_level_dn=15, black_level_dn=0).tolist()
    [0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12]
    """

    changes_response = True
    of_single_captures = True

    subtract_black_level: StrictBool = about(
        "Whether the black level is subtracted, with negative numbers clipped to 0.", NO_UNIT, True, default=False
    )
    dropped_bits: Annotated[int, Field(strict=True, ge=0, le=15)] = about(
        "Low bits that are dropped.", "bits", 2, default=0
    )
    rescaled: StrictBool = about(
        "Whether the numbers keep their scale after bits were dropped, with zeros in the dropped bits.",
        NO_UNIT,
        True,
        default=False,
    )
    companding: Literal["square_root"] | tuple[Annotated[int, Field(strict=True, ge=0, le=65535)], ...] | None = about(
        "square_root, which keeps the highest number, or a table with the output for each number from 0 on.",
        NO_UNIT,
        "square_root",
        default=None,
    )
    companded_bits: Annotated[int, Field(strict=True, ge=1, le=16)] | None = about(
        "Bits of the output of square_root; by default those of the converter.", "bits", 8, default=None
    )
    decoded: StrictBool = about(
        "Whether companded numbers are saved as the mean of the numbers that share their code.",
        NO_UNIT,
        True,
        default=False,
    )

    @field_validator("companding", mode="before")
    @classmethod
    def _known(cls, value: object) -> object:
        if isinstance(value, str) and value != "square_root":
            raise InputError("companding", value=value, expected="'square_root' or a table of numbers")
        return value

    @model_validator(mode="after")
    def _check(self) -> Self:
        if isinstance(self.companding, tuple) and any(np.diff(self.companding) < 0):
            raise InputError("companding", value=self.companding[:8], expected="numbers that do not fall")
        if self.companded_bits is not None and self.companding != "square_root":
            raise InputError("companded_bits", value=self.companded_bits, expected="omitted without square_root")
        if self.decoded and self.companding is None:
            raise InputError("decoded", value=True, expected="false without companding")
        return self

    def check(self, limits: Limits) -> None:
        """Raise `InputError` unless a companding table covers all numbers, and the output holds black below white."""
        black_level_dn, white_level_dn = limits.black_level_dn, limits.white_level_dn
        needed = self._highest(int(white_level_dn)) + 1
        if isinstance(self.companding, tuple) and len(self.companding) < needed:
            expected = f"a table of {needed} numbers or more, one for each number before it"
            raise InputError("companding", value=f"{len(self.companding)} numbers", expected=expected)
        if (most := int(white_level_dn).bit_length() - 1) < self.dropped_bits:
            expected = f"at most {most}, one less than the bits of the converter"
            raise InputError("dropped_bits", value=self.dropped_bits, expected=expected)
        black, white = self.levels(black_level_dn, white_level_dn)
        if not black < white <= white_level_dn:
            expected = (
                f"stages whose output keeps the black level below the white level, both from 0 to {white_level_dn:g}"
            )
            raise InputError("output", value=f"levels of {black:g} and {white:g}", expected=expected)

    def levels(self, black_level_dn: float, white_level_dn: float) -> tuple[float, float]:
        """Return black and white level of the output."""
        table = self.table(white_level_dn, black_level_dn)
        return float(np.interp(black_level_dn, np.arange(len(table)), table)), float(table[-1])

    def steps_dn(self, dn: NDArray[np.float64], black_level_dn: float, white_level_dn: float) -> NDArray[np.float64]:
        """Return how many numbers of the converter share the saved number, at numbers from the black level on.

        Examples
        --------
        >>> Output(companding="square_root", companded_bits=8).steps_dn(np.array([100.0, 4000.0]), 0, 4095)
        array([ 5., 32.])
        """
        first = math.ceil(black_level_dn)
        _, place, count = np.unique(
            self.table(white_level_dn, black_level_dn)[first:], return_inverse=True, return_counts=True
        )
        # The first saved number may begin below the black level; it counts as the second.
        count[0] = max(count[:2])
        at = np.clip(np.rint(dn) - first, 0, len(place) - 1).astype(np.intp)
        return np.asarray(count[place[at]], np.float64)

    def _highest(self, white_level: int) -> int:
        return white_level if self.rescaled else white_level >> self.dropped_bits

    def table(self, white_level_dn: float, black_level_dn: float) -> NDArray[np.uint16]:
        """Return the saved number for each number of the converter, (white level + 1,) uint16."""
        white = int(white_level_dn)
        numbers = np.arange(white + 1)
        if self.subtract_black_level:
            numbers = np.maximum(numbers - round(black_level_dn), 0)
        numbers >>= self.dropped_bits
        if self.rescaled:
            numbers <<= self.dropped_bits
        if self.companding is None:
            return numbers.astype(np.uint16)
        codes = self._codes(numbers, self._highest(white))
        if self.decoded:
            sums, counts = np.bincount(codes, numbers), np.bincount(codes)
            codes = np.rint(sums / np.maximum(counts, 1)).astype(np.int64)[codes]
        return codes.astype(np.uint16)

    def _codes(self, numbers: NDArray[np.int64], highest: int) -> NDArray[np.int64]:
        if isinstance(self.companding, tuple):
            return np.array(self.companding)[numbers]
        top = highest if self.companded_bits is None else (1 << self.companded_bits) - 1
        return np.asarray(np.rint(top * np.sqrt(numbers / highest)), np.int64)
