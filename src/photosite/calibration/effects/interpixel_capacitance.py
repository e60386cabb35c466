"""Interpixel capacitance: signal that couples to neighboring pixels."""

from __future__ import annotations

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.photon_transfer.pixel_coupling import PixelCoupling
from photosite.values.uncertain import Missing


def _measure(evidence: Evidence) -> PixelCoupling | Missing:
    return evidence.light.noise.coupling


EFFECT = Effect(90, _measure, key=None, exempt={"figure": "one number, in the table of all parameters"})
