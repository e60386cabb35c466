"""Charge transfer inefficiency of a CCD with overscan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from photosite.sensor.effects.charge_transfer import ChargeTransfer
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import AT_SATURATION, PRNU, RESPONSE, Drawing, EffectStudy, Range, TrueTerms


def _draw(drawing: Drawing, inefficiency: Range) -> dict[str, Any]:
    loss = {f"{direction}_inefficiency": drawing.between(*inefficiency) for direction in ("parallel", "serial")}
    return {"charge_transfer": loss, "optical_black": {"overscan_rows": 8, "overscan_cols": 8}}


def _terms(transfer: ChargeTransfer, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    """Return that pixels share a little charge, which changes their means and spreads."""
    return TrueTerms(undefined=(*RESPONSE, *PRNU, *AT_SATURATION, "dcnu_percent", "interpixel_coupling_percent"))


def _truth(transfer: ChargeTransfer, sensor: Sensor) -> Mapping[str, float]:
    return {name: getattr(transfer, f"{name}_inefficiency").value for name in ("parallel", "serial")}


STUDY = EffectStudy(draw=_draw, terms=_terms, truth=_truth, planned=False)
