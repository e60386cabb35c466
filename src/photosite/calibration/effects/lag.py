"""Image lag: charge that stays in a pixel for the next frames. The sensor model has none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.calibration.withheld import EFFECT_NOT_SEEN
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing


@dataclass(frozen=True)
class Lag(Finding, Shown):
    """Correlation of the shot noise with that of the same pixel in the next frame."""

    correlation: float

    def to_dict(self) -> Any:
        """Return the correlation, for JSON."""
        return {"correlation": self.correlation}


def _measure(evidence: Evidence) -> Lag | Missing:
    shared = evidence.light.noise.shared
    if shared is None or shared.frames is None:
        return EFFECT_NOT_SEEN.missing("the noise of successive frames is not correlated beyond chance")
    return Lag(shared.frames)


_NO_MODEL = "frames are independent in the sensor model: a plain camera draws it for studies"
EFFECT = Effect(96, _measure, key=None, exempt=dict.fromkeys(("section", "drawing", "figure", "docs"), _NO_MODEL))
