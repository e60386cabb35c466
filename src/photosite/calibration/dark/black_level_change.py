"""A black level that moves: from dark frame to dark frame, or with the exposure time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.checks.result_screening import Implausible
from photosite.calibration.reduction.groups import GroupStatistics, pooled_level
from photosite.values.diagnostic import DiagnosticKind, one_in
from photosite.values.uncertain import SIGMA_1_IN_10_000, Missing, Uncertain, Value

CHANGE_P_VALUE = 5e-4
"""Fraction of steady black levels that count as shifting, and again as drifting."""

NOTABLE_CHANGE = 0.1
"""Shift or drift, relative to the temporal noise of a pixel, from which a warning is given."""


@dataclass(frozen=True)
class BlackLevelChange:
    """Change of the black level between dark frames, DN; 0 where chance explains it.

    Parameters
    ----------
    shift
        Standard deviation of independent shifts from frame to frame.
    steady, wandering
        Drift over all dark frames together, from the trends within the groups: their sum, and the root of the sum of
        their squares, which is that of trends with random signs.
    noise
        Temporal noise of a pixel, DN.
    """

    shift: float
    steady: float
    wandering: float
    noise: float

    @property
    def drift(self) -> float:
        """Drift over all dark frames together, DN."""
        return max(self.steady, self.wandering)

    def variance(self, frames: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the variance that it adds to the mean of each group, DN^2.

        A drift shifts the groups by amounts that depend on the order of the groups in time, which is not known. A
        steady one is taken as uniform over the whole drift, and one of random signs as a random walk, with the two
        thirds of its variance by which two groups at random times differ from the mean together.
        """
        return self.shift**2 / frames + max(self.steady**2 / 12.0, self.wandering**2 / 1.5)

    def notable(self, size_dn: float) -> bool:
        """Whether a shift or a drift is worth a warning."""
        return size_dn > NOTABLE_CHANGE * self.noise

    def warning(self, what: str) -> str:
        """Return the warning of a black level that moves."""
        return (
            f"the black level {what} over the dark frames; the uncertainties of black level and dark current from the "
            f"mean were widened accordingly, that from the variance is not affected"
        )


_MOVED = ("black_level_dn", "dark_current_dn_per_s", "dark_current_e_per_s", "dark_voltage_mv_per_s")
_WIDENED = (
    "The uncertainties of black level and dark current from the mean were widened; that from the variance is right."
)

SHIFT = DiagnosticKind(
    "black-level-shifts",
    "warning",
    "The means of the dark frames differ from frame to frame beyond their noise.",
    _WIDENED,
    "Let the camera settle; switch its black level clamp off.",
    _MOVED,
    "standard deviation, DN",
    f"below {one_in(2.0 * CHANGE_P_VALUE)} clean sets",
)
DRIFT = DiagnosticKind(
    "black-level-drifts",
    "warning",
    "The means of the dark frames rise or fall steadily within their exposure times.",
    _WIDENED,
    "Let the camera reach its temperature before the first frame.",
    _MOVED,
    "drift over all dark frames, DN",
    f"below {one_in(2.0 * CHANGE_P_VALUE)} clean sets",
)

STEADY = BlackLevelChange(0.0, 0.0, 0.0, 0.0)
"""No change, or none that the frames show."""


def black_level_change(darks: Sequence[GroupStatistics]) -> BlackLevelChange:
    """Return the change of the black level between the dark frames.

    Frame means are compared with the line through those of their group, in the order of the frames. Their scatter
    about the lines, relative to the noise of the pixels, follows a chi-square distribution if only that noise
    contributes, and the ratio of what the slopes explain to that scatter an F distribution if there is no drift.
    """
    from scipy.special import chdtri, fdtri

    scatter = trend = excess = 0.0
    moved: list[float] = []
    freedom = 0
    for entry in darks:
        n, means = entry.frames, np.asarray(entry.frame_means)
        level = pooled_level(entry.levels)
        if n < 2 or (white := level.variance / level.pixels) == 0.0:
            continue
        left = means - means.mean()
        if n > 2:
            steps = np.arange(n) - 0.5 * (n - 1)
            squares = float(steps @ steps)
            slope = float(steps @ left) / squares
            left = left - slope * steps
            trend += slope**2 * squares / white
            moved.append(slope * n)
        own, square = n - 1 - (n > 2), float(left @ left)
        scatter, freedom = scatter + square / white, freedom + own
        excess += square - own * white
    noise = math.sqrt(max(pooled_level(entry.levels).variance for entry in darks if entry.frames > 1))
    if freedom == 0:
        return BlackLevelChange(0.0, 0.0, 0.0, noise)
    shifts = scatter > float(chdtri(freedom, CHANGE_P_VALUE)) and excess > 0.0
    rest = (scatter if shifts else max(scatter, freedom)) / freedom
    trends = len(moved)
    drifts = trends > 0 and trend / trends > float(fdtri(trends, freedom, 1.0 - CHANGE_P_VALUE)) * rest
    steady, wandering = (abs(math.fsum(moved)), math.hypot(*moved)) if drifts else (0.0, 0.0)
    return BlackLevelChange(math.sqrt(excess / freedom) if shifts else 0.0, steady, wandering, noise)


@dataclass(frozen=True)
class Contradiction:
    """Dark currents from the mean and from the variance that contradict each other, e-/s.

    Parameters
    ----------
    from_mean, from_variance
        The two dark currents.
    apart
        Their distance in standard uncertainties.
    moved_dn
        Movement of the black level over the range of dark exposures that would explain it, DN.
    """

    from_mean: Uncertain
    from_variance: Uncertain
    apart: float
    moved_dn: float

    def __str__(self) -> str:
        if self.moved_dn < 0.0:
            cause = (
                "the camera clamps its black level or subtracts a dark frame, its black level falls, or each flat "
                "field is a mean or median of frames and the system gain too small"
            )
        else:
            cause = (
                "the black level rises, the camera filters the noise of long exposures, or each dark frame is a mean "
                "or median of frames"
            )
        return (
            f"the dark current from the mean, {self.from_mean.value:.3g} e-/s, and from the variance, "
            f"{self.from_variance.value:.3g} e-/s, differ by {self.apart:.2g} standard uncertainties, as if the black "
            f"level moved by {self.moved_dn:.2g} DN between the dark exposures: {cause}"
        )

    @property
    def withheld(self) -> Implausible:
        """Why the dark current from the mean is withheld."""
        return Implausible(str(self))


def contradiction(
    slope: Value, sampling: float, variance_slope: Value, gain: Value, exposure_s: NDArray[np.float64]
) -> Contradiction | None:
    """Return the contradiction between the slopes of dark level and dark variance, if any.

    The uncertainty of the mean is that of `sampling`: a scatter of the dark levels about their line, which widens the
    uncertainty of the slope, is itself a sign of a black level that moves.
    """
    if isinstance(slope, Missing) or isinstance(variance_slope, Missing) or isinstance(gain, Missing):
        return None
    from_mean, from_variance = slope / gain, variance_slope / (gain * gain)
    difference = Uncertain.of(slope.value, sampling) / gain - from_variance
    # Not the interval: few exposure times leave few degrees of freedom, but on clean frames the uncertainty is at least
    # that of sampling, which is well known.
    apart = abs(difference.value) / difference.standard_uncertainty
    if apart <= SIGMA_1_IN_10_000:
        return None
    return Contradiction(from_mean, from_variance, apart, difference.value * gain.value * float(np.ptp(exposure_s)))
