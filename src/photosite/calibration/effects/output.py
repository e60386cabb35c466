"""Lossy digital stages behind the converter, which the reduction undoes or names."""

from __future__ import annotations

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.withheld import EFFECT_NOT_MEASURED
from photosite.values.uncertain import Missing


def _measure(evidence: Evidence) -> Missing:
    return EFFECT_NOT_MEASURED.missing(
        "digital gain, sums and companding are undone before the estimates, and named in the warnings"
    )


EFFECT = Effect(
    120,
    _measure,
    key=None,
    exempt=dict.fromkeys(("estimator", "figure"), "the reduction undoes digital stages, and diagnostics name them"),
)
