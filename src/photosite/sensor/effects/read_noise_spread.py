"""Read noise that differs from pixel to pixel."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from photosite.errors import InputError
from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import about


class ReadNoiseSpread(EffectSection):
    """Distribution of the pixels' read noise: log-normal, or quantiles that were measured.

    The root mean square over the pixels is the read noise of the sensor.

    Examples
    --------
    >>> ReadNoiseSpread(log_spread=0.2).relative(np.array([-1.0, 0.0, 1.0])).round(3).tolist()
    [0.787, 0.961, 1.174]
    >>> ReadNoiseSpread(quantiles=(1, 2)).relative(np.array([-9.0, 0.0, 9.0])).round(3).tolist()
    [0.655, 0.982, 1.309]
    """

    log_spread: Annotated[float, Field(ge=0.0, le=2.0)] | None = about(
        "Standard deviation of the natural logarithm of the read noise over the pixels.", "1", 0.2, default=None
    )
    quantiles: tuple[Annotated[float, Field(ge=0.0)], ...] | None = about(
        "Instead: read noise, in any unit, at equal steps of the fraction of pixels below, from 0 to 1.",
        "1",
        [0.7, 0.9, 1.0, 1.1, 2.5],
        default=None,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.log_spread is None) == (self.quantiles is None):
            both = "missing" if self.log_spread is None else "given"
            raise InputError(f"'log_spread' and 'quantiles' are both {both}", hint="Give one of them")
        values = np.array(self.quantiles or (0.0, 1.0))
        if len(values) < 2 or (np.diff(values) < 0.0).any() or values[-1] == 0.0:
            raise InputError(
                "quantiles", value=self.quantiles, expected="two or more, not decreasing, the last above 0"
            )
        return self

    def relative(self, deviates: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the noise over its root mean square at standard normal deviates."""
        if self.log_spread is not None:
            return np.asarray(np.exp(self.log_spread * deviates - self.log_spread**2))
        from scipy.special import ndtr

        values = np.array(self.quantiles, float)
        # The mean square of a quantile function that is linear between its entries
        square = np.mean((values[:-1] ** 2 + values[:-1] * values[1:] + values[1:] ** 2) / 3.0)
        at = np.interp(ndtr(deviates), np.linspace(0.0, 1.0, len(values)), values)
        return np.asarray(at / np.sqrt(square))
