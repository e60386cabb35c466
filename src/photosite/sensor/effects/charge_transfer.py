"""Charge transfer inefficiency of a CCD: at each transfer a share of the charge stays behind."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from photosite.errors import InputError
from photosite.sensor.effects.section import Corner, EffectSection
from photosite.sensor.quantity import NO_UNIT, NotNegative, about
from photosite.values.uncertain import Measured

_LARGEST = 1e-3
_LEFT_OUT = 1e-9
"""Share of the charge that may arrive later than is computed; it counts as the latest that is."""


class ChargeTransfer(EffectSection):
    """Inefficiency of the transfers to the output, which lies at a corner of the array.

    Counted from the output, row r takes r + 1 parallel transfers and column c takes c + 1 serial ones. What stays
    behind at a transfer joins the charge of the next pixel. Charge that arrives after the last line of the frame is
    lost from it.

    Examples
    --------
    >>> ChargeTransfer(parallel_inefficiency=1e-5).row_shares(2000)[:2, -1].round(5).tolist()
    [0.9802, 0.0196]
    """

    placed = True
    of_single_captures = True

    parallel_inefficiency: NotNegative = about(
        "Share of the charge that stays behind at a transfer along a column.", "1", 5e-6, default=Measured(0.0)
    )
    serial_inefficiency: NotNegative = about(
        "Share of the charge that stays behind at a transfer along a row.", "1", 1e-6, default=Measured(0.0)
    )
    output: Corner = about("Corner of the output.", NO_UNIT, "top_left", default="top_left")

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("parallel_inefficiency", "serial_inefficiency"):
            if (value := getattr(self, name).value) > _LARGEST:
                raise InputError(name, value=value, expected=f"at most {_LARGEST:g}")
        return self

    def nominal(self) -> Self:
        """Return that the sensor is a CCD with its output at this corner."""
        return type(self)(output=self.output)

    @property
    def order(self) -> tuple[slice, slice]:
        """Index that gives a frame's rows and columns in the order in which they are read, and back."""
        up, left = self.output.startswith("bottom"), self.output.endswith("right")
        return slice(None, None, -1 if up else 1), slice(None, None, -1 if left else 1)

    def row_shares(self, rows: int) -> NDArray[np.float64]:
        """Return (late, rows): the share of each row's charge that arrives so many rows late, in reading order."""
        return late_shares(self.parallel_inefficiency.value, rows)

    def column_shares(self, cols: int) -> NDArray[np.float64]:
        """Return (late, cols): the share of each column's charge that arrives so many columns late, likewise."""
        return late_shares(self.serial_inefficiency.value, cols)


def late_shares(inefficiency: float, lines: int) -> NDArray[np.float64]:
    """Return (late, lines): the share of charge after 1 to `lines` transfers that arrives so many transfers late.

    An electron that is transferred n times stays behind m times with the probability of a negative binomial
    distribution, C(n + m - 1, m) (1 - s)^n s^m. The shares of a line sum to 1.
    """
    from scipy.stats import nbinom

    most = int(nbinom.isf(_LEFT_OUT, lines, 1.0 - inefficiency)) if inefficiency else 0
    n = np.arange(1.0, lines + 1.0)
    shares = np.empty((most + 1, lines))
    shares[0] = (1.0 - inefficiency) ** n
    for m in range(1, most + 1):
        shares[m] = shares[m - 1] * (inefficiency * (n + m - 1.0) / m)
    shares[-1] += 1.0 - shares.sum(axis=0)
    return shares
