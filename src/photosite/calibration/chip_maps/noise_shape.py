"""Deviation of temporal noise from a normal distribution: kurtosis and Tukey lambda shape."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Source, Uncertain

Array = NDArray[np.float64]

QUANTIZATION_FOURTH = -1.0 / 120.0
"""Fourth cumulant of rounding to integers, DN^4: that of a uniform distribution."""

BLOCKS = 16
"""Number of blocks of rows for the jackknife uncertainties."""

NORMAL_SHAPE = 0.13556
"""`tukey_shape` of a normal distribution: the Tukey lambda with the highest correlation."""

_LEAST_SHAPE, _MOST_SHAPE = -0.45, 1.0


@dataclass(frozen=True)
class NoiseShape(Shown):
    """Shape of the distribution of temporal dark noise; normal noise has excess kurtosis 0 and shape `NORMAL_SHAPE`.

    Parameters
    ----------
    excess_kurtosis, within_pixels, between_pixels
        Of the values of all pixels about their own means, and its two contributions: non-normal noise of single pixels,
        and different noise in different pixels, 3 var(variance) / mean(variance)^2.
    tukey_lambda
        Shape parameter of the Tukey lambda distribution that fits the values best. Smaller means heavier tails; 0 is
        the logistic distribution. A shape above 0 has a largest deviation (`tukey_reach`), which values may exceed,
        because the fit follows the middle of the distribution.
    """

    excess_kurtosis: Estimate
    within_pixels: Estimate
    between_pixels: Estimate
    tukey_lambda: Estimate

    @property
    def shape_is_normal(self) -> bool:
        """Whether the 95 % interval of the shape includes `NORMAL_SHAPE`."""
        interval = self.tukey_lambda.interval_95
        return interval is not None and interval[0] <= NORMAL_SHAPE <= interval[1]


def measure_noise_shape(
    variance: NDArray[np.float32], fourth: NDArray[np.float32], frames: int, histogram: NDArray[np.int64], width: float
) -> NoiseShape:
    """Measure the shape of the distribution of a stack's temporal noise.

    Kurtosis: the second and fourth k-statistics of each pixel (Fisher 1930) estimate its cumulants without bias from
    any number of frames. Their means over pixels, corrected for rounding (Sheppard), give both parts. Shape: the
    probability plot correlation coefficient (Filliben, Technometrics 17 (1975) 111), as used in noise models for
    denoising (Wei et al., CVPR 2020). Uncertainties: jackknife over 16 blocks of rows. Subtracting the mean of n frames
    moves the shape towards normal; 2 / n of its distance from normal is added to its uncertainty.

    Parameters
    ----------
    variance, fourth, frames
        (rows, cols) unbiased temporal variance, and sum of the fourth powers of the deviations from the pixel's mean,
        over so many frames.
    histogram, width
        (16, bins) deviations by block of rows, centered on 0; width of a bin, DN.
    """
    method = f"{frames} dark frames, k-statistics over pixels, jackknife over {BLOCKS} blocks of rows"
    if frames < 4:
        why = f"{frames} dark frames at one exposure time; the fourth moment needs at least 4"
        excess = within = between = Estimate(reason=why, method=method)
    else:
        moments = _block_moments(variance, fourth, frames)
        excess, within, between = (_jackknifed(partial(_kurtosis, part), moments, method) for part in range(3))
    shape = _jackknifed(
        lambda counts: tukey_shape(counts, width),
        histogram.astype(np.float64),
        f"{frames} dark frames, probability plot correlation, jackknife over {BLOCKS} blocks of rows",
    )
    if isinstance(found := shape.uncertain, Uncertain):
        drawn = 2.0 / frames * abs(found.value - NORMAL_SHAPE)
        shape = Estimate.of(found + Uncertain.of(0.0, drawn), shape.method)
    return NoiseShape(excess, within, between, shape)


def _block_moments(variance: NDArray[np.float32], fourth: NDArray[np.float32], n: int) -> Array:
    """Return the sums (blocks, 4) over pixels of 1, k2, k4 and an unbiased estimate of the squared variance."""
    rows = variance.shape[0]
    sums = np.zeros((BLOCKS, 4))
    for block in range(BLOCKS):
        part = slice(block * rows // BLOCKS, (block + 1) * rows // BLOCKS)
        k2 = variance[part].astype(np.float64)
        m2, m4 = k2 * (n - 1) / n, fourth[part].astype(np.float64) / n
        k4 = n**2 * ((n + 1) * m4 - 3 * (n - 1) * m2**2) / ((n - 1) * (n - 2) * (n - 3))
        # E k2^2 = s^4 (n + 1) / (n - 1) + kappa4 / n
        squared = (k2**2 - k4 / n) * (n - 1) / (n + 1)
        sums[block] = k2.size, k2.sum(), k4.sum(), squared.sum()
    return sums


def _kurtosis(part: int, sums: Array) -> float:
    """Return the excess kurtosis (part 0), or its part within (1) or between (2) pixels, corrected for rounding."""
    variance, fourth, squared = (float(x) for x in sums[1:] / sums[0])
    exact = variance - QUANTIZATION_DN2
    within = (fourth - QUANTIZATION_FOURTH) / exact**2
    between = 3.0 * ((squared - 2 * QUANTIZATION_DN2 * variance + QUANTIZATION_DN2**2) / exact**2 - 1.0)
    return (within + between, within, between)[part]


def _jackknifed(statistic: Callable[[Array], float], blocks: Array, method: str) -> Estimate:
    """Return a statistic of the sum of the blocks, with its jackknife uncertainty."""
    total = blocks.sum(axis=0)
    filled = blocks[blocks.reshape(len(blocks), -1).any(axis=1)]
    if len(filled) < 2:
        return Estimate(reason="fewer than two rows", method=method)
    left_out = np.array([statistic(total - block) for block in filled])
    k = len(filled)
    uncertainty = float(np.sqrt((k - 1) / k * np.sum((left_out - left_out.mean()) ** 2)))
    return Estimate.of(Uncertain.of(statistic(total), uncertainty, Source.student(k - 1.0)), method)


def tukey_shape(counts: NDArray[np.floating], width: float) -> float:
    """Return the shape of the Tukey lambda distribution with the highest correlation to a histogram.

    The quantile function is Q(p) = (p^lambda - (1 - p)^lambda) / lambda. A bin from p0 to p1 is compared with the mean
    of Q between them, in closed form, so that the bin width does not matter. The (bins,) counts are centered on 0.

    Examples
    --------
    >>> from scipy.special import ndtr
    >>> edges = np.linspace(-8, 8, 257)
    >>> round(tukey_shape(np.diff(ndtr(edges)), 1 / 16), 5) == NORMAL_SHAPE
    True
    >>> abs(tukey_shape(np.diff(1 / (1 + np.exp(-4 * edges))), 1 / 16)) < 2e-3  # logistic
    True
    """
    from scipy.optimize import minimize_scalar

    filled = np.flatnonzero(counts)
    weights = counts[filled] / counts.sum()
    x = (filled + 0.5 - len(counts) / 2) * width
    x = x - weights @ x
    p = np.concatenate([[0.0], np.cumsum(weights)])
    p[-1] = 1.0
    norm = np.sqrt(weights @ x**2)

    def minus_correlation(shape: float) -> float:
        return -float(x @ np.diff(_quantile_integral(p, shape)) / (norm * np.sqrt(_quantile_square(shape))))

    return float(minimize_scalar(minus_correlation, bounds=(_LEAST_SHAPE, _MOST_SHAPE), method="bounded").x)


def tukey_density(shape: float, standard_deviation: float) -> tuple[Array, Array]:
    """Return points and density of a Tukey lambda distribution, for drawing.

    Examples
    --------
    >>> x, density = tukey_density(0.14, 2.0)  # nearly normal
    >>> round(float(np.interp(0.0, x, density) * 2.0 * np.sqrt(2 * np.pi)), 2)
    1.0
    """
    tail = np.geomspace(1e-9, 0.5, 400)
    p = np.concatenate([tail, 1.0 - tail[-2::-1]])
    scale = standard_deviation / np.sqrt(_quantile_square(shape))
    x = np.log(p / (1.0 - p)) if abs(shape) < 1e-6 else (p**shape - (1.0 - p) ** shape) / shape
    return x * scale, 1.0 / (scale * (p ** (shape - 1.0) + (1.0 - p) ** (shape - 1.0)))


def tukey_reach(shape: float, standard_deviation: float) -> float:
    """Return the largest deviation of a Tukey lambda distribution; infinite for a shape of 0 or less.

    Examples
    --------
    >>> round(tukey_reach(NORMAL_SHAPE, 1.0), 2), tukey_reach(-0.1, 1.0)
    (5.05, inf)
    """
    return standard_deviation / (shape * float(np.sqrt(_quantile_square(shape)))) if shape > 0.0 else float("inf")


def _quantile_integral(p: Array, shape: float) -> Array:
    """Return the integral of Q from 0 to p, up to a constant."""
    q = 1.0 - p
    if abs(shape) < 1e-6:
        from scipy.special import xlogy

        return np.asarray(xlogy(p, p) + xlogy(q, q))
    return np.asarray((p ** (shape + 1) + q ** (shape + 1)) / (shape * (shape + 1)))


def _quantile_square(shape: float) -> float:
    """Return the integral of Q^2 from 0 to 1: the variance of the distribution."""
    from scipy.special import beta

    if abs(shape) < 1e-4:
        return float(np.pi**2 / 3)
    return float(2.0 * (1.0 / (2 * shape + 1) - beta(shape + 1, shape + 1)) / shape**2)
