"""Charge transfer inefficiency of a CCD: at each transfer a share of the charge stays behind."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.sensor.quantity import about
from photosite.values.validated import Section

_LEFT_OUT = 1e-9
"""Share of the charge that may arrive later than is computed; it counts as the latest that is."""

_Inefficiency = Annotated[float, Field(strict=True, ge=0.0, le=1e-3)]


class ChargeTransfer(Section):
    """Inefficiency of the transfers to the output, which lies at the first row and the first column.

    Row r takes r + 1 parallel transfers and column c takes c + 1 serial ones. What stays behind at a transfer joins the
    charge of the next pixel. Charge that arrives after the last pixel is lost from the frame.

    Examples
    --------
    >>> ChargeTransfer(parallel_inefficiency=1e-5).row_shares(2000)[:2, -1].round(5).tolist()
    [0.9802, 0.0196]
    """

    parallel_inefficiency: _Inefficiency = about(
        "Share of the charge that stays behind at a transfer along a column.", "1", 5e-6, default=0.0
    )
    serial_inefficiency: _Inefficiency = about(
        "Share of the charge that stays behind at a transfer along a row.", "1", 1e-6, default=0.0
    )

    def row_shares(self, rows: int) -> NDArray[np.float64]:
        """Return (late, rows): the share of each row's charge that arrives so many rows late."""
        return late_shares(self.parallel_inefficiency, rows)

    def column_shares(self, cols: int) -> NDArray[np.float64]:
        """Return (late, cols): the share of each column's charge that arrives so many columns late."""
        return late_shares(self.serial_inefficiency, cols)


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
