"""Random errors of the converter's codes."""

from __future__ import annotations

from typing import Any

import numpy as np

from photosite.calibration.effects.converter_error import ConverterCodes
from photosite.sensor.effects.converter_error import ConverterError
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import Drawing, EffectStudy, Range
from photosite.studies.outcome import Outcomes, compare_estimates


def _draw(drawing: Drawing, rms_lsb: Range) -> dict[str, Any]:
    error = drawing.between(*rms_lsb) * drawing.rng.standard_normal(1 << drawing.bits)
    return {"converter_error": {"error_lsb": tuple(error.round(4).tolist())}}


def _compare(found: ConverterCodes, error: ConverterError, sensor: Sensor) -> Outcomes:
    """Compare the root mean squares with those of what the flat fields can show of the errors."""
    table = error.table()
    code = np.arange(table.size)
    upper = np.interp(code + 0.5, code + table, code)  # inputs at the upper ends of the codes
    dnl, inl = found.fast_part(np.diff(upper, prepend=-0.5) - 1.0)
    truth = {"dnl_rms_lsb": float(np.sqrt((dnl**2).mean())), "inl_rms_lsb": float(np.sqrt((inl**2).mean()))}
    return compare_estimates(found.estimates, truth)


STUDY = EffectStudy(draw=_draw, compare=_compare)
