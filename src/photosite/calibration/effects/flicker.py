"""Flicker of the light under a rolling shutter, which is no part of a sensor file."""

from __future__ import annotations

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.light.flicker import Flicker
from photosite.calibration.withheld import EFFECT_NOT_SEEN
from photosite.values.uncertain import Missing


def _measure(evidence: Evidence) -> Flicker | Missing:
    return evidence.light.noise.flicker or EFFECT_NOT_SEEN.missing(
        "rows vary no more in flat fields than in dark frames"
    )


_OF_THE_LIGHT = "the light flickers, not the sensor: a scene draws it"
EFFECT = Effect(95, _measure, exempt=dict.fromkeys(("section", "drawing", "figure", "docs"), _OF_THE_LIGHT))
