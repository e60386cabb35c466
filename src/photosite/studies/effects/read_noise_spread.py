"""Log-normal distribution of the read noise over the pixels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from photosite.sensor.effects.read_noise_spread import ReadNoiseSpread
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import Drawing, EffectStudy, Range


def _draw(drawing: Drawing, spread: Range) -> dict[str, Any]:
    return {"read_noise_spread": {"log_spread": drawing.between(*spread)}}


def _truth(spread: ReadNoiseSpread, sensor: Sensor) -> Mapping[str, float]:
    return {} if spread.log_spread is None else {"read_noise_log_spread": spread.log_spread}


STUDY = EffectStudy(draw=_draw, truth=_truth)
