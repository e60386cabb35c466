"""Stage "light": saturation, linear range and system gain of each channel."""

from __future__ import annotations

from dataclasses import dataclass

from photosite.calibration.dark import DarkResult
from photosite.calibration.measurements import NO_LIGHT
from photosite.calibration.photon_transfer.channel import Channel, gain_with_curvature
from photosite.calibration.photon_transfer.photon_transfer import GainFit, fit_gain, gain_value
from photosite.calibration.reduction.reduce import Reduction
from photosite.values.uncertain import Source, Value


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
    white = (1 << reduction.frames.bits) - 1
    channels = tuple(Channel.of(k, reduction.lights, dark.lines[k], white, shared) for k in range(len(reduction.names)))
    fit = fit_gain([channel.levels for channel in channels], [channel.used for channel in channels])
    gain = gain_with_curvature(gain_value(fit), [channel.curvature for channel in channels])
    return LightResult(channels, fit, gain)
