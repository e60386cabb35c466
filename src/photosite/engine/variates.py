"""Random numbers from random words: uniform, normal, Poisson. Each is exact up to the resolution 2^-32 of the words.

All functions are plain arithmetic, with logarithm and exponential from `elementary`. Loops over pixels become vector
instructions, and the results have the same bits on every machine.
"""

from __future__ import annotations

import math

import numpy as np

from photosite.engine.elementary import exp, log
from photosite.engine.jit import compiled
from photosite.engine.philox import philox4x32

_GRAIN = 1.0 / 4294967296.0
SMALL_MEAN = 10.0
"""Poisson counts are drawn by inversion below this mean, by rejection from it on."""
MOST_SMALL = 80
"""Largest count of the inversion; a mean below 10 exceeds it with probability below 1e-40."""
_MOST_COUNT = 2.0**62
"""Largest count, to avoid overflow of 64-bit integers; well capacities are below a millionth of it."""
INVERSE = np.array([0.0] + [1.0 / k for k in range(1, MOST_SMALL + 1)])
_LOG_FACTORIAL = np.array([
    # log k!, k = 0 .. 15, to 17 digits; Stirling's series is as accurate from 16 on
    0.0, 0.0, 0.69314718055994531, 1.7917594692280550, 3.1780538303479456, 4.7874917427820460, 6.5792512120101010,
    8.5251613610654143, 10.604602902745250, 12.801827480081469, 15.104412573075516, 17.502307845873886,
    19.987214495661886, 22.552163853123423, 25.191221182738682, 27.899271383840891,
])  # fmt: skip
_HALF_LOG_2_PI = 0.91893853320467274


@compiled(inline=True)
def uniform(word: np.uint32) -> float:
    """Return a uniform number in (0, 1), symmetric about 1/2: the center of one of 2^32 equal cells."""
    return (float(word) + 0.5) * _GRAIN


@compiled(inline=True)
def uniform_53(w0: np.uint32, w1: np.uint32) -> float:
    """Return a uniform number in (0, 1) from 53 random bits, for inversion of small probabilities."""
    return (float(w0 >> 5) * 67108864.0 + float(w1 >> 6) + 0.5) / 9007199254740992.0


@compiled()
def normal_central(q: float) -> float:
    """Return the normal quantile of 1/2 + q, |q| <= 0.425: Wichura, AS 241 (PPND16), Appl. Statistics 37 (1988) 477."""
    r = 0.180625 - q * q
    num = 2.5090809287301226727e3 * r + 3.3430575583588128105e4
    num = num * r + 6.7265770927008700853e4
    num = num * r + 4.5921953931549871457e4
    num = num * r + 1.3731693765509461125e4
    num = num * r + 1.9715909503065514427e3
    num = num * r + 1.3314166789178437745e2
    num = num * r + 3.3871328727963666080e0
    den = 5.2264952788528545610e3 * r + 2.8729085735721942674e4
    den = den * r + 3.9307895800092710610e4
    den = den * r + 2.1213794301586595867e4
    den = den * r + 5.3941960214247511077e3
    den = den * r + 6.8718700749205790830e2
    den = den * r + 4.2313330701600911252e1
    den = den * r + 1.0
    return q * num / den


@compiled()
def normal_tail(q: float) -> float:
    """Return the normal quantile of 1/2 + q, 0.425 < |q| < 1/2 - 1e-11: AS 241's second range.

    The third range is not needed: the smallest tail of `uniform` is 2^-33.
    """
    r = math.sqrt(-log(0.5 - abs(q))) - 1.6
    num = 7.74545014278341407640e-4 * r + 2.27238449892691845833e-2
    num = num * r + 2.41780725177450611770e-1
    num = num * r + 1.27045825245236838258e0
    num = num * r + 3.64784832476320460504e0
    num = num * r + 5.76949722146069140550e0
    num = num * r + 4.63033784615654529590e0
    num = num * r + 1.42343711074968357734e0
    den = 1.05075007164441684324e-9 * r + 5.47593808499534494600e-4
    den = den * r + 1.51986665636164571966e-2
    den = den * r + 1.48103976427480074590e-1
    den = den * r + 6.89767334985100004550e-1
    den = den * r + 1.67638483018380384940e0
    den = den * r + 2.05319162663775882187e0
    den = den * r + 1.0
    return math.copysign(num / den, q)


@compiled()
def normal(word: np.uint32) -> float:
    """Return a standard normal deviate."""
    q = uniform(word) - 0.5
    return normal_central(q) if abs(q) <= 0.425 else normal_tail(q)


