"""Distribution of the read noise over the pixels, with the maps of the chip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.calibration.withheld import NO_MAPS
from photosite.sensor.effects.read_noise_spread import ReadNoiseSpread
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing


@dataclass(frozen=True)
class NoiseSpread(Finding, Shown):
    """Standard deviation over the pixels of the natural logarithm of their read noise."""

    log_spread: Estimate

    @property
    def present(self) -> bool:
        """Whether the pixels differ beyond chance."""
        return self.log_spread.beyond_chance

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The spread."""
        return {"read_noise_log_spread": self.log_spread}

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the spread for a sensor file; none within chance, that of the base where it could not be measured."""
        if self.log_spread.value is None:
            return {}
        within = self.log_spread.upper_limit_95 is not None
        return {"read_noise_spread": None if within else ReadNoiseSpread(log_spread=self.log_spread.value)}


def _measure(evidence: Evidence) -> NoiseSpread | Missing:
    parameters = evidence.parameters
    if evidence.temporal is None:
        return NO_MAPS.missing(evidence.no_maps)
    for needed in (parameters.system_gain_dn_per_e, parameters.read_noise_mv):
        if needed.value is None:
            return Missing(needed.reason or "", needed.reason_id)
    return NoiseSpread(evidence.temporal.read_noise_log_spread)


EFFECT = Effect(82, _measure, key=None, exempt={"figure": "in the table of the noise in the dark"})
