"""Checks of the response to light: wrong light, tone curves, processed frames, bends, uneven light, shared noise."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from photosite.calibration.diagnostics import Check
from photosite.calibration.evidence import Evidence
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.dark_noise_ratio import PROCESSED_FRAMES
from photosite.calibration.photon_transfer.full_well import FULL_WELLS
from photosite.calibration.photon_transfer.level_outliers import LIGHT_OUTLIERS, outlier_warning
from photosite.calibration.photon_transfer.noise_covariance import CORRELATION_P_VALUE, SHARED_NOISE
from photosite.calibration.photon_transfer.response_shape import BEND_P_VALUE, TONE_CURVE, constant_light
from photosite.calibration.spatial.nonuniformity import is_large
from photosite.calibration.withheld import RESPONSE
from photosite.values.diagnostic import Diagnostic, DiagnosticKind, one_in
from photosite.values.uncertain import SIGMA_1_IN_1000, Missing, Uncertain, derive


def light_outliers(evidence: Evidence) -> Iterator[Diagnostic]:
    """Levels whose stated light contradicts the others."""
    outliers = evidence.light.outliers
    if outliers:
        farthest = max((outlier.stated_over_expected for outlier in outliers), key=lambda ratio: abs(math.log(ratio)))
        yield LIGHT_OUTLIERS(outlier_warning(evidence.reduction.lights, outliers), farthest)


def tone_curve(evidence: Evidence) -> Iterator[Diagnostic]:
    """Numbers that are not proportional to the light."""
    if evidence.light.tone is not None:
        yield TONE_CURVE(str(evidence.light.tone), evidence.light.tone.exponent)


def processed_frames(evidence: Evidence) -> Iterator[Diagnostic]:
    """Flat fields and dark frames that do not belong to one mode of the camera."""
    if (ratio := evidence.light.processed) is not None:
        yield PROCESSED_FRAMES(str(ratio), ratio.ratio)


BEND_OR_LIGHT = DiagnosticKind(
    "bend-or-light",
    "warning",
    "Without dark frames, the means of the flat fields do not lie on a straight line against the stated light.",
    "The response bends, or the light is not in proportion. The uncertainty of the system gain covers both.",
    "Take dark frames.",
    ("system_gain_dn_per_e", "*_e"),
    "relative uncertainty of the system gain from this",
)


def bend_or_light(evidence: Evidence) -> Iterator[Diagnostic]:
    """A bend of the means that cannot be assigned without dark frames."""
    if (bend := evidence.light.bend) is not None:
        yield BEND_OR_LIGHT(
            f"the means of the flat fields do not lie on a straight line against the stated light: the response bends, "
            f"or the light is not in proportion. Without dark frames these cannot be distinguished, and the "
            f"uncertainty of the system gain, {100 * bend.relative:.2g} % from this alone, covers both",
            bend.relative,
        )


FLICKER = DiagnosticKind(
    "flickering-light",
    "warning",
    "Rows of flat fields vary from frame to frame, as under a rolling shutter in flickering light.",
    "The noise of the bands was subtracted from the temporal variances.",
    "Use a light with a constant current, or exposure times that are multiples of its period.",
    ("system_gain_dn_per_e", "prnu*"),
    "standard deviation of the rows as a fraction of the signal",
    f"below {one_in(CORRELATION_P_VALUE)} sets",
)


def shared_noise(evidence: Evidence) -> Iterator[Diagnostic]:
    """Flicker of the light, and noise that pixels or successive frames share."""
    noise = evidence.light.noise
    if noise.flicker is not None:
        text = f"{noise.flicker}; its noise was subtracted from the temporal variances of the flat fields"
        yield FLICKER(text, noise.flicker.fraction)
    if noise.shared is not None and noise.shared.seen:
        yield SHARED_NOISE(str(noise.shared), noise.shared.frames or max(noise.shared.neighbors or (0.0,), key=abs))


SHADING = DiagnosticKind(
    "uneven-light",
    "warning",
    "The high-pass filter of EMVA 1288 removes a large part of the nonuniformity.",
    "The light was uneven, or the lens vignettes: prnu_percent contains it, prnu1288_percent does not.",
    "Use an even light (an integrating sphere, a diffuser), or no lens.",
    ("prnu_percent", "prnu1288_unfiltered_*"),
    "shading, percent",
)


def uneven_light(evidence: Evidence) -> Iterator[Diagnostic]:
    """Shading that is a large part of the nonuniformity."""
    pooled, patterns, estimates = evidence.pooled, evidence.patterns, evidence.parameters.estimates()
    named = sum(float(np.var(taps.level)) for taps in patterns.taps if not taps.dark)
    if patterns.structure is not None:
        named += float(patterns.structure.relative.var())
    if is_large(derive(lambda shading: shading - named, pooled.shading_variance), pooled.response_variance):
        shading, prnu, without = (estimates[n] for n in ("shading_percent", "prnu_percent", "prnu1288_percent"))
        known = "not known" if without.value is None else f"{without.value:.3g} %"
        yield SHADING(
            f"the light was uneven, or the lens vignettes: prnu_percent, {prnu.value:.3g} %, contains a shading of "
            f"{shading.value:.3g} %; prnu1288_percent, {known}, is without it; use an even light or no lens",
            shading.value,
        )


BENT_VARIANCE = DiagnosticKind(
    "bent-variance",
    "warning",
    "The temporal variance is not in proportion to the signal, though the signal is to the light.",
    "The system gain is that at small signal. The uncertainties of responsivity, PRNU and wells include a bend of the "
    "response that errors of the light may hide.",
    "Compare with another light source; noise that pixels share at large signals (brighter-fatter effect) stays.",
    ("system_gain_dn_per_e", *RESPONSE, "prnu*", "saturation_capacity_*"),
    "relative difference of the gain from that of a straight line",
)
BENT_RESPONSE = DiagnosticKind(
    "bent-response",
    "warning",
    "The response bends.",
    "All parameters follow from gain and responsivity at small signal, the figures of EMVA 1288 from a straight line.",
    "Nothing, or calibrate a smaller range of signals.",
    ("system_gain_dn_per_e", *RESPONSE, "linearity_*", "*_e"),
    "relative deviation of the brightest signal from a straight response",
    f"below {one_in(BEND_P_VALUE)} straight responses",
)
NONLINEAR_LIGHT = DiagnosticKind(
    "nonlinear-light",
    "warning",
    "The light is not in proportion to what is stated, and the variances show that the sensor is not the cause.",
    "The system gain is not affected; the uncertainties of responsivity and quantum efficiency include it.",
    "Check lamp, shutter and the stated light.",
    (*RESPONSE, "linearity_*"),
    "relative deviation of the brightest signal",
    f"below {one_in(BEND_P_VALUE)} sets in proportional light",
)
UNCLEAR_BEND = DiagnosticKind(
    "unclear-bend",
    "warning",
    "The signals are not in proportion to the stated light, and the variances cannot tell a bend of the response from "
    "errors of the light.",
    "The uncertainty of the system gain covers both.",
    "Take more frames, or check lamp and shutter.",
    ("system_gain_dn_per_e", "*_e", *RESPONSE),
    "half of the range of signal over light, relative",
    "none where dark frames of one exposure time leave open a dark current that explains it",
)


CONSTANT_LIGHT = DiagnosticKind(
    "constant-light",
    "warning",
    "The flat fields have a signal that does not grow with the stated light.",
    "The responsivity contains it. The system gain does not: the response is straight.",
    "Keep other light away; check whether the shutter stays open longer, or shorter, than stated.",
    (*RESPONSE, "linearity_*"),
    "signal at no light, relative to the brightest level in the linear range",
    "none in 400 straight and 2000 bent sets of levels; a bend below the dimmest level only looks the same",
)


def constant_signal(evidence: Evidence) -> Iterator[Diagnostic]:
    """Light that all flat fields have in addition to what is stated."""
    found = [
        (constant, float(channel.levels.signal[channel.used].max()), name)
        for name, channel in evidence.channels.items()
        if (constant := constant_light(channel.levels, channel.used)) is not None
    ]
    if found:
        constant, brightest, name = max(found, key=lambda each: abs(each[0].value) / each[1])
        yield CONSTANT_LIGHT(
            f"the flat fields have {constant.value:.3g} ± {constant.standard_uncertainty:.1g} DN at no light"
            f"{evidence.reduction.channel_label(name, ' in channel {}')}, {100 * constant.value / brightest:.2g} % of "
            f"the brightest level in the linear range: stray light that does not change with the stated light, or "
            f"exposure times that are off by a constant (or a response that bends below the dimmest level only). The "
            f"responsivity contains it, the system gain does not",
            constant.value / brightest,
        )


def response(evidence: Evidence) -> Iterator[Diagnostic]:
    """The channel whose gain a bend changes most, if it changes value or uncertainty by half."""
    found = [
        (gain.value / line.value - 1.0, gain.relative, line.relative, name, channel, curve)
        for name, channel in evidence.channels.items()
        for curve, gain, line in [(channel.curve, channel.gain, channel.straight_gain)]
        if curve is not None and isinstance(gain, Uncertain) and isinstance(line, Uncertain)
    ]
    if not found:
        return
    change, spread, by_line, name, channel, curve = max(found, key=lambda entry: max(abs(entry[0]), entry[1]))
    if abs(change) < 0.5 * by_line and spread < 1.5 * by_line:
        return
    gain, levels = 100.0 * change, np.flatnonzero(channel.used)
    top = int(levels[np.argmax(channel.levels.signal[channel.used])])
    sensor, light = curve.bend[top], curve.light_bend(top)
    at = f"at {channel.levels.signal[top]:.4g} DN{evidence.reduction.channel_label(name, ' in channel {}')}"
    if curve.shape is None:
        yield BENT_VARIANCE(
            f"the temporal variance is not in proportion to the signal, though the signal is to the light: the system "
            f"gain at small signal is {_away(gain)} that of a straight line. Causes are noise that pixels "
            f"share at large signals (brighter-fatter effect), or a bend of the response that errors of the light "
            f"hide; the uncertainties of responsivity, PRNU and wells include such a bend",
            change,
        )
        return
    by_sensor = abs(change) > SIGMA_1_IN_1000 * spread or any(curve.bend[i].beyond(SIGMA_1_IN_1000) for i in levels)
    by_light = any(curve.light_bend(int(i)).beyond(SIGMA_1_IN_1000) for i in levels)
    if by_sensor:
        responsivity = _responsivity_change(channel)
        yield BENT_RESPONSE(
            f"the response bends: {at}, the signal is {_away(100 * math.expm1(-sensor.value))} a straight response. "
            f"All parameters follow from the system gain{responsivity[0]} at small signal, the figures of EMVA 1288 "
            f"from a straight line: the gain at small signal is {_away(gain)} that of the line{responsivity[1]}",
            math.expm1(-sensor.value),
        )
    if by_light:
        yield NONLINEAR_LIGHT(
            f"the light is not in proportion to what is stated: {at}, the signal is "
            f"{_away(100 * math.expm1(-light.value))} it, and the variances show that the sensor is not the cause "
            f"(lamp, shutter, stated light). The system gain is not affected; the uncertainties of responsivity and "
            f"quantum efficiency include it",
            math.expm1(-light.value),
        )
    if not (by_sensor or by_light or channel.dark_current_can_bend):
        yield UNCLEAR_BEND(
            f"the signals are not in proportion to the stated light, by {100 * channel.disproportion:.2g} %, and the "
            f"variances cannot tell a bend of the response from errors of the light: the uncertainty of the system "
            f"gain covers both and is {spread / by_line:.2g} times that of a straight line; the gain is {_away(gain)} "
            f"that of the line. Take more frames, or check lamp and shutter",
            channel.disproportion,
        )


def _responsivity_change(channel: Channel) -> tuple[str, str]:
    """Return the words on the responsivity at small signal and its difference from the line; empty without photons."""
    at_zero, by_line = channel.responsivity(), channel.responsivity(by_line=True)
    if isinstance(at_zero, Missing) or isinstance(by_line, Missing):
        return "", ""
    change = 100.0 * (at_zero.value / by_line.value - 1.0)
    return " and the responsivity", f", the responsivity {_away(change)} its own"


def _away(percent: float) -> str:
    """Return a deviation in words, such as "4.6 % below"."""
    return f"{abs(percent):.2g} % {'below' if percent < 0.0 else 'above'}"


def partly_full_wells(evidence: Evidence) -> Iterator[Diagnostic]:
    """Levels at which some pixels are full below the full scale of the converter."""
    found = {name: channel for name, channel in evidence.channels.items() if channel.full}
    if found:
        name, channel = max(found.items(), key=lambda item: item[1].fall)
        top = channel.full[-1]
        one = len(channel.full) == 1
        count = "level lies" if one else f"{len(channel.full)} levels lie"
        yield FULL_WELLS(
            f"the brightest {count} in the full well of some pixels: at {channel.levels.signal[top]:.4g} DN"
            f"{evidence.reduction.channel_label(name, ' in channel {}')}, the temporal variance is "
            f"{100 * channel.fall:.2g} % below that of the other levels relative to the signal; "
            f"{'it was' if one else 'they were'} left out",
            channel.fall,
        )


CORRECTED_FLATS = DiagnosticKind(
    "corrected-flats",
    "warning",
    "Saturated pixels have no noise, but differ from each other.",
    "The flat fields were divided by a flat field, or corrected pixel by pixel: PRNU is what the correction left, and "
    "the saturation is a mean.",
    "Use flat fields as the camera reads them.",
    ("prnu*", "saturation_*", "shading_percent"),
    "standard deviation of the saturated pixels, DN",
    "none: no camera clips at many numbers without noise",
)


def corrected_flats(evidence: Evidence) -> Iterator[Diagnostic]:
    """Saturated pixels whose numbers differ, because they were corrected behind the converter."""
    if evidence.patterns.unlit is not None:
        return
    for name, channel in evidence.channels.items():
        levels = channel.levels
        noise, top = levels.noise, len(levels.x) - 1
        if not levels.repeated.all() or top < 1 or levels.white_fraction[top] > 0.9:
            continue
        spread = math.sqrt(max(float(levels.spread[top]) ** 2 - float(noise[top]), 0.0))
        # Full wells, which differ too, have the noise of the readout.
        dark = min((value.value for value in levels.dark_noise), default=math.inf)
        still = noise[top] < 0.1 * noise[:top].min() and noise[top] < 0.5 * dark
        if still and noise[top] < 0.05 * spread**2 and spread > 1.0:
            yield CORRECTED_FLATS(
                f"saturated pixels have no noise, but differ by {spread:.3g} DN"
                f"{evidence.reduction.channel_label(name, ' in channel {}')}: the flat fields were divided by a flat "
                f"field, or corrected pixel by pixel. PRNU is what the correction left; use flat fields as the camera "
                f"reads them",
                spread,
            )
            return


CHECKS = (
    Check("result", 122, corrected_flats, linear=True),
    Check("result", 125, partly_full_wells, linear=True),
    Check("result", 130, light_outliers),
    Check("result", 140, tone_curve),
    Check("result", 150, processed_frames, linear=True),
    Check("result", 160, bend_or_light, linear=True),
    Check("result", 170, shared_noise, linear=True),
    Check("result", 210, uneven_light, linear=True),
    Check("result", 215, constant_signal, linear=True),
    Check("result", 220, response, linear=True),
)
