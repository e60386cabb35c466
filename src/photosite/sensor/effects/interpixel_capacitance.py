"""Interpixel capacitance: the signal of a pixel couples to its neighbors after its charge was collected."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from photosite.errors import InputError
from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import NotNegative, about
from photosite.values.uncertain import Measured

_LARGEST_SHARE = 50.0


class InterpixelCapacitance(EffectSection):
    """Fractions of a pixel's signal that appear in its neighbors.

    Examples
    --------
    >>> coupling = InterpixelCapacitance(coupling_percent=1.0)
    >>> coupling.kernel()[1].tolist(), round(coupling.variance_factor, 4)
    ([0.01, 0.96, 0.01], 0.922)
    """

    coupling_percent: NotNegative = about("Fraction of the signal in each of the four next pixels.", "%", 1.2)
    diagonal_percent: NotNegative = about(
        "Fraction of the signal in each of the four diagonal neighbors.", "%", 0.1, default=Measured(0.0)
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (total := 4.0 * (self.coupling_percent.value + self.diagonal_percent.value)) > _LARGEST_SHARE:
            expected = f"at most {_LARGEST_SHARE:g} % in all eight neighbors"
            raise InputError("coupling_percent", value=total, expected=expected)
        return self

    def kernel(self) -> NDArray[np.float64]:
        """Return the (3, 3) fractions, with sum 1."""
        side, corner = self.coupling_percent.value / 100.0, self.diagonal_percent.value / 100.0
        row = [corner, side, corner]
        return np.array([row, [side, 1.0 - 4.0 * (side + corner), side], row])

    @property
    def variance_factor(self) -> float:
        """Variance that is left of noise that is independent between pixels: the sum of the squared fractions."""
        return math.fsum(np.square(self.kernel()).ravel())
