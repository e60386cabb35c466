"""The response curve: how the signal deviates from a straight response to the collected charge."""

from __future__ import annotations

from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from photosite.errors import InputError
from photosite.sensor.effects.section import EffectSection, Limits
from photosite.sensor.quantity import NO_UNIT, Increasing, about, check_length
from photosite.values.validated import Number

_NODES = 4097


class ResponseCurve(EffectSection):
    """Deviation of the signal from a straight response with the system gain, which is that at small signal.

    signal = charge (1 + deviation / 100). The deviation is a table over the charge, or a polynomial in charge / well
    capacity without a constant term; both are 0 at a charge of 0.

    Examples
    --------
    >>> bent = ResponseCurve(polynomial_percent=(0.0, -2.0))
    >>> bent.signal_e([0, 5000, 10000], well_capacity_e=10000)
    array([   0., 4975., 9800.])
    >>> ResponseCurve(charge_e=(0, 10000), deviation_percent=(0, -2)).signal_e([10000], well_capacity_e=10000)
    array([9800.])
    """

    changes_response = True

    charge_e: Increasing | None = about(
        "Collected electrons, from 0, increasing. With deviation_percent.", "e-", [0, 5000, 10000], default=None
    )
    deviation_percent: tuple[Number, ...] | None = about(
        "Deviation of the signal at each charge; between entries a monotonic cubic, beyond the last one its value.",
        "%",
        [0, -0.4, -1.9],
        over="charge_e",
        default=None,
    )
    standard_uncertainty_percent: tuple[Annotated[float, Field(ge=0.0)], ...] | None = about(
        "Standard uncertainty of each deviation.", "%", [0, 0.1, 0.1], over="charge_e", default=None
    )
    polynomial_percent: tuple[Number, ...] | None = about(
        "Deviation as a polynomial in charge / well_capacity_e: factors of its first, second, ... power. Instead of a "
        "table.",
        "%",
        [0.0, -2.0],
        default=None,
    )
    source: str | None = about("Origin of the curve.", NO_UNIT, "data sheet, figure 9", default=None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.charge_e is None) == (self.polynomial_percent is None):
            both = "missing" if self.charge_e is None else "given"
            hint = "Give a table, charge_e with deviation_percent, or a polynomial"
            raise InputError(f"'charge_e' and 'polynomial_percent' are both {both}", hint=hint)
        if self.charge_e is None:
            return self
        count = len(self.charge_e)
        if self.deviation_percent is None:
            raise InputError("field 'deviation_percent' is missing", hint="Give one deviation per charge")
        check_length("deviation_percent", self.deviation_percent, "charge", count)
        if self.standard_uncertainty_percent is not None:
            check_length("standard_uncertainty_percent", self.standard_uncertainty_percent, "charge", count)
        if count < 2:
            raise InputError("charge_e", value=self.charge_e, expected="two entries or more")
        for name in ("charge_e", "deviation_percent"):
            if (first := getattr(self, name)[0]) != 0.0:
                raise InputError(f"{name}[0]", value=first, expected="0: the curve begins at the charge 0")
        return self

    def check(self, limits: Limits) -> None:
        """Raise `InputError` unless the signal rises with the charge up to the well capacity."""
        self.check_rising(limits.well_capacity_e)

    def check_rising(self, well_capacity_e: float) -> None:
        """Raise `InputError` unless the signal rises with the charge up to a well capacity."""
        grid = np.linspace(0.0, well_capacity_e, _NODES)
        if not (rising := np.diff(self.signal_e(grid, well_capacity_e)) > 0.0).all():
            first = float(grid[int(np.argmin(rising))])
            expected = "a signal that rises with the charge up to the well capacity"
            raise InputError("the curve", value=f"falls at {first:.6g} e-", expected=expected)

    def signal_e(self, charge_e: ArrayLike, well_capacity_e: float) -> NDArray[np.float64]:
        """Return the signal in electrons at values of the collected charge."""
        charge = np.asarray(charge_e, np.float64)
        if self.polynomial_percent is not None:
            deviation = np.polynomial.polynomial.polyval(charge / well_capacity_e, (0.0, *self.polynomial_percent))
        else:
            from scipy.interpolate import PchipInterpolator

            assert self.charge_e is not None
            cubic: Any = PchipInterpolator(self.charge_e, self.deviation_percent)
            deviation = cubic(np.clip(charge, 0.0, self.charge_e[-1]))
        return charge * (1.0 + deviation / 100.0)

    def charge_at(self, signal_e: float, well_capacity_e: float) -> float:
        """Return the charge that gives a signal, at most the well capacity; both in electrons.

        Examples
        --------
        >>> ResponseCurve(polynomial_percent=(-10.0,)).charge_at(4750.0, well_capacity_e=10000)
        5000.0
        """
        signal, step = self.nodes(well_capacity_e)
        return float(np.interp(signal_e, signal, np.arange(signal.size) * step))

    def nodes(self, well_capacity_e: float) -> tuple[NDArray[np.float64], float]:
        """Return the signal at equal steps of charge from 0 to the well capacity, and the step, electrons."""
        grid = np.linspace(0.0, well_capacity_e, _NODES)
        return self.signal_e(grid, well_capacity_e), float(grid[1])
