"""Stage "light": saturation, linear range and system gain of each channel."""

from __future__ import annotations

from dataclasses import dataclass, replace

from photosite.calibration.dark import DarkResult
from photosite.calibration.measurements import NO_LIGHT
from photosite.calibration.noise_structure import NoiseStructure, without_flicker
from photosite.calibration.photon_transfer.channel import Channel, gain_with_curvature
from photosite.calibration.photon_transfer.photon_transfer import GainFit, fit_gain, gain_value
from photosite.calibration.photon_transfer.summed_covariance import gain_by_summed_covariance
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.reduce import Reduction
from photosite.values.uncertain import Missing, Source, Value


@dataclass(frozen=True)
class LightResult:
    """The channels, empty without light frames; photon transfer and system gain (DN/e-) of all of them together.

    `noise` is the structure of the noise, which the gain takes into account.
    """

    channels: tuple[Channel, ...]
    gain_fit: GainFit | None
    gain: Value
    noise: NoiseStructure


def measure_light_frames(
    reduction: Reduction, dark: DarkResult, noise: NoiseStructure, reader: FrameReader
) -> LightResult:
    """Analyze the light levels of each channel, and fit the system gain to all of them."""
    if not reduction.lights:
        return LightResult((), None, NO_LIGHT, noise)
    if noise.flicker is not None:
        reduction, flicker = without_flicker(reduction, reader, dark.mean, noise.flicker)
        noise = replace(noise, flicker=flicker)
    shared, white = Source(), (1 << reduction.frames.bits) - 1
    channels = tuple(Channel.of(k, reduction.lights, lines, white, shared) for k, lines in enumerate(dark.lines))
    levels, used = [channel.levels for channel in channels], [channel.used for channel in channels]
    fit = fit_gain(levels, used)
    gain = gain_value(fit)
    charge = None if noise.shared is None else noise.shared.charge
    if isinstance(charge, Missing):
        gain = charge
        channels = tuple(replace(channel, gain=gain) for channel in channels)
    elif charge is not None:
        gain = gain_by_summed_covariance(levels, used, charge)
        channels = tuple(
            replace(channel, gain=gain_with_curvature(own, [channel.curvature]))
            for channel in channels
            for own in [gain_by_summed_covariance([channel.levels], [channel.used], [charge[channel.index]])]
        )
    return LightResult(channels, fit, gain_with_curvature(gain, [channel.curvature for channel in channels]), noise)
