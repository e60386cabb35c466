"""Dark signal and dark variance against exposure, and their values at the exposure of a light level."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.calibration.photon_transfer.fit import Fit, fit_linear
from photosite.calibration.reduction.groups import Level
from photosite.calibration.reduction.quantization import differing_fraction
from photosite.calibration.withheld import ONE_DARK_EXPOSURE, UNKNOWN_DARK_NOISE
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.uncertain import COVERAGE_95, Missing, Uncertain, Value, combined, correlated

Array = NDArray[np.float64]

SCATTER_P_VALUE = 0.001
"""Fraction of ideal measurements whose dark variances may be reported to scatter beyond their sampling."""

EVEN_DARK_NOISE_DN = 0.45
"""Dark noise before rounding from which rounding changes a dark variance by less than 0.02 DN^2 at any mean."""

SAME_EXPOSURE = 1e-6
"""Relative difference up to which two exposure times are equal."""


def same_exposure(exposure_s: ArrayLike, other_s: ArrayLike) -> NDArray[np.bool_]:
    """Return whether exposure times are equal except for rounding."""
    return np.asarray(np.abs(np.subtract(exposure_s, other_s)) <= SAME_EXPOSURE * np.abs(other_s))


def shifts_with_mean(variance: ArrayLike) -> bool:
    """Return whether rounding makes the smallest of some dark variances, DN^2, depend on the mean."""
    return bool(np.min(variance, initial=math.inf) < EVEN_DARK_NOISE_DN**2 + QUANTIZATION_DN2)


@dataclass(frozen=True)
class DarkLine:
    """A quantity of the dark levels against exposure, and the straight line through it.

    Parameters
    ----------
    exposure_s, y, variance, shared
        (m,) exposure time; measured quantity; its sampling variance; standard uncertainty from clipping and rounding,
        which the points share.
    differing
        Fraction of `shared` by which rounding errors of the points may differ.
    fit
        The line; None with one exposure only.
    points
        The quantity with its independent sources, where other results share them; else empty.
    reason
        Why the quantity is unknown, else empty. `y` is then one nominal value, and its uncertainty so large that fits
        to differences from it find a constant of their own.
    """

    exposure_s: Array
    y: Array
    variance: Array
    fit: Fit | None
    shared: Array
    points: tuple[Uncertain, ...] = ()
    differing: float = 0.0
    reason: str = ""

    @classmethod
    def unknown(cls, nominal: float, uncertainty: float, reason: str) -> DarkLine:
        """Return an unknown quantity, constant at all exposures."""
        point = Uncertain.of(nominal, uncertainty)
        one = np.ones(1)
        return cls(0.0 * one, nominal * one, uncertainty**2 * one, None, 0.0 * one, (point,), reason=reason)

    @classmethod
    def through(
        cls,
        exposure_s: Array,
        y: Array,
        variance: Array,
        shared: Array,
        points: Sequence[Uncertain] = (),
        differing: float = 0.0,
        *,
        plain: bool = False,
    ) -> DarkLine:
        """Fit the line, if there are two exposures or more.

        Points with sources are temporal variances, whose uncertainty grows with their value. Their weights come from
        the fitted line, for the reason given in `photon_transfer.fit_gain`. With `plain`, all have equal weights.
        """
        if len(np.unique(exposure_s)) < 2:
            return cls(exposure_s, y, variance, None, shared, tuple(points), differing)
        design, shared_covariance = _design(exposure_s), np.outer(shared, shared)
        fit = fit_linear(design, y, np.diag(variance) + shared_covariance, plain=plain)
        expected = design @ fit.parameters
        if points and (expected > 0.0).all() and (y > 0.0).all():
            variance = variance * (expected / y) ** 2
            fit = fit_linear(design, y, np.diag(variance) + shared_covariance, plain=plain)
        return cls(exposure_s, y, variance, fit, shared, tuple(points), differing)

    @property
    def depends_on_mean(self) -> bool:
        """Whether rounding makes these variances depend on the means of their levels."""
        return not self.reason and shifts_with_mean(self.y)

    @property
    def covariance(self) -> Array:
        """(m, m) covariance of the measured quantity."""
        return np.asarray(np.diag(self.variance) + np.outer(self.shared, self.shared))

    @property
    def line(self) -> tuple[Value, Value]:
        """Intercept, and slope per second."""
        if self.reason:
            return UNKNOWN_DARK_NOISE.missing(self.reason), UNKNOWN_DARK_NOISE.missing(self.reason)
        if self.fit is None:
            reason = f"dark frames at one exposure time only, {self.exposure_s[0]:g} s; a slope needs two or more"
            return ONE_DARK_EXPOSURE.missing(reason), ONE_DARK_EXPOSURE.missing(reason)
        fit = self.fit
        apart = np.abs(fit.estimator) @ self.shared * self.differing  # the largest error that the points do not share
        if not self.points:
            intercept, slope = fit.uncertain
            return intercept + Uncertain.of(0.0, float(apart[0])), slope + Uncertain.of(0.0, float(apart[1]))
        # The part of the covariance that does not come from the points' own sources.
        left = fit.covariance - (fit.estimator * self.variance) @ fit.estimator.T
        freedom = fit.degrees_of_freedom if fit.extra_variance > 0.0 else math.inf
        rest = [
            part + Uncertain.of(0.0, float(more))
            for part, more in zip(correlated(np.zeros(2), left, freedom), apart, strict=True)
        ]
        intercept, slope = (combined(self.points, row) + more for row, more in zip(fit.estimator, rest, strict=True))
        return intercept, slope

    @property
    def sampling(self) -> float:
        """Standard uncertainty of the slope from sampling and what the points share, without scatter about the line."""
        if self.fit is None:
            return math.inf
        weights = self.fit.estimator[1]
        return math.hypot(
            math.sqrt(weights @ self.covariance @ weights), np.abs(weights) @ self.shared * self.differing
        )

    @property
    def repetition(self) -> float:
        """Fraction of a variance of single points that is left in `at_zero`: the sum of its squared weights."""
        weight = _inverse(self.variance) if self.fit is None else self.fit.estimator[0]
        return float(weight @ weight)

    @property
    def at_zero(self) -> Value:
        """The intercept, or the mean where there is one exposure only."""
        intercept, _ = self.line
        if isinstance(intercept, Uncertain) or self.reason:
            return intercept
        weight = _inverse(self.variance)
        if self.points:
            return combined(self.points, weight) + Uncertain.of(0.0, abs(float(weight @ self.shared)))
        return Uncertain.of(float(weight @ self.y), float(np.sqrt(weight @ self.covariance @ weight)))

    @property
    def scatter(self) -> float:
        """Standard deviation of the points about the line beyond sampling, relative to their mean; 0 within chance.

        For dark variances it measures how far the noise is from that of independent frames: interference with a
        constant pattern adds in some combinations of frames and cancels in others.
        """
        from scipy.special import chdtri

        fit = self.fit
        free = 0 if fit is None else fit.degrees_of_freedom
        if fit is None or free == 0 or fit.chi_square <= float(chdtri(free, SCATTER_P_VALUE)):
            return 0.0
        return math.sqrt(fit.extra_variance) / abs(float(self.y.mean()))

    @property
    def charge_uncertainty_dn(self) -> float:
        """Standard uncertainty of the intercept where the points scatter about the line beyond chance, else 0.

        Their exposure times may be wrong then. Few degrees of freedom count by their 95 % interval.
        """
        intercept, _ = self.line
        if self.scatter == 0.0 or isinstance(intercept, Missing):
            return 0.0
        low, high = intercept.interval_95
        return (high - low) / (2.0 * COVERAGE_95)

    def weights_at(self, exposure_s: Array) -> Array:
        """Return (exposures, m) weights: the dark value at each exposure is their product with `y`.

        They select dark frames of the same exposure where there are any (EMVA 1288), else the line.
        """
        weights = np.zeros((len(exposure_s), len(self.exposure_s)))
        for row, t in zip(weights, exposure_s, strict=True):
            same = same_exposure(self.exposure_s, t)
            if same.any():
                row[same] = _inverse(self.variance[same])
            elif self.fit is not None:
                row[:] = _design(np.array([t]))[0] @ self.fit.estimator
            else:
                row[:] = _inverse(self.variance)
        return weights


def _inverse(variance: Array) -> Array:
    """Return weights inversely proportional to the variances, with sum 1."""
    return np.asarray(1.0 / variance / np.sum(1.0 / variance))


def _design(t: Array) -> Array:
    return np.column_stack([np.ones_like(t), t])


@dataclass(frozen=True)
class DarkLines:
    """Dark signal (DN) and dark temporal variance (DN^2) of one channel against exposure."""

    mean: DarkLine
    variance: DarkLine

    @classmethod
    def through_single(cls, exposure_s: Sequence[float], levels: Sequence[Level], variance: DarkLine) -> DarkLines:
        """Return the lines through levels of one frame each, whose temporal variance is unknown.

        The spread over pixels is an upper limit of the noise that is left in a mean.
        """
        spread = np.array([level.spatial_variance for level in levels])
        pixels = np.array([level.pixels for level in levels])
        rounding = max(level.single_rounding for level in levels)
        t, y = np.asarray(exposure_s, dtype=np.float64), np.array([level.mean for level in levels])
        mean = DarkLine.through(
            t, y, np.maximum(spread, QUANTIZATION_DN2) / pixels, np.full(len(t), rounding), differing=1.0
        )
        return cls(mean, variance)

    @classmethod
    def of(
        cls,
        exposure_s: Sequence[float],
        levels: Sequence[Level],
        moved: Array | float = 0.0,
        *,
        plain: bool = False,
    ) -> DarkLines:
        """Return the lines through a channel's dark levels; single frames have a mean only.

        `moved` is the variance of each mean from changes of the black level, DN^2. With `plain`, all levels have equal
        weights.
        """
        t = np.asarray(exposure_s, dtype=np.float64)
        repeated = np.array([level.repeated for level in levels])
        temporal, uncertainty = temporal_variances(t, levels)
        samples = np.array([level.frames * level.pixels for level in levels])
        own = np.array([level.mean_variance for level in levels])
        corrected = np.array([level.shared_mean > 0.0 for level in levels])
        best_known = min((level for level in levels if level.repeated), key=lambda level: level.variance_uncertainty)
        # The same for all: with unequal fractions of one cause the fit would use their difference.
        shown = [level for level in levels if level.repeated] if shifts_with_mean(temporal) else [best_known]
        shared_means, shared_variances = (
            np.array([getattr(level, f"shared_{name}") for level in levels])
            if corrected.any()
            else np.full(len(levels), max(getattr(level, f"rounding_{name}") for level in shown))
            for name in ("mean", "variance")
        )
        y = np.array([level.mean for level in levels])
        differing = (
            0.0
            if corrected.any()
            else differing_fraction(y / best_known.step, best_known.rounding_pixel / best_known.step)
        )
        sampling = np.where(corrected, own, np.maximum(temporal, uncertainty) / samples) + moved
        mean = DarkLine.through(t, y, sampling, shared_means, differing=differing, plain=plain)
        noise = DarkLine.through(
            t[repeated],
            np.array([level.noise.value for level in levels if level.repeated]),
            uncertainty[repeated] ** 2,
            shared_variances[repeated],
            [level.noise for level in levels if level.repeated],
            differing,
            plain=plain,
        )
        return cls(mean, noise)


def temporal_variances(exposure_s: Array, levels: Sequence[Level]) -> tuple[Array, Array]:
    """Return (m,) temporal variance of each dark level and its uncertainty, DN^2.

    A single frame shows no noise and is given that of the repeated dark frames of the nearest exposure.
    """
    variance = np.array([level.variance for level in levels])
    uncertainty = np.array([level.variance_uncertainty for level in levels])
    repeated = np.flatnonzero([level.repeated for level in levels])
    for index, level in enumerate(levels):
        if not level.repeated:
            nearest = repeated[np.argmin(np.abs(exposure_s[repeated] - exposure_s[index]))]
            variance[index], uncertainty[index] = variance[nearest], uncertainty[nearest]
    return variance, uncertainty
