"""1/f drift of the black level, relative to the read noise of a pixel."""

from __future__ import annotations

import math
from typing import Any

from photosite.calibration.effects.black_level_drift import BlackLevelSeries, octaves_within
from photosite.sensor.effects.black_level_drift import BlackLevelDrift
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import Drawing, EffectStudy, Range
from photosite.studies.outcome import Outcomes, compare_estimates


def _draw(drawing: Drawing, fraction: Range) -> dict[str, Any]:
    return {"black_level_drift": {"standard_deviation_e": drawing.read_noise_e * drawing.between(*fraction)}}


def _compare(found: BlackLevelSeries, drift: BlackLevelDrift, sensor: Sensor) -> Outcomes:
    """Compare the standard deviation over the frames of the longest series."""
    size_e = drift.standard_deviation_e * math.sqrt(octaves_within(found.frames) / drift.octaves)
    return compare_estimates(found.estimates, {"drift_e": size_e, "drift_dn": size_e * sensor.system_gain_dn_per_e})


STUDY = EffectStudy(draw=_draw, compare=_compare, planned=False)
