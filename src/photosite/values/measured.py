"""A value with its standard uncertainty: what a measurement gives and a sensor file keeps."""

from __future__ import annotations

import math
from dataclasses import dataclass

from photosite.errors import InputError

COVERAGE_95 = 1.959963984540054
"""Half-width of a 95 % interval in standard uncertainties (normal distribution)."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A value and what is known about it.

    Parameters
    ----------
    value
        The value, in the unit that the name it is stored under ends in.
    standard_uncertainty
        One standard deviation of the value (GUM), in the same unit; 0 for a value taken as exact.
    source
        Where the value comes from.
    assumed
        True where nobody measured or published the value and it is an assumption.

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
            raise InputError(f"a measured value must be a finite number, not {self.value}")
        if not (math.isfinite(self.standard_uncertainty) and self.standard_uncertainty >= 0):
            raise InputError(f"a standard uncertainty must be finite and not negative, not {self.standard_uncertainty}")

    def __float__(self) -> float:
        return self.value

    @property
    def interval_95(self) -> tuple[float, float]:
        """The 95 % interval, lower and upper end."""
        half = COVERAGE_95 * self.standard_uncertainty
        return self.value - half, self.value + half
