"""Covered lines around the pixels with light, whose parameters must remain those of the sensor."""

from __future__ import annotations

from typing import Any

from photosite.studies.effect_study import Drawing, EffectStudy, Range


def _draw(drawing: Drawing, lines: Range) -> dict[str, Any]:
    """Draw an even number of lines for each side."""
    sides = "top", "bottom", "left", "right"
    return {"optical_black": {side: 2 * round(0.5 * drawing.between(*lines)) for side in sides}}


STUDY = EffectStudy(draw=_draw)
