"""Checks of the dark frames: clipping, missing noise, exposure times, a black level that moves, subtracted frames."""

from __future__ import annotations

import math
from collections.abc import Iterator

from scipy.special import chdtri

from photosite.calibration.dark.black_level_change import DRIFT, SHIFT
from photosite.calibration.dark.clipped_darks import CLIPPED_DARKS
from photosite.calibration.dark.cut_tail import CUT_TAIL
from photosite.calibration.diagnostics import Check
from photosite.calibration.evidence import Evidence
from photosite.calibration.photon_transfer.without_darks import BRIGHTER_FATTER
from photosite.calibration.reduction.groups import pooled_level
from photosite.calibration.withheld import ONE_DARK_EXPOSURE, UNKNOWN_DARK_NOISE
from photosite.values.diagnostic import Diagnostic, DiagnosticKind, one_in
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Missing, Uncertain, derive

_DARK_NOISE = ("read_noise_*", "dsnu_*", "black_level_dn")


def clipped_darks(evidence: Evidence) -> Iterator[Diagnostic]:
    """Dark frames whose numbers are 0 in more pixels than noise explains, or in a few noisy ones."""
    dark = evidence.dark
    if dark.clipped is not None:
        size = max(found.zero_fraction for found in dark.clipped.censored)
        yield CLIPPED_DARKS(dark.clipped.warning(evidence.reduction.names), size)
    if dark.cut is not None and (text := dark.cut.warning()) is not None:
        yield CUT_TAIL(text, dark.cut.zeros)


def unknown_dark_noise(evidence: Evidence) -> Iterator[Diagnostic]:
    """What is missing without the noise of dark frames, and what to add."""
    dark, lights, gain = evidence.dark, evidence.reduction.lights, evidence.light.gain
    if not dark.noise_unknown:
        return
    lacking = "black level, dark current, read noise, DSNU" if dark.level_unknown else "read noise, DSNU"
    text = f"{dark.noise_unknown}; without them {lacking} and what follows from them are not known"
    if not isinstance(gain, Missing):
        text += "; the system gain comes from the differences between flat fields"
        if dark.level_unknown:
            text += (
                f", and its uncertainty contains a variance that is {100.0 * BRIGHTER_FATTER:.0f} % too small in the "
                f"brightest (brighter-fatter effect), as far as the variances do not exclude it"
            )
    elif dark.level_unknown and lights:
        means = sorted(pooled_level(entry.levels).mean for entry in lights)
        ends = f"{means[0]:.2f}" if len(means) == 1 else f"{means[0]:.2f} to {means[-1]:.2f}"
        text += f"; the flat fields have a mean of {ends} DN"
    yield UNKNOWN_DARK_NOISE(text)


LONG_DARKS_S = 0.01
"""Exposure time from which dark frames of this time only cause a warning: 100 electrons per second leave one."""

DSNU_WITH_DARK_CURRENT = DiagnosticKind(
    "dsnu-with-dark-current",
    "warning",
    "Dark frames are clipped at 0, and those of the DSNU have a dark current.",
    "DSNU includes the nonuniformity of the dark current, which clipped frames do not show.",
    "Raise the camera's black level, or take most dark frames at a shorter exposure time.",
    ("dsnu_*",),
    "dark signal of the frames, DN",
)


def dark_exposures(evidence: Evidence) -> Iterator[Diagnostic]:
    """Black level, read noise or DSNU that include the dark current of long dark frames."""
    dark = evidence.dark
    if not dark.groups:
        return
    longest = max(entry.group.exposure_s for entry in dark.groups)
    what = "black level is that" if dark.noise_unknown else "black level, read noise and DSNU are those"
    if all(lines.mean.fit is None for lines in dark.lines):
        if longest >= LONG_DARKS_S:
            yield ONE_DARK_EXPOSURE(
                f"all dark frames have the exposure time {format_exposure(longest)} s: {what} at this time, with its "
                f"dark current, which is not known; take dark frames at a second, much shorter exposure time",
                longest,
            )
        return
    if dark.clipped is None:
        return
    for m in dark.channels:
        signal = derive(lambda slope: slope * dark.reference_exposure_s, m.dark_slope)
        assert isinstance(m.dsnu_variance, Uncertain)
        if isinstance(signal, Uncertain) and signal.value**2 > 3.0 * m.dsnu_variance.standard_uncertainty:
            yield DSNU_WITH_DARK_CURRENT(
                f"DSNU is that at {format_exposure(dark.reference_exposure_s)} s and includes the nonuniformity of "
                f"{signal.value:.3g} DN of dark current, which clipped dark frames do not show; raise the black "
                f"level, or take most dark frames at a shorter exposure time",
                signal.value,
            )
            return


