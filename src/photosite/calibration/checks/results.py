"""Checks of the results: implausible values, frames left out, missing ranges, variances that contradict the model."""

from __future__ import annotations

import math
from collections.abc import Iterator

from scipy.special import chdtri

from photosite.calibration.checks.result_screening import Implausible
from photosite.calibration.chip_maps.pixel_gain import PIXEL_GAINS_MISSING
from photosite.calibration.dark.dark_gain import GAIN_FROM_DARKS
from photosite.calibration.diagnostics import Check
from photosite.calibration.effects.em_gain import STATED_EM_GAIN, stated_gain_warning
from photosite.calibration.evidence import Evidence
from photosite.calibration.parameters import least_dark_variance
from photosite.calibration.withheld import (
    DARK_CURRENT,
    FEW_LEVELS,
    HIDDEN_NOISE,
    IMPLAUSIBLE,
    NO_FLAT_FIELDS,
    NO_MAPS,
    NO_SATURATION,
    RESPONSE,
    UNKNOWN_DARK_CURRENT,
)
from photosite.values.diagnostic import Diagnostic, DiagnosticKind, one_in
from photosite.values.uncertain import Missing, Uncertain


def reading(evidence: Evidence) -> tuple[Diagnostic, ...]:
    """What was assumed when the frames were read."""
    return evidence.reduction.frames.diagnostics


def implausible(evidence: Evidence) -> Iterator[Diagnostic]:
    """Values that were computed and cannot be true."""
    pooled = evidence.pooled
    for name, value, parameters in (
        ("dark current", pooled.dark_slope, (*DARK_CURRENT, "system_gain_dn_per_e")),
        ("quantum efficiency", pooled.responsivity, (*RESPONSE, "*_photons")),
    ):
        if isinstance(value, Implausible):
            yield IMPLAUSIBLE(f"{name} is implausible and was withheld: {value.reason}", parameters=parameters)


FRAMES_LEFT_OUT = DiagnosticKind(
    "frames-left-out",
    "warning",
    "Frames repeat others, are broken, or come from another chip or setting.",
    "The results are those of the other frames.",
    "See the list of frames that were left out, each with its reason.",
    size="number of frames",
)


def left_out(evidence: Evidence) -> Iterator[Diagnostic]:
    """Frames that were left out."""
    if rejected := evidence.reduction.rejected:
        text = f"{len(rejected)} repeated, broken or foreign frames were left out, first: {rejected[0]}"
        yield FRAMES_LEFT_OUT(text, len(rejected))


SHORT_DARKS = DiagnosticKind(
    "short-dark-exposures",
    "warning",
    "The longest flat fields are longer than the longest dark frames.",
    "Their dark signal was extrapolated, or taken as constant. The uncertainty of PRNU then contains the nonuniformity "
    "of their dark current, or PRNU is withheld.",
    "Take dark frames at the longest exposure time of the flat fields.",
    (*RESPONSE, "prnu*"),
    "longest exposure time of the flat fields, s",
    "none: exposure times are compared",
)


