"""Hot pixels: the tail of the dark current's distribution."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import LogSpread, NotNegative, UnitFraction, about
from photosite.values.uncertain import Measured


class HotPixels(EffectSection):
    """Pixels with additional dark current, drawn from the serial: log-normal over these pixels.

    Examples
    --------
    >>> HotPixels(fraction=0.001, median_e_per_s=200).log_spread.value
    1.0
    """

    fraction: UnitFraction = about("Fraction of the pixels that are hot.", "1", 0.001)
    median_e_per_s: NotNegative = about(
        "Median of their additional dark current, at the temperature of the dark current.", "e-/s", 200.0
    )
    log_spread: LogSpread = about("Standard deviation of its natural logarithm.", "1", 1.0, default=Measured(1.0))

    def with_dark_current(self, ratio: float) -> Self:
        """Return hot pixels with a dark current that is larger or smaller by a ratio.

        Examples
        --------
        >>> HotPixels(fraction=0.001, median_e_per_s=200).with_dark_current(2).median_e_per_s.value
        400.0
        """
        median = self.median_e_per_s
        changed = replace(median, value=ratio * median.value, standard_uncertainty=ratio * median.standard_uncertainty)
        return self.model_copy(update={"median_e_per_s": changed})
