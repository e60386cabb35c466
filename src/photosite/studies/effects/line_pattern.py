"""Fixed offsets of rows and columns over the DSNU, and gains of columns in percent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from photosite.sensor.effects.line_pattern import LinePattern
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import Drawing, EffectStudy, Range, TrueTerms


def _draw(drawing: Drawing, size: Range) -> dict[str, Any]:
    offsets = {f"{line}_offset_e": drawing.between(*size) * drawing.dsnu_e for line in ("row", "column")}
    return {"line_pattern": offsets | {"column_gain_percent": drawing.between(*size)}}


def _terms(pattern: LinePattern, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    parameters = {name: entry.value for name, entry in pattern}
    return TrueTerms(
        offset_variance_e2=parameters["row_offset_e"] ** 2 + parameters["column_offset_e"] ** 2,
        gain_variance=(parameters["column_gain_percent"] / 100.0) ** 2,
        parameters=parameters,
    )


STUDY = EffectStudy(draw=_draw, terms=_terms)
