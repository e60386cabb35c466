"""Amplifier glow of one edge or corner."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

from photosite.calibration.effects.glow import GlowMap
from photosite.sensor.effects.glow import Glow, Place
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import DSNU1288, Drawing, EffectStudy, Range, TrueTerms
from photosite.studies.outcome import Outcome, Outcomes


def _draw(drawing: Drawing, peak_e_per_s: Range) -> dict[str, Any]:
    place = get_args(Place)[int(drawing.rng.integers(8))]
    peak, decay = drawing.between(*peak_e_per_s), drawing.between(6.0, 16.0)
    return {"glow": {"places": [place], "peak_e_per_s": peak, "decay_pixels": decay}}


def _terms(glow: Glow, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    """Return the glow of the pixels; in long dark frames rows and columns differ by it."""
    rate = glow.map(sensor.array.rows, sensor.array.cols)
    return TrueTerms(dark_e_per_s=float(rate.mean()), dark_variance=float(rate.var()), undefined=DSNU1288)


def _truth(glow: Glow, sensor: Sensor) -> Mapping[str, float]:
    peak = glow.peak_e_per_s
    return {
        "peak_e_per_s": peak,
        "peak_dn_per_s": peak * sensor.system_gain_dn_per_e,
        "decay_pixels": glow.decay_pixels,
    }


def _compare(found: GlowMap, glow: Glow, sensor: Sensor) -> Outcomes:
    """Compare the places, which are exact where they are clear."""
    return {"places": Outcome(0.0, 0.0, 1.0, set(found.places) == set(glow.places))} if found.present else {}


STUDY = EffectStudy(draw=_draw, terms=_terms, truth=_truth, compare=_compare)
