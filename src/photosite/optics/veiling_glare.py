"""Veiling glare: light that the lens scatters over the sensor."""

from __future__ import annotations

from dataclasses import dataclass

from photosite.optics.checks import check_number


@dataclass(frozen=True)
class VeilingGlare:
    """Light that lens surfaces and the barrel scatter over the sensor.

    Parameters
    ----------
    fraction
        Scattered fraction of all arriving light, 0 to below 1: the veiling glare index of a uniform field (ISO 9358).
    spread_m
        Decay length on the sensor: the scatter falls as exp(-distance / spread_m). None: uniform over the frame.

    Examples
    --------
    >>> VeilingGlare(0.02, spread_m=3e-3)
    VeilingGlare(fraction=0.02, spread_m=0.003)
    """

    fraction: float
    spread_m: float | None = None

    def __post_init__(self) -> None:
        check_number("fraction", self.fraction, "a fraction from 0 to below 1", at_least=0, below=1)
        if self.spread_m is not None:
            hint = "Leave it out for uniform glare"
            check_number("spread_m", self.spread_m, "above 0", above=0, hint=hint)
