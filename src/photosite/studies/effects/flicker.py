"""Flicker of the light under a rolling shutter."""

from __future__ import annotations

import numpy as np

from photosite.sensor.model import Sensor
from photosite.studies.effect_study import EffectStudy, log_uniform
from photosite.studies.plain_camera import Disturbance, bands


def _disturb(sensor: Sensor, rng: np.random.Generator) -> tuple[Disturbance, dict[str, float]]:
    """Draw bands of 0.2 to 2 % with a period of 10 to 40 rows."""
    return Disturbance(light=bands(log_uniform(rng, 0.002, 0.02), log_uniform(rng, 10.0, 40.0))), {}


STUDY = EffectStudy(disturb=_disturb)
