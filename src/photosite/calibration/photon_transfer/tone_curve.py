"""Tone curves: frames whose numbers are not proportional to the light (gamma, logarithm, square-root companding).

A tone curve bends the response and the temporal variance together. Each alone has another cause: wrong exposure times
bend the response only, filtering changes the variance only. Bends of some percent are left to the response curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photosite.calibration.photon_transfer.photon_transfer import LINEAR_SHARE, LightLevels

STRONG = 0.8
"""Exponent of the signal against the light below which the response is that of a tone curve; 1 is straight."""

LEAST_LEVELS, LEAST_RANGE = 3, 2.0
"""Light levels, and ratio of the largest to the smallest light, that an exponent needs."""

STILL_RISING = 0.98
"""Share of the largest signal above which flat fields may all be saturated."""

QUIETER, LEAST_RISE = 6.0, 0.2
"""Standard uncertainties by which half of the flat fields are quieter than the dark frames, and relative rise of their
signal, at which they are not saturated."""

LEAST_STRAIGHT, FALLEN, RISEN = 4, 6.0, 1.1
"""Light levels up to 70 % of the signal at the largest variance that show a bend of the response. With fewer, falling
variances of rising signals are those of a tone curve or of soft saturation: standard uncertainties by which the
variance falls, and ratio of the signals beyond its maximum. Sharp saturation ends at one signal."""

SCATTER = 25.0
"""Chi square per degree of freedom of the variances about a line through the origin that a tone curve exceeds."""


@dataclass(frozen=True)
class ToneCurve:
    """A tone curve as found.

    Parameters
    ----------
    exponent
        Exponent of the signal above dark against the light.
    """

    exponent: float

    def __str__(self) -> str:
        return (
            f"the numbers are not proportional to the light: the signal rises with its power {self.exponent:.2f} and "
            f"the temporal variance not in proportion to the signal, as with a tone curve (gamma, logarithm, "
            f"square-root companding) or soft saturation; calibrate raw numbers, undo the curve with its table "
            f"(--linearize), or take more dim flat fields"
        )


def find_tone_curve(channels: Sequence[LightLevels]) -> ToneCurve | None:
    """Return the tone curve of the frames, None where no channel has a strong one.

    Levels up to 70 % of the largest signal are used, so that saturation does not count as a curve. All are used where
    most flat fields are quieter than the dark frames, as behind a logarithm.
    """
    found = [exponent for levels in channels if (exponent := _exponent(levels)) is not None]
    return ToneCurve(min(found)) if found else None


def _exponent(levels: LightLevels) -> float | None:
    take = levels.repeated & levels.trusted & ~levels.clipped & (levels.x > 0.0) & (levels.signal > 0.0)
    if not take.any():
        return None
    quiet = levels.shot < -QUIETER * np.sqrt(np.diag(levels.shot_covariance))
    lowest, highest = levels.signal[take].min(), levels.signal[take].max()
    rising = take & (levels.signal < STILL_RISING * highest)
    if 2 * quiet[rising].sum() <= rising.sum() or highest < (1.0 + LEAST_RISE) * lowest:
        take &= levels.signal <= LINEAR_SHARE * levels.signal[take].max()
    x, y, v = levels.x[take], levels.signal[take], levels.shot[take]
    if len(np.unique(x)) < LEAST_LEVELS or x.max() < LEAST_RANGE * x.min():
        return None
    log_x = np.log(x) - np.log(x).mean()
    exponent = float(log_x @ np.log(y) / (log_x @ log_x))
    if exponent >= STRONG:
        return exponent if _falls(levels) else None
    weight = 1.0 / np.diag(levels.shot_covariance)[take]
    slope = float((weight * y) @ v / ((weight * y) @ y))
    chi_square = float(weight @ (v - slope * y) ** 2)
    return exponent if slope <= 0.0 or chi_square > SCATTER * (len(y) - 1) else None


def _falls(levels: LightLevels) -> bool:
    """Return whether the variance falls while the signal still rises, and too few levels show the response below."""
    take = levels.repeated & levels.trusted & ~levels.clipped & (levels.signal > 0.0)
    order = np.argsort(levels.signal[take])
    y, v, u = (each[take][order] for each in (levels.signal, levels.shot, np.sqrt(np.diag(levels.shot_covariance))))
    peak = int(v.argmax())
    fallen = y[peak + 1 :][v[peak + 1 :] + FALLEN * np.hypot(u[peak + 1 :], u[peak]) < v[peak]]
    straight = np.count_nonzero(y <= LINEAR_SHARE * y[peak])
    return bool(len(fallen) > 1 and fallen[-1] > RISEN * fallen[0] and straight < LEAST_STRAIGHT)
