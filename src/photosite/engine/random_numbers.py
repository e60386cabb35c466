"""Random numbers: Philox4x32-10 words by counter, and uniform, normal and Poisson numbers from them.

A word is a function of a key and a counter, without state: Salmon, Moraes, Dror, Shaw, "Parallel random
numbers: as easy as 1, 2, 3", SC 2011. The key has 64 bits. The counter is four 32-bit words: pixel, frame, use, draw.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import bits_of_double, compiled, double_of_bits

# Uses, the third word of the counter. Each block has four words. These numbers never change: seeds keep their meaning.
EXPOSURE = np.uint32(0)
"""Words 0 and 1: the Poisson trial. Word 2: the read noise."""
FIXED_PATTERN = np.uint32(1)
"""Words 0, 1 and 2: PRNU, DSNU and dark current."""
BLINKING = np.uint32(2)
"""Word 0: the state of a blinking pixel. Word 1: whether it is drawn again."""
LINES = np.uint32(3)
"""Word 0: the deviate of a row. Word 1: that of the column with the same number."""
READ_NOISE = np.uint32(8)
"""Word 0: the read noise of a pixel, as a deviate."""
HOT_PIXELS = np.uint32(9)
"""Word 0: whether a pixel is hot. Word 1: its dark current."""
DEFECTS = np.uint32(10)
"""Word 0: whether a pixel is dead or stuck. Word 1: the number of a stuck one. Series 1 and 2: columns, clusters."""
TELEGRAPH = np.uint32(11)
"""Word 0: whether a pixel blinks. Words 1 and 2: its amplitude, and its fraction of time in the upper level."""
DRIFT = np.uint32(12)
"""Word 0: a step of the black level's drift, whose octave is the pixel; frame 0 is where it starts."""
LINE_PATTERN = np.uint32(13)
"""Words 0 and 1: the fixed offsets of a row and of a column. Word 2: the gain of a column."""
MULTIPLICATION = np.uint32(16)
"""Words 0 and 1: a trial of the gamma number of a multiplied charge. Words 2 and 3: clock-induced charge."""
DATA = np.uint32(32)
"""The choices for an item of a dataset, whose number is the first two words of the counter."""
ADDED_NOISE = np.uint32(33)
"""Words 0 and 1: the key of the noise that is added to frames with noise of their own; the counter is 0."""
CAPTURES = np.uint32(64)
"""Words 0 and 1: the key of a further capture of the same exposure, whose number is the first word of the counter."""

_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint32(0x9E3779B9)
_W1 = np.uint32(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)
_ROUNDS = 10

Words = tuple[np.uint32, np.uint32, np.uint32, np.uint32]

_LN2_HIGH = 6.93147180369123816490e-01  # 33 bits: its product with an exponent is exact
_LN2_LOW = 1.90821492927058770002e-10
_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD
_LOG2_E = 1.4426950408889634

WordArray = NDArray[np.uint32]


@compiled(inline=True)
def philox4x32(c0: np.uint32, c1: np.uint32, c2: np.uint32, c3: np.uint32, k0: np.uint32, k1: np.uint32) -> Words:
    """Return the four random 32-bit words of a counter and a key."""
    for _ in range(_ROUNDS):
        p0 = _M0 * np.uint64(c0)
        p1 = _M1 * np.uint64(c2)
        c0 = np.uint32(p1 >> _32) ^ c1 ^ k0
        c2 = np.uint32(p0 >> _32) ^ c3 ^ k1
        c1 = np.uint32(p1 & _LOW)
        c3 = np.uint32(p0 & _LOW)
        k0 = np.uint32(k0 + _W0)
        k1 = np.uint32(k1 + _W1)
    return c0, c1, c2, c3


def key_from_seed(seed: int) -> tuple[np.uint32, np.uint32]:
    """Return the two key words of a seed from 0 to 2^64 - 1.

    Examples
    --------
    >>> key_from_seed(7)
    (np.uint32(7), np.uint32(0))
    """
    return np.uint32(seed & 0xFFFFFFFF), np.uint32(seed >> 32)


def seed_of_added_noise(seed: int) -> int:
    """Return a seed of noise that is added to a frame, which may have noise drawn with the given seed itself.

    Examples
    --------
    >>> seed_of_added_noise(7) == 7
    False
    """
    zero = np.uint32(0)
    low, high, _, _ = philox4x32(zero, zero, ADDED_NOISE, zero, *key_from_seed(seed))
    return int(low) | int(high) << 32


# Logarithm and exponential from additions, multiplications and divisions alone.
#
# IEEE arithmetic gives the same bits on every machine; math libraries do not. Both functions compile to vector
# instructions. Their error is at most 2 units in the last place.


@compiled(inline=True)
def mantissa(x: float) -> tuple[float, float]:
    """Return m and e of a normal double x = m 2^e above 0, m between sqrt(1/2) and sqrt(2)."""
    bits = bits_of_double(x)
    exponent = (bits - _SQRT_HALF_BITS) >> 52
    return double_of_bits(bits - (exponent << 52)), float(exponent)


@compiled()
def log(x: float) -> float:
    """Return the natural logarithm of a normal double above 0.

    x = m 2^e; log m = 2 artanh((m - 1) / (m + 1)) by its series to the 19th power.
    """
    m, e = mantissa(x)
    s = (m - 1.0) / (m + 1.0)
    t = s * s
    series = 1 / 17 + t * (1 / 19)
    series = 1 / 15 + t * series
    series = 1 / 13 + t * series
    series = 1 / 11 + t * series
    series = 1 / 9 + t * series
    series = 1 / 7 + t * series
    series = 1 / 5 + t * series
    series = t * (1 / 3 + t * series)
    return e * _LN2_HIGH + (2.0 * s + (2.0 * s * series + e * _LN2_LOW))


