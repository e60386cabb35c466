"""Pixels that blink, with amplitudes of 1 to 10 times the read noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from photosite.sensor.effects.telegraph_noise import TelegraphNoise
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import AT_SATURATION, READ_NOISE, Drawing, EffectStudy, Range, TrueTerms


def _draw(drawing: Drawing, pixels: Range) -> dict[str, Any]:
    fraction = drawing.between(*pixels)
    return {"telegraph_noise": {"fraction": fraction, "amplitude_e": drawing.read_noise_e * drawing.between(1.0, 10.0)}}


def _terms(noise: TelegraphNoise, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    """Return that the read noise is neither that of all pixels nor that without blinking: a part is left out."""
    return TrueTerms(read_variance_e2=noise.variance_e2, undefined=(*READ_NOISE, *AT_SATURATION))


def _truth(noise: TelegraphNoise, sensor: Sensor) -> Mapping[str, float]:
    amplitude_dn = noise.amplitude_e * sensor.system_gain_dn_per_e
    return {"blinking_fraction": noise.fraction, "blinking_amplitude_dn": amplitude_dn}


STUDY = EffectStudy(draw=_draw, terms=_terms, truth=_truth, planned=False)
