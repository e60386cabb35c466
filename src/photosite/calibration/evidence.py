"""Stage "evidence": what the stages have established of a set of frames, from which effects are measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.amplifiers import Amplifier, AmplifierGains
from photosite.calibration.checks.result_screening import Implausible, screen_responsivity
from photosite.calibration.chip_maps.pixel_gain import PixelGains
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise
from photosite.calibration.dark.black_level_change import Contradiction, contradiction
from photosite.calibration.dark.dark_frames import with_standard_lines
from photosite.calibration.dark.dark_result import DarkResult, with_shared_charge, without_mean_slope
from photosite.calibration.light.light_frames import LightResult
from photosite.calibration.measurements import Measurements, pool_channels
from photosite.calibration.parameters import Parameters, estimate_parameters
from photosite.calibration.photon_transfer.channel import Channel, Curve, LinearRange, channel_curves, linear_range
from photosite.calibration.photon_transfer.linearity import channel_linearity
from photosite.calibration.photon_transfer.response_shape import TONE_CURVE
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.spatial.fixed_pattern import FixedPattern, FixedPatterns
from photosite.calibration.spatial.left_out import LeftOut
from photosite.calibration.withheld import NO_SENSOR_FILE
from photosite.engine.lazy_maps import ConstantMap
from photosite.sensor.chip import MeasuredChip
from photosite.sensor.model import Sensor
from photosite.values.uncertain import Missing, Uncertain, Value


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What the stages of a calibration have established.

    Parameters
    ----------
    reduction, dark, light, patterns
        The results of the stages; `light.noise` is the structure of the noise.
    base
        The sensor as known before the measurement, None if unknown.
    measured, pooled
        The measurements of each channel, and of all channels together.
    parameters, by_line, channel_parameters
        The parameters of all channels together, at small signal and by the straight lines of EMVA 1288, and of each
        channel.
    electrical_scale
        Voltage swing and analog gain of `base`.
    amplifiers, amplifier_gains
        The amplifiers that the files name, and their gains where they differ.
    alike
        The parameters with DSNU, PRNU and DCNU as with readout channels that are alike; None where none differ.
    chip, temporal, dark_rate_dn_per_s
        With maps: the maps and the temporal noise of the chip; (rows, cols) dark current of its pixels without glow.
    pixel_gains
        With maps of the gain: what they show, or why they are missing.
    no_maps, maps_failed
        Why there are no maps, and whether they were requested.
    """

    reduction: Reduction
    dark: DarkResult
    light: LightResult
    patterns: FixedPatterns
    base: Sensor | None
    measured: Sequence[Measurements]
    pooled: Measurements
    parameters: Parameters
    by_line: Parameters
    channel_parameters: Mapping[str, Parameters]
    electrical_scale: Mapping[str, Uncertain]
    amplifiers: Mapping[str, Amplifier] = field(default_factory=dict)
    amplifier_gains: AmplifierGains | None = None
    alike: Parameters | None = None
    chip: MeasuredChip | None = None
    temporal: TemporalNoise | None = None
    dark_rate_dn_per_s: NDArray[np.float32] | None = None
    pixel_gains: PixelGains | Missing | None = None
    no_maps: str = "the chip was not mapped; calibrate with maps (--maps)"
    maps_failed: bool = False

    def without_dark_maps(self) -> Evidence:
        """Return the evidence without mean frame and slopes of the dark frames, up to 12 bytes per pixel.

        Only the fixed pattern and the glow need them.
        """
        reduction, dark = replace(self.reduction, reference_mean=None, dark_slopes=None), self.dark
        if dark.mean is not None:
            unknown = ConstantMap(dark.mean.mean.shape, math.nan)
            dark = replace(dark, mean=replace(dark.mean, mean=unknown), slope_map=None)
        return replace(self, reduction=reduction, dark=dark)

    @property
    def channels(self) -> dict[str, Channel]:
        """The channels with their light levels, by name; empty without light frames."""
        return dict(zip(self.reduction.names, self.light.channels, strict=False))

    @cached_property
    def left_out(self) -> LeftOut | None:
        """Defective pixels that all figures are without, and the figures with them; None without such pixels."""
        defects = self.reduction.defects
        return None if defects is None else LeftOut.of(defects, self.parameters)

    @property
    def linear_range(self) -> dict[str, LinearRange]:
        """The linear range of each channel that has one."""
        return {
            name: linear_range(channel)
            for name, channel in self.channels.items()
            if (channel.used & channel.levels.trusted).any()
        }

    @property
    def curves(self) -> dict[str, Mapping[str, Curve]]:
        """The points behind the fits of each channel."""
        lines = zip(self.reduction.names, self.dark.lines, strict=True)
        return {name: channel_curves(dark, self.channels.get(name)) for name, dark in lines}


