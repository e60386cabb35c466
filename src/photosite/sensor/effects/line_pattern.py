"""Fixed pattern of whole rows and columns: offsets of rows and columns, gains of columns."""

from __future__ import annotations

from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import NotNegative, ResponseSpread, about
from photosite.values.uncertain import Measured


class LinePattern(EffectSection):
    """Standard deviations over the rows and columns of a chip, normal and drawn from its serial.

    Examples
    --------
    >>> LinePattern(column_offset_e=2.0, column_gain_percent=0.3).row_offset_e.value
    0.0
    """

    row_offset_e: NotNegative = about(
        "Fixed offsets of the rows, standard deviation.", "e-", 0.5, default=Measured(0.0)
    )
    column_offset_e: NotNegative = about(
        "Fixed offsets of the columns, standard deviation.", "e-", 2.0, default=Measured(0.0)
    )
    column_gain_percent: ResponseSpread = about(
        "Gains of the columns relative to their mean, standard deviation.", "%", 0.3, default=Measured(0.0)
    )

    @property
    def line_variances(self) -> tuple[float, float]:
        """Variance of the offsets of rows and columns, e-^2, and of the gains of columns."""
        offset = self.row_offset_e.value**2 + self.column_offset_e.value**2
        return offset, (self.column_gain_percent.value / 100.0) ** 2
