"""Limitations of a calibration as warnings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.special import chdtri

from photosite.calibration.checks.level_checks import digital_gain_warnings, find_first_frames, level_warnings
from photosite.calibration.checks.result_screening import Implausible
from photosite.calibration.dark.dark_result import DarkResult
from photosite.calibration.effects.em_gain import stated_gain_warning
from photosite.calibration.evidence import Evidence
from photosite.calibration.measurements import Measurements
from photosite.calibration.parameters import least_dark_variance
from photosite.calibration.photon_transfer.channel import Channel, response_warnings
from photosite.calibration.photon_transfer.level_outliers import outlier_warning
from photosite.calibration.photon_transfer.photon_transfer import GainFit
from photosite.calibration.photon_transfer.without_darks import BRIGHTER_FATTER
from photosite.calibration.reduction.groups import GroupStatistics, pooled_level
from photosite.calibration.spatial.nonuniformity import is_large
from photosite.values.estimate import Estimate
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Missing, Uncertain, Value, derive

SCATTER = 4.0
"""Chi square per degree of freedom of the photon transfer above which a warning is given."""

LONG_DARKS_S = 0.01
"""Exposure time from which dark frames of this time only cause a warning: 100 electrons per second leave one."""

OFF_BY_CHANCE, NOTABLE = 1e-4, 0.1
"""Share of clean sets whose dark levels may scatter this far; least scatter, as a share of the spread of the pixels."""

FAR_BELOW_ZERO, PARTS_FAR_BELOW_ZERO, LINES_FAR_BELOW_ZERO = 4.75, 6.85, 15.0
"""At this many uncertainties below zero, a standard deviation's variance is over three of its uncertainties below; over
four, for the parts of patterns by rows and columns, of which one is below three in 1 of 50 chips with planes of 24
rows; and over eight, for the noise of rows and columns: its uncertainty falls with the variance of few lines that
happen to be alike, so that three are exceeded in 8 of 1000 clean sets of four frames with 48 rows, and eight in 1 of
2000 of two frames with 24 rows."""

LEAST_PATTERN = 0.05
"""DSNU over read noise below which a dark frame was probably subtracted; sensors have 0.1 and more."""


def calibration_warnings(evidence: Evidence) -> Iterator[str]:
    """Yield the limitations of a calibration."""
    yield from _warnings(evidence)
    base = evidence.base
    stated = None if base is None or base.effects is None else base.effects.em_gain
    if stated is not None:
        text = stated_gain_warning(stated, evidence.parameters.system_gain_dn_per_e)
        if text is not None:
            yield text


def _warnings(evidence: Evidence) -> Iterator[str]:
    reduction, dark, light, patterns = evidence.reduction, evidence.dark, evidence.light, evidence.patterns
    pooled, estimates = evidence.pooled, evidence.parameters.estimates()
    names, channels = reduction.names, light.channels
    yield from reduction.frames.notes
    if dark.clipped is not None:
        yield dark.clipped.warning(names)
    if dark.cut is not None:
        yield from dark.cut.warnings()
    if dark.noise_unknown:
        yield _incomplete_warning(dark, reduction.lights, light.gain)
    yield from _dark_exposure_warnings(dark)
    yield from dark.change.warnings()
    if (scattered := _dark_scatter_warning(dark)) is not None:
        yield scattered
    yield from level_warnings(reduction, dark.groups, channels)
    if (first := find_first_frames(reduction)) is not None:
        yield str(first)
    yield from digital_gain_warnings(reduction)
    yield from dict.fromkeys(str(entry) for entry in reduction.sums if entry is not None)
    if (missing := _missing_pattern_warning(pooled)) is not None:
        yield missing
    if light.outliers:
        yield outlier_warning(reduction.lights, light.outliers)
    if light.tone is not None:
        yield str(light.tone)
        return
    if light.processed is not None:
        yield light.processed.reason
    if light.bend is not None:
        yield (
            f"the means of the flat fields do not lie on a straight line against the stated light: the response bends, "
            f"or the light is not in proportion. Without dark frames these cannot be distinguished, and the "
            f"uncertainty of the system gain, {100 * light.bend.relative:.2g} % from this alone, covers both"
        )
    yield from light.noise.warnings()
    yield from (str(found) for found in (patterns.structure, patterns.dark_structure) if found is not None)
    yield from map(str, patterns.taps)
    yield from map(str, patterns.far)
    named = sum(float(np.var(taps.level)) for taps in patterns.taps if not taps.dark)
    if patterns.structure is not None:
        named += float(patterns.structure.relative.var())
    if is_large(derive(lambda shading: shading - named, pooled.shading_variance), pooled.response_variance):
        yield _shading_warning(estimates)
    yield from response_warnings(names, channels)
    for name, value in (("dark current", pooled.dark_slope), ("quantum efficiency", pooled.responsivity)):
        if isinstance(value, Implausible):
            yield f"{name} is implausible and was withheld: {value.reason}"
    if rejected := reduction.rejected:
        yield f"{len(rejected)} repeated, broken or foreign frames were left out, first: {rejected[0]}"
    if channels:
        yield from _range_warnings(names, dark, channels)
        yield from _noise_warnings(None if isinstance(light.gain, Missing) else light.gain_fit, pooled)
    else:
        yield "no light frames: gain, electrons, PRNU and saturation could not be estimated"
    yield from _negative_warnings(estimates)


def _negative_warnings(estimates: Mapping[str, Estimate]) -> Iterator[str]:
    """Warn of variances below zero beyond chance."""

    def below(name: str, times: float) -> bool:
        entry = estimates[name]
        if entry.value is None or entry.standard_uncertainty is None or entry.interval_95 is None:
            return False
        # Roots of variances have an upper limit; far below zero the interval ends at 0 instead.
        of_variance = entry.upper_limit_95 is not None or entry.interval_95[1] == 0.0
        return of_variance and entry.value < -times * entry.standard_uncertainty

    of_lines = [name for name in ("row_noise_dn", "column_noise_dn") if below(name, LINES_FAR_BELOW_ZERO)]
    if of_lines:
        yield (
            f"{', '.join(of_lines)}: the lines of the dark frames differ less from frame to frame than independent "
            f"pixels make them differ, as after the camera subtracted the mean of each line; take raw frames"
        )
    others = [name for name in estimates if not name.startswith(("row_noise", "column_noise"))]
    limits = {
        name: PARTS_FAR_BELOW_ZERO if {"row", "column"} & set(name.split("_")) else FAR_BELOW_ZERO for name in others
    }
    if negative := [name for name, times in limits.items() if below(name, times)]:
        yield (
            f"{', '.join(negative)}: the variance is negative beyond chance; the noise of these frames is not "
            f"independent between pixels or between frames (row noise, for example)"
        )


def _incomplete_warning(dark: DarkResult, lights: Sequence[GroupStatistics], gain: Value) -> str:
    """Return what is missing without the noise of dark frames, and what to add."""
    lacking = "black level, dark current, read noise, DSNU" if dark.level_unknown else "read noise, DSNU"
    text = f"{dark.noise_unknown}; without them {lacking} and what follows from them are not known"
    if not isinstance(gain, Missing):
        if not dark.level_unknown:
            return f"{text}; the system gain comes from the differences between flat fields"
        return (
            f"{text}; the system gain comes from the differences between flat fields, and its uncertainty contains a "
            f"variance that is {100.0 * BRIGHTER_FATTER:.0f} % too small in the brightest (brighter-fatter effect), as "
            f"far as the variances do not exclude it"
        )
    if not dark.level_unknown or not lights:
        return text
    means = sorted(pooled_level(entry.levels).mean for entry in lights)
    ends = f"{means[0]:.2f}" if len(means) == 1 else f"{means[0]:.2f} to {means[-1]:.2f}"
    return f"{text}; the flat fields have a mean of {ends} DN"


def _shading_warning(estimates: Mapping[str, Estimate]) -> str:
    shading, prnu, without = (estimates[name] for name in ("shading_percent", "prnu_percent", "prnu1288_percent"))
    known = "not known" if without.value is None else f"{without.value:.3g} %"
    return (
        f"the light was uneven, or the lens vignettes: prnu_percent, {prnu.value:.3g} %, contains a shading of "
        f"{shading.value:.3g} %; prnu1288_percent, {known}, is without it; use an even light or no lens"
    )


def _dark_scatter_warning(dark: DarkResult) -> str | None:
    """Return a warning where the dark levels do not lie on a line against exposure, and nothing else says why."""
    noise = max((pooled_level(entry.levels).spatial_variance for entry in dark.groups), default=0.0)
    for lines in dark.lines:
        fit = lines.mean.fit
        if fit is None or fit.degrees_of_freedom == 0 or dark.change.warnings():
            continue
        scatter = math.sqrt(fit.extra_variance)
        if fit.chi_square > float(chdtri(fit.degrees_of_freedom, OFF_BY_CHANCE)) and scatter**2 > NOTABLE**2 * noise:
            return (
                f"the dark levels scatter by {scatter:.2g} DN about a straight line against exposure, beyond their "
                f"noise: a stated exposure time is wrong, or black level or temperature changed; the uncertainties of "
                f"black level, dark current from the mean, read noise and DSNU were widened accordingly"
            )
    return None


def _dark_exposure_warnings(dark: DarkResult) -> Iterator[str]:
    """Warn where black level, read noise or DSNU include the dark current of long dark frames."""
    if not dark.groups:
        return
    longest = max(entry.group.exposure_s for entry in dark.groups)
    what = "black level is that" if dark.noise_unknown else "black level, read noise and DSNU are those"
    if all(lines.mean.fit is None for lines in dark.lines):
        if longest >= LONG_DARKS_S:
            yield (
                f"all dark frames have the exposure time {format_exposure(longest)} s: {what} at this time, with its "
                f"dark current, which is not known; take dark frames at a second, much shorter exposure time"
            )
        return
    if dark.clipped is None:
        return
    for m in dark.channels:
        signal = derive(lambda slope: slope * dark.reference_exposure_s, m.dark_slope)
        assert isinstance(m.dsnu_variance, Uncertain)
        if isinstance(signal, Uncertain) and signal.value**2 > 3.0 * m.dsnu_variance.standard_uncertainty:
            yield (
                f"DSNU is that at {format_exposure(dark.reference_exposure_s)} s and includes the nonuniformity of "
                f"{signal.value:.3g} DN of dark current, which clipped dark frames do not show; raise the black "
                f"level, or take most dark frames at a shorter exposure time"
            )
            return


def _range_warnings(names: Sequence[str], dark: DarkResult, channels: Sequence[Channel]) -> Iterator[str]:
    """Warn of dark frames and flat fields that do not cover the range of exposures."""
    longest_dark = max((entry.group.exposure_s for entry in dark.groups), default=math.inf)
    longest_light = max(float(channel.levels.exposure_s.max()) for channel in channels)
    current = channels[0].unknown_dark_current()
    if current is not None and channels[0].levels.photons_known:
        size = ""
        if isinstance(current, Uncertain):
            largest = current.value + math.sqrt(3.0) * current.standard_uncertainty
            size = f", up to {largest:.2g} DN/s; the uncertainties of responsivity and quantum efficiency include it"
        yield (
            f"the dark frames have one exposure time, {longest_dark:g} s, and the flat fields others: the dark current "
            f"is not known{size}; take dark frames at a second exposure time"
        )
    elif longest_light > longest_dark * (1.0 + 1e-6):
        taken = "extrapolated" if current is None else "taken as constant"
        yield (
            f"the longest dark exposure, {longest_dark:g} s, is shorter than the longest flat, {longest_light:g} s; "
            f"the dark signal of the longer flat fields was {taken}"
        )
    if unsaturated := [n for n, c in zip(names, channels, strict=True) if c.saturation.signal is None]:
        of_channel = f" in channel{'s' * (len(unsaturated) > 1)} {', '.join(unsaturated)}" if len(names) > 1 else ""
        yield f"no flat field reached saturation{of_channel}; all unclipped levels were taken as linear"
    for name, channel in zip(names, channels, strict=True):
        if (levels := int((channel.used & channel.levels.trusted).sum())) < 3:
            known = not isinstance(channel.gain, Missing)
            what = (
                "the system gain comes from one level of light, and is too low if that level is close to saturation"
                if levels == 1 and known
                else "its linearity could not be checked"
            )
            count = f"{levels} light level{'' if levels == 1 else 's'}"
            yield f"channel {name} has {count} in its linear range; {what}"


def _noise_warnings(fit: GainFit | None, m: Measurements) -> Iterator[str]:
    """Warn of temporal variances that contradict the model, or that quantization hides."""
    if fit is not None and fit.degrees_of_freedom and (scatter := fit.chi_square / fit.degrees_of_freedom) > SCATTER:
        yield (
            f"the photon transfer points scatter {math.sqrt(scatter):.2g} times as much as sampling explains; "
            f"uncertainties were widened accordingly"
        )
    if isinstance(m.dark_variance, Uncertain) and m.dark_variance.value < (least := least_dark_variance(m)):
        yield (
            f"the dark temporal variance, {m.dark_variance.value:.3g} DN², is below {least:.3g} DN²: "
            f"quantization hides the read noise; use its upper limit; rounding errors, which may be large, were added "
            f"to the uncertainties of DSNU, black level, dark current and DCNU"
        )


def _missing_pattern_warning(m: Measurements) -> str | None:
    """Return a warning where dark frames have no fixed pattern, as after a dark frame was subtracted in the camera."""
    dsnu, read = m.dsnu_variance, m.read_variance
    if not isinstance(dsnu, Uncertain) or not isinstance(read, Uncertain) or read.value <= 0.0 or m.dark_method:
        return None
    if dsnu.interval_95[1] > LEAST_PATTERN**2 * read.value:
        return None
    return (
        f"the dark frames have no fixed pattern: DSNU is below {100 * LEAST_PATTERN:.0f} % of the read noise, as after "
        f"a dark frame was subtracted in the camera; DSNU and dark current are then those that are left, and the read "
        f"noise contains that of the subtracted frame (1.41 times the sensor's for a single one)"
    )
