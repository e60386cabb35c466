"""A value with its standard uncertainty, as in a sensor file."""

from __future__ import annotations

import math
from dataclasses import dataclass

from photosite.errors import InputError

COVERAGE_95 = 1.959963984540054
"""Half-width of a 95 % interval in standard uncertainties (normal distribution)."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A value with its standard uncertainty and source.

    Parameters
    ----------
    value, standard_uncertainty
        In the unit at the end of the field's name; the standard uncertainty (GUM) of an exact value is 0.
    source, assumed
        Origin of the value; whether it is an assumption, neither measured nor published.

    Raises
    ------
    InputError
        If the value is not finite, or the uncertainty is negative or not finite.

    Examples
    --------
    >>> read_noise_mv = Measured(0.52, 0.004, source="150 dark frames")
    >>> float(read_noise_mv), [round(x, 4) for x in read_noise_mv.interval_95]
    (0.52, [0.5122, 0.5278])
    """

    value: float
    standard_uncertainty: float = 0.0
    source: str | None = None
    assumed: bool = False

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise InputError("value", value=self.value, expected="a finite number")
        if not (math.isfinite(self.standard_uncertainty) and self.standard_uncertainty >= 0):
            expected = "a finite number, 0 or above"
            raise InputError("standard_uncertainty", value=self.standard_uncertainty, expected=expected)

    def __float__(self) -> float:
        return self.value

    @property
    def interval_95(self) -> tuple[float, float]:
        """Lower and upper end of the 95 % interval."""
        half = COVERAGE_95 * self.standard_uncertainty
        return self.value - half, self.value + half