@compiled()
def poisson_small(mean: float, w0: np.uint32, w1: np.uint32) -> int:
    """Return a Poisson count of a mean from 0 to 10, by inversion of the cumulative sum with 53 random bits."""
    p = uniform_53(w0, w1)
    term = exp(-mean)
    total = term
    count = 0
    while p > total and count < MOST_SMALL:
        count += 1
        term *= mean * INVERSE[count]
        total += term
    return count


# Means from 10 on: transformed rejection with squeeze (PTRS; Hoermann, "The transformed rejection method for generating
# Poisson random variables", Insurance: Mathematics and Economics 12 (1993) 39), one function per step.


@compiled(inline=True)
def poisson_candidate(mean: float, w0: np.uint32) -> float:
    """Return the count that a trial proposes; it may be negative."""
    b = 0.931 + 2.53 * math.sqrt(mean)
    a = -0.059 + 0.02483 * b
    u = uniform(w0) - 0.5
    return math.floor(min((2.0 * a / (0.5 - abs(u)) + b) * u + mean + 0.43, _MOST_COUNT))


@compiled(inline=True)
def poisson_squeeze(mean: float, w0: np.uint32, w1: np.uint32) -> bool:
    """Return whether the candidate is accepted at once, as about four of five are."""
    b = 0.931 + 2.53 * math.sqrt(mean)
    us = 0.5 - abs(uniform(w0) - 0.5)
    return (us >= 0.07) & (uniform(w1) <= 0.9277 - 3.6224 / (b - 2.0))


@compiled(inline=True)
def poisson_accept(mean: float, candidate: float, w0: np.uint32, w1: np.uint32) -> bool:
    """Return whether a candidate of 16 or more is accepted by the exact ratio, if the squeeze did not accept it.

    log(v / hat) <= k log(mean) - mean - log k!, with Stirling's series for log k! so that large terms cancel:
    k log(mean / k) + (k - mean) - log(2 pi k) / 2 - 1 / 12k + 1 / 360k^3 - 1 / 1260k^5.
    """
    k = candidate
    log_ratio = log(mean / k)
    inverse = 1.0 / k
    square = inverse * inverse
    stirling = inverse * (1 / 12 - square * (1 / 360 - square * (1 / 1260 - square * (1 / 1680))))
    density = k * log_ratio + (k - mean) - _HALF_LOG_2_PI - 0.5 * log(k) - stirling
    return _accepted(mean, density, w0, w1)


@compiled()
def _accept_below_16(mean: float, candidate: float, w0: np.uint32, w1: np.uint32) -> bool:
    density = candidate * log(mean) - mean - _LOG_FACTORIAL[int(candidate)]
    return _accepted(mean, density, w0, w1)


@compiled(inline=True)
def _accepted(mean: float, log_density: float, w0: np.uint32, w1: np.uint32) -> bool:
    b = 0.931 + 2.53 * math.sqrt(mean)
    a = -0.059 + 0.02483 * b
    us = 0.5 - abs(uniform(w0) - 0.5)
    v = uniform(w1)
    inverse_alpha = 1.1239 + 1.1328 / (b - 3.4)
    possible = (us >= 0.013) | (v <= us)
    return possible & (log(v * inverse_alpha / (a / (us * us) + b)) <= log_density)


@compiled()
def poisson_after(
    mean: float, pixel: np.uint32, frame: np.uint32, source: np.uint32, draw: np.uint32, k0: np.uint32, k1: np.uint32
) -> float:
    """Return the count of the first trial accepted, from this draw on."""
    while True:
        w0, w1, _, _ = philox4x32(pixel, frame, source, draw, k0, k1)
        candidate = poisson_candidate(mean, w0)
        if poisson_squeeze(mean, w0, w1):
            return candidate
        if candidate >= 16.0:
            if poisson_accept(mean, candidate, w0, w1):
                return candidate
        elif candidate >= 0.0 and _accept_below_16(mean, candidate, w0, w1):
            return candidate
        draw += np.uint32(1)


@compiled()
def poisson(mean: float, pixel: np.uint32, frame: np.uint32, source: np.uint32, k0: np.uint32, k1: np.uint32) -> float:
    """Return a Poisson count, exact for every mean from 0 on; a rejected trial uses the counter's next draw."""
    zero = np.uint32(0)
    if mean < SMALL_MEAN:
        w0, w1, _, _ = philox4x32(pixel, frame, source, zero, k0, k1)
        return float(poisson_small(mean, w0, w1))
    return poisson_after(mean, pixel, frame, source, zero, k0, k1)