def moving_black_level(evidence: Evidence) -> Iterator[Diagnostic]:
    """A black level that shifts or drifts over the dark frames."""
    change = evidence.dark.change
    if change.notable(change.shift):
        yield SHIFT(change.warning(f"shifts by {change.shift:.2g} DN from frame to frame"), change.shift)
    if change.notable(change.drift):
        yield DRIFT(change.warning(f"drifts by {change.drift:.2g} DN"), change.drift)


DARK_SCATTER_P_VALUE = 1e-4
"""Fraction of clean sets whose dark levels may scatter as far about their line."""

NOTABLE_SCATTER = 0.1
"""Least scatter that is reported, as a fraction of the spread of the pixels."""

DARK_SCATTER = DiagnosticKind(
    "dark-levels-scatter",
    "warning",
    "The dark levels do not lie on a straight line against the exposure time.",
    "The uncertainties of black level, dark current from the mean, read noise and DSNU were widened.",
    "Check the stated exposure times; keep temperature and black level constant.",
    (*_DARK_NOISE, "dark_current_dn_per_s", "dark_current_e_per_s", "dark_voltage_*"),
    "scatter about the line, DN",
    f"below {one_in(DARK_SCATTER_P_VALUE)} clean sets",
)


def dark_scatter(evidence: Evidence) -> Iterator[Diagnostic]:
    """Dark levels that do not lie on a line against exposure, where nothing else says why."""
    dark = evidence.dark
    noise = max((pooled_level(entry.levels).spatial_variance for entry in dark.groups), default=0.0)
    moved = dark.change.notable(dark.change.shift) or dark.change.notable(dark.change.drift)
    for lines in dark.lines:
        fit = lines.mean.fit
        if fit is None or fit.degrees_of_freedom == 0 or moved:
            continue
        scatter = math.sqrt(fit.extra_variance)
        beyond_chance = fit.chi_square > float(chdtri(fit.degrees_of_freedom, DARK_SCATTER_P_VALUE))
        rounded = scatter < 0.5 and dark.rounding_shows  # means of numbers without noise are whole numbers
        if beyond_chance and scatter**2 > NOTABLE_SCATTER**2 * noise and not rounded:
            yield DARK_SCATTER(
                f"the dark levels scatter by {scatter:.2g} DN about a straight line against exposure, beyond their "
                f"noise: a stated exposure time is wrong, or black level or temperature changed; the uncertainties of "
                f"black level, dark current from the mean, read noise and DSNU were widened accordingly",
                scatter,
            )
            return


LEAST_PATTERN = 0.05
"""DSNU over read noise below which a dark frame was probably subtracted; sensors have 0.1 and more."""

NO_FIXED_PATTERN = DiagnosticKind(
    "no-fixed-pattern",
    "warning",
    f"DSNU is below {100 * LEAST_PATTERN:.0f} % of the read noise.",
    "A dark frame was probably subtracted in the camera. DSNU and dark current are those that are left, and the read "
    "noise contains that of the subtracted frame.",
    "Switch off the dark frame subtraction (long exposure noise reduction), and take the frames again.",
    ("read_noise_*", "dsnu*", "dark_current_*", "dark_voltage_*"),
    "DSNU over read noise",
)


def missing_pattern(evidence: Evidence) -> Iterator[Diagnostic]:
    """Dark frames without fixed pattern, as after a dark frame was subtracted in the camera."""
    dsnu, read = evidence.pooled.dsnu_variance, evidence.pooled.read_variance
    if isinstance(dsnu, Missing) or isinstance(read, Missing) or read.value <= 0.0 or evidence.pooled.dark_method:
        return
    if dsnu.interval_95[1] <= LEAST_PATTERN**2 * read.value:
        yield NO_FIXED_PATTERN(
            f"the dark frames have no fixed pattern: DSNU is below {100 * LEAST_PATTERN:.0f} % of the read noise, as "
            f"after a dark frame was subtracted in the camera; DSNU and dark current are then those that are left, and "
            f"the read noise contains that of the subtracted frame (1.41 times the sensor's for a single one)",
            math.sqrt(max(dsnu.value, 0.0) / read.value),
        )


CHECKS = (
    Check("result", 20, clipped_darks),
    Check("result", 30, unknown_dark_noise),
    Check("result", 40, dark_exposures),
    Check("result", 50, moving_black_level),
    Check("result", 60, dark_scatter),
    Check("result", 120, missing_pattern),
)
