"""Dead pixels and clusters of them, all of which must be listed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from photosite.calibration.effects.pixel_defects import FoundDefects
from photosite.sensor.chip import DefectKind
from photosite.sensor.chip_effects import dead_pixels
from photosite.sensor.effects.pixel_defects import PixelDefects
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import Drawing, EffectStudy, Range, TrueTerms
from photosite.studies.outcome import Outcome, Outcomes


def _draw(drawing: Drawing, fraction: Range) -> dict[str, Any]:
    return {"pixel_defects": {"dead_fraction": drawing.between(*fraction), "clusters": 2, "cluster_pixels": 5}}


def _terms(defects: PixelDefects, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    """Return nothing: the figures are those of the other pixels."""
    return TrueTerms()


def _compare(found: FoundDefects, defects: PixelDefects, sensor: Sensor) -> Outcomes:
    """Compare the list of dead pixels, whose number is exact, with those of the chip."""
    assert found.defects is not None
    drawn = np.unique(dead_pixels(defects, sensor))
    dead = found.defects.kind == DefectKind.DEAD
    listed = found.defects.row[dead].astype(np.int64) * sensor.array.cols + found.defects.col[dead]
    wrong = np.setxor1d(drawn, listed).size
    return {"dead_pixels": Outcome(float(listed.size - drawn.size), 0.0, float(drawn.size) or 1.0, wrong == 0)}


STUDY = EffectStudy(draw=_draw, terms=_terms, compare=_compare)
