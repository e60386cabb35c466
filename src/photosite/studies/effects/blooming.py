"""Blooming, beside hot pixels whose dark current overflows the well in long dark frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from photosite.sensor.effects.blooming import Blooming
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import DARK_CURRENT, DSNU1288, Drawing, EffectStudy, Range, TrueTerms


def _draw(drawing: Drawing, drained: Range) -> dict[str, Any]:
    """Draw the drained fraction; the well of hot pixels fills within a second or two."""
    hot = {"fraction": 0.004, "median_e_per_s": 0.6 * drawing.well_e, "log_spread": 0.4}
    return {"blooming": {"drained": drawing.between(*drained)}, "hot_pixels": hot}


def _terms(blooming: Blooming, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    """Return that overflowing pixels, and the columns beside them, have another dark current in each exposure time."""
    return TrueTerms(undefined=(*DARK_CURRENT, "dcnu_percent", *DSNU1288, "column_offset_e", "row_offset_e"))


def _truth(blooming: Blooming, sensor: Sensor) -> Mapping[str, float]:
    return {"kept": 1.0 - blooming.drained.value}


STUDY = EffectStudy(draw=_draw, terms=_terms, truth=_truth)
