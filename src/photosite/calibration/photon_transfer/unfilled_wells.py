"""Charge that is missing in the mean of a level at which nearly all wells are full.

A pixel of the mean mu holds min(X, W) electrons, with the well W and X normal of variance mu: its mean is below W, and
part of its shot noise is left. With the standard deviation s and b = (mu - W) / s, the mean is below by
s (phi(b) - b Q(b)), and the variance that is left is s^2 ((1 + b^2) Q(b) - b phi(b)) less the square of that.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from photosite.values.uncertain import Uncertain

Array = NDArray[np.float64]

SIGNIFICANT = 3.0
"""Standard uncertainties of the variance from which the mean is corrected; below, only its uncertainty grows."""

_EXCESS = np.linspace(-1.0, 8.0, 901)
"""Light beyond the well in standard deviations of noise and pattern together."""

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(41)


def missing_charge(
    variance: float, uncertainty: float, unknown: float, noise: float, pattern: float, gain: float
) -> Uncertain:
    """Return by how much the mean of a level is below that of full wells, DN.

    Parameters
    ----------
    variance, uncertainty
        Temporal variance of the level beyond the read noise, DN^2, and its standard uncertainty.
    unknown
        By how much the variance may be larger, DN^2.
    noise, pattern
        Standard deviations of the shot noise of a full well, and of the means of the pixels without a well, DN.
    gain
        System gain, DN/e-.

    Examples
    --------
    >>> found = missing_charge(4.2, 0.16, 0.0, 39.0, 2.4, 0.63)
    >>> round(found.value, 2), round(found.standard_uncertainty, 3)
    (0.17, 0.007)
    >>> missing_charge(0.1, 0.16, 0.0, 39.0, 2.4, 0.63).value
    0.0
    """
    most = _missing(max(variance, 0.0) + uncertainty + unknown, noise, pattern)
    if variance < SIGNIFICANT * uncertainty:
        return Uncertain.of(0.0, most)
    value = _missing(variance, noise, pattern)
    # The pattern need not be normal; electrons are Poisson, with the skewness gain / noise.
    shape = value - _missing(variance, noise, 0.0), value * gain / noise
    return Uncertain.of(value, math.hypot(most - value, *shape))


def _missing(variance: float, noise: float, pattern: float) -> float:
    """Return the charge of normal noise and a normal pattern that leave this temporal variance."""
    total = math.hypot(noise, pattern)
    excess = (_EXCESS[:, None] * total + pattern * _NODES) / noise
    shown = noise**2 * (_remaining(excess)[0] @ _WEIGHTS) / _WEIGHTS.sum()
    charge = total * _remaining(_EXCESS)[1]
    return float(np.interp(variance, shown[::-1], charge[::-1]))


def _remaining(excess: Array) -> tuple[Array, Array]:
    """Return the variance and the missing mean of min(X, W), in variances and standard deviations of X."""
    b = np.clip(excess, -40.0, 40.0)
    density, tail = np.exp(-0.5 * b**2) / math.sqrt(2.0 * math.pi), ndtr(-b)
    below = density - b * tail
    return (1.0 + b**2) * tail - b * density - below**2, below
