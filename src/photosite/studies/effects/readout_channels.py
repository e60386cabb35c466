"""Gains of odd and even columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from photosite.calibration.effects.readout_channels import ChannelDifferences
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import Drawing, EffectStudy, Range, TrueTerms
from photosite.studies.outcome import Outcome, Outcomes


def _draw(drawing: Drawing, percent: Range) -> dict[str, Any]:
    half = drawing.sign * drawing.between(*percent) / 200.0
    return {"readout_channels": {"relative_gain": [[1.0 + half, 1.0 - half]]}}


def _terms(true: ReadoutChannels, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    gains, offset_e = true.tables()
    gains = gains / gains.mean()
    return TrueTerms(
        offset_variance_e2=float(offset_e.var()),
        gain_variance=float(gains.var()),
        gains=gains.ravel(),
        # Lines that alternate pass the high-pass filter in full, unlike lines at random.
        undefined=("prnu1288_percent", "prnu1288_row_percent", "prnu1288_column_percent") if gains.std() else (),
    )


def _compare(found: ChannelDifferences, true: ReadoutChannels, sensor: Sensor) -> Outcomes:
    """Compare the gain of the first channel; the scale is the difference from the mean."""
    channels = found.channels
    if true is None or true.relative_gain is None:
        return {}
    if channels is None or channels.relative_gain is None or channels.arrangement != true.arrangement:
        return {"gain": "not found"}
    entry, expected = channels.relative_gain[0][0], true.relative_gain[0][0].value
    spread, scale = entry.standard_uncertainty, abs(expected - 1.0)
    return {"gain": Outcome.of(entry.value, spread, entry.interval_95, expected, scale)}


STUDY = EffectStudy(draw=_draw, terms=_terms, compare=_compare, planned=False)
