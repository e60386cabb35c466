"""Stage "light": saturation, linear range and system gain of each channel."""

from __future__ import annotations

from dataclasses import dataclass, replace

from photosite.calibration.dark import DarkResult
from photosite.calibration.measurements import NO_LIGHT
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.photon_transfer import GainFit, fit_gain, gain_value
from photosite.calibration.photon_transfer.response_curvature import find_curvature, gain_with_curvature
from photosite.calibration.reduction.reduce import Reduction
from photosite.values.uncertain import Source, Uncertain, Value


@dataclass(frozen=True)
class LightResult:
    """What the light frames show.

    Parameters
    ----------
    channels
        The channels; empty without light frames.
    gain_fit
        Photon transfer of all channels together; None where no level can be used.
    gain
        System gain of all channels together, DN/e-.
    """

    channels: tuple[Channel, ...]
    gain_fit: GainFit | None
    gain: Value


def measure_light_frames(reduction: Reduction, dark: DarkResult) -> LightResult:
    """Analyse the light levels of each channel, and fit the system gain to all of them."""
    if not reduction.lights:
        return LightResult((), None, NO_LIGHT)
    shared = Source()
    channels = tuple(_measure_channel(k, reduction, dark, shared) for k in range(len(reduction.names)))
    fit = fit_gain([channel.levels for channel in channels], [channel.used for channel in channels])
    gain = gain_with_curvature(gain_value(fit), [channel.curvature for channel in channels])
    return LightResult(channels, fit, gain)


def _measure_channel(index: int, reduction: Reduction, dark: DarkResult, shared: Source) -> Channel:
    channel = Channel.of(index, reduction.lights, dark.lines[index], (1 << reduction.frames.bits) - 1)
    curvature, gain = find_curvature(channel.levels, channel.used, shared), channel.gain
    if curvature is not None and isinstance(gain, Uncertain):
        gain = curvature.widen(gain, curvature.gain)
    return replace(channel, gain=gain, curvature=curvature)
