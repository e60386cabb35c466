"""Gains and offsets of readout channels, from the periodic structure and the steps of mean frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding, SensorChanges, why_zero
from photosite.calibration.spatial.channel_tables import measured_channels
from photosite.sensor.effects.model import Effects
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured, Missing, Uncertain, Value


@dataclass(frozen=True)
class ChannelDifferences(Finding, Shown):
    """The readout channels where their gains or offsets differ, and the system gain in DN/e-."""

    channels: ReadoutChannels | None
    gain: Value

    @property
    def present(self) -> bool:
        """Whether channels differ."""
        return self.channels is not None

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the channels for a sensor file; those of the base without a system gain."""
        return {} if isinstance(self.gain, Missing) else {"readout_channels": self.channels}

    def subtract(self, changes: SensorChanges) -> dict[str, Any]:
        """Return the spreads of the pixels without those of readout channels, rows and columns."""
        lines = Effects(readout_channels=self.channels, line_pattern=changes.fields.get("line_pattern"))
        offset_e2, gain = lines.line_variances
        variances = {"prnu_percent": 1e4 * gain, "dcnu_percent": 1e4 * gain, "dsnu_mv": changes.mv_per_e**2 * offset_e2}
        found = {}
        for name, variance in variances.items():
            if (spread := changes.measured(name)) is not None and variance > 0.0:
                left = Uncertain.of(spread.value**2 - variance, 2.0 * spread.value * spread.standard_uncertainty)
                rest = Estimate.of_variance(left, "")
                note = f"{spread.source}; without rows, columns and readout channels"
                if (rest.value or 0.0) < 0.0:
                    note += f": {why_zero(rest)}"
                found[name] = Measured(max(rest.value or 0.0, 0.0), rest.standard_uncertainty or 0.0, note)
        return found

    def to_dict(self) -> Any:
        """Return the channels as in a sensor file, for JSON; None where they are alike."""
        return None if self.channels is None else self.channels.model_dump(mode="json")


def _measure(evidence: Evidence) -> ChannelDifferences:
    found, gain = evidence.patterns, evidence.light.gain
    channels = measured_channels(found.structure, found.dark_structure, found.taps, gain)
    return ChannelDifferences(channels, evidence.parameters.system_gain_dn_per_e.uncertain)


EFFECT = Effect(70, _measure)
