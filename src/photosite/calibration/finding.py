"""What a calibration finds of one effect, and how it becomes a part of a sensor file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from photosite.sensor.file_units import CONVERSION
from photosite.sensor.model import Sensor
from photosite.values.diagnostic import Diagnostic
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Measured


@dataclass(frozen=True)
class SensorChanges:
    """Fields of a sensor file that a calibration gives, by the names that `Sensor.with_` takes.

    Parameters
    ----------
    base
        The sensor as known before the measurement.
    source
        Where the values are from, for the file.
    fields
        The changed fields.
    """

    base: Sensor
    source: str
    fields: Mapping[str, Any]

    @property
    def mv_per_e(self) -> float:
        """Millivolts at the pixel per electron."""
        return float(1e-3 * self.fields[CONVERSION].value)

    def measured(self, name: str) -> Measured | None:
        """Return a changed value; None where the field is unchanged."""
        return self.fields.get(name)

    def updated(self, fields: Mapping[str, Any]) -> SensorChanges:
        """Return the changes with other fields."""
        return SensorChanges(self.base, self.source, {**self.fields, **fields})


class Finding:
    """Base class of what is found of an effect."""

    __slots__ = ()

    @property
    def present(self) -> bool:
        """Whether the effect is there beyond chance."""
        return True

    @property
    def estimates(self) -> Mapping[str, Estimate]:
        """The estimates by name: by default, those fields that are estimates."""
        return {name: entry for name, entry in vars(self).items() if isinstance(entry, Estimate)}

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Parameters that the effect makes wrong by more than their uncertainty."""
        return ()

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the fields of a sensor file that state the effect, as `Sensor.with_` takes them.

        None as a value states that the sensor does not have the effect; a field that is left out stays as in `base`.
        """
        return {}

    def subtract(self, changes: SensorChanges) -> dict[str, Any]:
        """Return the fields that would count the effect a second time, without it."""
        return {}

    def to_dict(self) -> Any:
        """Return the estimates, for JSON."""
        return {name: entry.to_dict() for name, entry in self.estimates.items()}


def why_zero(estimate: Estimate) -> str:
    """Return why a sensor file states 0 for a noise or nonuniformity, without a unit.

    Files may state the value in another unit than the estimate, so that limits are multiples of its uncertainty.
    """
    if (limit := estimate.upper_limit_95) is not None and (unit := estimate.standard_uncertainty):
        return f"not distinguishable from 0, 95 % upper limit {limit / unit:.3g} times the standard uncertainty"
    if (estimate.value or 0.0) < 0.0:
        return "the variance is negative"
    if not estimate.value or not estimate.standard_uncertainty:
        return "the estimate is 0"
    ratio = estimate.value / estimate.standard_uncertainty
    return f"the estimate, {ratio:.3g} times the standard uncertainty, is within chance of 0"
