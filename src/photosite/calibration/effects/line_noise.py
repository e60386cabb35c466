"""Noise that the pixels of a row or of a column share in a frame and not in the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding, why_zero
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured


@dataclass(frozen=True)
class LineNoise(Finding, Shown):
    """Noise of rows and of columns, millivolts at the pixel and digital numbers."""

    row_noise_mv: Estimate
    column_noise_mv: Estimate
    row_noise_dn: Estimate
    column_noise_dn: Estimate

    @property
    def present(self) -> bool:
        """Whether rows or columns have noise beyond chance."""
        return self.row_noise_dn.beyond_chance or self.column_noise_dn.beyond_chance

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return both for a sensor file: 0 within chance, as most sensors have none."""
        return {
            name: entry.measured(source)
            if entry.beyond_chance
            else Measured(0.0, entry.standard_uncertainty or 0.0, f"{source}; {why_zero(entry)}")
            for name, entry in (("row_noise_mv", self.row_noise_mv), ("column_noise_mv", self.column_noise_mv))
            if entry.value is not None
        }


def _measure(evidence: Evidence) -> LineNoise:
    names = "row_noise_mv", "column_noise_mv", "row_noise_dn", "column_noise_dn"
    return LineNoise(*(getattr(evidence.parameters, name) for name in names))


EFFECT = Effect(
    10,
    _measure,
    key=None,
    exempt={"docs": "fields of the noise, on the page of the sensor file", "figure": "drawn with line_pattern"},
)
