"""Integral nonlinearity of the analog-to-digital converter."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import about
from photosite.values.validated import Number


class ConverterError(EffectSection):
    """Error of the converter's codes against a straight line.

    Examples
    --------
    >>> ConverterError(error_lsb=[0, 1.5, 0]).table().tolist()
    [0.0, 1.5, 0.0]
    """

    error_lsb: Annotated[tuple[Number, ...], Field(min_length=2)] = about(
        "Integral nonlinearity at equal steps from 0 to the highest code, linear in between.", "LSB", [0, 1.5, -0.5, 0]
    )

    def table(self) -> NDArray[np.float64]:
        """Return the errors as an array."""
        return np.array(self.error_lsb)