def collect_evidence(
    reduction: Reduction,
    dark: DarkResult,
    light: LightResult,
    patterns: FixedPatterns,
    sensor: Sensor | None,
    amplifiers: Mapping[str, Amplifier] | None = None,
) -> Evidence:
    """Return the evidence: the results of the stages, with the parameters that follow from them."""
    as_taken = dark
    dark = with_shared_charge(dark, light.noise.shared)
    at_mean_gain = dark
    if (gains := AmplifierGains.of(amplifiers or {})) is not None:
        light, at_mean_gain = gains.light(light), gains.dark(dark)
    found = _contradiction(at_mean_gain, light.gain)
    dark, at_mean_gain = without_mean_slope(dark, found), without_mean_slope(at_mean_gain, found)
    scale, mv_per_dn = _electrical_scale(sensor)
    measured, pooled = _measurements(reduction, at_mean_gain, light, patterns.channels, by_line=False)
    alike = _alike(reduction, as_taken, light, patterns.channels, gains)
    lines = _measurements(reduction, with_standard_lines(dark), light, patterns.channels, by_line=True)[1]
    return Evidence(
        reduction=reduction,
        dark=dark,
        light=light,
        patterns=patterns,
        base=sensor,
        measured=measured,
        pooled=pooled,
        parameters=estimate_parameters(pooled, mv_per_dn),
        by_line=estimate_parameters(lines, mv_per_dn, standard=True),
        channel_parameters={
            name: estimate_parameters(m, mv_per_dn) for name, m in zip(reduction.names, measured, strict=True)
        },
        electrical_scale=scale,
        amplifiers=amplifiers or {},
        amplifier_gains=gains,
        alike=None if alike is None else estimate_parameters(alike, mv_per_dn),
    )


def _alike(
    reduction: Reduction,
    dark: DarkResult,
    light: LightResult,
    patterns: Sequence[FixedPattern],
    gains: AmplifierGains | None,
) -> Measurements | None:
    """Return the measurements as with readout channels that are alike; None where none differ."""
    if not any(pattern.alike for pattern in patterns):
        return None
    channels = tuple(pattern.alike_dark(m) for m, pattern in zip(dark.channels, patterns, strict=True))
    dark = with_shared_charge(replace(dark, channels=channels), light.noise.shared)
    if gains is not None:
        dark = gains.dark(dark)
    dark = without_mean_slope(dark, _contradiction(dark, light.gain))
    return _measurements(reduction, dark, light, [pattern.as_alike() for pattern in patterns], by_line=False)[1]


def _contradiction(dark: DarkResult, gain: Value) -> Contradiction | None:
    exposure_s = np.array([entry.group.exposure_s for entry in dark.groups])
    slopes = dark.pooled.dark_slope, dark.slope_sampling, dark.pooled.dark_variance_slope
    return contradiction(*slopes, gain, exposure_s)


def _measurements(
    reduction: Reduction, dark: DarkResult, light: LightResult, patterns: Sequence[FixedPattern], *, by_line: bool
) -> tuple[list[Measurements], Measurements]:
    """Return the measurements of each channel and of all pooled, at small signal or by the standard's lines."""
    measured = _measure_channels(dark, light, patterns, by_line=by_line)
    gain = light.line_gain if by_line else light.gain
    pooled = pool_channels(reduction.names, measured, dark.pooled, gain, dark.reference_exposure_s)
    coupling = light.noise.coupling if isinstance(light.noise.coupling, Missing) else light.noise.coupling.side
    measured, pooled = [replace(m, coupling=coupling) for m in measured], replace(pooled, coupling=coupling)
    if light.noise.shared is not None and isinstance(why := light.noise.shared.charge, Missing):
        measured, pooled = [m.without_noise(why) for m in measured], pooled.without_noise(why)
    if light.tone is not None:
        why = TONE_CURVE.missing(str(light.tone))
        measured, pooled = [m.without_light(why) for m in measured], pooled.without_light(why)
    return measured, pooled


def _measure_channels(
    dark: DarkResult, light: LightResult, patterns: Sequence[FixedPattern], *, by_line: bool
) -> list[Measurements]:
    found = [(pattern if by_line else pattern.in_electrons()).variances for pattern in patterns]
    measured = [replace(m, **variances) for m, variances in zip(dark.channels, found, strict=True)]
    if light.dark_gain is not None and not by_line:
        measured = [replace(m, gain=light.gain, gain_method=light.dark_gain.method) for m in measured]
    elif not light.channels:
        measured = [replace(m, gain=light.line_gain if by_line else light.gain) for m in measured]
    for k, channel in enumerate(light.channels):
        gain = channel.line_gain if by_line else channel.gain
        responsivity = screen_responsivity(channel.responsivity(by_line=by_line), gain)
        linearity = (channel_linearity(channel),)
        measured[k] = measured[k].with_channel(channel, responsivity, by_line=by_line, linearity=linearity)
    shared = light.noise.shared
    charge = () if shared is None or isinstance(shared.charge, Missing) else shared.charge
    factors = [entry.factor.value for entry in charge] or [1.0] * len(measured)
    measured = [
        m.without_dark_shot_noise(dark.reference_exposure_s).for_sensor(factor)
        for m, factor in zip(measured, factors, strict=True)
    ]
    for m in measured:
        if isinstance(why := m.responsivity, Implausible):
            # All channels received the same light: photons that are implausible for one are so for all.
            return [replace(m, responsivity=why, saturation_responsivity=why, saturation_photons=why) for m in measured]
    return measured


def _electrical_scale(sensor: Sensor | None) -> tuple[dict[str, Uncertain], Value]:
    """Return voltage swing and analog gain, which all values in volts share, and millivolts at the pixel per DN."""
    if sensor is None:
        return {}, NO_SENSOR_FILE.missing(
            "millivolts need the sensor's voltage swing and analog gain; give a sensor file of this sensor"
        )
    values = {name: sensor.measured(name) for name in ("voltage_swing_v", "analog_gain")}
    scale = {name: Uncertain.of(entry.value, entry.standard_uncertainty) for name, entry in values.items()}
    return scale, scale["voltage_swing_v"] / scale["analog_gain"] * (1e3 / (1 << sensor.readout.bits))
