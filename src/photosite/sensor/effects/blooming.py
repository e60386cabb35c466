"""Blooming: charge above the full well flows along the column."""

from __future__ import annotations

from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import UnitFraction, about
from photosite.values.uncertain import Measured


class Blooming(EffectSection):
    """Flow of the charge that a pixel cannot hold, half of it each way along the column.

    Examples
    --------
    >>> Blooming(drained=0.9).drained.value
    0.9
    """

    placed = True
    of_single_captures = True

    drained: UnitFraction = about(
        "Share of the charge above the full well that an anti-blooming drain removes.", "1", 0.9, default=Measured(0.0)
    )
