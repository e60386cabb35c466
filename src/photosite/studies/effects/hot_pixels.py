"""Hot pixels: a log-normal tail of the dark current, or pixels of one dark current."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from photosite.sensor.effects.hot_pixels import HotPixels
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import DARK_CURRENT, DSNU1288, Drawing, EffectStudy, Range, TrueTerms, log_uniform
from photosite.studies.plain_camera import Disturbance


def _draw(drawing: Drawing, pixels: Range) -> dict[str, Any]:
    fraction, median = drawing.between(*pixels), drawing.between(200.0, 1000.0)
    return {"hot_pixels": {"fraction": fraction, "median_e_per_s": median, "log_spread": drawing.between(0.3, 0.8)}}


def _terms(hot: HotPixels, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    """Return that means and spreads are neither those of all pixels nor those without hot ones: a part is left out."""
    return TrueTerms(undefined=(*DARK_CURRENT, "dcnu_percent", *DSNU1288))


def _truth(hot: HotPixels, sensor: Sensor) -> Mapping[str, float]:
    gain = sensor.system_gain_dn_per_e
    if sensor.effects is not None and sensor.effects.blooming is not None:
        return {}  # the charge that flows over is dark current elsewhere
    return {
        "fraction": hot.fraction.value,
        "median_dn_per_s": hot.median_e_per_s.value * gain,
        "log_spread": hot.log_spread.value,
        "mean_dn_per_s": sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value) * gain,
        "dcnu_percent": sensor.noise.dcnu_percent.value,
    }


def _disturb(sensor: Sensor, rng: np.random.Generator) -> tuple[Disturbance, dict[str, float]]:
    """Draw 0.3 to 1 % hot pixels with 2000 to 6000 e-/s, which are left out of all figures."""
    return Disturbance(hot=(log_uniform(rng, 0.003, 0.01), log_uniform(rng, 2000.0, 6000.0))), {}


STUDY = EffectStudy(draw=_draw, terms=_terms, truth=_truth, disturb=_disturb)