def ranges(evidence: Evidence) -> Iterator[Diagnostic]:
    """Dark frames and flat fields that do not cover the range of exposures."""
    names, dark, channels = evidence.reduction.names, evidence.dark, evidence.light.channels
    if not channels:
        if (found := evidence.light.dark_gain) is None:
            yield NO_FLAT_FIELDS("no light frames: gain, electrons, PRNU and saturation could not be estimated")
        else:
            text, lacking = "no light frames: PRNU and saturation could not be estimated", ("prnu*", "saturation_*")
            yield NO_FLAT_FIELDS(text, parameters=lacking)
            yield GAIN_FROM_DARKS(str(found), found.gain.standard_uncertainty / found.gain.value)
        return
    longest_dark = max((entry.group.exposure_s for entry in dark.groups), default=math.inf)
    longest_light = max(float(channel.levels.exposure_s.max()) for channel in channels)
    current = channels[0].unknown_dark_current()
    if current is not None and channels[0].levels.photons_known:
        size, largest = "", None
        if isinstance(current, Uncertain):
            largest = current.value + math.sqrt(3.0) * current.standard_uncertainty
            size = (
                f", up to {largest:.2g} DN/s; the uncertainties of responsivity, quantum efficiency and PRNU include it"
            )
        yield UNKNOWN_DARK_CURRENT(
            f"the dark frames have one exposure time, {longest_dark:g} s, and the flat fields others: the dark current "
            f"is not known{size}. Take dark frames at a second exposure time",
            largest,
        )
    elif longest_light > longest_dark * (1.0 + 1e-6):
        constant = current is not None
        taken = "taken as constant" if constant else "extrapolated"
        if isinstance(current, Uncertain):
            taken += "; the uncertainty of PRNU contains the nonuniformity of their dark current"
        elif any(isinstance(pattern.response_variance, Missing) for pattern in evidence.patterns.channels):
            taken += "; PRNU may contain much of their dark current, and is withheld"
        yield SHORT_DARKS(
            f"the longest dark exposure, {longest_dark:g} s, is shorter than the longest flat, {longest_light:g} s; "
            f"the dark signal of the longer flat fields was {taken}",
            longest_light,
            SHORT_DARKS.parameters if constant else RESPONSE,
        )
    if unsaturated := [n for n, c in zip(names, channels, strict=True) if c.saturation.signal is None]:
        channels_text = f" in channel{'s' * (len(unsaturated) > 1)} {', '.join(unsaturated)}" if len(names) > 1 else ""
        yield NO_SATURATION(
            f"no flat field reached saturation{channels_text}; all unclipped levels were taken as linear"
        )
    for name, channel in zip(names, channels, strict=True):
        if (levels := int((channel.used & channel.levels.trusted).sum())) < 3:
            known = not isinstance(channel.gain, Missing)
            what = (
                "the system gain comes from one level of light, and is too low if that level is close to saturation, "
                "or by three times a bend of the response at that level"
                if levels == 1 and known
                else "its linearity could not be checked"
            )
            count = f"{levels} light level{'' if levels == 1 else 's'}"
            yield FEW_LEVELS(f"channel {name} has {count} in its linear range; {what}", levels)


LARGEST_SCATTER = 4.0
"""Chi square per degree of freedom of the photon transfer above which a warning is given, unless by chance."""

SCATTER_P_VALUE = 1e-4
"""Fraction of clean sets whose temporal variances may scatter as far."""

SCATTERED_TRANSFER = DiagnosticKind(
    "scattered-photon-transfer",
    "warning",
    "The temporal variances scatter about the line of photon transfer more than sampling explains.",
    "The uncertainty of the system gain and of what follows from it was widened. Where uneven steps of the converter "
    "(DNL) are the cause, the response differs from level to level, and PRNU by up to a few percent of it.",
    "Look for levels that differ in the plot of the photon transfer.",
    ("system_gain_dn_per_e", "*_e", "*_e_per_s", "prnu*"),
    "root of chi square per degree of freedom",
    f"below {one_in(SCATTER_P_VALUE)} clean sets",
)


def variances(evidence: Evidence) -> Iterator[Diagnostic]:
    """Temporal variances that contradict the model, or that quantization hides."""
    if not evidence.light.channels:
        return
    fit = None if isinstance(evidence.light.gain, Missing) else evidence.light.gain_fit
    freedom = 0 if fit is None else fit.degrees_of_freedom
    if fit and freedom and fit.chi_square > max(LARGEST_SCATTER * freedom, chdtri(freedom, SCATTER_P_VALUE)):
        scatter = fit.chi_square / freedom
        yield SCATTERED_TRANSFER(
            f"the photon transfer points scatter {math.sqrt(scatter):.2g} times as much as sampling explains; "
            f"uncertainties were widened accordingly. Where uneven steps of the converter (DNL) are the cause, PRNU "
            f"may be a few percent of it off",
            math.sqrt(scatter),
        )
    variance, least = evidence.pooled.dark_variance, least_dark_variance(evidence.pooled)
    if isinstance(variance, Uncertain) and variance.value < least:
        yield HIDDEN_NOISE(
            f"the dark temporal variance, {variance.value:.3g} DN², is below {least:.3g} DN²: "
            f"quantization hides the read noise; use its upper limit; rounding errors, which may be large, were added "
            f"to the uncertainties of DSNU, black level, dark current and DCNU; the system gain comes from the flat "
            f"fields, with a free constant, but not that of the emva1288 block; the sensitivity threshold is an upper "
            f"limit, and the dynamic range a lower one",
            variance.value,
        )


