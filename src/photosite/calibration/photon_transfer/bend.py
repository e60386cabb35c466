"""What a response that is not straight does to gain and responsivity, which are slopes of straight lines.

EMVA 1288 fits straight lines through the origin up to 70 % of saturation, and so does this package. Of a converter or
an amplifier that bends by 2 %, the photon transfer's line is off by 3 %: variance goes with the square of the local
slope. Points on a smooth bend scatter little, so their scatter does not tell. Here a parabola is put through the
response; where it is better than the line beyond chance, gain and responsivity at no light are worked out with
it, and the difference becomes part of the uncertainty. The values stay those of the standard.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.photon_transfer.photon_transfer import LightLevels
from photosite.values.uncertain import Missing, Source, Uncertain, Value

if TYPE_CHECKING:
    from photosite.calibration.patterns import Channel

LEAST_LEVELS = 5
"""Different levels in the linear range that a parabola needs to say anything."""

BY_CHANCE = 1e-3
"""Share of straight responses that may be said to bend."""


@dataclass(frozen=True)
class Bend:
    """How far slopes at no light lie above those of the straight lines, relative to these.

    Parameters
    ----------
    gain, responsivity
        (slope at no light) / (slope of the line) - 1.
    curvature
        Of the response x (1 + curvature x), per unit of the light levels' axis;
        0 where it is the stated light that bends.
    source
        What all these, and all channels, share.
    """

    gain: float
    responsivity: float
    curvature: float
    source: Source

    def contrast(self, x: float) -> float:
        """Slope at a light level over its signal per light, less 1: what small differences of light are shown less."""
        return (1.0 + 2.0 * self.curvature * x) / (1.0 + self.curvature * x) - 1.0

    def widen(self, value: Uncertain, relative: float) -> Uncertain:
        """A slope with its bend among its uncertainties."""
        return value if relative == 0.0 else value + Uncertain(0.0, {self.source: relative * value.value})


def find_bend(levels: LightLevels, used: NDArray[np.bool_], source: Source) -> Bend | None:
    """The bend of a channel's response, or None where it is straight as far as can be seen.

    Parameters
    ----------
    levels, used
        The light levels, and which are in the linear range.
    source
        What bends of all channels have in common.
    """
    take = used & (levels.x > 0.0)
    if take.sum() < LEAST_LEVELS:
        return None
    x, y = levels.x[take], levels.signal[take]
    covariance = levels.signal_covariance[np.ix_(take, take)]
    unit = float(x.max())
    if len(np.unique(np.round(x / unit, 6))) < LEAST_LEVELS:
        return None
    parabola = fit_linear(np.column_stack([x / unit, (x / unit) ** 2]), y, covariance)
    slope, bend = (float(value) for value in parabola.parameters)
    uncertainty = float(np.sqrt(parabola.covariance[1, 1]))
    freedom = parabola.degrees_of_freedom if parabola.extra_variance > 0.0 else np.inf
    if slope <= 0.0 or abs(bend) < float(stdtrit(freedom, 1.0 - BY_CHANCE / 2.0)) * uncertainty:
        return None
    line = float(fit_linear((x / unit)[:, None], y, covariance).parameters[0])
    shift, seen = _gain_shift(levels, take, slope, bend, unit)
    return Bend(shift, slope / line - 1.0, bend / slope / unit if seen else 0.0, source)


def _gain_shift(
    levels: LightLevels, take: NDArray[np.bool_], slope: float, bend: float, unit: float
) -> tuple[float, bool]:
    """Gain at no light over that of the line, less 1, both with the same weights; and whether the noise sees the bend.

    With y the bent signal and e the electrons, the shot variance is (dy/de)^2 e. Divided by the square of the local
    slope relative to that at no light, it is in proportion to the straight signal, with the gain at no light as factor.
    Where that fits the variances worse than no bend, it is the stated light that bends (a lamp, a shutter), and the
    gain, which does not know of it, stays.
    """
    there = take & levels.repeated
    if not there.any():
        return 0.0, False
    x, y, v = levels.x[there] / unit, levels.signal[there], levels.shot[there]
    weight = 1.0 / np.diag(levels.shot_covariance)[there]
    local2 = (1.0 + 2.0 * bend / slope * x) ** 2
    bent = slope * x * local2
    of_line = float((weight * y) @ v / ((weight * y) @ y))
    at_no_light = float((weight * bent) @ v / ((weight * bent) @ bent))
    chi_square = [float(weight @ (v - expected) ** 2) for expected in (at_no_light * bent, of_line * y)]
    if chi_square[0] >= chi_square[1]:
        return 0.0, False
    return at_no_light / of_line - 1.0, True


def with_bends(channels: Sequence[Channel]) -> list[Channel]:
    """The channels, each with its bend, and with that in its gain's uncertainty."""
    source = Source()
    result = []
    for channel in channels:
        bend = find_bend(channel.levels, channel.used, source)
        gain = channel.gain
        if bend is not None and isinstance(gain, Uncertain):
            gain = bend.widen(gain, bend.gain)
        result.append(replace(channel, bend=bend, gain=gain))
    return result


def bent_gain(gain: Value, channels: Sequence[Channel]) -> Value:
    """The gain of all channels together with their bends, the largest, in its uncertainty."""
    bends = [channel.bend for channel in channels if channel.bend is not None]
    if not bends or isinstance(gain, Missing):
        return gain
    worst = max(bends, key=lambda bend: abs(bend.gain))
    return worst.widen(gain, worst.gain)


def bend_warning(names: Sequence[str], channels: Sequence[Channel]) -> list[str]:
    """A warning where the response bends enough to be worth knowing: more than the other uncertainties of the gain."""
    for name, channel in zip(names, channels, strict=False):  # darks alone have no channels
        bend, gain = channel.bend, channel.gain
        if bend is None or isinstance(gain, Missing) or abs(bend.gain) < 0.5 * gain.relative:
            continue
        of_channel = f" of channel {name}" if len(names) > 1 else ""
        return [
            f"the response{of_channel} is not straight: at no light the system gain is {100 * bend.gain:+.2g} % and "
            f"the responsivity {100 * bend.responsivity:+.2g} % off the lines that the standard fits; uncertainties "
            f"were widened accordingly"
        ]
    return []
