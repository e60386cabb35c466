"""Response curve: a cubic bend, and the deviation at half and at the largest signal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from photosite.calibration.effects.response_curve import ResponseCurves
from photosite.sensor.effects.response_curve import ResponseCurve
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import Drawing, EffectStudy, Range, TrueTerms, log_uniform
from photosite.studies.outcome import Outcome, Outcomes
from photosite.studies.plain_camera import Disturbance, bent


def _draw(drawing: Drawing, percent: Range) -> dict[str, Any]:
    """Draw a deviation at the well capacity, of either sign."""
    return {"response_curve": {"polynomial_percent": (0.0, drawing.sign * drawing.between(*percent))}}


def _terms(bend: ResponseCurve, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    well_e = sensor.pixel.well_capacity_e.value
    return TrueTerms(signal_of_well_e=float(bend.signal_e(well_e, well_e)))


def _compare(found: ResponseCurves, bend: ResponseCurve, sensor: Sensor) -> Outcomes:
    """Compare the deviation at half and at the largest signal below saturation."""
    result: Outcomes = {}
    gain, well_e = sensor.system_gain_dn_per_e, sensor.pixel.well_capacity_e.value
    full = 0.9 * sensor.saturation_capacity_e * gain
    for curve in found.curves.values():
        for name, fraction in (("half", 0.5), ("full", 1.0)):
            level = int(np.argmin(np.abs(curve.signal_dn - fraction * full)))
            signal_e = float(curve.signal_dn[level]) / gain
            true = 100.0 * (signal_e / bend.charge_at(signal_e, well_e) - 1.0)
            entry = curve.deviation_percent[level]
            result[f"{name}_percent"] = Outcome.of(entry.value, entry.standard_uncertainty, entry.interval_95, true)
    return result


def _disturb(sensor: Sensor, rng: np.random.Generator) -> tuple[Disturbance, dict[str, float]]:
    """Draw a response bent by 0.5 to 10 % at saturation, of either sign, with the second to fourth power."""
    size = log_uniform(rng, 0.005, 0.1) * rng.choice([-1.0, 1.0])
    return Disturbance(charge=bent(size, int(rng.integers(2, 5)), sensor.saturation_capacity_e)), {}


STUDY = EffectStudy(draw=_draw, terms=_terms, compare=_compare, disturb=_disturb, planned=False)
