"""From random words to random numbers: uniform, normal, Poisson. Each is exact up to the 2^-32 grain of its words."""

from __future__ import annotations

import math

import numpy as np

from photosite.engine.jit import compiled
from photosite.engine.philox import philox4x32

_GRAIN = 1.0 / 4294967296.0
_SMALL_MEAN = 10.0


@compiled(inline=True)
def uniform(word: np.uint32) -> float:
    """Uniform in (0, 1), symmetric about 1/2: the middle of one of 2^32 equal cells."""
    return (float(word) + 0.5) * _GRAIN


@compiled()
def normal(p: float) -> float:
    """Standard normal quantile of p in (0, 1): Wichura, AS 241 (PPND16), Applied Statistics 37 (1988) 477; 1e-16."""
    q = p - 0.5
    if abs(q) <= 0.425:
        r = 0.180625 - q * q
        num = (
            (
                (
                    (
                        ((2.5090809287301226727e3 * r + 3.3430575583588128105e4) * r + 6.7265770927008700853e4) * r
                        + 4.5921953931549871457e4
                    )
                    * r
                    + 1.3731693765509461125e4
                )
                * r
                + 1.9715909503065514427e3
            )
            * r
            + 1.3314166789178437745e2
        ) * r + 3.3871328727963666080e0
        den = (
            (
                (
                    (
                        ((5.2264952788528545610e3 * r + 2.8729085735721942674e4) * r + 3.9307895800092710610e4) * r
                        + 2.1213794301586595867e4
                    )
                    * r
                    + 5.3941960214247511077e3
                )
                * r
                + 6.8718700749205790830e2
            )
            * r
            + 4.2313330701600911252e1
        ) * r + 1.0
        return q * num / den
    tail = p if q < 0 else 1.0 - p
    r = math.sqrt(-math.log(tail))
    if r <= 5.0:
        r -= 1.6
        num = (
            (
                (
                    (
                        ((7.74545014278341407640e-4 * r + 2.27238449892691845833e-2) * r + 2.41780725177450611770e-1)
                        * r
                        + 1.27045825245236838258e0
                    )
                    * r
                    + 3.64784832476320460504e0
                )
                * r
                + 5.76949722146069140550e0
            )
            * r
            + 4.63033784615654529590e0
        ) * r + 1.42343711074968357734e0
        den = (
            (
                (
                    (
                        ((1.05075007164441684324e-9 * r + 5.47593808499534494600e-4) * r + 1.51986665636164571966e-2)
                        * r
                        + 1.48103976427480074590e-1
                    )
                    * r
                    + 6.89767334985100004550e-1
                )
                * r
                + 1.67638483018380384940e0
            )
            * r
            + 2.05319162663775882187e0
        ) * r + 1.0
    else:
        # Not reached: 2^-33, the smallest p of `uniform`, has r = 4.8.
        return math.nan
    value = num / den
    return -value if q < 0 else value


@compiled()
def poisson(mean: float, pixel: np.uint32, frame: np.uint32, source: np.uint32, k0: np.uint32, k1: np.uint32) -> int:
    """A Poisson count of a mean of 0 or more, exact at every mean.

    Below 10 by inversion of the cumulative sum; above by transformed rejection with squeeze (PTRS; Hoermann, "The
    transformed rejection method for generating Poisson random variables", Insurance: Mathematics and Economics 12
    (1993) 39). Rejected trials take the next draw of the same pixel, frame and source.
    """
    if mean <= 0.0:
        return 0
    w0, w1, _, _ = philox4x32(pixel, frame, source, np.uint32(0), k0, k1)
    if mean < _SMALL_MEAN:
        # 53 bits, so that the cumulative sum is met to double precision.
        p = ((w0 >> 5) * 67108864.0 + (w1 >> 6) + 0.5) / 9007199254740992.0
        count = 0
        term = math.exp(-mean)
        total = term
        while p > total and term > 0.0:
            count += 1
            term *= mean / count
            total += term
        return count
    root = math.sqrt(mean)
    b = 0.931 + 2.53 * root
    a = -0.059 + 0.02483 * b
    inverse_alpha = 1.1239 + 1.1328 / (b - 3.4)
    squeeze = 0.9277 - 3.6224 / (b - 2.0)
    log_mean = math.log(mean)
    draw = np.uint32(0)
    while True:
        u = uniform(w0) - 0.5
        v = uniform(w1)
        us = 0.5 - abs(u)
        count = math.floor((2.0 * a / us + b) * u + mean + 0.43)
        if us >= 0.07 and v <= squeeze:
            return count
        if (
            count >= 0
            and (us >= 0.013 or v <= us)
            and math.log(v) + math.log(inverse_alpha) - math.log(a / (us * us) + b)
            <= count * log_mean - mean - math.lgamma(count + 1.0)
        ):
            return count
        draw += np.uint32(1)
        w0, w1, _, _ = philox4x32(pixel, frame, source, draw, k0, k1)
