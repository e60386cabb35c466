"""Defective pixels: those that all figures are without, and with maps the list that lies beside a sensor file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from photosite.calibration.chip_maps.defect_groups import DefectGroup, group_defects
from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.calibration.reduction.defective_pixels import BadPixel, DefectivePixels
from photosite.calibration.spatial.left_out import LeftOut
from photosite.calibration.withheld import NO_MAPS
from photosite.sensor.chip import Defects
from photosite.sensor.effects.hot_pixels import HotPixels
from photosite.sensor.effects.pixel_defects import ListedDefect, PixelDefects
from photosite.sensor.effects.telegraph_noise import TelegraphNoise
from photosite.sensor.model import Sensor
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured, Missing, Value

LEAST_HOT = 3
"""Hot pixels from which the spread of their dark currents is known."""


@dataclass(frozen=True)
class FoundDefects(Finding, Shown):
    """The defective pixels of all kinds.

    Parameters
    ----------
    defects
        Those in the maps of the chip; None without maps.
    left_out
        Those that all figures are without; None if there are none.
    gain
        System gain in DN/e-.
    """

    defects: Defects | None
    left_out: LeftOut | None
    gain: Value

    @property
    def present(self) -> bool:
        """Whether there are any."""
        return self.left_out is not None or (self.defects is not None and any(self.defects.counts().values()))

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the pixels that were left out, for a sensor file; with maps, these have them."""
        if self.left_out is None or self.defects is not None:
            return {}
        pixels = self.left_out.pixels
        listed = pixels.of(BadPixel.DEAD) | pixels.of(BadPixel.STUCK)
        found = {"pixel_defects": _listed(pixels)} if listed.any() else {}
        if isinstance(self.gain, Missing):
            return found
        return found | _hot(pixels, self.gain.value, source) | _blinking(pixels, self.gain.value)

    def to_dict(self) -> Any:
        """Return the number of each kind in the maps, and what was left out, for JSON."""
        counts = {} if self.defects is None else dict(self.defects.counts())
        return counts if self.left_out is None else {**counts, "left_out": self.left_out.to_dict()}


def _listed(pixels: DefectivePixels) -> PixelDefects:
    """Return dead and stuck pixels: fractions of single ones, numbers of columns and clusters, stuck lines by place."""
    total, fields = pixels.shape[0] * pixels.shape[1], {}
    listed = []
    for kind, name in ((BadPixel.DEAD, "dead"), (BadPixel.STUCK, "stuck")):
        chosen = pixels.of(kind)
        row, col = (part[chosen] for part in pixels.place)
        groups = group_defects(row, col, pixels.shape)
        single = [group for group in groups if group.shape == "pixel" or len(group) == 1]
        fields[f"{name}_fraction"] = len(single) / total
        joined = [group for group in groups if group not in single]
        columns = [group for group in joined if _whole_column(group, pixels.shape[0])]
        if kind == BadPixel.DEAD:
            fields["dead_columns"] = len(columns)
            joined = [group for group in joined if group not in columns]
            clusters = [group for group in joined if group.shape == "cluster"]
            if clusters:
                fields["clusters"] = len(clusters)
                fields["cluster_pixels"] = min(max(round(float(np.mean([len(group) for group in clusters]))), 2), 1000)
            joined = [group for group in joined if group not in clusters]
        for group in joined:
            values = pixels.mean_dn[-1] if kind == BadPixel.STUCK else pixels.response
            value = float(np.median(values[chosen][group.index]))
            (r0, c0), (r1, c1) = group.first, group.last
            listed.append(ListedDefect(kind=name, rows=(r0, r1), cols=(c0, c1), value=max(value, 0.0)))
    return PixelDefects(**fields, listed=tuple(listed))


def _whole_column(group: DefectGroup, rows: int) -> bool:
    return group.shape == "column" and 2 * len(group) > rows


def _hot(pixels: DefectivePixels, gain: float, source: str) -> dict[str, Any]:
    """Return the hot pixels, log-normal over those that were left out."""
    rates = pixels.rate_dn_per_s[pixels.of(BadPixel.HOT)] / gain
    rates = rates[rates > 0.0]
    n = len(rates)
    if n < LEAST_HOT:
        return {}
    logs, note = np.log(rates), f"{source}: {n} pixels that are left out of the other figures"
    spread, total = max(float(logs.std(ddof=1)), 1e-3), pixels.shape[0] * pixels.shape[1]
    median = math.exp(float(np.median(logs)))
    return {
        "hot_pixels": HotPixels(
            fraction=Measured(n / total, math.sqrt(n) / total, note),
            median_e_per_s=Measured(median, 1.2533 * median * spread / math.sqrt(n), note),
            log_spread=Measured(spread, spread / math.sqrt(2 * (n - 1)), note),
        )
    }


def _blinking(pixels: DefectivePixels, gain: float) -> dict[str, Any]:
    """Return noisy pixels as blinking ones with the same mean variance: <a^2> / 6 of exponential distances a."""
    variance = pixels.noise_dn2[pixels.of(BadPixel.NOISY) & ~pixels.steady_dark]
    if not len(variance) or not np.isfinite(variance).all():
        return {}
    amplitude_e = math.sqrt(3.0 * float(variance.mean())) / gain
    fraction = len(variance) / (pixels.shape[0] * pixels.shape[1])
    return {"telegraph_noise": TelegraphNoise(fraction=fraction, amplitude_e=amplitude_e)}


def _measure(evidence: Evidence) -> FoundDefects | Missing:
    chip, left_out = evidence.chip, evidence.left_out
    if chip is None and left_out is None:
        return NO_MAPS.missing(evidence.no_maps)
    gain = evidence.parameters.system_gain_dn_per_e.uncertain
    return FoundDefects(None if chip is None else chip.defects, left_out, gain)


EFFECT = Effect(110, _measure, key="defects", missing="absent")
