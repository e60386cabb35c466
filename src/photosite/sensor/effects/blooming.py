"""Blooming: charge above the full well flows along the column."""

from __future__ import annotations

from photosite.sensor.quantity import UnitInterval, about
from photosite.values.validated import Section


class Blooming(Section):
    """Flow of the charge that a pixel cannot hold, half of it each way along the column.

    Examples
    --------
    >>> Blooming(drained=0.9).drained
    0.9
    """

    drained: UnitInterval = about(
        "Share of the charge above the full well that an anti-blooming drain removes.", "1", 0.9, default=0.0
    )
