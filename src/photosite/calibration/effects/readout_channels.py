"""Gains and offsets of readout channels, from the periodic structure and the steps of mean frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.calibration.amplifiers import amplifier_channels
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


_AGREE_SIGMA = 4.0
"""Standard uncertainties up to which steps between mean signals are the ratios of amplifiers' gains."""


def _of_amplifiers(own: ReadoutChannels, by_steps: ReadoutChannels | None) -> ReadoutChannels:
    """Return amplifiers as channels, with the gains by the steps of mean flat fields where these agree.

    Steps are more precise, and need light without a step; the offsets are those of the amplifiers.
    """
    if by_steps is None or by_steps.arrangement != "blocks" or not (own.relative_gain and by_steps.relative_gain):
        return own
    times = tuple(count // part for count, part in zip(by_steps.shape, own.shape, strict=True))
    if tuple(count * part for count, part in zip(times, own.shape, strict=True)) != by_steps.shape:
        return own

    def repeated(table: tuple[tuple[Measured, ...], ...]) -> list[list[Measured]]:
        return [[entry for entry in row for _ in range(times[1])] for row in table for _ in range(times[0])]

    for row, steps in zip(repeated(own.relative_gain), by_steps.relative_gain, strict=True):
        for entry, step in zip(row, steps, strict=True):
            if abs(entry.value - step.value) > _AGREE_SIGMA * entry.standard_uncertainty:
                return own
    offsets = None if own.offset_e is None else repeated(own.offset_e)
    return ReadoutChannels.model_validate(
        {"arrangement": "blocks", "relative_gain": by_steps.relative_gain, "offset_e": offsets}
    )


def _measure(evidence: Evidence) -> ChannelDifferences:
    found, gain = evidence.patterns, evidence.light.gain
    channels = measured_channels(found.structure, found.dark_structure, found.taps, gain)
    frames = evidence.reduction.frames
    own = amplifier_channels(evidence.amplifiers, frames.rows, frames.cols)
    if own is not None:
        channels = _of_amplifiers(own, channels)
    return ChannelDifferences(channels, evidence.parameters.system_gain_dn_per_e.uncertain)


EFFECT = Effect(70, _measure)
