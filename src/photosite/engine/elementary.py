"""Logarithm and exponential from additions, multiplications and divisions alone.

IEEE arithmetic gives the same bits on every machine; math libraries do not. Both functions compile to vector
instructions. Their error is at most 2 units in the last place.
"""

from __future__ import annotations

from photosite.engine.jit import bits_of_double, compiled, double_of_bits

_LN2_HIGH = 6.93147180369123816490e-01  # 33 bits: its product with an exponent is exact
_LN2_LOW = 1.90821492927058770002e-10
_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD
_LOG2_E = 1.4426950408889634


@compiled()
def log(x: float) -> float:
    """Return the natural logarithm of a normal double above 0.

    x = m 2^e with m between sqrt(1/2) and sqrt(2); log m = 2 artanh((m - 1) / (m + 1)) by its series to the 19th power.
    """
    bits = bits_of_double(x)
    exponent = (bits - _SQRT_HALF_BITS) >> 52
    m = double_of_bits(bits - (exponent << 52))
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
    e = float(exponent)
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
