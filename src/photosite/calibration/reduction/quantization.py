"""Uncertainty of a mean and a temporal variance from rounding, beyond the 1/12 DN^2 that is subtracted.

A normal number of mean m and standard deviation s, rounded, has an error e whose moments are known in closed form
(Widrow and Kollar, Quantization Noise, 2008, ch. 4). With c_k = (-1)^k exp(-2 pi^2 k^2 s^2):

    mean of e                               = sum c_k / (pi k) sin(2 pi k m)
    mean of e^2                             = 1/12 + sum c_k / (pi k)^2 cos(2 pi k m)
    covariance with the unrounded number    = s^2 2 sum c_k cos(2 pi k m)

Above 1 DN of noise the sums vanish. At 0.5 DN the variance may be wrong by 0.008 DN^2, at 0.3 DN by most of its value:
too low where the mean is a whole number, too high where it lies between two. Where the means of the pixels differ, the
sums average out.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.values.uncertain import Source, Uncertain

NEGLIGIBLE_FROM = 2.0
"""Variance before rounding, DN^2, above which the sums are below 1e-16."""

GRID_TOLERANCE = 0.005
"""Tolerance, DN^2, within which a variance before rounding explains a measured one: the step of the grid."""

_TERMS = 60

_AXES = np.linspace(0.0, 0.5, 101), np.linspace(0.02, 1.5, 297)
"""Phases and noises of the grid, DN."""

_NOTABLE_GAIN = 1.1
"""Slope of the rounded mean, from 0.4 DN of noise down, above which the pixels' means differ less than measured."""


