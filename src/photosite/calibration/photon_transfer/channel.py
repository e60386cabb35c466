"""One color channel of the light frames: saturation, linear range, gain, and the curvature of its response.

EMVA 1288 fits straight lines through the origin up to 70 % of saturation, and so does this package. For a converter or
amplifier with 2 % curvature the photon transfer line is off by 3 %, because the variance goes with the square of the
local slope. Points on a smooth curve scatter little, so their scatter does not show it. Therefore a parabola is fitted
to the response. Where it fits better than the line beyond chance, gain and responsivity at zero light are computed
with it, and the difference becomes part of the uncertainty. The values stay those of the standard.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from photosite.calibration.photon_transfer.dark_lines import DarkLines
from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.photon_transfer.photon_transfer import (
    LightLevels,
    Saturation,
    find_saturation,
    fit_gain,
    fit_response,
    gain_value,
    light_levels,
    linear_levels,
)
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.values.uncertain import Missing, Source, Uncertain, Value

NO_PHOTONS = Missing("the photons per pixel are not known; give them in a descriptor or a protocol")

LEAST_LEVELS = 5
"""Different light levels in the linear range that the parabola needs."""

BY_CHANCE = 1e-3
"""Share of straight responses that may be reported as curved."""


@dataclass(frozen=True)
class Channel:
    """One color channel of the light frames.

    Parameters
    ----------
    index, dark
        Index of the channel in `channel_names`, and its dark signal and dark variance against exposure time.
    levels, saturation, used
        Its light levels, dark subtracted; where it saturates; (levels,) whether a level lies in the linear range.
    gain
        System gain of this channel alone, DN/e-.
    curvature
        Curvature of its response; None where the response is straight within the noise.
    """

    index: int
    dark: DarkLines
    levels: LightLevels
    saturation: Saturation
    used: NDArray[np.bool_]
    gain: Value
    curvature: ResponseCurvature | None = None

    @classmethod
    def of(
        cls,
        index: int,
        lights: Sequence[GroupStatistics],
        dark: DarkLines,
        white: int,
        curvature_source: Source | None = None,
    ) -> Channel:
        """Analyze the light levels of a channel.

        `white` is the full scale of the converter, DN. The curvature is measured where its source of uncertainty,
        which all channels share, is given.
        """
        levels = light_levels(lights, index, dark)
        saturation = find_saturation(levels, white)
        used = linear_levels(levels, saturation)
        curvature = None if curvature_source is None else find_curvature(levels, used, curvature_source)
        gain = gain_with_curvature(gain_value(fit_gain([levels], [used])), [curvature])
        return cls(index, dark, levels, saturation, used, gain, curvature)

    def responsivity(self) -> Value:
        """Return the responsivity in DN/photon, or the reason why it is missing."""
        if not self.levels.photons_known:
            return NO_PHOTONS
        fit = fit_response(self.levels, self.used)
        return Missing("no light level lies in the linear range") if fit is None else fit.uncertain[0]

    def temporal_variance(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (levels,) temporal variance, the dark's included, DN^2, and the square of its uncertainty."""
        levels, dark = self.levels, self.dark.variance
        weights = dark.weights_at(levels.exposure_s)
        of_dark = np.sum(weights**2 * dark.variance, axis=1)
        # Negative only by rounding.
        return levels.shot + weights @ dark.y, np.maximum(np.diag(levels.shot_covariance) - of_dark, 0.0)


@dataclass(frozen=True)
class ResponseCurvature:
    """How far the slopes at zero light differ from those of the straight lines.

    Parameters
    ----------
    gain, responsivity
        (slope at zero light) / (slope of the line) - 1.
    curvature
        c in the response x (1 + c x), per unit of the light levels' axis; 0 where the stated light is the cause.
    source
        Source of uncertainty shared by gain, responsivity and all channels.
    """

    gain: float
    responsivity: float
    curvature: float
    source: Source

    def contrast(self, x: float) -> float:
        """Return the local slope at a light level over signal / light there, less 1."""
        return (1.0 + 2.0 * self.curvature * x) / (1.0 + self.curvature * x) - 1.0

    def widen(self, value: Uncertain, relative: float) -> Uncertain:
        """Return a slope with a relative difference added to its uncertainty."""
        return value if relative == 0.0 else value + Uncertain(0.0, {self.source: relative * value.value})


