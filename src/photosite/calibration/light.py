"""Stage "light": saturation, linear range and system gain of each channel."""

from __future__ import annotations

from dataclasses import dataclass, replace

from photosite.calibration.checks.digital_gain import unequal_gains
from photosite.calibration.dark import DarkResult
from photosite.calibration.measurements import NO_LIGHT
from photosite.calibration.noise_structure import NoiseStructure, without_flicker
from photosite.calibration.photon_transfer.channel import Channel, gain_with_curvature
from photosite.calibration.photon_transfer.dark_noise_ratio import find_dark_noise_ratio
from photosite.calibration.photon_transfer.photon_transfer import GainFit, fit_gain, gain_value
from photosite.calibration.photon_transfer.summed_covariance import gain_by_summed_covariance
from photosite.calibration.photon_transfer.tone_curve import ToneCurve, find_tone_curve
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.reduce import Reduction
from photosite.values.uncertain import Missing, Source, Value


@dataclass(frozen=True)
class LightResult:
    """The channels, empty without light frames; photon transfer and system gain (DN/e-) of all of them together.

    `noise` is the structure of the noise, which the gain takes into account; `tone` a tone curve, with which no figure
    of the light holds; `processed` why flats and dark frames do not belong to one mode of the camera.
    """

    channels: tuple[Channel, ...]
    gain_fit: GainFit | None
    gain: Value
    noise: NoiseStructure
    tone: ToneCurve | None = None
    processed: Missing | None = None


def measure_light_frames(
    reduction: Reduction, dark: DarkResult, noise: NoiseStructure, reader: FrameReader
) -> LightResult:
    """Analyze the light levels of each channel, and fit the system gain to all of them."""
    if not reduction.lights:
        return LightResult((), None, NO_LIGHT, noise)
    if noise.flicker is not None:
        reduction, flicker = without_flicker(reduction, reader, dark.mean, noise.flicker)
        noise = replace(noise, flicker=flicker)
    shared = Source()
    channels = tuple(
        Channel.of(k, reduction.lights, lines, reduction.whites[k], shared) for k, lines in enumerate(dark.lines)
    )
    levels, used = [channel.levels for channel in channels], [channel.used for channel in channels]
    if (tone := find_tone_curve(levels)) is not None:
        why = Missing(str(tone))
        return LightResult(tuple(replace(channel, gain=why) for channel in channels), None, why, noise, tone)
    if (ratio := find_dark_noise_ratio(channels)) is not None:
        why = Missing(str(ratio))
        return LightResult(tuple(replace(channel, gain=why) for channel in channels), None, why, noise, processed=why)
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
    gain = unequal_gains(reduction) or gain_with_curvature(gain, [channel.curvature for channel in channels])
    return LightResult(channels, fit, gain, noise)
