"""Image lag: charge that stays in a pixel for the next frame."""

from __future__ import annotations

import numpy as np

from photosite.sensor.model import Sensor
from photosite.studies.effect_study import EffectStudy, log_uniform
from photosite.studies.plain_camera import Disturbance


def _disturb(sensor: Sensor, rng: np.random.Generator) -> tuple[Disturbance, dict[str, float]]:
    """Draw a fraction of 1.5 to 5 % of the charge that stays for the next frame."""
    return Disturbance(lag=log_uniform(rng, 0.015, 0.05)), {}


STUDY = EffectStudy(disturb=_disturb)