FAR_BELOW_ZERO = {"row_noise": 15.0, "column_noise": 15.0, "row": 6.85, "column": 6.85, "": 4.75}
"""By a part of a parameter's name, the uncertainties below zero at which a standard deviation is negative beyond
chance.

At 4.75 of them, its variance is over three of its uncertainties below zero; at 6.85 over four, for the parts of
patterns by rows and columns, of which one is below three in 1 of 50 chips with planes of 24 rows; at 15 over eight, for
the noise of rows and columns: its uncertainty falls with the variance of few lines that happen to be alike, so that
three are exceeded in 8 of 1000 clean sets of four frames with 48 rows, and eight in 1 of 2000 of two frames with 24
rows."""

ALIKE_LINES = DiagnosticKind(
    "lines-alike",
    "warning",
    "Rows or columns of the dark frames differ less from frame to frame than independent pixels make them differ.",
    "The camera subtracted the mean of each line: the noise of rows and columns is not the sensor's.",
    "Take raw frames, without correction of lines.",
    ("row_noise_*", "column_noise_*"),
    false_alarms="below 1 of 2000 sets of two frames with 24 rows",
)
NEGATIVE_VARIANCE = DiagnosticKind(
    "negative-variance",
    "warning",
    "A variance is negative beyond chance.",
    "The noise of these frames is not independent between pixels or between frames (row noise, for example).",
    "Look for processing in the camera: noise reduction, line correction, compression.",
)


def negative_variances(evidence: Evidence) -> Iterator[Diagnostic]:
    """Variances below zero beyond chance."""
    below = []
    for name, entry in evidence.parameters.estimates().items():
        if entry.value is None or entry.standard_uncertainty is None or entry.interval_95 is None:
            continue
        # Roots of variances have an upper limit; far below zero the interval ends at 0 instead.
        from_variance = entry.upper_limit_95 is not None or entry.interval_95[1] == 0.0
        times = next(limit for part, limit in FAR_BELOW_ZERO.items() if part in name)
        if from_variance and entry.value < -times * entry.standard_uncertainty:
            below.append(name)
    if line_names := [name for name in below if name in ("row_noise_dn", "column_noise_dn")]:
        yield ALIKE_LINES(
            f"{', '.join(line_names)}: the lines of the dark frames differ less from frame to frame than independent "
            f"pixels make them differ, as after the camera subtracted the mean of each line; take raw frames"
        )
    if others := [name for name in below if not name.startswith(("row_noise", "column_noise"))]:
        yield NEGATIVE_VARIANCE(
            f"{', '.join(others)}: the variance is negative beyond chance; the noise of these frames is not "
            f"independent between pixels or between frames (row noise, for example)",
            parameters=others,
        )


def stated_em_gain(evidence: Evidence) -> Iterator[Diagnostic]:
    """Excess noise where the sensor file states an electron multiplication gain."""
    base = evidence.base
    stated = None if base is None or base.effects is None else base.effects.em_gain
    if stated is not None and (text := stated_gain_warning(stated, evidence.parameters.system_gain_dn_per_e)):
        yield STATED_EM_GAIN(text, stated.excess_noise_factor)


def missing_maps(evidence: Evidence) -> Iterator[Diagnostic]:
    """Maps that were requested and could not be measured."""
    if evidence.maps_failed:
        yield NO_MAPS(f"the chip's maps could not be measured: {evidence.no_maps}")
    if isinstance(gains := evidence.pixel_gains, Missing):
        yield PIXEL_GAINS_MISSING(f"no map of the gain: {gains.reason}")
    elif gains is not None:
        yield from gains.diagnostics


CHECKS = (
    Check("result", 10, reading),
    Check("result", 230, implausible, linear=True),
    Check("result", 240, left_out, linear=True),
    Check("result", 250, ranges, linear=True),
    Check("result", 260, variances, linear=True),
    Check("result", 270, negative_variances, linear=True),
    Check("result", 280, stated_em_gain),
    Check("result", 290, missing_maps),
)
