"""Curvature of the response, and its effect on system gain and responsivity.

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

from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.photon_transfer.photon_transfer import LightLevels
from photosite.values.uncertain import Missing, Source, Uncertain, Value

LEAST_LEVELS = 5
"""Different light levels in the linear range that the parabola needs."""

BY_CHANCE = 1e-3
"""Share of straight responses that may be reported as curved."""


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
    x, y = levels.x[take], levels.signal[take]
    covariance = levels.signal_covariance[np.ix_(take, take)]
    unit = float(x.max())
    if len(np.unique(np.round(x / unit, 6))) < LEAST_LEVELS:
        return None
    parabola = fit_linear(np.column_stack([x / unit, (x / unit) ** 2]), y, covariance)
    slope, square = (float(value) for value in parabola.parameters)
    uncertainty = float(np.sqrt(parabola.covariance[1, 1]))
    freedom = parabola.degrees_of_freedom if parabola.extra_variance > 0.0 else np.inf
    if slope <= 0.0 or abs(square) < float(stdtrit(freedom, 1.0 - BY_CHANCE / 2.0)) * uncertainty:
        return None
    line = float(fit_linear((x / unit)[:, None], y, covariance).parameters[0])
    shift, in_variance = _gain_shift(levels, take, slope, square, unit)
    return ResponseCurvature(shift, slope / line - 1.0, square / slope / unit if in_variance else 0.0, source)


def _gain_shift(
    levels: LightLevels, take: NDArray[np.bool_], slope: float, square: float, unit: float
) -> tuple[float, bool]:
    """Return the gain at zero light over that of the line, less 1, and whether the variance shows the curvature.

    With y the curved signal and e the electrons, the shot variance is (dy/de)^2 e. Divided by the square of the local
    slope relative to that at zero light, it is proportional to the straight signal, with the gain at zero light as
    factor. Where that fits the variances worse than no curvature, the stated light is the cause (lamp, shutter), which
    does not affect the gain. Both fits use the same weights.
    """
    known = take & levels.repeated
    if not known.any():
        return 0.0, False
    x, y, v = levels.x[known] / unit, levels.signal[known], levels.shot[known]
    weight = 1.0 / np.diag(levels.shot_covariance)[known]
    local2 = (1.0 + 2.0 * square / slope * x) ** 2
    curved = slope * x * local2
    of_line = float((weight * y) @ v / ((weight * y) @ y))
    at_zero_light = float((weight * curved) @ v / ((weight * curved) @ curved))
    chi_square = [float(weight @ (v - expected) ** 2) for expected in (at_zero_light * curved, of_line * y)]
    if chi_square[0] >= chi_square[1]:
        return 0.0, False
    return at_zero_light / of_line - 1.0, True


def gain_with_curvature(gain: Value, curvatures: Sequence[ResponseCurvature | None]) -> Value:
    """Return the gain of all channels with the largest of their curvatures in its uncertainty."""
    known = [curvature for curvature in curvatures if curvature is not None]
    if not known or isinstance(gain, Missing):
        return gain
    worst = max(known, key=lambda curvature: abs(curvature.gain))
    return worst.widen(gain, worst.gain)
