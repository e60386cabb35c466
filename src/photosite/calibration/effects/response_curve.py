"""Response curve: deviation of the signal from a straight response."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.calibration.photon_transfer import response_curve
from photosite.sensor.effects.response_curve import ResponseCurve
from photosite.sensor.model import Sensor
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Value


@dataclass(frozen=True)
class ResponseCurves(Finding, Shown):
    """The curve of each channel whose response bends, and the system gain in DN/e-."""

    curves: Mapping[str, response_curve.ResponseCurve]
    gain: Value

    @property
    def present(self) -> bool:
        """Whether the response of a channel bends."""
        return bool(self.curves)

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return one curve for a sensor file: the weighted mean at the charges of the channel with the widest range.

        That of the base without a system gain.
        """
        if isinstance(self.gain, Missing):
            return {}
        if not self.curves:
            return {"response_curve": None}
        tables = []
        for curve in self.curves.values():
            charge = np.array([entry.value for entry in curve.electrons])
            order = np.argsort(charge)
            deviation = np.array([entry.value for entry in curve.deviation_percent])
            spread = np.array([entry.standard_uncertainty for entry in curve.deviation_percent])
            tables.append((charge[order], deviation[order], spread[order]))
        grid = max((charge for charge, _, _ in tables), key=lambda charge: float(charge[-1]))
        grid = grid[np.append(True, np.diff(grid) > 1e-3 * grid[-1])]
        values, weights = np.zeros((2, grid.size))
        spread = np.full(grid.size, np.inf)
        for charge, deviation, own in tables:
            covered = grid <= charge[-1]
            at, u = (np.interp(grid, np.append(0.0, charge), np.append(0.0, part)) for part in (deviation, own))
            weight = covered / np.maximum(u, 1e-9) ** 2
            values += weight * at
            weights += weight
            # The channels share the gain, so that their mean is not better known than the best of them.
            spread = np.minimum(spread, np.where(covered, u, np.inf))
        return {
            "response_curve": ResponseCurve(
                charge_e=(0.0, *grid.tolist()),
                deviation_percent=(0.0, *(values / weights).tolist()),
                standard_uncertainty_percent=(0.0, *spread.tolist()),
                source=source,
            )
        }

    def to_dict(self) -> Any:
        """Return the curve of each channel, for JSON."""
        return {name: curve.to_dict() for name, curve in self.curves.items()}


def _measure(evidence: Evidence) -> ResponseCurves:
    curves = {name: channel.curve for name, channel in evidence.channels.items() if channel.curve is not None}
    return ResponseCurves(curves, evidence.parameters.system_gain_dn_per_e.uncertain)


EFFECT = Effect(15, _measure)