@compiled()
def exp(x: float) -> float:
    """Return the exponential of a double between -700 and 700.

    x = k ln 2 + r, |r| below 0.35; e^r by its series to the 13th power; times 2^k exactly.
    """
    # Adding 1.5 * 2^52 rounds to an integer, in the low bits.
    shifted = x * _LOG2_E + 6755399441055744.0
    k = shifted - 6755399441055744.0
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    series = 1 / 479001600 + r / 6227020800
    series = 1 / 39916800 + r * series
    series = 1 / 3628800 + r * series
    series = 1 / 362880 + r * series
    series = 1 / 40320 + r * series
    series = 1 / 5040 + r * series
    series = 1 / 720 + r * series
    series = 1 / 120 + r * series
    series = 1 / 24 + r * series
    series = 1 / 6 + r * series
    series = 1 / 2 + r * series
    series = 1.0 + r * (1.0 + r * series)
    return series * double_of_bits((int(k) + 1023) << 52)


# Uniform, normal and Poisson numbers from random words, each exact up to the resolution 2^-32 of the words.
#
# All functions are plain arithmetic, with the logarithm and exponential above. Loops over pixels become vector
# instructions, and the results have the same bits on every machine.


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
def poisson_hat(mean: float) -> tuple[float, float]:
    """Return a and b of the hat, Hoermann's names."""
    b = 0.931 + 2.53 * math.sqrt(mean)
    return -0.059 + 0.02483 * b, b


@compiled(inline=True)
def poisson_place(w0: np.uint32) -> tuple[float, float]:
    """Return u of a trial, between -1/2 and 1/2, and its distance from the nearer end."""
    u = uniform(w0) - 0.5
    return u, 0.5 - abs(u)


@compiled(inline=True)
def poisson_candidate(mean: float, w0: np.uint32) -> float:
    """Return the count that a trial proposes; it may be negative."""
    a, b = poisson_hat(mean)
    u, us = poisson_place(w0)
    return math.floor(min((2.0 * a / us + b) * u + mean + 0.43, _MOST_COUNT))


@compiled(inline=True)
def poisson_squeeze(mean: float, w0: np.uint32, w1: np.uint32) -> bool:
    """Return whether the candidate is accepted at once, as about four of five are."""
    _, b = poisson_hat(mean)
    _, us = poisson_place(w0)
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
    a, b = poisson_hat(mean)
    _, us = poisson_place(w0)
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
        draw = np.uint32(draw + np.uint32(1))


@compiled()
def poisson(mean: float, pixel: np.uint32, frame: np.uint32, source: np.uint32, k0: np.uint32, k1: np.uint32) -> float:
    """Return a Poisson count, exact for every mean from 0 on; a rejected trial uses the counter's next draw."""
    zero = np.uint32(0)
    if mean < SMALL_MEAN:
        w0, w1, _, _ = philox4x32(pixel, frame, source, zero, k0, k1)
        return float(poisson_small(mean, w0, w1))
    return poisson_after(mean, pixel, frame, source, zero, k0, k1)


# Gamma numbers (Marsaglia and Tsang, "A simple method for generating gamma variables", ACM Trans. Math. Software 26
# (2000) 363): d (1 + x / sqrt(9 d))^3 with d = shape - 1/3 and a normal deviate x, accepted by the exact ratio.

_POWER_DRAW = np.uint32(0xFFFFFFFF)
"""The draw whose word 0 is the power of shapes below 1."""


@compiled(inline=True)
def gamma_constants(shape: float) -> tuple[float, float]:
    """Return d, and c = 1 / sqrt(9 d), of a shape of 1 or more."""
    d = shape - 1.0 / 3.0
    return d, math.sqrt(1.0 / (9.0 * d))


@compiled(inline=True)
def gamma_candidate(d: float, c: float, x: float) -> float:
    """Return the number that a trial proposes; it may be negative, and is rejected then."""
    root = 1.0 + x * c
    return d * (root * root * root)


@compiled(inline=True)
def gamma_squeeze(d: float, c: float, x: float, u: float) -> bool:
    """Return whether a candidate is accepted at once, as all but about 5 % / shape are.

    With y = c x, the exact test is log u < d g(y), g(y) = 1.5 y^2 - 3 y - y^3 + 3 log(1 + y) >= -1.28 y^4 from
    y = -1/2 on, and e^z >= 1 + z.
    """
    y = x * c
    square = y * y
    return (y > -0.5) & (u < 1.0 - 1.28 * d * (square * square))


@compiled()
def gamma(shape: float, pixel: np.uint32, frame: np.uint32, source: np.uint32, k0: np.uint32, k1: np.uint32) -> float:
    """Return a gamma number of scale 1, for a shape above 0; a rejected trial uses the counter's next draw."""
    d, c = gamma_constants(shape if shape >= 1.0 else shape + 1.0)
    draw = np.uint32(0)
    value = 0.0
    while True:
        w0, w1, _, _ = philox4x32(pixel, frame, source, draw, k0, k1)
        x, u = normal(w0), uniform(w1)
        value = gamma_candidate(d, c, x)
        if gamma_squeeze(d, c, x, u):
            break
        if value > 0.0:
            cube = value / d
            if log(u) < 0.5 * (x * x) + d * (1.0 - cube + log(cube)):
                break
        draw = np.uint32(draw + np.uint32(1))
    if shape < 1.0:
        w0, _, _, _ = philox4x32(pixel, frame, source, _POWER_DRAW, k0, k1)
        value *= exp(max(log(uniform(w0)) / shape, -690.0))
    return value
