"""Stage "assemble": the results of the other stages become a `Calibration`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from photosite.calibration.checks.level_checks import level_warnings
from photosite.calibration.checks.result_screening import Implausible, implausible_warnings, screen_responsivity
from photosite.calibration.dark import DarkResult
from photosite.calibration.fixed_pattern import FixedPattern
from photosite.calibration.light import LightResult
from photosite.calibration.measurements import Measurements, pool_channels
from photosite.calibration.parameter_estimates import LEAST_DARK_VARIANCE, estimate_parameters
from photosite.calibration.photon_transfer.channel import Channel, curvature_warnings
from photosite.calibration.photon_transfer.curves import channel_curves, linear_range
from photosite.calibration.photon_transfer.general_model import general_model
from photosite.calibration.photon_transfer.linearity import channel_linearity
from photosite.calibration.photon_transfer.photon_transfer import GainFit
from photosite.calibration.photon_transfer.snr import snr_curve
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing, Uncertain, Value

SCATTER = 4.0
"""Chi square per degree of freedom of the photon transfer above which a warning is given."""

FAR_APART = 3.29
"""Distance of two estimates of one quantity, in standard uncertainties, beyond which a warning is given: 1 in 1000."""

FAR_BELOW_ZERO = 4.75
"""At this many uncertainties below zero, a standard deviation's variance is over three of its uncertainties below."""


def assemble(
    reduction: Reduction,
    dark: DarkResult,
    light: LightResult,
    patterns: Sequence[FixedPattern],
    sensor: Sensor | None,
) -> Calibration:
    """Return the calibration."""
    frames, names, channels = reduction.frames, reduction.names, light.channels
    measured = _measure_channels(dark, channels, patterns)
    together = _measure_together(dark, names, measured, light.gain)
    scale = _electrical_scale(sensor)
    mv_per_dn = _mv_per_dn(sensor, scale)
    estimates = estimate_parameters(together, mv_per_dn).estimates()
    per_channel = {name: estimate_parameters(m, mv_per_dn) for name, m in zip(names, measured, strict=True)}
    by_name = dict(zip(names, channels, strict=False))  # empty without light frames
    warnings = [
        *frames.notes,
        *([] if dark.clipped is None else [dark.clipped.warning(names)]),
        *level_warnings(reduction, dark.groups, channels),
        *curvature_warnings(names, channels),
        *implausible_warnings({"dark current": together.dark_slope, "quantum efficiency": together.responsivity}),
        *_analysis_warnings(reduction, dark, light, together),
        *_negative_variance_warnings(estimates),
    ]
    return Calibration(
        **estimates,
        channels=per_channel if len(names) > 1 else {},
        curves={name: channel_curves(lines, by_name.get(name)) for name, lines in zip(names, dark.lines, strict=True)},
        snr={name: snr_curve(channel) for name, channel in by_name.items()},
        spatial={name: pattern.spatial for name, pattern in zip(names, patterns, strict=True)},
        model="linear" if _photons_known(frames) else "general",
        general={name: general_model(channel) for name, channel in by_name.items()},
        linearity={name: m.linearity[0] for name, m in zip(names, measured, strict=True) if m.linearity},
        linear_range={name: linear_range(channel) for name, channel in by_name.items() if channel.used.any()},
        warnings=tuple(warnings),
        rejected=reduction.rejected,
        frames_used=reduction.used,
        source=frames.source,
        rows=frames.rows,
        cols=frames.cols,
        bits=frames.bits,
        cfa=frames.cfa,
        base=sensor,
        electrical_scale=scale,
        chip=None,
        temporal=None,
        no_maps_reason=None,
        gain_setting=frames.gain_settings[0],
        temperature_c=_temperatures(frames),
    )


def _measure_channels(
    dark: DarkResult, channels: Sequence[Channel], patterns: Sequence[FixedPattern]
) -> list[Measurements]:
    """Return each channel's measurements."""
    measured = []
    for k, m in enumerate(dark.channels):
        if channels:
            m = _with_light(m, channels[k], patterns[k])
        measured.append(m.without_dark_shot_noise(dark.reference_exposure_s).for_sensor())
    for m in measured:
        if isinstance(why := m.responsivity, Implausible):
            # All channels received the same light: photons that are implausible for one are so for all.
            return [replace(m, responsivity=why, saturation_responsivity=why, saturation_photons=why) for m in measured]
    return measured


def _with_light(m: Measurements, channel: Channel, pattern: FixedPattern) -> Measurements:
    responsivity = channel.responsivity()
    if channel.curvature is not None and isinstance(responsivity, Uncertain):
        responsivity = channel.curvature.widen(responsivity, channel.curvature.responsivity)
    variances = {name: value for name, value in vars(pattern).items() if name != "spatial"}
    responsivity = screen_responsivity(responsivity, channel.gain)
    return m.with_channel(channel, responsivity, **variances, linearity=(channel_linearity(channel),))


def _measure_together(
    dark: DarkResult, names: Sequence[str], channels: Sequence[Measurements], gain: Value
) -> Measurements:
    """Return the measurements of all channels together; `gain` was fitted to all of them."""
    if len(channels) == 1:
        return replace(channels[0], gain=gain)
    pooled = pool_channels(names, channels, dark.together, gain).without_dark_shot_noise(dark.reference_exposure_s)
    # Black level and dark slope were measured on all pixels; the channels' responsivity is already for the sensor.
    return replace(pooled.for_sensor(), responsivity=pooled.responsivity)


