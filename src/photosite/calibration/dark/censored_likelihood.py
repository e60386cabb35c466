"""Black level, read noise and DSNU of dark frames clipped at zero, by maximum likelihood.

A camera without a pedestal clips the lower half of its dark noise, so that the remaining spreads are not those of the
sensor. The model is that of the sensor file: pixel means are normal around the black level (DSNU); a pixel's numbers
are normal around its mean (read noise), rounded to whole numbers, and 0 below 1/2. The likelihood (a Tobit model with
two levels) is largest at the true values, and its curvature there gives their uncertainty (Tobin, Econometrica
26 (1958) 24; Amemiya, J. Econometrics 24 (1984) 3).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from photosite.calibration.withheld import CLIPPED_TOO_FAR
from photosite.engine.frame_sums import FrameSums
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.uncertain import Missing

_NODES, _WEIGHTS = np.polynomial.hermite.hermgauss(24)
_LOG_WEIGHTS = np.log(_WEIGHTS) + _NODES**2


@dataclass(frozen=True)
class ClippedCounts:
    """Exact sufficient statistics of one channel's dark frames under the model.

    A pixel is described by its number of zeros and its sum; the squares do not depend on the pixel's mean. Pixels with
    the same two numbers form a cell.
    """

    frames: int
    zeros: NDArray[np.int64]  # (cells,) number of zeros among a pixel's numbers
    total: NDArray[np.int64]  # (cells,) their sum
    pixels: NDArray[np.int64]  # (cells,) number of pixels
    squares: int  # sum of the squares of all numbers

    @classmethod
    def of(cls, zeros: NDArray[np.integer], total: NDArray[np.integer], frames: int, squares: int) -> ClippedCounts:
        """Return the statistics of two maps, (pixels,) each, and the sum of all squares."""
        base = int(total.max(initial=0)) + 1
        cells, pixels = np.unique(zeros.astype(np.int64) * base + total.astype(np.int64), return_counts=True)
        return cls(frames, cells // base, cells % base, pixels, squares)

    @property
    def zero_fraction(self) -> float:
        """Fraction of all numbers that are 0."""
        return float(self.zeros @ self.pixels) / (self.frames * int(self.pixels.sum()))


_BATCH_FRAMES = 4


def count_clipped(
    frames: Iterable[NDArray[np.unsignedinteger]], shape: tuple[int, int], tile: NDArray[np.int64]
) -> tuple[ClippedCounts, ...]:
    """Return the counts per channel of dark frames, in one pass and in memory independent of their number."""
    numbers, zeros = FrameSums(shape, tile), np.zeros(shape, np.uint16)
    left = iter(frames)
    while batch := list(islice(left, _BATCH_FRAMES)):
        numbers.add(batch)
        for dn in batch:
            np.add(zeros, dn == 0, out=zeros, casting="unsafe")
        del batch, dn  # free their memory before the next batch
    result = []
    for k, totals in enumerate(numbers.label_totals()):
        planes = [np.s_[r :: tile.shape[0], c :: tile.shape[1]] for r, c in np.argwhere(tile == k)]
        zero_map, sum_map = (
            np.concatenate([entry[plane].ravel() for plane in planes]) for entry in (zeros, numbers.sum)
        )
        result.append(ClippedCounts.of(zero_map, sum_map, numbers.count, totals.squares))
    return tuple(result)


@dataclass(frozen=True)
class CensoredDark:
    """Censored fit of one channel; variances in DN^2."""

    pixels: int
    frames: int
    zero_fraction: float  # fraction of the numbers that are 0
    black_level: float  # mean of the dark signal, DN; may be negative
    dsnu_variance: float  # over pixels of their means
    read_variance: float  # of a pixel's numbers about its mean, without rounding
    # (3, 3) of `theta`: the inverse of the information, widened by `misfit` where chance does not explain
    # it, plus the error from rounding (`ROUNDING_ERROR`).
    covariance: NDArray[np.float64]
    misfit: float  # chi square per degree of freedom of the pixels' numbers of zeros against the model
    misfit_is_chance: bool  # whether chance explains it

    @property
    def theta(self) -> NDArray[np.float64]:
        """(3,) black level, DSNU variance and read variance."""
        return np.array([self.black_level, self.dsnu_variance, self.read_variance])


_NEWTON_STEPS = 60


def _expectations(counts: ClippedCounts, theta: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return the log likelihood and its gradient by black level, DSNU variance and read variance.

    A pixel's mean is integrated out by Gauss-Hermite quadrature around the mode of its integrand, which is
    log-concave; the gradient is the expectation over the same weights (Fisher's identity).
    """
    mu, a, b = theta
    r, v = math.sqrt(b), b + QUANTIZATION_DN2
    n0 = counts.zeros[:, None].astype(np.float64)
    n1 = counts.frames - n0
    s = counts.total[:, None].astype(np.float64)

    def censored(m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return z, log P(0), and the density over P(0)."""
        z = (0.5 - m) / r
        log_p = log_ndtr(z)
        return z, log_p, np.exp(-0.5 * z * z - 0.5 * math.log(2.0 * math.pi) - log_p)

    curvature = n1 / v + 1.0 / a
    m = (s / v + mu / a) / curvature
    for _ in range(_NEWTON_STEPS):
        z, _, hazard = censored(m)
        slope = -n0 * hazard / r - (n1 * m - s) / v - (m - mu) / a
        curvature = n0 * hazard * (z + hazard) / b + n1 / v + 1.0 / a
        step = slope / curvature
        m = m + step
        if float(np.abs(step).max()) < 1e-9 * r:
            break
    width = np.sqrt(2.0 / curvature)
    m = m + width * _NODES
    z, log_p, hazard = censored(m)
    n1_part = n1 * m * m - 2.0 * m * s
    exponent = n0 * log_p - n1_part / (2.0 * v) - (m - mu) ** 2 / (2.0 * a) + _LOG_WEIGHTS
    top = exponent.max(axis=1, keepdims=True)
    fraction = np.exp(exponent - top)
    weight_sum = fraction.sum(axis=1, keepdims=True)
    fraction /= weight_sum
    pixels = counts.pixels.astype(np.float64)
    log_cell = (
        (top + np.log(weight_sum) + np.log(width))[:, 0]
        - 0.5 * math.log(2.0 * math.pi * a)
        - 0.5 * n1[:, 0] * math.log(2.0 * math.pi * v)
    )
    likelihood = float(pixels @ log_cell) - counts.squares / (2.0 * v)
    away = m - mu
    gradient = np.array(
        [
            pixels @ (fraction * away).sum(1) / a,
            pixels @ ((fraction * away * away).sum(1) - a) / (2.0 * a * a),
            pixels @ (fraction * (-n0 * hazard * z / (2.0 * b) - n1 / (2.0 * v) + n1_part / (2.0 * v * v))).sum(1)
            + counts.squares / (2.0 * v * v),
        ]
    )
    return likelihood, gradient


def _information(counts: ClippedCounts, theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) observed information: minus the derivative of the gradient, by central differences."""
    total = theta[1] + theta[2]
    # Half of the DSNU variance at most, so that it stays above zero.
    steps = np.array([1e-3 * math.sqrt(total), min(1e-3 * total, 0.5 * theta[1]), 1e-3 * theta[2]])
    matrix = np.column_stack(
        [
            (_expectations(counts, theta - step)[1] - _expectations(counts, theta + step)[1]) / (2.0 * step.max())
            for step in np.diag(steps)
        ]
    )
    return np.asarray(0.5 * (matrix + matrix.T))


def _start(counts: ClippedCounts) -> NDArray[np.float64]:
    """Return a start from the fraction of zeros and the mean of all numbers, for equal DSNU and read noise."""
    pixels = int(counts.pixels.sum())
    samples = counts.frames * pixels
    zeros = min(max(counts.zero_fraction, 0.5 / samples), 1.0 - 0.5 / samples)
    normal = NormalDist()
    z = normal.inv_cdf(1.0 - zeros)
    mean = float(counts.total @ counts.pixels) / samples
    spread = mean / (normal.pdf(z) + z * normal.cdf(z))
    return np.array([z * spread, 0.5 * spread**2, 0.5 * spread**2])


_NO_SPREAD = 1e-4
"""DSNU variance over read variance at which the search ends, where the likelihood grows towards zero DSNU."""


def _maximum(counts: ClippedCounts) -> NDArray[np.float64] | None:
    """Return where the likelihood is largest; None where no maximum was found."""
    from scipy.optimize import minimize

    start = _start(counts)
    scale, samples = math.sqrt(start[1] + start[2]), counts.frames * float(counts.pixels.sum())
    if not scale > 0.0:
        return None

    def theta_of(x: NDArray[np.float64]) -> NDArray[np.float64]:
        b = scale**2 * math.exp(x[2])
        # Not zero: the last Newton step starts from this limit.
        return np.array([scale * x[0], b * (_NO_SPREAD + math.exp(x[1])), b])

    def cost(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        theta = theta_of(x)
        likelihood, slope = _expectations(counts, theta)
        along_a = slope[1] * theta[2] * math.exp(x[1])
        chain = np.array([scale * slope[0], along_a, slope[1] * theta[1] + slope[2] * theta[2]])
        return -likelihood / samples, -chain / samples

    x0 = np.array([start[0] / scale, 0.0, math.log(start[2] / scale**2)])
    bounds = [(x0[0] - 20.0, x0[0] + 20.0), (-16.0, 8.0), (x0[2] - 12.0, x0[2] + 12.0)]
    found = minimize(cost, x0, jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": 1e-14, "gtol": 1e-9})
    theta = theta_of(found.x)
    return theta if np.isfinite(theta).all() else None


LEAST_READ_NOISE = 0.5
"""DN. Below it a rounded normal differs too much from a normal of variance + 1/12 (by exp(-2 pi^2 s^2), 0.7 % here)."""
MOST_UNCERTAIN = 0.25
"""Relative uncertainty of the read noise, or of the total spread, above which the result is withheld."""
ROUNDING_ERROR = 10.0
"""Error of the variances from replacing a rounded normal by a normal of variance v = s^2 + 1/12.

In units of s^2 / (2880 v^2), the leading term of a rounded normal's kurtosis; the error of the mean is half of it in
units of s. The number is the largest over a grid of sensors with a million pixels each."""
LEAST_PIXELS = 100
"""Pixels that must be above zero at least once."""


def fit_censored(counts: ClippedCounts) -> CensoredDark | Missing:
    """Estimate black level, DSNU and read noise of dark frames clipped at zero, by maximum likelihood.

    Where the likelihood grows towards zero DSNU, the result is one Newton step from there: the variance may be
    negative, as everywhere in a calibration. The result is missing where too little is above zero.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> pixel_means = rng.normal(0.0, 2.3, 2000)  # half of all numbers are below zero
    >>> frames = np.maximum(np.rint(rng.normal(pixel_means, 2.2, (20, 2000))), 0).astype(np.int64)
    >>> dark = fit_censored(ClippedCounts.of((frames == 0).sum(0), frames.sum(0), 20, int((frames**2).sum())))
    >>> round(dark.dsnu_variance**0.5, 1), round(dark.read_variance**0.5, 1)
    (2.3, 2.2)
    """
    zeros = f"{100 * counts.zero_fraction:.3g} % of the numbers are 0"
    positive = int(counts.pixels[counts.total > 0].sum())
    if positive < LEAST_PIXELS:
        return CLIPPED_TOO_FAR.missing(f"{zeros}, and only {positive} pixels are ever above 0; too little is left")
    theta = _maximum(counts)
    if theta is None:
        return CLIPPED_TOO_FAR.missing(f"{zeros}, and no noise with a fixed pattern explains the rest")
    try:
        covariance = np.asarray(np.linalg.inv(_information(counts, theta)), np.float64)
    except np.linalg.LinAlgError:
        covariance = np.full((3, 3), -1.0)
    if not (np.isfinite(covariance).all() and (np.diag(covariance) > 0.0).all()):
        return CLIPPED_TOO_FAR.missing(f"{zeros}; the rest does not separate read noise from DSNU")
    theta = theta + covariance @ _expectations(counts, theta)[1]
    mu, a, b = (float(value) for value in theta)
    total = a + b
    total_uncertainty = math.sqrt(covariance[1, 1] + covariance[2, 2] + 2.0 * covariance[1, 2])
    if not (b > 0.0 and total > 0.0):
        return CLIPPED_TOO_FAR.missing(f"{zeros}; the rest shows no read noise")
    if b < LEAST_READ_NOISE**2:
        return CLIPPED_TOO_FAR.missing(
            f"{zeros} and the read noise is near {math.sqrt(b):.2g} DN, below {LEAST_READ_NOISE:g}: rounding and "
            f"clipping together hide it"
        )
    uncertain = max(math.sqrt(covariance[2, 2]) / (2.0 * b), total_uncertainty / (2.0 * total))
    if uncertain > MOST_UNCERTAIN:
        return CLIPPED_TOO_FAR.missing(f"{zeros}; the noise of the rest is known to ±{100 * uncertain:.0f} % only")
    misfit, by_chance = _misfit(counts, mu, max(a, 0.0), b)
    rounding = ROUNDING_ERROR / (2880.0 * (b + QUANTIZATION_DN2) ** 2) * np.array([0.5 * math.sqrt(b), b, b])
    return CensoredDark(
        pixels=int(counts.pixels.sum()),
        frames=counts.frames,
        zero_fraction=counts.zero_fraction,
        black_level=mu,
        dsnu_variance=a,
        read_variance=b,
        covariance=np.asarray(covariance * (1.0 if by_chance else misfit) + np.diag(rounding**2)),
        misfit=misfit,
        misfit_is_chance=by_chance,
    )


MISFIT_P_VALUE = 1e-3
"""Fraction of sensors that follow the model and may be reported not to."""
LEAST_CLASS, MOST_CLASSES = 20.0, 30
"""Least expected pixels in a class of the comparison with the model, and largest number of classes."""


def _misfit(counts: ClippedCounts, mu: float, a: float, b: float) -> tuple[float, bool]:
    """Return chi square per degree of freedom of the pixels' zeros against the model, and whether chance explains it.

    A pixel's number of zeros is binomial given its mean, and the means are normal. Deviations (hot pixels, shading,
    noise with tails) show here.
    """
    from scipy.stats import binom, chi2

    n, pixels = counts.frames, int(counts.pixels.sum())
    t = np.linspace(-8.0, 8.0, 801)
    fraction = np.exp(-0.5 * t * t)
    below = ndtr((0.5 - mu - math.sqrt(a) * t) / math.sqrt(b))
    chances = np.exp(binom.logpmf(np.arange(n + 1)[:, None], n, below))  # binom.pmf overflows at tiny probabilities
    expected = pixels * (chances @ (fraction / fraction.sum()))
    found = np.bincount(counts.zeros, weights=counts.pixels.astype(np.float64), minlength=n + 1)
    # Classes of similar size, each with enough pixels for chi square.
    wanted = max(LEAST_CLASS, pixels / MOST_CLASSES)
    edges = np.unique(np.minimum(np.cumsum(expected) // wanted, pixels // wanted - 1), return_index=True)[1]
    if len(edges) < 2:
        return 0.0, True
    classes = np.add.reduceat(expected, edges)
    chi_square = float((((np.add.reduceat(found, edges) - classes) ** 2) / classes).sum())
    freedom = len(edges) - 1
    return chi_square / freedom, float(chi2.sf(chi_square, freedom)) > MISFIT_P_VALUE
