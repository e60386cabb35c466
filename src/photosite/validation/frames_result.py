"""What a validation of real frames is told, and what it found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from photosite.frames.raw_frame import RawFrame
from photosite.optics.protocols import Optics
from photosite.scene.scene import DEFAULT_DISTANCE_M
from photosite.sensor.model import Sensor
from photosite.validation.fill_factor import FillFactorFit
from photosite.validation.lamp import Lamp
from photosite.validation.result import Validation
from photosite.values.region import Corners, Quadrilateral

Fitted = Literal["fill_factor", "light"]
FITTED: tuple[Fitted, ...] = ("fill_factor", "light")
"""What may be left to the frames to say: one of these, since both scale all patches alike."""


@dataclass(frozen=True, eq=False)
class Told:
    """What the simulation is told of the camera and its scene.

    Parameters
    ----------
    sensor
        The sensor file. Its size is that of the frames in the simulation; its colour filter array is what the frames
        are read by.
    optics
        The lens.
    lamp
        The light on the chart.
    exposure_s
        Of the frames; None takes what they say.
    luminance_cd_m2
        Mean luminance of the chart's patches; None takes the lamp's.
    distance_m
        From the lens to the chart.
    """

    sensor: Sensor
    optics: Optics
    lamp: Lamp
    exposure_s: float | None = None
    luminance_cd_m2: float | None = None
    distance_m: float = DEFAULT_DISTANCE_M


@dataclass(frozen=True, eq=False)
class FrameValidation:
    """Raw frames against their simulation.

    Parameters
    ----------
    validation
        The comparison of patches, after the fit where there was one.
    told
        What the simulation was told; exposure and luminance as they were used in the end.
    corners, patches
        Of the chart's field of patches, and the parts that were compared, in pixels.
    fitted, fit
        What was fitted, and what the fit said, as a fill factor; None where nothing was.
    contradictions
        What cannot be: facts of the files that the sensor file denies, a fitted value no camera has.
    diagnosis
        What explains the difference, where there is one.
    measured, simulated
        The first frame of each.
    frames
        How many were measured and simulated.
    notes
        What was assumed or left out.
    """

    validation: Validation
    told: Told
    corners: Corners
    patches: tuple[Quadrilateral, ...]
    fitted: Fitted | None
    fit: FillFactorFit | None
    contradictions: tuple[str, ...]
    diagnosis: tuple[str, ...]
    measured: RawFrame
    simulated: RawFrame
    frames: tuple[int, int]
    notes: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether patches agree at the stated level, and nothing contradicts."""
        return self.validation.agrees and not self.contradictions

    @property
    def reasons(self) -> tuple[str, ...]:
        """The verdict in words: contradictions, each test, by how much they differ, and what explains it."""
        return (*self.contradictions, *self.validation.reasons, *self.diagnosis)

    @property
    def fit_in_words(self) -> str | None:
        """What was fitted, with its standard error and 95 % interval; None where nothing was."""
        if self.fit is None:
            return None
        scale = 1.0 if self.fitted == "fill_factor" else (self.told.luminance_cd_m2 or 0.0) / self.fit.value
        low, high = (scale * end for end in self.fit.interval_95)
        luminance = ("mean luminance of the patches", " cd/m2")
        what, unit = ("fill factor", "") if self.fitted == "fill_factor" else luminance
        error = scale * self.fit.standard_error
        places = max(0, 1 - math.floor(math.log10(error))) if error > 0 else 6  # the error to two digits
        value, known, low_end, high_end = (f"{x:.{places}f}" for x in (scale * self.fit.value, error, low, high))
        return f"fitted: {what} {value} ± {known}{unit} (95 % interval {low_end} to {high_end})"

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, numbers and strings for JSON: `Validation.to_dict`, and what this one adds."""
        told = self.told
        return self.validation.to_dict() | {
            "agrees": self.agrees,
            "reasons": list(self.reasons),
            "notes": [*self.notes, *self.validation.notes],
            "contradictions": list(self.contradictions),
            "diagnosis": list(self.diagnosis),
            "sensor": told.sensor.name,
            "illuminant": told.lamp.name,
            "luminance_cd_m2": told.luminance_cd_m2,
            "exposure_s": told.exposure_s,
            "distance_m": told.distance_m,
            "corners": [list(corner) for corner in self.corners],
            "frames": list(self.frames),
            "fitted": self.fitted,
            "fit": None if self.fit is None else self.fit.to_dict(),
        }
