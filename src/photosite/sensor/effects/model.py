"""The section `effects` of a sensor file."""

from __future__ import annotations

from photosite.errors import InputError
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.sensor.effects.response_curve import ResponseCurve
from photosite.sensor.quantity import NO_UNIT, about
from photosite.values.validated import Section


class Effects(Section):
    """Effects beyond the pixel model; None for those that the sensor does not have.

    Examples
    --------
    >>> Effects(response_curve={"polynomial_percent": [0.0, -2.0]}).readout_channels is None
    True
    """

    response_curve: ResponseCurve | None = about(
        "Deviation of the signal from a straight response.", NO_UNIT, {"polynomial_percent": [0.0, -2.0]}, default=None
    )
    readout_channels: ReadoutChannels | None = about(
        "Gains and offsets of readout channels.", NO_UNIT, {"relative_gain": [[1.01, 0.99]]}, default=None
    )

    def check(self, rows: int, cols: int, well_capacity_e: float) -> None:
        """Raise `InputError` unless the effects are consistent with the sensor's size and well capacity."""
        try:
            if self.response_curve is not None:
                self.response_curve.check(well_capacity_e)
        except InputError as error:
            raise error.within("effects.response_curve") from None
        try:
            if self.readout_channels is not None:
                self.readout_channels.check(rows, cols)
        except InputError as error:
            raise error.within("effects.readout_channels") from None
