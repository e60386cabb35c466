"""Covered lines and overscan: left out of the frames that are calibrated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.frames.frame_set import FrameSet, without_border
from photosite.sensor.model import Sensor
from photosite.values.region import Border
from photosite.values.shown import Shown


@dataclass(frozen=True)
class CoveredLines(Finding, Shown):
    """Lines without light around the calibrated pixels, as the base sensor states them.

    Parameters
    ----------
    rows, cols
        Size of the calibrated frames.
    border
        Lines at top, bottom, left and right.
    """

    rows: int
    cols: int
    border: Border

    @property
    def present(self) -> bool:
        """Whether there are such lines."""
        return any(self.border)

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the size of the chip; a sensor file without such lines has no section of them."""
        top, bottom, left, right = self.border
        size = {"rows": self.rows + top + bottom, "cols": self.cols + left + right}
        return size if self.present or base.effects is None else size | {"optical_black": None}


def _measure(evidence: Evidence) -> CoveredLines:
    frames, base = evidence.reduction.frames, evidence.base
    border = None if base is None or base.effects is None else base.effects.border
    if base is not None and border is not None and evidence.chip is None:  # maps are of the calibrated pixels alone
        top, bottom, left, right = border
        if (frames.rows + top + bottom, frames.cols + left + right) == (base.array.rows, base.array.cols):
            return CoveredLines(frames.rows, frames.cols, border)
    return CoveredLines(frames.rows, frames.cols, (0, 0, 0, 0))


EFFECT = Effect(100, _measure, key=None, exempt={"figure": "stated by the file, not estimated"})


def without_covered_lines(frames: FrameSet, sensor: Sensor | None) -> FrameSet:
    """Return the frames without the lines that the sensor file states as covered or overscan, if they hold them."""
    border = None if sensor is None or sensor.effects is None else sensor.effects.border
    if sensor is None or border is None or not any(border) or frames.border is not None:
        return frames
    if (frames.rows, frames.cols) != (sensor.array.rows, sensor.array.cols):
        return frames
    return without_border(frames, border)
