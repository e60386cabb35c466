"""Screening of results: values that cannot be true are withheld, with the likely cause."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.withheld import IMPLAUSIBLE
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Missing, Value

BEYOND_CHANCE = 2.0
"""Half-widths of a 95 % interval beyond which chance is not an explanation (1 in 10 000 for a normal distribution)."""

SHORTEST_DARKS_S = 1e-4
"""Longest dark exposure below which no dark current shows: 10 000 electrons per second give one electron."""

LONGEST_LIKELY_S = 1e-3
"""Least plausible value of a measurement's longest dark exposure, for the factor by which stated ones are wrong."""


@dataclass(frozen=True)
class Implausible(Missing):
    """A result that was computed and cannot be true, with the likely cause."""

    id: str = IMPLAUSIBLE.id


def screen_dark_slope(slope: Value, exposure_s: NDArray[np.float64], *, variance: bool = False) -> Value:
    """Return the slope of the dark level or variance against exposure, or why it cannot be a dark current.

    A dark current is not negative, and exposure times too short for any charge are in a wrong unit. The slope is in
    DN/s, or in DN^2/s `variance`; `exposure_s` holds the dark exposure times.
    """
    if isinstance(slope, Missing):
        return slope
    if (why := too_short_for_dark_current(exposure_s)) is not None:
        return why
    above = slope.interval_95[1] - slope.value
    if slope.value + BEYOND_CHANCE * above >= 0.0:
        return slope
    low, high = float(exposure_s.min()), float(exposure_s.max())
    fall, uncertainty = -slope.value * (high - low), slope.standard_uncertainty * (high - low)
    what, unit = ("temporal variance", "DN²") if variance else ("level", "DN")
    return Implausible(
        f"the dark {what} falls by {fall:.3g} ± {uncertainty:.1g} {unit} from {format_exposure(low)} to "
        f"{format_exposure(high)} s, but a dark current is not negative: the camera clamps its black level, the black "
        f"level drifted or the chip cooled between the exposures, or the stated exposure times are wrong (order, unit)"
    )


def too_short_for_dark_current(exposure_s: NDArray[np.float64]) -> Implausible | None:
    """Return why dark frames of these exposure times show no dark current; None if they can."""
    low, high = float(exposure_s.min()), float(exposure_s.max())
    if not 0.0 < high < SHORTEST_DARKS_S:
        return None
    factor = 1e3
    while high * factor < LONGEST_LIKELY_S:
        factor *= 1e3
    unit = {1e3: "microseconds", 1e6: "milliseconds", 1e9: "seconds"}.get(factor)
    where = "" if unit is None else f", {unit} in place of nanoseconds"
    return Implausible(
        f"the dark exposures are {low:.3g} to {high:.3g} s, too short for any dark current (none reaches "
        f"{SHORTEST_DARKS_S:g} s): an EMVA descriptor has nanoseconds, a protocol seconds, and these seem wrong by a "
        f"factor of {factor:.0f} or more ({low * factor:.3g} to {high * factor:.3g} s){where}; correct them"
    )


def screen_variance_slope(slope: Value, mean_slope: Value) -> Value:
    """Return the slope of the dark variance, or why it is withheld where that of the level is implausible.

    With black level clamping the dark current shows in the variance only (EMVA 1288 R4.0, dark current), which then
    grows beyond chance. Otherwise it is no more credible than the level.
    """
    if isinstance(slope, Missing) or not isinstance(mean_slope, Implausible):
        return slope
    if slope.value > BEYOND_CHANCE * (slope.value - slope.interval_95[0]):
        return slope
    return Implausible(f"the dark temporal variance does not grow beyond chance, and {mean_slope.reason}")


def screen_responsivity(responsivity: Value, gain: Value) -> Value:
    """Return the responsivity, or why it is withheld where the quantum efficiency would exceed 100 %."""
    if isinstance(responsivity, Missing) or isinstance(gain, Missing):
        return responsivity
    efficiency = responsivity / gain
    below = efficiency.value - efficiency.interval_95[0]
    if efficiency.value - BEYOND_CHANCE * below <= 1.0:
        return responsivity
    return Implausible(
        f"the stated photons give a quantum efficiency of {100 * efficiency.value:.4g} %, above 100 %: the photons per "
        f"pixel are too few by a factor of {efficiency.value:.2g} or more (another pixel area, exposure time or "
        f"wavelength, or irradiance in another unit)"
    )
