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
    """The channels, empty without light frames; photon transfer and system gain (DN/e-) of all of them together."""

    channels: tuple[Channel, ...]
    gain_fit: GainFit | None
    gain: Value


def measure_light_frames(reduction: Reduction, dark: DarkResult) -> LightResult:
    """Analyse the light levels of each channel, and fit the system gain to all of them."""
    if not reduction.lights:
        return LightResult((), None, NO_LIGHT)
    shared, white = Source(), (1 << reduction.frames.bits) - 1
    channels = tuple(Channel.of(k, reduction.lights, lines, white, shared) for k, lines in enumerate(dark.lines))
    fit = fit_gain([channel.levels for channel in channels], [channel.used for channel in channels])
    gain = gain_with_curvature(gain_value(fit), [channel.curvature for channel in channels])
    return LightResult(channels, fit, gain)
