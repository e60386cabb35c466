"""Gains and offsets of readout channels, from the periodic structure and the steps of mean frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from photosite.calibration.amplifiers import amplifier_channels, within_amplifiers
from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding, SensorChanges, why_zero
from photosite.calibration.spatial.channel_tables import measured_channels
from photosite.sensor.effects.model import Effects
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate, signed_square
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured, Missing, Uncertain, Value

PIXELS: Mapping[str, tuple[str, tuple[str, str]]] = {
    "dsnu_dn": ("dsnu_within_channels_dn", ("DSNU within readout channels", "DN")),
    "dsnu_e": ("dsnu_within_channels_e", ("DSNU within readout channels", "e⁻")),
    "dsnu_mv": ("dsnu_within_channels_mv", ("DSNU within readout channels", "mV")),
    "prnu_percent": ("prnu_within_channels_percent", ("PRNU within readout channels", "%")),
    "dcnu_percent": ("dcnu_within_channels_percent", ("DCNU within readout channels", "%")),
}
"""Nonuniformities of the pixels without the differences between readout channels: name, label and unit, by the
parameter that includes these differences."""


@dataclass(frozen=True)
class ChannelDifferences(Finding, Shown):
    """The readout channels where their gains or offsets differ, and the system gain in DN/e-.

    `pixels` are DSNU, PRNU and DCNU without these differences, by the names of the parameters that include them; empty
    where the channels are alike.
    """

    channels: ReadoutChannels | None
    gain: Value
    pixels: Mapping[str, Estimate] = field(default_factory=dict)

    @property
    def present(self) -> bool:
        """Whether channels differ."""
        return self.channels is not None or bool(self.pixels)

    @property
    def estimates(self) -> Mapping[str, Estimate]:
        """DSNU, PRNU and DCNU within the readout channels."""
        return {PIXELS[name][0]: entry for name, entry in self.pixels.items()}

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the channels for a sensor file; those of the base without a system gain."""
        return {} if isinstance(self.gain, Missing) else {"readout_channels": self.channels}

    def subtract(self, changes: SensorChanges) -> dict[str, Any]:
        """Return the spreads of the pixels without those of readout channels, rows and columns."""
        channels = Effects(readout_channels=self.channels).line_variances
        lines = Effects(line_pattern=changes.fields.get("line_pattern")).line_variances
        found = {}
        for name in ("prnu_percent", "dcnu_percent", "dsnu_mv"):
            if (spread := changes.measured(name)) is None:
                continue
            known = name in self.pixels and self.pixels[name].value is not None
            if self.channels is not None:  # differences that the file does not state stay in the spread
                known &= (self.channels.offset_e if name == "dsnu_mv" else self.channels.relative_gain) is not None
            if name == "dcnu_percent" and changes.fields.keys() & {"hot_pixels", "glow"}:
                known = False  # the spread is not that of all pixels
            offset_e2, gain = lines if known else np.add(lines, channels).tolist()
            variance = changes.mv_per_e**2 * offset_e2 if name == "dsnu_mv" else 1e4 * gain
            if not known and variance == 0.0:
                continue
            own = self.pixels[name].measured("") if known else spread
            square = signed_square(own.value) - variance
            rest = Estimate.of_variance(Uncertain.of(square, 2.0 * abs(own.value) * own.standard_uncertainty), "")
            note = f"{spread.source}; without rows, columns and readout channels"
            if (rest.value or 0.0) < 0.0:
                note += f": {why_zero(rest)}"
            found[name] = Measured(max(rest.value or 0.0, 0.0), rest.standard_uncertainty or 0.0, note)
        return found

    def to_dict(self) -> Any:
        """Return the channels as in a sensor file and the estimates, for JSON; None where the channels are alike."""
        if not self.present:
            return None
        channels = {} if self.channels is None else self.channels.model_dump(mode="json")
        return {**channels, **super().to_dict()}


_AGREE_SIGMA = 4.0
"""Standard uncertainties up to which steps between mean signals are the ratios of amplifiers' gains."""


def _of_amplifiers(own: ReadoutChannels, by_steps: ReadoutChannels | None) -> ReadoutChannels:
    """Return amplifiers as channels, with the gains by the steps of mean flat fields where these agree.

    Steps are more precise, and need light without a step; the offsets are those of the amplifiers.
    """
    if by_steps is None or by_steps.arrangement != "blocks" or by_steps.relative_gain is None:
        return own
    times = tuple(count // part for count, part in zip(by_steps.shape, own.shape, strict=True))
    if tuple(count * part for count, part in zip(times, own.shape, strict=True)) != by_steps.shape:
        return own

    def repeated(table: tuple[tuple[Measured, ...], ...]) -> list[list[Measured]]:
        return [[entry for entry in row for _ in range(times[1])] for row in table for _ in range(times[0])]

    if own.relative_gain is not None:
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
    pixels = {} if evidence.alike is None else {name: getattr(evidence.alike, name) for name in PIXELS}
    if evidence.amplifiers and (channels is not None or evidence.amplifier_gains is not None):
        of_each = within_amplifiers(evidence.amplifiers, evidence.parameters)
        pixels |= {name: entry for name, entry in of_each.items() if entry.value is not None}
    return ChannelDifferences(channels, evidence.parameters.system_gain_dn_per_e.uncertain, pixels)


EFFECT = Effect(70, _measure, labels=dict(PIXELS.values()))
