"""Low bits that are dropped behind the converter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from photosite.sensor.effects.output import Output
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import AT_SATURATION, VOLTS, Drawing, EffectStudy, Range, TrueTerms


def _draw(drawing: Drawing, bits: Range) -> dict[str, Any]:
    return {"output": {"dropped_bits": round(drawing.between(*bits))}}


def _terms(output: Output, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    """Return the scale of the numbers; what is dropped is half a step on average. Volts are those of the converter."""
    step = 2.0**output.dropped_bits
    return TrueTerms(digital_scale=1.0 / step, black_shift_dn=-0.5 * (step - 1.0), undefined=(*AT_SATURATION, *VOLTS))


STUDY = EffectStudy(draw=_draw, terms=_terms, planned=False)