def find_curvature(levels: LightLevels, used: NDArray[np.bool_], source: Source) -> ResponseCurvature | None:
    """Return the curvature of a channel's response; None where it is straight within the noise."""
    take = used & (levels.x > 0.0)
    if take.sum() < LEAST_LEVELS:
        return None
    unit = float(levels.x[take].max())
    x, y = levels.x[take] / unit, levels.signal[take]
    if len(np.unique(np.round(x, 6))) < LEAST_LEVELS:
        return None
    covariance = levels.signal_covariance[np.ix_(take, take)]
    parabola = fit_linear(np.column_stack([x, x**2]), y, covariance)
    slope, square = (float(value) for value in parabola.parameters)
    freedom = parabola.degrees_of_freedom if parabola.extra_variance > 0.0 else np.inf
    limit = float(stdtrit(freedom, 1.0 - BY_CHANCE / 2.0)) * float(np.sqrt(parabola.covariance[1, 1]))
    if slope <= 0.0 or abs(square) < limit:
        return None
    line = float(fit_linear(x[:, None], y, covariance).parameters[0])
    shift = _gain_shift(levels, take, slope, square, unit)
    curvature = 0.0 if shift is None else square / slope / unit
    return ResponseCurvature(shift or 0.0, slope / line - 1.0, curvature, source)


def _gain_shift(levels: LightLevels, take: NDArray[np.bool_], slope: float, square: float, unit: float) -> float | None:
    """Return the gain at zero light over that of the line, less 1; None where the variance is that of a straight line.

    With y the curved signal and e the electrons, the shot variance is (dy/de)^2 e. Divided by the square of the local
    slope relative to that at zero light, it is proportional to the straight signal, with the gain at zero light as
    factor. Where that fits the variances worse than no curvature, the stated light is the cause (lamp, shutter), which
    does not affect the gain. Both fits use the same weights.
    """
    known = take & levels.repeated
    if not known.any():
        return None
    x, y, v = levels.x[known] / unit, levels.signal[known], levels.shot[known]
    weight = 1.0 / np.diag(levels.shot_covariance)[known]
    curved = slope * x * (1.0 + 2.0 * square / slope * x) ** 2
    of_line = float((weight * y) @ v / ((weight * y) @ y))
    at_zero_light = float((weight * curved) @ v / ((weight * curved) @ curved))
    misfit_curved, misfit_straight = (
        float(weight @ (v - expected) ** 2) for expected in (at_zero_light * curved, of_line * y)
    )
    return None if misfit_curved >= misfit_straight else at_zero_light / of_line - 1.0


def gain_with_curvature(gain: Value, curvatures: Sequence[ResponseCurvature | None]) -> Value:
    """Return the gain of one or all channels with the largest of their curvatures in its uncertainty."""
    known = [curvature for curvature in curvatures if curvature is not None]
    if not known or isinstance(gain, Missing):
        return gain
    worst = max(known, key=lambda curvature: abs(curvature.gain))
    return worst.widen(gain, worst.gain)


def curvature_warnings(names: Sequence[str], channels: Sequence[Channel]) -> list[str]:
    """Return a warning where the curvature exceeds half of the gain's other uncertainties."""
    for name, channel in zip(names, channels, strict=False):  # no channels without light frames
        curvature, gain = channel.curvature, channel.gain
        if curvature is None or isinstance(gain, Missing) or abs(curvature.gain) < 0.5 * gain.relative:
            continue
        of_channel = f" of channel {name}" if len(names) > 1 else ""
        return [
            f"the response{of_channel} is not straight: at zero light the system gain differs by "
            f"{100 * curvature.gain:+.2g} % and the responsivity by {100 * curvature.responsivity:+.2g} % from the "
            f"standard's straight lines; the uncertainties include this difference"
        ]
    return []