def rounding_error(
    mean: float | NDArray[np.float64], sd: float | NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the change of the mean, DN, and of the variance beyond 1/12, DN^2, by rounding.

    `mean` and `sd` are those of the normal numbers before rounding, DN; they are broadcast together.
    """
    m, s = np.asarray(mean, np.float64), np.asarray(sd, np.float64)
    shift, square, slope = (np.zeros(np.broadcast_shapes(m.shape, s.shape)) for _ in range(3))
    for k in range(1, _TERMS + 1):
        c = (-1) ** k * np.exp(-2.0 * (math.pi * k * s) ** 2)
        cosine = np.cos(2.0 * math.pi * k * m)
        shift += c / (math.pi * k) * np.sin(2.0 * math.pi * k * m)
        square += c / (math.pi * k) ** 2 * cosine
        slope += 2.0 * c * cosine
    return shift, square - shift**2 + 2.0 * s**2 * slope


@lru_cache(maxsize=1)
def _grid() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the variance before rounding, and the change of mean and variance, for all phases and noises."""
    mean, sd = _AXES[0], _AXES[1][:, None]
    return np.broadcast_to(sd**2, (len(sd), len(mean))), *rounding_error(mean, sd)


@lru_cache(maxsize=1)
def _notable() -> tuple[NDArray[np.float64], ...]:
    """Return the slope of the rounded mean against the mean, and the grid, where the slope is notable."""
    mean, sd = _AXES[0], _AXES[1][:, None]
    slope = np.ones((len(sd), len(mean)))
    for k in range(1, _TERMS + 1):
        slope += 2.0 * (-1) ** k * np.exp(-2.0 * (math.pi * k * sd) ** 2) * np.cos(2.0 * math.pi * k * mean)
    return tuple(each[slope > _NOTABLE_GAIN] for each in (slope, *_grid()))


def remaining_fraction(spatial_variance: float) -> float:
    """Return the fraction of the sums that remains where the pixels' means have a variance, DN^2.

    It is the larger of the fractions for normally and for uniformly distributed means (a shaded field).

    Examples
    --------
    >>> remaining_fraction(0.0), round(remaining_fraction(1.0), 3)
    (1.0, 0.092)
    """
    if spatial_variance <= 0.0:
        return 1.0
    uniform = 1.0 / (math.pi * math.sqrt(12.0 * spatial_variance))
    return min(max(math.exp(-2.0 * math.pi**2 * spatial_variance), uniform), 1.0)


def second_rounding(step: float, variance: float) -> tuple[float, float, float]:
    """Return standard uncertainties from rounding multiples of a step again, to whole digital numbers.

    The error of the second rounding repeats every 1 DN, but the numbers come at multiples of the step, so that its k-th
    term has the frequency f = |k - m / step| nearest to 0. The uncertainties are those of a mean, DN, of a variance
    relative to it, 4 f/k exp(-2 pi^2 f^2 s^2), and of a variance, DN^2, each as for a sine at any phase.

    Examples
    --------
    >>> second_rounding(3.0, 9.0)
    (0.0, 0.0, 0.0)
    >>> [round(value, 3) for value in second_rounding(1.37, 6.0)]
    [0.052, 0.043, 0.007]
    """
    if step == round(step):
        return 0.0, 0.0, 0.0
    k = np.arange(1, _TERMS + 1)
    f = np.abs(k - np.rint(k * step) / step)
    left = np.exp(-2.0 * math.pi**2 * f**2 * max(0.0, variance))  # 0 for NaN, the variance of one frame
    root = math.sqrt(2.0)
    mean_error, relative = (float(np.linalg.norm(terms)) / root for terms in (left / (math.pi * k), 4.0 * f / k * left))
    return mean_error, relative, float((left / (math.pi * k) ** 2).sum()) / root


def rounding_uncertainty(variance: float, uncertainty: float, spatial_variance: float) -> tuple[float, float, float]:
    """Return standard uncertainties from rounding: of a level's mean, its temporal variance, and a pixel's mean, DN.

    It is the largest effect over all noises and phases that explain the measured variance (1/12 included) within its
    uncertainty, divided by sqrt(2), as for a sine at any phase. `spatial_variance` is that of the pixels' means,
    without temporal noise.

    Examples
    --------
    >>> mean_error, variance_error, pixel_error = rounding_uncertainty(0.5**2 + 1 / 12, 1e-4, 0.04)
    >>> round(mean_error, 4), round(variance_error, 4), round(pixel_error, 4)
    (0.0008, 0.0028, 0.0018)
    >>> rounding_uncertainty(4.0, 0.01, 0.0)
    (0.0, 0.0, 0.0)
    """
    analog = variance - 1.0 / 12.0
    if not analog < NEGLIGIBLE_FROM:  # includes NaN, the variance of one frame
        return 0.0, 0.0, 0.0
    left = remaining_fraction(spatial_variance)
    before, mean_error, variance_error = _grid()
    apart = np.abs(before + left * variance_error - analog)
    possible = apart <= max(GRID_TOLERANCE + 2.0 * uncertainty, float(apart.min()))
    mean, wide = (float(np.abs(of[possible]).max()) / math.sqrt(2.0) for of in (mean_error, variance_error))
    return left * mean, left * wide, max(mean, _pixel_error(analog, uncertainty, spatial_variance))


def _pixel_error(analog: float, uncertainty: float, spatial_variance: float) -> float:
    """Return the uncertainty of a pixel's mean where rounding between two whole numbers enlarges the spread of means.

    The spread before rounding is the measured one over the slope of the rounded mean.
    """
    gain, before, mean_error, variance_error = _notable()
    spatial = max(spatial_variance, 1e-9) / gain**2
    left = np.minimum(np.maximum(np.exp(-2.0 * math.pi**2 * spatial), 1.0 / np.sqrt(12.0 * math.pi**2 * spatial)), 1.0)
    possible = np.abs(before + left * variance_error - analog) <= GRID_TOLERANCE + 2.0 * uncertainty
    return float(np.abs(mean_error[possible]).max(initial=0.0)) / math.sqrt(2.0)


def with_rounding(variance: Uncertain, pixel_error: float) -> Uncertain:
    """Return a variance over pixels, DN^2, with the uncertainty from rounding, given that of a pixel's mean, DN.

    The errors of the pixels may be correlated with their means. By the Cauchy-Schwarz inequality they change the
    variance by at most 2 s e + e^2, with s and e the standard deviations of means and errors; divided by sqrt(2) as in
    `rounding_uncertainty`. The interval ends at the largest change.

    Examples
    --------
    >>> round(with_rounding(Uncertain(0.04), 0.0018).standard_uncertainty, 5)  # 0.2 DN at a noise of 0.5 DN: 1.3 %
    0.00051
    """
    spread = math.sqrt(max(variance.value, 0.0))
    root = math.sqrt(2.0)
    return variance + Uncertain.of(0.0, (2.0 * spread + pixel_error) * pixel_error / root, Source(root, root))


def differing_fraction(means: NDArray[np.float64], pixel_error: float) -> float:
    """Return the largest difference of the rounding errors of levels, relative to the largest possible one.

    The error is nearly a sine of the mean with a period of 1 DN, and equal for equal means.

    Examples
    --------
    >>> near, far = np.array([64.0, 64.01]), np.array([64.0, 65.3])
    >>> round(differing_fraction(near, 0.0018), 3), differing_fraction(far, 0.0018)
    (0.047, 1.0)
    """
    return min(math.pi * (float(np.ptp(means)) + 2.0 * math.sqrt(2.0) * pixel_error), 1.0)
