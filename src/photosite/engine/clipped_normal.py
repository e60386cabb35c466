"""Mean and variance of digital numbers whose noise is normal, through well, converter and rounding; with derivatives.

    v  = min(X, well) + R          X ~ N(mean, before), R ~ N(0, after), independent
    dn = clip(round(v), 0, white)

All are in digital numbers: X is the collected charge and `before` its variance (shot noise), `after` the variance of
what the well does not limit (read noise). The two limits act together, because in many cameras they coincide.

The part of h = white - v above 0 has first and second moments that follow from the bivariate normal distribution
(S. Rosenbaum, J. R. Stat. Soc. B 23 (1961) 405). The derivative of E[g(X)] is E[g'] by the mean of X, and E[g''] / 2 by
its variance (R. Price, IRE Trans. Inf. Theory 4 (1958) 69), again in closed form. Rounding adds the first terms of the
Euler-Maclaurin formula: 1/12 for numbers that are not clipped, and the density at 0.

The result lacks the part of rounding that is periodic in the mean, at most exp(-2 pi^2 s^2) / pi for a noise of s, and
at the white level the density over 24, 0.017 / s. A limit farther than 9 standard deviations away is ignored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, owens_t

Array = NDArray[np.float64]

ROUNDING_DN2 = 1.0 / 12.0
_FAR = 9.0
"""Standard deviations at which a normal distribution counts as ended; what is beyond is 1e-19."""
_LEAST_DN = 1e-4
"""Least standard deviation of R at the limits, which without it meet in an edge."""
_ROOT_2_PI = math.sqrt(2.0 * math.pi)


@dataclass(frozen=True, eq=False)
class Partials:
    """Derivatives of one moment, arrays of the pixels."""

    mean: Array  # by the mean of X
    before: Array  # by the variance of X
    after: Array  # by the variance of R
    well: Array  # by the well's limit

    def along(self, mean: Array, before: Array, after: Array | float, well: Array | float) -> Array:
        """Return the derivative along a direction."""
        return self.mean * mean + self.before * before + self.after * after + self.well * well


@dataclass(frozen=True, eq=False)
class ClippedMoments:
    """Mean and variance of the digital numbers, and their derivatives."""

    mean: Array
    variance: Array
    of_mean: Partials
    of_variance: Partials


def clipped_moments(
    mean: Array, before: Array, after: Array | float, well: Array | float, white: float
) -> ClippedMoments:
    """Return mean and variance of the digital numbers of pixels, with derivatives.

    - `mean`, `before`: Arrays of one shape: mean and variance of X. The variance is above 0 near the limits.
    - `after`: Variance of R, 0 or above.
    - `well`: The limit of X.
    - `white`: The highest number; above 0.

    Examples
    --------
    >>> even = clipped_moments(np.array([100.0, 4000.0, 9000.0]), np.full(3, 400.0), 1.0, 4000.0, 4095.0)
    >>> even.mean.round(3), even.variance.round(3)
    (array([ 100.   , 3992.021, 4000.   ]), array([401.083, 137.421,   1.083]))
    """
    total = before + after
    reach = _FAR * np.sqrt(total)
    # Mean, variance, four derivatives of the mean, four of the variance
    values = np.zeros((10, *mean.shape))
    values[0], values[1] = mean, total + ROUNDING_DN2
    values[[2, 7, 8]] = 1.0
    near = (before > 0) & ((well - mean < _FAR * np.sqrt(before)) | (white - mean < reach))
    if near.any():
        after, well = (np.broadcast_to(each, mean.shape)[near] for each in (after, well))
        values[:, near] = _below_limits(mean[near], before[near], np.maximum(after, _LEAST_DN**2), well, white)
    dark = (total > 0) & (mean < reach)
    if dark.any():
        values[:, dark] = _above_zero(values[:, dark], mean[dark], total[dark])
    return ClippedMoments(values[0], values[1], Partials(*values[2:6]), Partials(*values[6:]))


def clipped_charge(mean: Array, variance: Array, well: float) -> ClippedMoments:
    """Return mean and variance of min(X, well), X normal, with derivatives.

    Examples
    --------
    >>> kept = clipped_charge(np.array([100.0, 4000.0]), np.full(2, 400.0), 4000.0)
    >>> kept.mean.round(3), kept.variance.round(3)
    (array([ 100.   , 3992.021]), array([400.   , 136.338]))
    """
    values = np.zeros((8, *mean.shape))  # mean, variance, three derivatives each by mean, variance and well
    values[0], values[1] = mean, variance
    values[[2, 6]] = 1.0
    near = well - mean < _FAR * np.sqrt(variance)
    if near.any():
        s = np.sqrt(variance[near])
        a = (well - mean[near]) / s
        below, density = ndtr(a), _density(a)
        h1, h2 = s * (a * below + density), variance[near] * ((a * a + 1.0) * below + a * density)
        by_mean, by_variance, by_well = below, -0.5 * density / s, ndtr(-a)
        # Of the variance of h = (well - X)+, E[h^2] - E[h]^2
        of_variance = -2.0 * h1 * ndtr(-a), below + 2.0 * h1 * by_variance, 2.0 * h1 * by_well
        values[:, near] = well - h1, h2 - h1 * h1, by_mean, by_variance, by_well, *of_variance
    zero = np.zeros_like(mean)
    of_mean, of_variance_2 = (Partials(values[k], values[k + 1], zero, values[k + 2]) for k in (2, 5))
    return ClippedMoments(values[0], values[1], of_mean, of_variance_2)


def _below_limits(mean: Array, before: Array, after: Array, well: Array, white: float) -> Array:
    """Return the (10, n) values after well and white level, in the order of `clipped_moments`."""
    s, r, t = np.sqrt(before), np.sqrt(after), np.sqrt(before + after)
    far = well + (_FAR + 3.0) * r
    # What lies far above the well's limit is never reached; a nearer limit loses no digits.
    limit = np.minimum(white, far)
    a, k, u = (well - mean) / s, (limit - mean) / t, (limit - well) / r
    alpha = (a - s / t * k) * (t / r)
    density_a, density_k, density_u = _density(a), _density(k), _density(u)
    above, below_u, below_alpha = ndtr(-a), ndtr(u), ndtr(alpha)
    both = _bivariate(a, k, s / t, r / t)
    # Moments of (u - z)+, z standard normal; and of h+ over t, and over t^2, where X is below the well's limit
    psi_1, psi_2 = u * below_u + density_u, (u * u + 1.0) * below_u + u * density_u
    first = k * both + density_k * below_alpha + s / t * density_a * below_u
    second = k * first + both + s * r / t**2 * density_a * psi_1
    h1 = above * r * psi_1 + t * first
    h2 = above * after * psi_2 + t**2 * second
    at_well, at_white = density_a / s, density_k * below_alpha / t
    slopes = np.stack(
        [
            both,
            -0.5 * (at_well * below_u + at_white),
            -0.5 * (density_u / r * above + at_white),
            above * below_u,
        ]
    )
    squares = np.stack([-2.0 * t * first, both + at_well * r * psi_1, both + above * below_u, -2.0 * above * r * psi_1])
    of_variance = squares + 2.0 * h1 * slopes
    clipped = white < far  # some numbers are clipped, and not rounded
    rounded = np.where(clipped, both + above * below_u, 1.0)
    bend, cross = k * at_white / t, density_k * _density(alpha) / t**2
    of_rounded = np.stack(
        [
            -at_white,
            -0.5 * (bend - cross * r / s),
            -0.5 * (bend + cross * s / r + above * u * density_u / after),
            -above * density_u / r,
        ]
    )
    of_variance += ROUNDING_DN2 * np.where(clipped, of_rounded, 0.0)
    return np.concatenate([[limit - h1, h2 - h1 * h1 + ROUNDING_DN2 * rounded], slopes, of_variance])


def _above_zero(values: Array, mean: Array, total: Array) -> Array:
    """Return the (10, n) values after the clip at 0."""
    t = np.sqrt(total)
    y = -mean / t
    density, below = _density(y), ndtr(y)
    at_0 = density / t
    l1, l2 = t * (y * below + density), total * ((y * y + 1.0) * below + y * density)

    def by(mean: Array, variance: Array) -> Array:
        return np.stack([mean, variance, variance, np.zeros_like(mean)])

    of_l1, of_l2 = by(-below, 0.5 * at_0), by(-2.0 * l1, below)
    of_below, of_at_0 = by(-at_0, -0.5 * y * at_0 / t), by(y * at_0 / t, 0.5 * (y * y - 1.0) * at_0 / total)
    first, variance, slopes, of_variance = values[0], values[1], values[2:6], values[6:]
    clipped = first + l1
    rounding = clipped * at_0 - below
    of_rounding = (slopes + of_l1) * at_0 + clipped * of_at_0 - of_below
    return np.concatenate(
        [
            [clipped - at_0 / 24.0, variance - l2 - l1 * l1 - 2.0 * first * l1 + ROUNDING_DN2 * rounding],
            slopes + of_l1 - of_at_0 / 24.0,
            of_variance - of_l2 - 2.0 * (clipped * of_l1 + l1 * slopes) + ROUNDING_DN2 * of_rounding,
        ]
    )


def _density(x: Array | float) -> Array:
    return np.asarray(np.exp(-0.5 * np.square(x)) / _ROOT_2_PI)


def _bivariate(a: Array, k: Array, correlation: Array, rest: Array) -> Array:
    """Return P(x < a, z < k) of two standard normal variables (D. B. Owen, Ann. Math. Stat. 27 (1956) 1075).

    `rest` is sqrt(1 - correlation^2), given apart because it may be small.
    """
    tiny = np.finfo(np.float64).tiny
    a, k = (np.where(x == 0, tiny, x) for x in (a, k))
    with np.errstate(over="ignore"):
        from_a, from_k = owens_t(a, (k / a - correlation) / rest), owens_t(k, (a / k - correlation) / rest)
    return np.asarray(0.5 * (ndtr(a) + ndtr(k)) - from_a - from_k - np.where((a < 0) != (k < 0), 0.5, 0.0))
