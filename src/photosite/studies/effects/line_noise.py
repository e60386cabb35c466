"""Noise of rows and of columns, relative to the read noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from photosite.sensor.model import Sensor
from photosite.sensor.sections import Noise
from photosite.studies.effect_study import Drawing, EffectStudy, Range, TrueTerms, log_uniform
from photosite.studies.plain_camera import Disturbance


def _draw(drawing: Drawing, fraction: Range) -> dict[str, Any]:
    names = "row_noise_mv", "column_noise_mv"
    return {name: drawing.read_noise_mv * drawing.between(*fraction) for name in names}


def _terms(noise: Noise, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    truth: dict[str, float] = {}
    for name in ("row_noise", "column_noise"):
        mv = getattr(noise, f"{name}_mv").value
        electrons = sensor.electrons(mv)
        truth |= {f"{name}_dn": electrons * sensor.system_gain_dn_per_e, f"{name}_e": electrons, f"{name}_mv": mv}
    return TrueTerms(parameters=truth)


def _disturb(sensor: Sensor, rng: np.random.Generator) -> tuple[Disturbance, dict[str, float]]:
    """Draw row noise of 0.1 to 1 times the read noise."""
    fraction = log_uniform(rng, 0.1, 1.0)
    sigma_dn = sensor.noise.read_noise_mv.value / sensor.mv_per_dn * fraction
    total = dict.fromkeys(
        ("read_noise_dn", "read_noise_e", "read_noise_mv", "temporal_dark_noise_e"), math.hypot(1.0, fraction)
    ) | dict.fromkeys(("row_noise_dn", "row_noise_e", "row_noise_mv"), fraction)
    return Disturbance(numbers=lambda values, rng, _: values + rng.normal(0.0, sigma_dn, (len(values), 1))), total


STUDY = EffectStudy(section="noise", draw=_draw, terms=_terms, disturb=_disturb)
