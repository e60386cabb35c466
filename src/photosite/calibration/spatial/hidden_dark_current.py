"""Dark current that dark frames of one exposure time leave open, in the pattern of flat fields of other times.

The mean current D is between what the dark noise and the means of the flat fields allow
(`Channel.unknown_dark_current`). Its standard deviation over pixels is at most D, for any D equally likely from 0 on.
The current of each pixel is in the dark frames as well, with their exposure time t: the covariance of their pattern
with the slopes of the flat fields, which grow by s seconds per unit of light, is at least var(d) t s. So it limits
var(d), the better the longer the dark frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.without_darks import CONSTANT_S
from photosite.calibration.spatial.nonuniformity import VarianceComponents
from photosite.values.uncertain import COVERAGE_95, Missing, Source, Uncertain

_UNKNOWN_SPREAD = Source()
"""The nonuniformity of this dark current: that of all channels."""


@dataclass(frozen=True)
class HiddenDarkCurrent:
    """Mean over pixels in DN/s, variance over pixels, and exposure time of the dark frames."""

    mean: Uncertain
    variance: Uncertain
    dark_s: float

    def without(self, relative: Uncertain, slope: float, seconds: float) -> Uncertain:
        """Return the relative variance of slopes without it; the slopes contain `seconds` per unit of light."""
        part = seconds / slope
        light = self.mean * -part + 1.0
        return (relative - self.variance * part**2) / (light * light)

    def in_flat(self, parts: VarianceComponents, signal: float, exposure_s: float) -> VarianceComponents:
        """Return the relative variances of a mean flat field, less those of the dark frames, without it.

        The standard's equations do not know it.
        """
        pixels = self.variance * ((exposure_s**2 - self.dark_s**2) / signal**2)
        light = self.mean * ((self.dark_s - exposure_s) / signal) + 1.0
        own = replace(parts, total=parts.total - pixels, pixel=parts.pixel - pixels, standard=None)
        return replace(own.scaled(1.0 / (light * light)), standard=parts.by_standard)


def hidden_dark_current(
    channel: Channel, seconds: float, shared: Uncertain | None
) -> HiddenDarkCurrent | Missing | None:
    """Return the dark current that one dark exposure time leaves open; None where there is none, or it is negligible.

    Parameters
    ----------
    channel, seconds
        The channel, and the exposure time per unit of light in its slopes.
    shared
        Covariance of the slopes with the dark frames over pixels, if it is known.
    """
    current = channel.unknown_dark_current()
    if isinstance(current, Missing):
        times = channel.levels.exposure_s[channel.used & channel.levels.trusted]
        return current if float(times.max() - times.min()) > CONSTANT_S else None
    if current is None:
        return None
    half, dark_s = math.sqrt(3.0) * current.standard_uncertainty, float(channel.dark.mean.exposure_s[0])
    low, high = current.value - half, current.value + half
    # Moments of (c D)^2, with c uniform from 0 to 1, and D from low to high
    square = (high * high + high * low + low * low) / 9.0
    fourth = math.fsum(high**n * low ** (4 - n) for n in range(5)) / 25.0
    value, spread = square, math.sqrt(max(fourth - square**2, 0.0))
    if shared is not None and dark_s * seconds > 0.0:
        most = max(shared.value, 0.0) + COVERAGE_95 * shared.standard_uncertainty
        limit = 0.5 * most / (dark_s * seconds)
        if limit / math.sqrt(3.0) < spread:
            value, spread = limit, limit / math.sqrt(3.0)
    return HiddenDarkCurrent(current, Uncertain.of(value, spread, _UNKNOWN_SPREAD), dark_s)
