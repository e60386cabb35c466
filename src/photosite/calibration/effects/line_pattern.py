"""Fixed offsets of rows and columns, and gains of columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.sensor.effects.line_pattern import LinePattern
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown


@dataclass(frozen=True)
class FixedLines(Finding, Shown):
    """Spread of the offsets of rows and of columns in electrons, and of the gains of columns in percent."""

    row_offset_e: Estimate
    column_offset_e: Estimate
    column_gain_percent: Estimate

    @property
    def present(self) -> bool:
        """Whether one of them is beyond chance."""
        return any(entry.beyond_chance for entry in self.estimates.values())

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the pattern that is beyond chance; parts that could not be measured are those of the base."""
        assumed = None if base.effects is None else base.effects.line_pattern
        found = {}
        for name, usual in assumed or LinePattern():
            entry: Estimate = getattr(self, name)
            if entry.value is None:
                found[name] = usual
            elif entry.beyond_chance:
                found[name] = entry.measured(source)
        return {"line_pattern": LinePattern(**found) if any(part.value for part in found.values()) else None}


def _measure(evidence: Evidence) -> FixedLines:
    return FixedLines(*(getattr(evidence.parameters, name) for name in LinePattern.model_fields))


EFFECT = Effect(60, _measure, key=None)
