"""Defective pixels, with the maps of the chip; they are listed in the maps that lie beside a sensor file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.calibration.withheld import NO_MAPS
from photosite.sensor.chip import Defects
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing


@dataclass(frozen=True)
class FoundDefects(Finding, Shown):
    """The defective pixels of all kinds."""

    defects: Defects

    @property
    def present(self) -> bool:
        """Whether there are any."""
        return any(self.defects.counts().values())

    def to_dict(self) -> Any:
        """Return the number of each kind, for JSON."""
        return self.defects.counts()


def _measure(evidence: Evidence) -> FoundDefects | Missing:
    return NO_MAPS.missing(evidence.no_maps) if evidence.chip is None else FoundDefects(evidence.chip.defects)


EFFECT = Effect(110, _measure, key="defects", missing="absent")