def _photons_known(frames: FrameSet) -> bool:
    lights = frames.of_kind("light")
    return bool(lights) and all(group.photons_per_pixel is not None for group in lights)


def _temperatures(frames: FrameSet) -> tuple[float, float] | None:
    known = [group.temperature_c for group in frames.groups if group.temperature_c is not None]
    return (min(known), max(known)) if known else None


def _electrical_scale(sensor: Sensor | None) -> dict[str, Uncertain]:
    """Return the electrical scale of the sensor by field name, which all values in volts share."""
    if sensor is None:
        return {}
    values = {name: sensor.measured(name) for name in ("voltage_swing_v", "analog_gain")}
    return {name: Uncertain.of(entry.value, entry.standard_uncertainty) for name, entry in values.items()}


def _mv_per_dn(sensor: Sensor | None, scale: Mapping[str, Uncertain]) -> Value:
    """Return millivolts at the pixel per digital number."""
    if sensor is None:
        return Missing("millivolts need the sensor's voltage swing and analog gain; give a sensor file of this sensor")
    return scale["voltage_swing_v"] / scale["analog_gain"] * (1e3 / (1 << sensor.readout.bits))


def _negative_variance_warnings(estimates: Mapping[str, Estimate]) -> list[str]:
    """Warn of standard deviations whose variance is negative by more than three of its standard uncertainties."""
    names = [
        name
        for name, entry in estimates.items()
        if entry.value is not None
        and entry.upper_limit_95 is not None
        and entry.standard_uncertainty is not None
        and entry.value < -FAR_BELOW_ZERO * entry.standard_uncertainty
    ]
    if not names:
        return []
    return [
        f"{', '.join(names)}: the variance is negative beyond chance; the noise of these frames is not independent "
        f"between pixels or between frames (row noise, for example)"
    ]


def _analysis_warnings(reduction: Reduction, dark: DarkResult, light: LightResult, together: Measurements) -> list[str]:
    warnings: list[str] = []
    rejected, names, channels = reduction.rejected, reduction.names, light.channels
    if rejected:
        warnings.append(f"{len(rejected)} repeated or broken frames were left out, first: {rejected[0]}")
    if not channels:
        return [*warnings, "no light frames: gain, electrons, PRNU and saturation could not be estimated"]
    longest_dark = max(entry.group.exposure_s for entry in dark.groups)
    longest_light = max(float(channel.levels.exposure_s.max()) for channel in channels)
    if longest_light > longest_dark * (1.0 + 1e-6):
        warnings.append(
            f"the longest dark exposure, {longest_dark:g} s, is shorter than the longest flat, {longest_light:g} s; "
            f"the dark signal of the longer flats was extrapolated"
        )
    if unsaturated := [n for n, c in zip(names, channels, strict=True) if c.saturation.signal is None]:
        of_channel = f" in channel{'s' * (len(unsaturated) > 1)} {', '.join(unsaturated)}" if len(names) > 1 else ""
        warnings.append(f"no flat field reached saturation{of_channel}; all unclipped levels were taken as linear")
    for name, channel in zip(names, channels, strict=True):
        if channel.used.sum() < 3:
            warnings.append(
                f"channel {name} has {int(channel.used.sum())} light levels in its linear range; "
                f"its linearity could not be checked"
            )
    return (
        warnings + _scatter_warning(light.gain_fit) + _dark_current_warning(together) + _quantisation_warning(together)
    )


def _scatter_warning(fit: GainFit | None) -> list[str]:
    if fit is None or not fit.degrees_of_freedom:
        return []
    scatter = fit.chi_square / fit.degrees_of_freedom
    if scatter <= SCATTER:
        return []
    return [
        f"the photon transfer points scatter {math.sqrt(scatter):.2g} times as much as sampling explains; "
        f"uncertainties were widened accordingly"
    ]


def _dark_current_warning(m: Measurements) -> list[str]:
    """Warn where the dark current from the mean and that from the variance differ."""
    if isinstance(m.dark_slope, Missing) or isinstance(m.dark_variance_slope, Missing) or isinstance(m.gain, Missing):
        return []
    of_mean, of_variance = m.dark_slope / m.gain, m.dark_variance_slope / (m.gain * m.gain)
    difference = of_variance - of_mean
    apart = abs(difference.value) / difference.standard_uncertainty
    if apart <= FAR_APART:
        return []
    return [
        f"the dark current from the mean, {of_mean.value:.3g} e-/s, and from the variance, {of_variance.value:.3g} "
        f"e-/s, differ by {apart:.2g} standard uncertainties: a camera with black level clamping shows its dark "
        f"current in the variance only; a drift of the black level shows in the mean only"
    ]


def _quantisation_warning(m: Measurements) -> list[str]:
    if isinstance(m.dark_variance, Missing) or m.dark_variance.value >= LEAST_DARK_VARIANCE:
        return []
    return [
        f"the dark temporal variance, {m.dark_variance.value:.3g} DN², is below {LEAST_DARK_VARIANCE} DN²: "
        f"quantisation hides the read noise; use its upper limit"
    ]
